#include "local_planner_service.hpp"

#include <chrono>
#include <memory>
#include <utility>

#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "messages/plan_blobs.hpp"
#include "planning/planning.hpp"

namespace hedgehop::services {

using messages::Stamp;

namespace {

constexpr std::size_t kSectorsMin = 4;
constexpr std::size_t kSectorsMax = 128;  // of the message

messages::LocalHistogram histogram_of(const local_planning::Decision& decision) {
  messages::LocalHistogram histogram;
  histogram.step_number = decision.number;
  histogram.x_m = decision.state.x_m;
  histogram.y_m = decision.state.y_m;
  histogram.altitude_m = decision.state.altitude_m;
  histogram.heading_math_rad = decision.state.heading_math_rad;
  histogram.chosen_sector = decision.chosen_sector;
  for (const local_planning::Decision::Sector& sector : decision.sectors) {
    messages::LocalHistogram::Sector shown;
    shown.climb_angle_rad = static_cast<float>(elementary::atan(sector.climb_tangent));
    shown.cost = sector.cost;
    switch (sector.mask) {
      case local_planning::DirectionMask::kFree:
        shown.mask = messages::SectorMask::kFree;
        break;
      case local_planning::DirectionMask::kClimb:
        shown.mask = messages::SectorMask::kClimb;
        break;
      case local_planning::DirectionMask::kTurn:
        shown.mask = messages::SectorMask::kTurn;
        break;
      case local_planning::DirectionMask::kUnknown:
        shown.mask = messages::SectorMask::kUnknown;
        break;
    }
    histogram.sectors.push_back(shown);
  }
  return histogram;
}

}  // namespace

LocalPlannerOptions LocalPlannerService::read_options(ConfigReader reader) {
  LocalPlannerOptions options;
  options.histogram_rate_hz = reader.required_double("histogram_rate_hz");
  reader.require(options.histogram_rate_hz >= 0.0 && options.histogram_rate_hz <= 20.0,
                 "histogram_rate_hz", "must lie between 0 and 20");
  static_cast<PlannerOptions&>(options) = read_planner_options(std::move(reader));
  return options;
}

LocalPlannerService::LocalPlannerService(const LocalPlannerOptions& options, bus::Bus& bus,
                                         bus::BlobExchange& exchange, bus::ServiceLoop& loop,
                                         bool is_lockstep)
    : histogram_rate_hz_(options.histogram_rate_hz),
      bus_(bus),
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
  const std::string reason = bus::reason_against_provenance(route.provenance);
  if (!reason.empty() && !bus_.is_replay()) {
    throw DataError("the route cannot be flown: " + reason, "install one version everywhere");
  }
  const flight::RoutePlan route_plan = messages::decode_route_plan(route_blob);
  if (route_plan.request_id != route.request_id) {
    throw DataError("the route's blob answers request " + route_plan.request_id.hex() +
                    ", its header says " + route.request_id.hex());
  }
  const planning::PlanningConfig& config =
      config_.read(route_plan.config_text, "config of the route");
  local_planning::StepModel step_model;
  if (lockstep_) {
    step_model = [&](const command_model::ModelState& state, const command_model::Command& command,
                     double step_s) {
      return lockstep_->step(route.request_id, state, command, step_s, observer);
    };
  }
  auto result = planning::plan_flight(map, route_plan, config, step_model, observer,
                                      watch_of(route.request_id));
  if (auto* no_plan = std::get_if<flight::NoPlan>(&result)) {
    return std::move(*no_plan);
  }
  const auto& plan = std::get<flight::Plan>(result);
  messages::TrajectoryHeader header;
  header.request_id = route.request_id;
  header.map_hash = map.hash;
  header.patch_number = route.patch_number;
  header.route = route.plan;
  header.plan = exchange_.offer_records(messages::encode_flight_plan(plan, route.plan.id),
                                        messages::kFlightStateBytes, true);
  header.duration_s = plan.measures.duration_s;
  header.length_m = plan.measures.length_m;
  header.clearance_min_m = plan.verdict.clearance_min_m;
  header.is_verified = plan.verdict.is_verified;
  header.violation_count = plan.verdict.violation_count;
  header.provenance = bus::provenance_of("local_planner");
  return Answer{header.plan.id, [this, header, asked] {
                  bus_.publish(messages::kTrajectoryChannel, header, asked);
                }};
}

// A replay has no clock to be paced by.
local_planning::DecisionWatch LocalPlannerService::watch_of(const Hash128& request_id) {
  if (histogram_rate_hz_ <= 0.0 || bus_.is_replay()) {
    return {};
  }
  using Clock = std::chrono::steady_clock;
  const auto next = std::make_shared<Clock::time_point>();
  const std::chrono::duration<double> period(1.0 / histogram_rate_hz_);
  return {[next, period] {
            const auto now = Clock::now();
            if (now < *next) {
              return false;
            }
            *next = now + std::chrono::duration_cast<Clock::duration>(period);
            return true;
          },
          [this, request_id](const local_planning::Decision& decision) {
            if (decision.sectors.size() < kSectorsMin || decision.sectors.size() > kSectorsMax) {
              return;
            }
            messages::LocalHistogram histogram = histogram_of(decision);
            histogram.request_id = request_id;
            bus_.publish(messages::kLocalHistogramChannel, histogram, bus_.message_time());
          }};
}

}  // namespace hedgehop::services
