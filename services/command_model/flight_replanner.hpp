#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "base/time.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "bus/map_exchange.hpp"
#include "flight/plan.hpp"
#include "messages/plan_messages.hpp"

namespace hedgehop::services {

/// A flight under way, as its planner needs to know it.
struct FlightUnderWay {
  const flight::RoutePlan* route = nullptr;
  const flight::Trajectory* trajectory = nullptr;
  std::size_t step = 0;  // of the trajectory, where the vehicle is
  Hash128 map_hash;      // that it was planned on
  bool weighs_threats = false;
  // Of a trajectory that is a reaction, via points that were ahead when it began are behind where
  // it has come so near to them; 0 for a plan.
  double via_radius_m = 0.0;
};

/// The via points of the request that the flight has not passed by at that step.
std::vector<flight::RequestPoint> via_ahead(const FlightUnderWay& flight, std::size_t step);

/// The request for the rest of a flight, from the state of `step` on: place, height and heading are
/// those of that state; via points that the flight has passed by then are left out; everything else
/// is as it was asked for. None where the surface under that state is not known.
std::optional<flight::PlanRequest> rest_of_flight(const FlightUnderWay& flight, std::size_t step);

/// Has a flight planned again when the map changes under it (MAP_PATCH): asks the planners for a
/// plan from the place where the vehicle will be `lead_s` later, and repeats that until the answer
/// is there. When the vehicle comes to that place first, it asks again with twice the lead. What
/// cannot be planned is told, and the flight goes on as it was planned.
class FlightReplanner {
 public:
  /// @param lead_s  0: never asks
  FlightReplanner(double lead_s, bus::Bus& bus, bus::BlobExchange& exchange);

  /// @param flight  the newest one that has been taken over; none on the ground
  void tick(const std::optional<FlightUnderWay>& flight, Time now);

  [[nodiscard]] bool has_asked(const Hash128& request_id) const {
    return asked_ids_.contains(request_id);
  }
  /// "; planned again for patch 3: ...", or empty.
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  struct Asked {
    messages::PlanRequestMessage message;
    std::size_t step = 0;  // where the new plan begins
    double lead_s = 0.0;
    bool is_given_up = false;
  };
  void ask(const FlightUnderWay& flight, double lead_s);
  void stop_asking();

  double lead_s_;
  bus::Bus& bus_;
  bus::BlobExchange& exchange_;
  bus::NewestIndex newest_;
  std::optional<Asked> asked_;
  std::set<Hash128> asked_ids_;
  Time next_ask_;
  std::string text_;
};

}  // namespace hedgehop::services
