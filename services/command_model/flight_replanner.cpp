#include "flight_replanner.hpp"

#include <algorithm>
#include <cmath>

#include "geo/map_projection.hpp"
#include "messages/plan_blobs.hpp"

namespace hedgehop::services {
namespace {

using messages::PlanState;
using messages::Stamp;

constexpr double kRepeat_s = 1.0;
constexpr double kLeadMax_s = 120.0;
constexpr double kRestMin_s = 5.0;  // a shorter rest is not planned again
constexpr std::size_t kAskedIdsMax = 64;

std::size_t nearest_step(const std::vector<flight::FlightState>& states,
                         const geo::MapPoint& point) {
  const auto square_m2 = [&](const flight::FlightState& state) {
    const double dx_m = state.x_m - point.x_m;
    const double dy_m = state.y_m - point.y_m;
    return dx_m * dx_m + dy_m * dy_m;
  };
  return static_cast<std::size_t>(
      std::min_element(states.begin(), states.end(),
                       [&](const auto& a, const auto& b) { return square_m2(a) < square_m2(b); }) -
      states.begin());
}

}  // namespace

std::vector<flight::RequestPoint> via_ahead(const FlightUnderWay& flight, std::size_t step) {
  const auto& states = flight.trajectory->states;
  const geo::MapProjection projection(flight.route->map.crs_wkt);
  const auto is_ahead = [&](const flight::RequestPoint& via) {
    const geo::MapPoint point = projection.to_map(via.position);
    const std::size_t nearest = nearest_step(states, point);
    const flight::FlightState& there = states[nearest];
    const double dx_m = there.x_m - point.x_m;
    const double dy_m = there.y_m - point.y_m;
    const bool is_far = flight.via_radius_m > 0.0 &&
                        dx_m * dx_m + dy_m * dy_m > flight.via_radius_m * flight.via_radius_m;
    return nearest > step || is_far;
  };
  const auto& via = flight.route->request.via;
  return {std::find_if(via.begin(), via.end(), is_ahead), via.end()};
}

std::optional<flight::PlanRequest> rest_of_flight(const FlightUnderWay& flight, std::size_t step) {
  const auto& states = flight.trajectory->states;
  const flight::FlightState& state = states.at(step);
  if (std::isnan(state.surface_m)) {
    return std::nullopt;
  }
  const geo::MapProjection projection(flight.route->map.crs_wkt);
  flight::PlanRequest request = flight.route->request;
  request.start.position = projection.to_geodetic({state.x_m, state.y_m});
  request.start.height_m = state.altitude_m - state.surface_m;
  request.start_heading_true_rad = state.heading_true_rad;
  request.via = via_ahead(flight, step);
  return request;
}

FlightReplanner::FlightReplanner(double lead_s, bus::Bus& bus, bus::BlobExchange& exchange)
    : lead_s_(lead_s), bus_(bus), exchange_(exchange) {
  if (lead_s_ <= 0.0 || bus.is_replay()) {  // of a log, what was asked is in it
    lead_s_ = 0.0;
    return;
  }
  bus.subscribe<messages::MapIndex>(messages::kMapIndexChannel,
                                    [this](const messages::MapIndex& index, const Stamp& stamp) {
                                      newest_.hear(index, stamp.sender_id);
                                    });
  bus.subscribe<messages::PlanStatus>(
      messages::kPlanStatusChannel, [this](const messages::PlanStatus& status, const Stamp&) {
        if (!asked_ || asked_->is_given_up || status.request_id != asked_->message.request_id ||
            (status.state != PlanState::kNoPlan && status.state != PlanState::kRefused)) {
          return;
        }
        asked_->is_given_up = true;
        text_ = "; it cannot be planned again: " +
                (status.no_plan ? status.no_plan->explanation : status.text);
      });
}

void FlightReplanner::stop_asking() {
  if (asked_ && !asked_->is_given_up) {
    bus_.publish(messages::kPlanCancelChannel, messages::PlanCancel{asked_->message.request_id},
                 bus_.now());
  }
  asked_.reset();
}

void FlightReplanner::ask(const FlightUnderWay& flight, double lead_s) {
  stop_asking();
  const messages::MapIndex& index = *newest_.index();
  Asked asked;
  asked.lead_s = lead_s;
  asked.message.map_hash = index.hash_for(flight.weighs_threats);
  text_ = "; it is planned again for patch " + std::to_string(index.patch_number);
  const double step_s = flight.trajectory->step_s;
  asked.step = flight.step + static_cast<std::size_t>(std::ceil(lead_s / step_s));
  const auto rest_steps = static_cast<std::size_t>(kRestMin_s / step_s);
  std::optional<flight::PlanRequest> request;
  if (asked.step + rest_steps < flight.trajectory->states.size()) {
    request = rest_of_flight(flight, asked.step);
  }
  if (!request) {
    asked.is_given_up = true;
    text_ = "; it is too near its end to be planned again for patch " +
            std::to_string(index.patch_number);
    asked_ = std::move(asked);
    return;
  }
  const std::string& config_text = flight.route->config_text;
  asked.message.request = *request;
  asked.message.request_id = flight::plan_request_id(*request, asked.message.map_hash, config_text);
  asked.message.config = exchange_.offer(messages::encode_planning_config(config_text), true);
  if (asked_ids_.size() >= kAskedIdsMax) {
    asked_ids_.clear();
  }
  asked_ids_.insert(asked.message.request_id);
  asked_ = std::move(asked);
  next_ask_ = {};
}

void FlightReplanner::tick(const std::optional<FlightUnderWay>& flight, Time now) {
  if (lead_s_ <= 0.0) {
    return;
  }
  const auto& index = newest_.index();
  if (!flight || !index || index->hash_for(flight->weighs_threats) == flight->map_hash) {
    asked_.reset();  // answered, or there is nothing to ask any more
    text_.clear();
    return;
  }
  if (!asked_ || asked_->message.map_hash != index->hash_for(flight->weighs_threats)) {
    ask(*flight, lead_s_);
  } else if (!asked_->is_given_up && flight->step >= asked_->step) {
    ask(*flight, std::min(2.0 * asked_->lead_s, kLeadMax_s));
  }
  if (!asked_->is_given_up && now >= next_ask_) {
    next_ask_ = now + kRepeat_s;
    bus_.publish(messages::kPlanRequestChannel, asked_->message, now);
  }
}

}  // namespace hedgehop::services
