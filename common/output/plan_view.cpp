#include "output/plan_view.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/angles.hpp"
#include "base/config_reader.hpp"
#include "base/errors.hpp"

namespace hedgehop::output {

PlanDemands demands_of(const std::string& config_text) {
  PlanDemands demands;
  const auto try_to = [&](const auto& read) {
    try {
      ConfigReader reader = ConfigReader::from_text(config_text, "config of the plan");
      read(reader);
    } catch (const UserError&) {
    }
  };
  try_to([&](ConfigReader& reader) {
    demands.reference_height_m = reader.required_double("reference_height_m");
  });
  try_to([&](ConfigReader& reader) {
    ConfigReader section = reader.required_section("verification");
    demands.ceiling_height_m = section.required_double("ceiling_height_m");
    demands.required_clearance_m = section.required_double("required_clearance_m");
  });
  try_to([&](ConfigReader& reader) {
    ConfigReader vehicle = reader.required_section("vehicle");
    ConfigReader limits = vehicle.required_section("limits");
    demands.bank_max_rad = limits.required_angle("bank_max_deg");
  });
  return demands;
}

Headings followed_headings(const flight::Trajectory& trajectory) {
  Headings headings;
  double flown_rad = wrap_to_two_pi(trajectory.states.front().heading_true_rad);
  headings.low_deg = std::numeric_limits<double>::infinity();
  headings.high_deg = -headings.low_deg;
  for (const flight::FlightState& state : trajectory.states) {
    const double step_rad = wrap_to_pi(state.heading_true_rad - flown_rad);
    flown_rad += std::isnan(step_rad) ? 0.0 : step_rad;
    headings.flown_deg.push_back(degrees_from_radians(flown_rad));
    headings.target_deg.push_back(
        degrees_from_radians(flown_rad + wrap_to_pi(state.target_heading_true_rad - flown_rad)));
    for (const double value : {headings.flown_deg.back(), headings.target_deg.back()}) {
      headings.low_deg = std::fmin(headings.low_deg, value);
      headings.high_deg = std::fmax(headings.high_deg, value);
    }
  }
  return headings;
}

MapWindow window_around(const std::vector<const flight::Plan*>& plans, const map::Map& map,
                        const std::vector<const std::vector<flight::Waypoint>*>& routes) {
  const raster::GridGeometry& g = map.geometry;
  MapWindow window{1e300, 1e300, -1e300, -1e300};
  const auto include = [&](const geo::MapPoint& p) {
    window.west_m = std::min(window.west_m, p.x_m);
    window.east_m = std::max(window.east_m, p.x_m);
    window.south_m = std::min(window.south_m, p.y_m);
    window.north_m = std::max(window.north_m, p.y_m);
  };
  for (const flight::Plan* plan : plans) {
    for (const flight::FlightState& state : plan->trajectory.states) {
      include(state.point());
    }
    for (const flight::Waypoint& waypoint : plan->route_plan.route.waypoints) {
      include(waypoint.point());
    }
  }
  for (const std::vector<flight::Waypoint>* route : routes) {
    for (const flight::Waypoint& waypoint : *route) {
      include(waypoint.point());
    }
  }
  const double longest_m = std::max(window.width_m(), window.height_m());
  const double margin_m = std::max(800.0, 0.10 * longest_m);
  // A flight along an axis still gets a picture with two sides.
  const auto grown = [&](double& low_m, double& high_m, double least_m, double lowest_m,
                         double highest_m) {
    const double half_m =
        std::max(0.5 * (high_m - low_m) + margin_m, 0.5 * std::max(least_m, 10.0 * g.cell_m));
    const double centre_m = 0.5 * (low_m + high_m);
    low_m = std::max(centre_m - half_m, lowest_m);
    high_m = std::min(centre_m + half_m, highest_m);
  };
  grown(window.west_m, window.east_m, 0.5 * longest_m, g.west_m, g.east_m());
  grown(window.south_m, window.north_m, 0.5 * longest_m, g.south_m, g.north_m());
  if (!(window.width_m() > g.cell_m) || !(window.height_m() > g.cell_m)) {
    throw DataError("figures: the plan lies outside its map",
                    "give the map that the plan was made on");
  }
  return window;
}

std::string choice_color(std::size_t choice) {
  static constexpr std::array<const char*, 6> kColors = {"#9be564", "#ff5fa2", "#ffb000",
                                                         "#b58cff", "#35d0ba", "#ff7043"};
  return kColors[choice % kColors.size()];
}

double round_number_below(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  return power * (value >= 5.0 * power ? 5.0 : value >= 2.0 * power ? 2.0 : 1.0);
}

}  // namespace hedgehop::output
