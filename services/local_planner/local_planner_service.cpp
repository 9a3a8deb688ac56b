#include "local_planner_service.hpp"

#include "base/errors.hpp"
#include "messages/plan_blobs.hpp"
#include "planning/planning.hpp"

namespace hedgehop::services {

using messages::Stamp;

LocalPlannerService::LocalPlannerService(const PlannerOptions& options, bus::Bus& bus,
                                         bus::BlobExchange& exchange, bus::ServiceLoop& loop,
                                         bool is_lockstep)
    : bus_(bus),
      exchange_(exchange),
      desk_(options, messages::PlanStage::kLocal, bus, exchange, loop) {
  if (is_lockstep) {
    lockstep_.emplace(bus, desk_);
  }
  bus.subscribe<messages::MapIndex>(
      messages::kMapIndexChannel,
      [this](const messages::MapIndex& index, const Stamp& stamp) { desk_.receive(index, stamp); });
  bus.subscribe<messages::RouteHeader>(
      messages::kRouteChannel, [this](const messages::RouteHeader& route, const Stamp& stamp) {
        desk_.receive({route.request_id, route.map_hash, route.plan,
                       "route of request " + route.request_id.hex(),
                       [this, route, asked = stamp.time](const map::Map& map, const Bytes& input,
                                                         Observer& observer) {
                         return plan(route, asked, map, input, observer);
                       }});
      });
  bus.subscribe<messages::PlanCancel>(
      messages::kPlanCancelChannel,
      [this](const messages::PlanCancel& cancel, const Stamp&) { desk_.receive(cancel); });
}

std::variant<Answer, flight::NoPlan> LocalPlannerService::plan(const messages::RouteHeader& route,
                                                               Time asked, const map::Map& map,
                                                               const Bytes& route_blob,
                                                               Observer& observer) {
  const flight::RoutePlan route_plan = messages::decode_route_plan(route_blob);
  if (route_plan.request_id != route.request_id) {
    throw DataError("the route's blob answers request " + route_plan.request_id.hex() +
                    ", its header says " + route.request_id.hex());
  }
  const planning::PlanningConfig config =
      planning::read_planning_config(route_plan.config_text, "config of the route");
  local_planning::StepModel step_model;
  if (lockstep_) {
    step_model = [&](const command_model::ModelState& state, const command_model::Command& command,
                     double step_s) {
      return lockstep_->step(route.request_id, state, command, step_s, observer);
    };
  }
  auto result = planning::plan_flight(map, route_plan, config, step_model, observer);
  if (auto* no_plan = std::get_if<flight::NoPlan>(&result)) {
    return std::move(*no_plan);
  }
  const auto& plan = std::get<flight::Plan>(result);
  messages::TrajectoryHeader header;
  header.request_id = route.request_id;
  header.map_hash = map.hash;
  header.patch_number = route.patch_number;
  header.route = route.plan;
  header.plan = exchange_.offer(messages::encode_flight_plan(plan, route.plan.id), true);
  header.duration_s = plan.measures.duration_s;
  header.length_m = plan.measures.length_m;
  header.clearance_min_m = plan.verdict.clearance_min_m;
  header.is_verified = plan.verdict.is_verified;
  header.violation_count = plan.verdict.violation_count;
  header.provenance = "hedgehop local_planner";
  return Answer{header.plan.id, [this, header, asked] {
                  bus_.publish(messages::kTrajectoryChannel, header, asked);
                }};
}

}  // namespace hedgehop::services
