#pragma once

#include <array>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "flight/plan.hpp"
#include "messages/channels.hpp"
#include "messages/plan_blobs.hpp"

/// One example of each message and blob, with another value in each field.
namespace hedgehop::test {

inline constexpr messages::Stamp kExampleStamp{{1'700'000'000'123'456}, 4711, 42};

inline messages::BlobRef example_ref(std::uint64_t n) {
  return {{n, n + 1}, static_cast<std::int64_t>(1000 * n + 7), static_cast<std::int64_t>(5000 * n)};
}

inline messages::MapIndex example_map_index() {
  messages::MapIndex index;
  index.map_hash = {0x0123456789abcdefULL, 0xfedcba9876543210ULL};
  index.patch_number = 3;
  index.geometry = {400000.5, 5400000.25, 30.0, 750, 890};
  index.tile_cells = 128;
  index.reference_height_m = 15.24;
  index.further_heights_m = {30.5, 60.0};
  index.tile_table = example_ref(11);
  index.features = example_ref(22);
  index.threats = messages::ThreatLayers{7, {81, 82}, example_ref(33)};
  index.label = "SYNTHETIC REGION";
  return index;
}

inline messages::MapPatch example_map_patch() {
  messages::MapPatch patch;
  patch.base_map_hash = {1, 2};
  patch.patch_number = 5;
  map::Patch& thing = patch.patch;
  thing.id = 77;
  thing.kind = map::PatchKind::kArea;
  thing.centre = {401000.0, 5401000.0};
  thing.radius_m = 12.0;
  thing.height_m = 35.5;
  thing.top_m = 640.0;
  thing.is_hard = false;
  thing.floor = {120.5, map::AreaLimit::Reference::kAboveGround};
  thing.ceiling = {900.25, map::AreaLimit::Reference::kAmsl};
  thing.outline = {{1.0, 2.0}, {3.0, 4.0}, {5.0, 6.5}};
  thing.label = "crane";
  return patch;
}

inline messages::MapPatchState example_map_patch_state() {
  return {{3, 4}, {5, 6}, 9, 8, 4712, 78, "patch 78: its centre lies outside the map"};
}

inline messages::Chunk example_chunk() {
  messages::Chunk chunk;
  chunk.blob_id = {31, 32};
  chunk.packed_bytes = 2 * messages::kChunkBytes + 3;
  chunk.number = 2;
  chunk.piece = {std::byte{9}, std::byte{0}, std::byte{255}};
  return chunk;
}

inline messages::ChunkRequest example_chunk_request() { return {{{{1, 2}, 3, 4}, {{5, 6}, 7, 8}}}; }

inline flight::PlanRequest example_request() {
  flight::PlanRequest request;
  request.start = {{0.87, 0.2}, 15.5};
  request.goal = {{0.88, 0.21}, std::nullopt};
  request.via = {{{0.871, 0.201}, 30.0}, {{0.872, 0.202}, std::nullopt}};
  request.start_heading_true_rad = 1.25;
  request.speed_mps = 41.0;
  request.seed = 0xF000000000000001ULL;
  request.work_budget = 123456;
  return request;
}

inline messages::PlanRequestMessage example_plan_request() {
  return {{41, 42}, {43, 44}, example_ref(45), example_request()};
}

inline messages::PlanStatus example_plan_status() {
  messages::PlanStatus status;
  status.request_id = {51, 52};
  status.stage = messages::PlanStage::kLocal;
  status.state = messages::PlanState::kNoPlan;
  status.work_units = 1000;
  status.work_budget = 400000;
  status.best_cost_m = 12345.5;
  status.lower_bound_m = 9999.25;
  status.no_plan = flight::NoPlan{flight::NoPlanCause::kLocalPlannerStuck,
                                  geo::MapPoint{401.5, 402.5}, "stuck in a valley"};
  status.text = "stuck in a valley";
  return status;
}

inline messages::RouteHeader example_route_header() {
  return {{61, 62}, {63, 64},  2,     example_ref(65),       31000.5,
          20000.25, 18000.125, 77777, 0x8000000000000007ULL, "hedgehop 0.1.0"};
}

inline messages::TrajectoryHeader example_trajectory_header() {
  return {{71, 72}, {73, 74}, 4, example_ref(75),       example_ref(76), 450.5, 18100.25,
          17.75,    false,    3, "hedgehop 0.1.0 local"};
}

inline command_model::ModelState example_model_state() {
  return {101.5, 102.5, 103.5, 40.5, -2.5, 0.125, -0.25, 0.0625, -0.03125, 1.5, -0.75, 0.375};
}

inline messages::VehicleTarget example_vehicle_target() {
  return {{81, 82}, 7, true, 0.05, example_model_state(), {39.5, 2.75, -1.25}};
}

inline messages::VehicleState example_vehicle_state() {
  return {{91, 92}, 8, true, 0.4, example_model_state(), 3.5, 17.5, {38.5, -1.75, 2.25}};
}

inline messages::LocalHistogram example_local_histogram() {
  messages::LocalHistogram histogram;
  histogram.request_id = {95, 96};
  histogram.step_number = 9;
  histogram.x_m = 201.5;
  histogram.y_m = 202.5;
  histogram.altitude_m = 203.5;
  histogram.heading_math_rad = -1.5;
  histogram.chosen_sector = 2;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  histogram.sectors = {{0.25F, 3.5F, messages::SectorMask::kFree},
                       {0.5F, nan, messages::SectorMask::kClimb},
                       {-0.125F, 4.5F, messages::SectorMask::kTurn},
                       {nan, nan, messages::SectorMask::kUnknown}};
  return histogram;
}

inline messages::ServiceStatus example_service_status() {
  messages::ServiceStatus status;
  status.name = "map_tiler";
  status.host = "host-1";
  status.process_id = 4321;
  status.program_version = "0.1.0";
  status.config_hash = {201, 202};
  status.types_hash = {203, 204};
  status.state = messages::ServiceState::kDegraded;
  status.uptime_s = 12.5;
  status.published_count = 1;
  status.received_count = 2;
  status.rejected_count = 3;
  status.gap_count = 4;
  status.drop_count = 5;
  status.sent_chunk_count = 6;
  status.missing_chunk_count = 7;
  status.text = "tile 3 is missing";
  return status;
}

inline flight::RoutePlan example_route_plan() {
  flight::RoutePlan plan;
  plan.request = example_request();
  plan.config_text = "speed_mps: 40.0\nnested:\n\tx: 1\n";
  plan.map = {{301, 302}, 0, "PROJCS[\"UTM\"]", "EGM96", "SYNTHETIC", {"line one", "line two"}};
  plan.request_id = flight::plan_request_id(plan.request, plan.map.hash, plan.config_text);
  plan.start = {1.5, 2.5, 3.5};
  plan.goal = {4.5, 5.5, 6.5};
  plan.route.waypoints = {{1.5, 2.5, 3.5}, {0.1, 0.2, 0.3}, {4.5, 5.5, 6.5}};
  plan.route.guide = {{1.5, 2.5, 3.5}, {4.5, 5.5, 6.5}};
  plan.route.guide_spacing_m = 50.125;
  plan.route.cost = {1000.1, 2000.2, 3000.3, 4000.4};
  plan.route.lower_bound_m = 999.9;
  plan.route.work_units = 11;
  plan.route.samples = 12;
  plan.route.batches = 13;
  return plan;
}

inline flight::FlightState example_flight_state(double k) {
  flight::FlightState state;
  double* const fields[] = {&state.time_s,
                            &state.x_m,
                            &state.y_m,
                            &state.altitude_m,
                            &state.speed_mps,
                            &state.heading_true_rad,
                            &state.convergence_rad,
                            &state.bank_rad,
                            &state.roll_rate_radps,
                            &state.pitch_rad,
                            &state.pitch_rate_radps,
                            &state.climb_rate_mps,
                            &state.vertical_acceleration_mps2,
                            &state.target_heading_true_rad,
                            &state.commanded_heading_true_rad,
                            &state.commanded_climb_angle_rad,
                            &state.commanded_speed_mps,
                            &state.surface_m,
                            &state.terrain_m};
  double value = k;
  for (double* field : fields) {
    *field = value;
    value += 0.1;
  }
  return state;
}

inline flight::Plan example_plan() {
  flight::Plan plan;
  plan.route_plan = example_route_plan();
  plan.trajectory.step_s = 0.05;
  plan.trajectory.states = {example_flight_state(0.0), example_flight_state(1.7)};
  plan.measures = {501.1, 502.2, 503.3, 504.4, 505.5, 506.6, 507.7, 0.88};
  plan.decisions = 21;
  plan.infeasible_decisions = 22;
  plan.verdict.is_verified = false;
  plan.verdict.violation_count = 23;
  plan.verdict.violations = {{"clearance", 1.1, {1.2, 1.3}, 1.4, 1.5},
                             {"bank", 2.1, {2.2, 2.3}, 2.4, 2.5}};
  plan.verdict.clearance_min_m = 601.1;
  plan.verdict.clearance_min_place = {602.2, 603.3};
  plan.verdict.bank_max_rad = 604.4;
  plan.verdict.roll_rate_max_radps = 605.5;
  plan.verdict.climb_rate_max_mps = 606.6;
  plan.verdict.descent_rate_max_mps = 607.7;
  plan.verdict.speed_min_mps = 608.8;
  plan.verdict.speed_max_mps = 609.9;
  plan.verdict.share_under_ceiling = 0.77;
  plan.verdict.goal_distance_m = 610.1;
  plan.warnings = {"one warning", "another"};
  return plan;
}

/// Channel and bytes of one example of every channel.
inline std::vector<std::pair<std::string, Bytes>> example_of_each_channel() {
  using namespace messages;
  std::vector<std::pair<std::string, Bytes>> examples;
  const auto add = [&]<typename T>(const Channel<T>& channel, const T& content) {
    examples.emplace_back(channel.name, to_message(content, kExampleStamp));
  };
  add(kMapIndexChannel, example_map_index());
  add(kMapPatchChannel, example_map_patch());
  add(kMapPatchStateChannel, example_map_patch_state());
  add(kChunkChannel, example_chunk());
  add(kChunkRequestChannel, example_chunk_request());
  add(kPlanRequestChannel, example_plan_request());
  add(kPlanCancelChannel, PlanCancel{{99, 98}});
  add(kPlanStatusChannel, example_plan_status());
  add(kRouteChannel, example_route_header());
  add(kTrajectoryChannel, example_trajectory_header());
  add(kVehicleTargetChannel, example_vehicle_target());
  add(kVehicleStateChannel, example_vehicle_state());
  add(kLocalHistogramChannel, example_local_histogram());
  add(kServiceStatusChannel, example_service_status());
  return examples;
}

}  // namespace hedgehop::test
