#pragma once

#include <cstdint>
#include <vector>

#include "base/config_reader.hpp"
#include "flight/route.hpp"
#include "flight/trajectory.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::briefing {

struct CostOptions {
  double step_m = 0.0;    // > 0
  double beside_m = 0.0;  // > 0
};
/// Section `costs` of config/report.yaml.
CostOptions read_cost_options(ConfigReader& reader);

/// What a metre of path costs at a place of the flight, term by term [-]; `length_m` is 1. A wire
/// that the track crosses within the step around the place is spread over it.
struct CostPlace {
  double along_m = 0.0;  // distance flown
  double time_s = 0.0;
  geo::MapPoint place;
  double height_m = 0.0;      // above the surface
  double seen = 0.0;          // visibility at that height, as planners see it
  std::uint16_t classes = 0;  // bits of the semantics layer; 0 outside the map
  flight::RouteCost here;
  flight::RouteCost left;  // at the same height, `beside_m` to the left of the track; NaN outside
  flight::RouteCost right;
};

/// What flying here costs, place by place.
struct CostProfile {
  double step_m = 0.0;  // of horizontal path that each place stands for
  std::vector<CostPlace> places;

  /// Sum over all places [m]: the midpoint rule over the horizontal path.
  [[nodiscard]] flight::RouteCost total() const;
};

/// Mean cost of a metre [-], here or beside, of the places with `from_m <= along_m < to_m`. Places
/// beside that lie outside the map or over unknown surface are left out; NaN if none is left.
flight::RouteCost mean_cost(const CostProfile& profile, double from_m, double to_m,
                            flight::RouteCost CostPlace::*side);

/// Cost of the flown path in equal steps of at most `step_m`, places in their middles. Heights are
/// those of the flight; beside it, the same height above the surface there.
/// Empty for a flight without length. O(length / step).
CostProfile cost_profile(const risk::CostModel& model, const flight::Trajectory& trajectory,
                         const CostOptions& options);

/// Cost of straight lines between places at a constant height above the surface, by the midpoint
/// rule [m]: what the shortest way would cost if nothing but the ground mattered. NaN where it
/// leaves the map.
flight::RouteCost straight_cost(const risk::CostModel& model,
                                const std::vector<geo::MapPoint>& places, double height_m,
                                double step_m);

}  // namespace hedgehop::briefing
