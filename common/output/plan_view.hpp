#pragma once

#include <optional>
#include <string>
#include <vector>

#include "flight/plan.hpp"
#include "map/map.hpp"
#include "output/map_images.hpp"

namespace hedgehop::output {

/// Numbers that the plan's config states and pictures show. A config of another version may lack
/// some of them; then they are not drawn.
struct PlanDemands {
  std::optional<double> reference_height_m;
  std::optional<double> ceiling_height_m;
  std::optional<double> required_clearance_m;
  std::optional<double> bank_max_rad;
};
PlanDemands demands_of(const std::string& config_text);

/// Heading and target heading, followed through north instead of jumping there: the flown heading
/// may leave [0, 360), the target lies within half a turn of it. One entry for each state.
struct Headings {
  std::vector<double> flown_deg;
  std::vector<double> target_deg;
  double low_deg = 0.0;
  double high_deg = 0.0;
};
Headings followed_headings(const flight::Trajectory& trajectory);

/// Part of the map around both paths of all these plans and these further routes, with a margin.
/// Throws DataError if they lie outside the map.
MapWindow window_around(const std::vector<const flight::Plan*>& plans, const map::Map& map,
                        const std::vector<const std::vector<flight::Waypoint>*>& routes = {});

/// "#rrggbb" in which one of several routes to choose from is drawn; 0 is the plan's own.
std::string choice_color(std::size_t choice);

/// 1, 2 or 5 times a power of ten, at most `value` > 0.
double round_number_below(double value);

}  // namespace hedgehop::output
