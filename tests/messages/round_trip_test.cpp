#include <cmath>
#include <cstring>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <set>

#include "messages/message_error.hpp"
#include "support/example_messages.hpp"

#include "hedgehop/all_types.hpp"

// Each message is looked at twice: through the generated type, which is what other programs see,
// and through from_message(). A pair of fields that is swapped on both ways fails the first look.

namespace hedgehop::messages {
namespace {

using test::kExampleStamp;

template <typename Wire>
Wire wire_of(const Bytes& bytes) {
  Wire wire{};
  EXPECT_EQ(wire.decode(bytes.data(), 0, static_cast<int>(bytes.size())),
            static_cast<int>(bytes.size()));
  return wire;
}

template <typename Wire, typename T>
struct Trip {
  explicit Trip(const T& sent_in) : sent(sent_in) {
    const Bytes bytes = to_message(sent, kExampleStamp);
    EXPECT_LE(bytes.size(), kMaxMessageBytes);
    wire = wire_of<Wire>(bytes);
    Stamp stamp;
    back = from_message<T>(bytes, stamp);
    EXPECT_EQ(stamp, kExampleStamp);
    EXPECT_EQ(wire.utime, kExampleStamp.time.utime_us);
    EXPECT_EQ(wire.sender_id, kExampleStamp.sender_id);
    EXPECT_EQ(wire.seq, kExampleStamp.seq);
    EXPECT_EQ(wire.version, Wire::VERSION);
  }
  const T sent;
  Wire wire{};
  T back;
};

#define SAME(wire_member, member)                       \
  do {                                                  \
    EXPECT_EQ(trip.wire.wire_member, trip.sent.member); \
    EXPECT_EQ(trip.back.member, trip.sent.member);      \
  } while (false)
#define SAME_HASH(wire_member, member)                                                      \
  do {                                                                                      \
    EXPECT_EQ(static_cast<std::uint64_t>(trip.wire.wire_member[0]), trip.sent.member.high); \
    EXPECT_EQ(static_cast<std::uint64_t>(trip.wire.wire_member[1]), trip.sent.member.low);  \
    EXPECT_EQ(trip.back.member, trip.sent.member);                                          \
  } while (false)
#define SAME_REF(wire_member, member)                                             \
  do {                                                                            \
    SAME_HASH(wire_member.blob_id, member.id);                                    \
    SAME(wire_member.packed_bytes, member.packed_bytes);                          \
    SAME(wire_member.content_bytes, member.content_bytes);                        \
    EXPECT_EQ(trip.wire.wire_member.chunk_count, trip.sent.member.chunk_count()); \
  } while (false)
#define SAME_OPTIONAL(wire_member, member)               \
  do {                                                   \
    EXPECT_EQ(trip.wire.wire_member, *trip.sent.member); \
    EXPECT_EQ(trip.back.member, trip.sent.member);       \
  } while (false)
#define SAME_ENUM(wire_member, member)                                    \
  do {                                                                    \
    EXPECT_EQ(trip.wire.wire_member, static_cast<int>(trip.sent.member)); \
    EXPECT_EQ(trip.back.member, trip.sent.member);                        \
  } while (false)

TEST(RoundTrip, MapIndexKeepsEachFieldUnderItsName) {
  const Trip<map_index_v2_t, MapIndex> trip(test::example_map_index());
  SAME_HASH(map_hash, map_hash);
  SAME(patch_number, patch_number);
  SAME(west_m, geometry.west_m);
  SAME(south_m, geometry.south_m);
  SAME(cell_m, geometry.cell_m);
  SAME(column_count, geometry.columns);
  SAME(row_count, geometry.rows);
  SAME(tile_cell_count, tile_cells);
  SAME(reference_height_m, reference_height_m);
  SAME_REF(tile_table, tile_table);
  SAME_REF(features, features);
  SAME(threat_count, threats->count);
  SAME_HASH(threats_map_hash, threats->map_hash);
  SAME_REF(threats, threats->table);
  SAME(label, label);
  EXPECT_THAT(trip.wire.layers, testing::ElementsAre(0, 1, 2, 3, 4, 4));
  EXPECT_EQ(trip.wire.layer_height_m[3], trip.sent.reference_height_m);
  SAME(layer_height_m[4], further_heights_m[0]);
  SAME(layer_height_m[5], further_heights_m[1]);
}

TEST(RoundTrip, AMapIndexWithoutNamedObserversSaysThatThereAreNone) {
  MapIndex index = test::example_map_index();
  index.threats.reset();
  const Trip<map_index_v2_t, MapIndex> trip(index);
  EXPECT_EQ(trip.wire.threat_count, 0);
  EXPECT_EQ(trip.back, index);
  EXPECT_EQ(index.hash_for(true), index.map_hash);
  EXPECT_FALSE(index.offers({81, 82}));
  const MapIndex with = test::example_map_index();
  EXPECT_EQ(with.hash_for(true), (Hash128{81, 82}));
  EXPECT_EQ(with.hash_for(false), index.map_hash);
  EXPECT_TRUE(with.offers({81, 82}) && with.offers(index.map_hash));
  EXPECT_FALSE(with.offers({81, 83}));
}

TEST(RoundTrip, AMapIndexOfTheFirstFormIsStillReadAndHasNoNamedObservers) {
  map_index_t wire{};
  wire.utime = 7;
  wire.sender_id = 8;
  wire.seq = 9;
  wire.version = map_index_t::VERSION;
  wire.map_hash[0] = 1;
  wire.map_hash[1] = 2;
  wire.patch_number = 3;
  wire.cell_m = 30.0;
  wire.column_count = 75;
  wire.row_count = 89;
  wire.tile_cell_count = 64;
  wire.reference_height_m = 15.24;
  wire.num_layers = 4;
  wire.layers = {0, 1, 2, 3};
  wire.layer_height_m = {0.0, 0.0, 0.0, 15.24};
  for (blob_ref_t* ref : {&wire.tile_table, &wire.features}) {
    ref->packed_bytes = 10;
    ref->chunk_count = 1;
  }
  wire.label = "old";
  Bytes bytes(static_cast<std::size_t>(wire.getEncodedSize()));
  ASSERT_GT(wire.encode(bytes.data(), 0, static_cast<int>(bytes.size())), 0);
  Stamp stamp;
  const auto back = from_message<MapIndex>(bytes, stamp);
  EXPECT_EQ(stamp, (Stamp{{7}, 8, 9}));
  EXPECT_EQ(back.map_hash, (Hash128{1, 2}));
  EXPECT_EQ(back.patch_number, 3);
  EXPECT_EQ(back.geometry.rows, 89);
  EXPECT_EQ(back.label, "old");
  EXPECT_FALSE(back.threats.has_value());
}

TEST(RoundTrip, MapPatchKeepsEachFieldUnderItsName) {
  const Trip<map_patch_v2_t, MapPatch> trip(test::example_map_patch());
  SAME_HASH(base_map_hash, base_map_hash);
  SAME(patch_number, patch_number);
  SAME(is_present, is_present);
  SAME(patch_id, patch.id);
  SAME_ENUM(kind, patch.kind);
  SAME(x_m, patch.centre.x_m);
  SAME(y_m, patch.centre.y_m);
  SAME(radius_m, patch.radius_m);
  SAME_OPTIONAL(height_m, patch.height_m);
  SAME_OPTIONAL(top_altitude_m, patch.top_m);
  SAME(is_hard, patch.is_hard);
  SAME(floor_m, patch.floor.value_m);
  EXPECT_EQ(trip.wire.floor_is_above_ground, 1);
  SAME(ceiling_m, patch.ceiling.value_m);
  EXPECT_EQ(trip.wire.ceiling_is_above_ground, 0);
  EXPECT_EQ(trip.back.patch.floor, trip.sent.patch.floor);
  EXPECT_EQ(trip.back.patch.ceiling, trip.sent.patch.ceiling);
  SAME(label, patch.label);
  ASSERT_EQ(trip.back.patch.outline.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    SAME(vertex_x_m[i], patch.outline[i].x_m);
    SAME(vertex_y_m[i], patch.outline[i].y_m);
  }
  EXPECT_EQ(trip.back.patch, trip.sent.patch);
}

TEST(RoundTrip, AMapPatchOfTheFirstFormIsStillRead) {
  map_patch_t wire{};
  wire.utime = 7;
  wire.sender_id = 8;
  wire.seq = 9;
  wire.version = map_patch_t::VERSION;
  wire.map_hash[0] = 1;
  wire.map_hash[1] = 2;
  wire.patch_number = 3;
  wire.patch_id = 4;
  wire.kind = map_patch_t::KIND_AREA;
  wire.is_present = 1;
  wire.top_altitude_m = 500.0;
  wire.num_vertices = 3;
  wire.vertex_x_m = {0.0, 10.0, 0.0};
  wire.vertex_y_m = {0.0, 0.0, 20.0};
  wire.label = "old";
  Bytes bytes(static_cast<std::size_t>(wire.getEncodedSize()));
  ASSERT_GT(wire.encode(bytes.data(), 0, static_cast<int>(bytes.size())), 0);
  Stamp stamp;
  const auto back = from_message<MapPatch>(bytes, stamp);
  EXPECT_EQ(stamp, (Stamp{{7}, 8, 9}));
  EXPECT_EQ(back.base_map_hash, (Hash128{1, 2}));
  EXPECT_EQ(back.patch_number, 3);
  EXPECT_EQ(back.patch.id, 4);
  EXPECT_EQ(back.patch.kind, map::PatchKind::kArea);
  EXPECT_TRUE(back.patch.is_hard);
  EXPECT_TRUE(std::isinf(back.patch.floor.value_m));
  EXPECT_EQ(back.patch.ceiling.value_m, 500.0);
  ASSERT_EQ(back.patch.outline.size(), 3U);
  EXPECT_EQ(back.patch.outline[2].y_m, 20.0);
  EXPECT_EQ(back.patch.label, "old");
}

TEST(RoundTrip, MapPatchStateKeepsEachFieldUnderItsName) {
  const Trip<map_patch_state_t, MapPatchState> trip(test::example_map_patch_state());
  SAME_HASH(base_map_hash, base_map_hash);
  SAME_HASH(map_hash, map_hash);
  SAME(patch_number, patch_number);
  SAME(patch_count, patch_count);
  SAME(refused_sender_id, refused_sender_id);
  SAME(refused_patch_id, refused_patch_id);
  SAME(refusal, refusal);
}

TEST(RoundTrip, ChunkKeepsEachFieldUnderItsName) {
  const Trip<chunk_t, Chunk> trip(test::example_chunk());
  SAME_HASH(blob_id, blob_id);
  SAME(packed_bytes, packed_bytes);
  SAME(chunk_number, number);
  EXPECT_EQ(trip.wire.chunk_count, 3);
  EXPECT_THAT(trip.wire.piece, testing::ElementsAre(9, 0, 255));
  EXPECT_EQ(trip.back, trip.sent);
}

TEST(RoundTrip, ChunkRequestKeepsEachFieldUnderItsName) {
  const Trip<chunk_request_t, ChunkRequest> trip(test::example_chunk_request());
  ASSERT_EQ(trip.back.ranges.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    SAME_HASH(ranges[i].blob_id, ranges[i].blob_id);
    SAME(ranges[i].first_chunk, ranges[i].first);
    SAME(ranges[i].chunk_count, ranges[i].count);
  }
}

#define SAME_POINT(wire_member, member)                                                \
  do {                                                                                 \
    SAME(wire_member.latitude_rad, member.position.latitude_rad);                      \
    SAME(wire_member.longitude_rad, member.position.longitude_rad);                    \
    EXPECT_EQ(trip.back.member.height_m, trip.sent.member.height_m);                   \
    EXPECT_EQ(std::isnan(trip.wire.wire_member.height_m), !trip.sent.member.height_m); \
    if (trip.sent.member.height_m) {                                                   \
      EXPECT_EQ(trip.wire.wire_member.height_m, *trip.sent.member.height_m);           \
    }                                                                                  \
  } while (false)

TEST(RoundTrip, PlanRequestKeepsEachFieldUnderItsName) {
  const Trip<plan_request_t, PlanRequestMessage> trip(test::example_plan_request());
  SAME_HASH(request_id, request_id);
  SAME_HASH(map_hash, map_hash);
  SAME_REF(config, config);
  SAME_POINT(start, request.start);
  SAME_POINT(goal, request.goal);
  SAME_OPTIONAL(start_heading_true_rad, request.start_heading_true_rad);
  SAME_OPTIONAL(speed_mps, request.speed_mps);
  EXPECT_EQ(static_cast<std::uint64_t>(trip.wire.seed), trip.sent.request.seed);
  EXPECT_EQ(trip.back.request.seed, trip.sent.request.seed);
  SAME(work_budget, request.work_budget);
  ASSERT_EQ(trip.back.request.via.size(), 2U);
  SAME_POINT(via[0], request.via[0]);
  SAME_POINT(via[1], request.via[1]);
}

TEST(RoundTrip, PlanRequestWithTheMostPlacesFitsOneDatagram) {
  PlanRequestMessage request = test::example_plan_request();
  request.request.via.assign(kMaxVia, request.request.start);
  EXPECT_LE(to_message(request, kExampleStamp).size(), kMaxMessageBytes);
  request.request.via.push_back(request.request.start);
  EXPECT_THROW(to_message(request, kExampleStamp), std::invalid_argument);
}

TEST(RoundTrip, PlanRequestWithoutOptionsComesBackWithoutThem) {
  PlanRequestMessage request = test::example_plan_request();
  request.request.start_heading_true_rad.reset();
  request.request.speed_mps.reset();
  const Trip<plan_request_t, PlanRequestMessage> trip(request);
  EXPECT_FALSE(trip.back.request.start_heading_true_rad);
  EXPECT_FALSE(trip.back.request.speed_mps);
}

TEST(RoundTrip, PlanStatusKeepsEachFieldUnderItsName) {
  const Trip<plan_status_t, PlanStatus> trip(test::example_plan_status());
  SAME_HASH(request_id, request_id);
  SAME_ENUM(stage, stage);
  SAME_ENUM(state, state);
  SAME(work_units, work_units);
  SAME(work_budget, work_budget);
  SAME_OPTIONAL(best_cost_m, best_cost_m);
  SAME(lower_bound_m, lower_bound_m);
  ASSERT_TRUE(trip.back.no_plan);
  SAME_ENUM(cause, no_plan->cause);
  SAME(cause_x_m, no_plan->place->x_m);
  SAME(cause_y_m, no_plan->place->y_m);
  SAME(text, no_plan->explanation);
}

TEST(RoundTrip, EveryCauseSurvives) {
  for (int cause = 0; cause <= static_cast<int>(flight::NoPlanCause::kGoalInsideArea); ++cause) {
    PlanStatus status = test::example_plan_status();
    status.no_plan->cause = static_cast<flight::NoPlanCause>(cause);
    const Trip<plan_status_t, PlanStatus> trip(status);
    EXPECT_EQ(trip.back.no_plan->cause, status.no_plan->cause);
  }
}

TEST(RoundTrip, LongStatusTextIsCutBetweenCharacters) {
  PlanStatus status = test::example_plan_status();
  status.state = PlanState::kWorking;
  status.no_plan.reset();
  status.text.clear();
  for (int i = 0; i < 500; ++i) {
    status.text += "\xC3\xA4";  // a with two dots, two bytes
  }
  status.text.insert(0, "x");  // so that the limit falls inside a character
  const Trip<plan_status_t, PlanStatus> trip(status);
  EXPECT_EQ(trip.back.text.size(), 699U);
  EXPECT_EQ(trip.back.text.back(), '\xA4');
}

TEST(RoundTrip, RouteHeaderKeepsEachFieldUnderItsName) {
  const Trip<route_t, RouteHeader> trip(test::example_route_header());
  SAME_HASH(request_id, request_id);
  SAME_HASH(map_hash, map_hash);
  SAME(patch_number, patch_number);
  SAME_REF(plan, plan);
  SAME(cost_m, cost_m);
  SAME(lower_bound_m, lower_bound_m);
  SAME(length_m, length_m);
  SAME(work_units, work_units);
  EXPECT_EQ(static_cast<std::uint64_t>(trip.wire.seed), trip.sent.seed);
  EXPECT_EQ(trip.back.seed, trip.sent.seed);
  SAME(provenance, provenance);
}

TEST(RoundTrip, TrajectoryHeaderKeepsEachFieldUnderItsName) {
  const Trip<trajectory_t, TrajectoryHeader> trip(test::example_trajectory_header());
  SAME_HASH(request_id, request_id);
  SAME_HASH(map_hash, map_hash);
  SAME(patch_number, patch_number);
  SAME_REF(route, route);
  SAME_REF(plan, plan);
  SAME(duration_s, duration_s);
  SAME(length_m, length_m);
  SAME(clearance_min_m, clearance_min_m);
  SAME(is_verified, is_verified);
  SAME(violation_count, violation_count);
  SAME(provenance, provenance);
}

#define SAME_STATE()                                                          \
  do {                                                                        \
    SAME(state.x_m, state.x_m);                                               \
    SAME(state.y_m, state.y_m);                                               \
    SAME(state.altitude_m, state.altitude_m);                                 \
    SAME(state.speed_mps, state.speed_mps);                                   \
    SAME(state.heading_math_rad, state.heading_math_rad);                     \
    SAME(state.bank_left_rad, state.bank_left_rad);                           \
    SAME(state.roll_rate_left_radps, state.roll_rate_left_radps);             \
    SAME(state.pitch_rad, state.pitch_rad);                                   \
    SAME(state.pitch_rate_radps, state.pitch_rate_radps);                     \
    SAME(state.climb_rate_mps, state.climb_rate_mps);                         \
    SAME(state.vertical_acceleration_mps2, state.vertical_acceleration_mps2); \
    SAME(state.climb_integral_mps, state.climb_integral_mps);                 \
  } while (false)
#define SAME_COMMAND()                                          \
  do {                                                          \
    SAME(commanded_speed_mps, command.speed_mps);               \
    SAME(commanded_heading_math_rad, command.heading_math_rad); \
    SAME(commanded_climb_rate_mps, command.climb_rate_mps);     \
  } while (false)

TEST(RoundTrip, VehicleTargetKeepsEachFieldUnderItsName) {
  const Trip<vehicle_target_t, VehicleTarget> trip(test::example_vehicle_target());
  SAME_HASH(request_id, request_id);
  SAME(step_number, step_number);
  SAME(is_lockstep, is_lockstep);
  SAME(step_s, step_s);
  SAME_STATE();
  SAME_COMMAND();
}

TEST(RoundTrip, VehicleStateKeepsEachFieldUnderItsName) {
  const Trip<vehicle_state_t, VehicleState> trip(test::example_vehicle_state());
  SAME_HASH(request_id, request_id);
  SAME(step_number, step_number);
  SAME(is_lockstep, is_lockstep);
  SAME(flight_time_s, flight_time_s);
  SAME_STATE();
  SAME_OPTIONAL(heading_true_rad, heading_true_rad);
  SAME_OPTIONAL(height_m, height_m);
  SAME_COMMAND();
}

TEST(RoundTrip, LocalHistogramKeepsEachFieldUnderItsName) {
  const Trip<local_histogram_t, LocalHistogram> trip(test::example_local_histogram());
  SAME_HASH(request_id, request_id);
  SAME(step_number, step_number);
  SAME(x_m, x_m);
  SAME(y_m, y_m);
  SAME(altitude_m, altitude_m);
  SAME(heading_math_rad, heading_math_rad);
  SAME_OPTIONAL(chosen_sector, chosen_sector);
  ASSERT_EQ(trip.back.sectors.size(), 4U);
  for (std::size_t k = 0; k < 4; ++k) {
    const LocalHistogram::Sector& sent = trip.sent.sectors[k];
    EXPECT_THAT(trip.wire.climb_angle_rad[k], testing::NanSensitiveFloatEq(sent.climb_angle_rad));
    EXPECT_THAT(trip.wire.sector_cost[k], testing::NanSensitiveFloatEq(sent.cost));
    EXPECT_THAT(trip.back.sectors[k].climb_angle_rad,
                testing::NanSensitiveFloatEq(sent.climb_angle_rad));
    EXPECT_THAT(trip.back.sectors[k].cost, testing::NanSensitiveFloatEq(sent.cost));
    SAME_ENUM(mask[k], sectors[k].mask);
  }
}

TEST(RoundTrip, LocalHistogramWithTheMostSectorsFitsOneDatagram) {
  LocalHistogram histogram = test::example_local_histogram();
  histogram.sectors.resize(kMaxSectors);
  EXPECT_LE(to_message(histogram, kExampleStamp).size(), kMaxMessageBytes);
}

TEST(RoundTrip, ServiceStatusKeepsEachFieldUnderItsName) {
  const Trip<service_status_t, ServiceStatus> trip(test::example_service_status());
  SAME(name, name);
  SAME(host, host);
  SAME(process_id, process_id);
  SAME(program_version, program_version);
  SAME_HASH(config_hash, config_hash);
  SAME_HASH(types_hash, types_hash);
  SAME_ENUM(state, state);
  SAME(uptime_s, uptime_s);
  SAME(published_count, published_count);
  SAME(received_count, received_count);
  SAME(rejected_count, rejected_count);
  SAME(gap_count, gap_count);
  SAME(drop_count, drop_count);
  SAME(sent_chunk_count, sent_chunk_count);
  SAME(missing_chunk_count, missing_chunk_count);
  SAME(text, text);
}

TEST(RoundTrip, LongestServiceStatusFitsOneDatagram) {
  ServiceStatus status = test::example_service_status();
  status.name.assign(500, 'n');
  status.host.assign(500, 'h');
  status.program_version.assign(500, 'v');
  status.text.assign(5000, 't');
  EXPECT_LE(to_message(status, kExampleStamp).size(), kMaxMessageBytes);
}

TEST(RoundTrip, RoutePlanKeepsEachFieldUnderItsName) {
  const flight::RoutePlan sent = test::example_route_plan();
  const Bytes bytes = encode_route_plan(sent);
  const auto wire = wire_of<route_plan_t>(bytes);
  EXPECT_EQ(wire.config_text, sent.config_text);
  EXPECT_EQ(wire.crs_wkt, sent.map.crs_wkt);
  EXPECT_EQ(wire.vertical_datum, sent.map.vertical_datum);
  EXPECT_EQ(wire.label, sent.map.label);
  EXPECT_EQ(wire.attributions, sent.map.attributions);
  EXPECT_EQ(static_cast<std::uint64_t>(wire.map_hash[1]), sent.map.hash.low);
  EXPECT_EQ(wire.requested_start.latitude_rad, sent.request.start.position.latitude_rad);
  EXPECT_EQ(wire.requested_goal.longitude_rad, sent.request.goal.position.longitude_rad);
  EXPECT_EQ(wire.start_heading_true_rad, *sent.request.start_heading_true_rad);
  EXPECT_EQ(wire.speed_mps, *sent.request.speed_mps);
  EXPECT_EQ(wire.start.y_m, sent.start.y_m);
  EXPECT_EQ(wire.goal.altitude_m, sent.goal.altitude_m);
  EXPECT_EQ(wire.cost_length_m, sent.route.cost.length_m);
  EXPECT_EQ(wire.cost_visibility_m, sent.route.cost.visibility_m);
  EXPECT_EQ(wire.cost_semantics_m, sent.route.cost.semantics_m);
  EXPECT_EQ(wire.cost_height_m, sent.route.cost.height_m);
  EXPECT_EQ(wire.lower_bound_m, sent.route.lower_bound_m);
  EXPECT_EQ(wire.guide_spacing_m, sent.route.guide_spacing_m);

  const flight::RoutePlan back = decode_route_plan(bytes);
  EXPECT_EQ(back.request_id, sent.request_id);
  EXPECT_EQ(flight::plan_request_id(back.request, back.map.hash, back.config_text),
            sent.request_id);  // covers every field of the request
  EXPECT_EQ(back.map.crs_wkt, sent.map.crs_wkt);
  EXPECT_EQ(back.map.vertical_datum, sent.map.vertical_datum);
  EXPECT_EQ(back.map.label, sent.map.label);
  EXPECT_EQ(back.map.attributions, sent.map.attributions);
  EXPECT_EQ(back.start, sent.start);
  EXPECT_EQ(back.goal, sent.goal);
  EXPECT_EQ(back.route.waypoints, sent.route.waypoints);
  EXPECT_EQ(back.route.guide, sent.route.guide);
  EXPECT_EQ(back.route.guide_spacing_m, sent.route.guide_spacing_m);
  EXPECT_EQ(back.route.cost, sent.route.cost);
  EXPECT_EQ(back.route.lower_bound_m, sent.route.lower_bound_m);
  EXPECT_EQ(back.route.work_units, sent.route.work_units);
  EXPECT_EQ(back.route.samples, sent.route.samples);
  EXPECT_EQ(back.route.batches, sent.route.batches);
}

TEST(RoundTrip, ARouteWhoseCostHasTermsBeyondEquationOneTravelsInTheSecondForm) {
  flight::RoutePlan sent = test::example_route_plan();
  const Bytes first_form = encode_route_plan(sent);
  sent.route.cost.threats_m = 77.5;
  EXPECT_EQ(decode_route_plan(encode_route_plan(sent)).route.cost, sent.route.cost);
  sent.route.cost.soft_ceiling_m = 33.25;
  sent.route.cost.wire_crossings_m = 11.125;
  sent.route.cost.slope_m = 5.0625;
  const Bytes bytes = encode_route_plan(sent);
  const auto wire = wire_of<route_plan_v2_t>(bytes);
  EXPECT_EQ(wire.cost_soft_ceiling_m, 33.25);
  EXPECT_EQ(wire.cost_threats_m, 77.5);
  EXPECT_EQ(wire.cost_wire_crossings_m, 11.125);
  EXPECT_EQ(wire.cost_slope_m, 5.0625);
  const flight::RoutePlan back = decode_route_plan(bytes);
  EXPECT_EQ(back.route.cost, sent.route.cost);
  EXPECT_EQ(back.route.guide, sent.route.guide);
  // All else is the first form.
  flight::RoutePlan without = back;
  without.route.cost = test::example_route_plan().route.cost;
  EXPECT_EQ(encode_route_plan(without), first_form);
  sent.route.cost.slope_m = std::nan("");
  EXPECT_THROW(encode_route_plan(sent), std::invalid_argument);
  sent.route.cost.slope_m = -1.0;
  EXPECT_THROW(encode_route_plan(sent), std::invalid_argument);
  Bytes of_another_version = bytes;
  of_another_version[9] = std::byte{2};
  EXPECT_THROW(decode_route_plan(of_another_version), MessageError);
  Bytes nested_version = bytes;
  nested_version[11] = std::byte{2};
  EXPECT_THROW(decode_route_plan(nested_version), MessageError);
  EXPECT_THROW(decode_route_plan(ByteView(bytes).first(bytes.size() - 8)), MessageError);
}

TEST(RoundTrip, RouteAndFlightBlobsGiveTheWholePlanBack) {
  const flight::Plan sent = test::example_plan();
  const Hash128 route_id{7, 8};
  const flight::RoutePlan route = decode_route_plan(encode_route_plan(sent.route_plan));
  const Bytes bytes = encode_flight_plan(sent, route_id);
  const flight::Plan back = decode_flight_plan(bytes, route, route_id);
  // Every number of a state, bit by bit; a state is nothing but doubles.
  ASSERT_EQ(back.trajectory.states.size(), sent.trajectory.states.size());
  EXPECT_EQ(std::memcmp(back.trajectory.states.data(), sent.trajectory.states.data(),
                        sent.trajectory.states.size() * sizeof(flight::FlightState)),
            0);
  EXPECT_EQ(std::memcmp(&back.measures, &sent.measures, sizeof sent.measures), 0);
  EXPECT_EQ(back.trajectory.step_s, sent.trajectory.step_s);
  EXPECT_EQ(back.decisions, sent.decisions);
  EXPECT_EQ(back.infeasible_decisions, sent.infeasible_decisions);
  EXPECT_EQ(back.warnings, sent.warnings);
  EXPECT_EQ(back.route_plan.request_id, sent.route_plan.request_id);
  const flight::Verdict& a = back.verdict;
  const flight::Verdict& b = sent.verdict;
  EXPECT_EQ(a.is_verified, b.is_verified);
  EXPECT_EQ(a.violation_count, b.violation_count);
  ASSERT_EQ(a.violations.size(), b.violations.size());
  for (std::size_t i = 0; i < a.violations.size(); ++i) {
    EXPECT_EQ(a.violations[i].rule, b.violations[i].rule);
    EXPECT_EQ(a.violations[i].time_s, b.violations[i].time_s);
    EXPECT_EQ(a.violations[i].place.x_m, b.violations[i].place.x_m);
    EXPECT_EQ(a.violations[i].place.y_m, b.violations[i].place.y_m);
    EXPECT_EQ(a.violations[i].value, b.violations[i].value);
    EXPECT_EQ(a.violations[i].limit, b.violations[i].limit);
  }
  EXPECT_EQ(a.clearance_min_m, b.clearance_min_m);
  EXPECT_EQ(a.clearance_min_place.x_m, b.clearance_min_place.x_m);
  EXPECT_EQ(a.clearance_min_place.y_m, b.clearance_min_place.y_m);
  EXPECT_EQ(a.bank_max_rad, b.bank_max_rad);
  EXPECT_EQ(a.roll_rate_max_radps, b.roll_rate_max_radps);
  EXPECT_EQ(a.climb_rate_max_mps, b.climb_rate_max_mps);
  EXPECT_EQ(a.descent_rate_max_mps, b.descent_rate_max_mps);
  EXPECT_EQ(a.speed_min_mps, b.speed_min_mps);
  EXPECT_EQ(a.speed_max_mps, b.speed_max_mps);
  EXPECT_EQ(a.share_under_ceiling, b.share_under_ceiling);
  EXPECT_EQ(a.goal_distance_m, b.goal_distance_m);

  // And under the right names on the wire.
  const auto wire = wire_of<flight_plan_t>(bytes);
  const flight::FlightState& state = sent.trajectory.states[1];
  EXPECT_EQ(wire.states[1].bank_rad, state.bank_rad);
  EXPECT_EQ(wire.states[1].pitch_rad, state.pitch_rad);
  EXPECT_EQ(wire.states[1].surface_m, state.surface_m);
  EXPECT_EQ(wire.states[1].terrain_m, state.terrain_m);
  EXPECT_EQ(wire.states[1].commanded_heading_true_rad, state.commanded_heading_true_rad);
  EXPECT_EQ(wire.states[1].target_heading_true_rad, state.target_heading_true_rad);
  EXPECT_EQ(wire.visibility_m, sent.measures.visibility_m);
  EXPECT_EQ(wire.semantics_m, sent.measures.semantics_m);
  EXPECT_EQ(wire.bank_rad_m, sent.measures.bank_rad_m);
  EXPECT_EQ(wire.climb_rate_max_mps, b.climb_rate_max_mps);
  EXPECT_EQ(wire.descent_rate_max_mps, b.descent_rate_max_mps);
  EXPECT_EQ(wire.violations[1].found, b.violations[1].value);
  EXPECT_EQ(wire.violations[1].demanded, b.violations[1].limit);
}

TEST(RoundTrip, AFlightGrowsByTheBytesOfAStateAndEndsInIt) {
  flight::Plan plan = test::example_plan();
  const std::size_t bytes = encode_flight_plan(plan, {7, 8}).size();
  plan.trajectory.states.push_back(plan.trajectory.states.back());
  plan.trajectory.states.back().terrain_m = 1.0;  // the last field: 0x3FF0...
  const Bytes longer = encode_flight_plan(plan, {7, 8});
  EXPECT_EQ(longer.size() - bytes, kFlightStateBytes);
  EXPECT_EQ(longer[longer.size() - 8], std::byte{0x3F});
  EXPECT_EQ(longer[longer.size() - 7], std::byte{0xF0});
}

TEST(RoundTrip, FlightOfAnotherRouteIsRefused) {
  const flight::Plan plan = test::example_plan();
  const Bytes bytes = encode_flight_plan(plan, {7, 8});
  EXPECT_THROW(decode_flight_plan(bytes, plan.route_plan, {7, 9}), MessageError);
  flight::RoutePlan other = plan.route_plan;
  other.request_id.low += 1;
  EXPECT_THROW(decode_flight_plan(bytes, other, {7, 8}), MessageError);
}

TEST(RoundTrip, RouteWithAForeignRequestIdIsRefused) {
  flight::RoutePlan plan = test::example_route_plan();
  plan.request.seed += 1;
  EXPECT_THROW(encode_route_plan(plan), std::invalid_argument);
}

TEST(Types, NoTwoShareAFingerprint) {
  std::set<std::int64_t> fingerprints;
  for (const TypeFingerprint& type : type_fingerprints()) {
    EXPECT_TRUE(fingerprints.insert(type.fingerprint).second) << type.type;
  }
  EXPECT_GE(fingerprints.size(), 26U);
}

TEST(Types, EveryChannelCarriesATypeThatExists) {
  std::set<std::string_view> names;
  for (const TypeFingerprint& type : type_fingerprints()) {
    names.insert(type.type);
  }
  for (const ChannelType& channel : kChannelTypes) {
    EXPECT_TRUE(names.contains(channel.type)) << channel.channel;
  }
  EXPECT_EQ(test::example_of_each_channel().size(), kChannelTypes.size());
}

}  // namespace
}  // namespace hedgehop::messages
