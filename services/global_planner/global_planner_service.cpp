#include "global_planner_service.hpp"

#include "base/errors.hpp"
#include "messages/plan_blobs.hpp"
#include "planning/planning.hpp"

namespace hedgehop::services {

using messages::Stamp;

GlobalPlannerService::GlobalPlannerService(const PlannerOptions& options, bus::Bus& bus,
                                           bus::BlobExchange& exchange, bus::ServiceLoop& loop,
                                           RoutePlanner planner, std::string name)
    : bus_(bus),
      exchange_(exchange),
      planner_(std::move(planner)),
      name_(std::move(name)),
      desk_(options, messages::PlanStage::kGlobal, bus, exchange, loop) {
  bus.subscribe<messages::MapIndex>(
      messages::kMapIndexChannel,
      [this](const messages::MapIndex& index, const Stamp& stamp) { desk_.receive(index, stamp); });
  bus.subscribe<messages::PlanRequestMessage>(
      messages::kPlanRequestChannel,
      [this](const messages::PlanRequestMessage& message, const Stamp& stamp) {
        desk_.receive({message.request_id, message.map_hash, message.config,
                       "config of request " + message.request_id.hex(),
                       [this, message, asked = stamp.time](const map::Map& map, const Bytes& input,
                                                           Observer& observer) {
                         return plan(message, asked, map, input, observer);
                       }});
      });
  bus.subscribe<messages::PlanCancel>(
      messages::kPlanCancelChannel,
      [this](const messages::PlanCancel& cancel, const Stamp&) { desk_.receive(cancel); });
}

std::variant<Answer, flight::NoPlan> GlobalPlannerService::plan(
    const messages::PlanRequestMessage& message, Time asked, const map::Map& map,
    const Bytes& config_blob, Observer& observer) {
  const planning::PlanningConfig& config =
      config_.read(messages::decode_planning_config(config_blob), "config of the request");
  if (flight::plan_request_id(message.request, map.hash, config.text) != message.request_id) {
    throw DataError("the request's id is not that of its map, request and config",
                    "sender and planner differ in version");
  }
  const std::int64_t patch_number = desk_.patch_number();
  auto result = planner_(
      map, message.request, config,
      [this](const global_planning::RouteProgress& progress) { desk_.report(progress); }, observer);
  if (auto* no_plan = std::get_if<flight::NoPlan>(&result)) {
    return std::move(*no_plan);
  }
  const auto& plan = std::get<flight::RoutePlan>(result);
  messages::RouteHeader header;
  header.request_id = message.request_id;
  header.map_hash = map.hash;
  header.patch_number = patch_number;
  header.plan = exchange_.offer(messages::encode_route_plan(plan), true);
  header.cost_m = plan.route.cost.total_m();
  header.lower_bound_m = plan.route.lower_bound_m;
  header.length_m = flight::length_m(plan.route.waypoints);
  header.work_units = plan.route.work_units;
  header.seed = message.request.seed;
  header.provenance = name_;
  return Answer{header.plan.id,
                [this, header, asked] { bus_.publish(messages::kRouteChannel, header, asked); }};
}

}  // namespace hedgehop::services
