#include <algorithm>

#include "base/errors.hpp"
#include "preparation/prepare.hpp"

namespace hedgehop::preparation {

PrepareOptions PrepareOptions::read(ConfigReader& reader) {
  PrepareOptions options;
  const auto within = [](ConfigReader& section, const char* key, double low, double high) {
    const double value = section.required_double(key);
    section.require(value >= low && value <= high, key,
                    "must lie in " + std::to_string(low) + " to " + std::to_string(high));
    return value;
  };
  options.cell_m = within(reader, "cell_m", 1.0, 1000.0);
  options.cells_max = reader.required_integer("cells_max");
  reader.require(options.cells_max >= 1 && options.cells_max <= 400'000'000, "cells_max",
                 "must lie in 1 to 400000000");
  const std::string datum = reader.required_string("vertical_datum");
  try {
    options.vertical_datum = geo::VerticalDatum::parse(datum);
  } catch (const UsageError& error) {
    reader.refuse("vertical_datum", std::string("is not known: ") + error.hint());
  }
  options.void_fill_radius_m = within(reader, "void_fill_radius_m", 0.0, 1000.0);

  ConfigReader attributions = reader.required_section("attributions");
  options.attribution_srtm = attributions.required_string("srtm");
  options.attribution_openstreetmap = attributions.required_string("openstreetmap");
  attributions.finish();

  ConfigReader heights = reader.required_section("default_heights");
  const auto height_m = [&](const char* key) { return within(heights, key, 0.0, 1000.0); };
  options.default_heights.forest_m = height_m("forest_m");
  options.default_heights.tree_m = height_m("tree_m");
  options.default_heights.building_m = height_m("building_m");
  options.default_heights.building_level_m = height_m("building_level_m");
  options.default_heights.structure_m = height_m("structure_m");
  options.default_heights.built_up_area_m = height_m("built_up_area_m");
  options.default_heights.power_line_m = height_m("power_line_m");
  options.default_heights.minor_power_line_m = height_m("minor_power_line_m");
  options.default_heights.mast_m = height_m("mast_m");
  options.default_heights.tower_m = height_m("tower_m");
  options.default_heights.chimney_m = height_m("chimney_m");
  options.default_heights.wind_turbine_m = height_m("wind_turbine_m");
  options.default_heights.aerialway_m = height_m("aerialway_m");
  options.default_heights.drag_lift_m = height_m("drag_lift_m");
  heights.finish();

  ConfigReader obstacles = reader.required_section("obstacles");
  const auto radius_m = [&](const char* key) { return within(obstacles, key, 0.0, 10000.0); };
  options.obstacles.safety_radius_m = radius_m("safety_radius_m");
  options.obstacles.wind_turbine_radius_m = radius_m("wind_turbine_radius_m");
  options.obstacles.unknown_horizontal_error_m = radius_m("unknown_horizontal_error_m");
  options.obstacles.unknown_vertical_error_m = radius_m("unknown_vertical_error_m");
  obstacles.finish();

  ConfigReader areas = reader.required_section("areas");
  options.areas.hard_kinds = areas.required_strings("hard_kinds");
  options.areas.soft_kinds = areas.required_strings("soft_kinds");
  areas.finish();

  ConfigReader settlements = reader.required_section("settlements");
  const auto distance_m = [&](const char* key) { return within(settlements, key, 0.0, 10000.0); };
  options.settlements.grow_m = distance_m("grow_m");
  options.settlements.shrink_m = distance_m("shrink_m");
  options.settlements.village_area_max_m2 = within(settlements, "village_area_max_m2", 0.0, 1e9);
  options.settlements.village_adequate_m = distance_m("village_adequate_m");
  options.settlements.village_desired_m = distance_m("village_desired_m");
  options.settlements.settlement_adequate_m = distance_m("settlement_adequate_m");
  options.settlements.settlement_desired_m = distance_m("settlement_desired_m");
  options.settlements.visibility_min = within(settlements, "visibility_min", 0.0, 1.0);
  settlements.finish();

  ConfigReader visibility = reader.required_section("visibility");
  options.visibility.radius_m = within(visibility, "radius_m", 60.0, 20000.0);
  options.visibility.reference_height_m = within(visibility, "reference_height_m", 0.0, 1000.0);
  const std::int64_t azimuths = visibility.required_integer("azimuths");
  visibility.require(azimuths >= 8 && azimuths <= 1000 && azimuths % 4 == 0, "azimuths",
                     "must be a multiple of 4 in 8 to 1000");
  options.visibility.azimuths = static_cast<int>(azimuths);
  options.visibility.is_earth_curved = visibility.required_bool("earth_curvature");
  options.visibility.refraction = within(visibility, "refraction", 0.0, 0.9);
  options.visibility.further_heights_m = visibility.required_doubles("further_heights_m");
  std::vector<double>& heights_m = options.visibility.further_heights_m;
  std::sort(heights_m.begin(), heights_m.end());
  for (const double further_m : heights_m) {
    visibility.require(further_m >= 0.0 && further_m <= 10000.0, "further_heights_m",
                       "must lie in 0 to 10000");
    visibility.require(std::count(heights_m.begin(), heights_m.end(), further_m) == 1 &&
                           further_m != options.visibility.reference_height_m,
                       "further_heights_m", "must not hold a height twice, nor reference_height_m");
  }
  visibility.require(heights_m.size() <= 64, "further_heights_m", "must not hold more than 64");
  ConfigReader weights = visibility.required_section("ground_weights");
  options.ground_weights.forest = within(weights, "forest", 0.0, 1.0);
  options.ground_weights.urban = within(weights, "urban", 0.0, 1.0);
  options.ground_weights.water = within(weights, "water", 0.0, 1.0);
  options.ground_weights.open = within(weights, "open", 0.0, 1.0);
  weights.finish();
  visibility.finish();
  reader.finish();
  return options;
}

}  // namespace hedgehop::preparation
