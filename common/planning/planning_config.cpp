#include <algorithm>
#include <cmath>
#include <filesystem>

#include "base/angles.hpp"
#include "base/config_entries.hpp"
#include "base/config_reader.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "base/shipped_config.hpp"
#include "geo/map_projection.hpp"
#include "planning/config_origins.hpp"
#include "planning/planning.hpp"

namespace hedgehop::planning {
namespace {

constexpr char kShippedName[] = "config/planning.yaml";
constexpr char kHeadingLabels[] = "global.heading_labels";

// A vehicle is named by a path: beside the user's config, or one that ships with hedgehop.
struct VehicleText {
  std::string text;
  std::string source;
};

VehicleText vehicle_text(const std::string& vehicle_file, const std::string& config_file) {
  if (!config_file.empty()) {
    const std::filesystem::path beside =
        std::filesystem::path(config_file).parent_path() / vehicle_file;
    std::error_code error;
    if (std::filesystem::is_regular_file(beside, error)) {
      return {read_file(beside), beside.string()};
    }
  }
  for (const std::string& name : shipped_config_names()) {
    if (name == vehicle_file) {
      return {std::string(shipped_config(name)), "config/" + name};
    }
  }
  throw ConfigError((config_file.empty() ? kShippedName : config_file) +
                        std::string(": vehicle_file '") + vehicle_file +
                        "' exists neither beside the config nor among the shipped ones",
                    "vehicles/ec135.yaml is shipped; hedgehop config list shows all");
}

// The command model must be able to follow its limits: at the hardest braking and the hardest
// acceleration they may not change faster than its climb rate.
void check_power_limits(const flight::PowerLimits& power, const flight::Limits& limits) {
  constexpr double kStep_mps = 0.5;
  const double speeding_mps2 = kGravity_mps2 * elementary::tan(limits.pitch_max_rad);
  for (double altitude_m = -500.0; altitude_m <= 9000.0; altitude_m += 500.0) {
    for (double speed_mps = limits.speed_min_mps; speed_mps < limits.speed_max_mps;
         speed_mps += kStep_mps) {
      const flight::VerticalRates a = power.rates(speed_mps, altitude_m);
      const flight::VerticalRates b = power.rates(speed_mps + kStep_mps, altitude_m);
      const double change_mps =
          std::max(std::fabs(b.climb_mps - a.climb_mps),
                   std::fabs(std::min(b.descent_mps, limits.descent_rate_max_mps) -
                             std::min(a.descent_mps, limits.descent_rate_max_mps)));
      if (change_mps / kStep_mps * speeding_mps2 > 0.9 * limits.vertical_acceleration_max_mps2) {
        throw ConfigError("the power curve of the vehicle changes its vertical limits by " +
                              std::to_string(change_mps / kStep_mps) + " m/s per m/s of speed at " +
                              std::to_string(speed_mps) +
                              " m/s, faster than its climb rate can follow when it brakes",
                          "a smaller power.vortex_descent_slope, or a "
                          "greater limits.vertical_acceleration_max_mps2");
      }
    }
  }
}

}  // namespace

PlanningConfig in_wind(const PlanningConfig& config, const std::string& crs_wkt,
                       const geo::MapPoint& start) {
  PlanningConfig result = config;
  if (config.conditions.wind_mps == 0.0) {
    return result;
  }
  const flight::Wind wind =
      config.conditions.wind(geo::MapProjection(crs_wkt).convergence_rad(start));
  result.vehicle.wind = wind;
  result.demands.wind = wind;
  result.global.wind = wind;
  const double slowest_mps = wind.speed_mps() / flight::kWindShareMax;
  result.local.slow_speed_mps = std::max(config.local.slow_speed_mps, slowest_mps);
  std::erase_if(result.local.retry_speeds_mps,
                [&](double speed_mps) { return speed_mps < slowest_mps; });
  return result;
}

global_planning::GlobalOptions global_options(const PlanningConfig& config, double speed_mps) {
  global_planning::GlobalOptions options = config.global;
  options.airspeed_mps = speed_mps;
  if (config.vehicle.power_limits) {
    const double share = config.local.climb_share / speed_mps;
    options.vehicle_slopes = std::make_shared<const global_planning::SlopeLimits>(
        elementary::tan(options.climb_angle_max_rad),
        elementary::tan(options.descent_angle_max_rad), [&](double altitude_m) {
          const flight::VerticalRates rates = config.vehicle.vertical_rates(speed_mps, altitude_m);
          return global_planning::SlopeLimits::Tangents{share * rates.climb_mps,
                                                        share * rates.descent_mps};
        });
  }
  return options;
}

PlanningConfig read_planning_config(const std::string& text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(text, name);
  PlanningConfig config{.text = canonical_config(text, name),
                        .reference_height_m = reader.required_double("reference_height_m"),
                        .speed_mps = reader.required_double("speed_mps"),
                        .unknown_visibility = reader.required_double("unknown_visibility"),
                        .small_patch_m = reader.required_double("small_patch_m"),
                        .weights = {},
                        .semantics = risk::SemanticCostTable({}, 0.0),
                        .global = {},
                        .local = {},
                        .demands = {},
                        .vehicle = {}};
  reader.require(config.reference_height_m > 0.0, "reference_height_m", "must be above 0");
  reader.require(config.unknown_visibility >= 0.0 && config.unknown_visibility <= 1.0,
                 "unknown_visibility", "must lie between 0 and 1");
  reader.require(config.small_patch_m >= 0.0 && config.small_patch_m <= 10000.0, "small_patch_m",
                 "must lie between 0 and 10000");
  ConfigReader weights = reader.required_section("weights");
  config.weights = risk::read_weights(weights);
  ConfigReader semantics = reader.required_section("semantics");
  config.semantics = risk::SemanticCostTable::read(semantics);
  ConfigReader global = reader.required_section("global");
  config.global = global_planning::read_global_options(global);
  ConfigReader local = reader.required_section("local");
  config.local = local_planning::read_local_options(local);
  ConfigReader demands = reader.required_section("verification");
  config.demands = verification::read_demands(demands);
  ConfigReader vehicle = reader.required_section("vehicle");
  config.vehicle = command_model::read_vehicle(vehicle);
  ConfigReader conditions = reader.required_section("conditions");
  config.conditions = flight::read_conditions(conditions);
  if (config.conditions.is_power_used) {
    reader.require(config.vehicle.power.has_value(), "vehicle",
                   "has no section `power`, which conditions.use_power_curve needs");
    config.vehicle.power_limits.emplace(*config.vehicle.power, config.conditions);
    check_power_limits(*config.vehicle.power_limits, config.vehicle.limits);
    config.demands.power = verification::PowerDemand{*config.vehicle.power, config.conditions};
  }
  reader.finish();
  if (config.conditions.wind_mps > 0.0 && config.global.use_roadmap) {
    throw ConfigError(name +
                          ": global.planner: roadmap knows no wind, and conditions.wind_mps is " +
                          std::to_string(config.conditions.wind_mps),
                      "global.planner: lattice, or conditions.wind_mps: 0");
  }
  reader.require(config.speed_mps >= config.vehicle.limits.speed_min_mps &&
                     config.speed_mps <= config.vehicle.limits.speed_max_mps,
                 "speed_mps", "must lie within the vehicle's speed limits");
  config.global = global_options(config, config.speed_mps);
  return config;
}

namespace {

// What an effective config is put together from.
struct Parts {
  std::string shipped;
  std::string overlay;  // of --config; empty: none
  VehicleText vehicle;
};

Parts parts_of(const std::string& config_file) {
  Parts parts;
  parts.shipped = shipped_config("planning.yaml");
  std::string vehicle_file = config_word(parts.shipped, kShippedName, "vehicle_file").value();
  if (!config_file.empty()) {
    parts.overlay = read_file(config_file);
    if (const auto chosen = config_word(parts.overlay, config_file, "vehicle_file")) {
      vehicle_file = *chosen;
    }
  }
  parts.vehicle = vehicle_text(vehicle_file, config_file);
  return parts;
}

std::string merged(const Parts& parts, const std::string& config_file,
                   const std::vector<std::string>& settings) {
  std::string text = without_config_key(parts.shipped, kShippedName, "vehicle_file");
  text =
      with_config_section(text, kShippedName, "vehicle", parts.vehicle.text, parts.vehicle.source);
  if (!config_file.empty()) {
    // The overlay itself is merged, not a copy of it: errors then name the line that the user
    // wrote.
    text = overlay_config(text, kShippedName, parts.overlay, config_file, {"vehicle_file"});
  }
  for (const std::string& setting : settings) {
    text = set_config_value(text, setting);
  }
  return canonical_config(text, "effective configuration");
}

}  // namespace

std::string effective_planning_config(const std::string& config_file,
                                      const std::vector<std::string>& settings) {
  return merged(parts_of(config_file), config_file, settings);
}

std::vector<ConfigOrigin> planning_config_origins(const std::string& config_file,
                                                  const std::vector<std::string>& settings) {
  const Parts parts = parts_of(config_file);
  std::vector<ConfigOrigin> origins;
  for (ConfigEntry& entry :
       config_entries(merged(parts, config_file, settings), "effective configuration")) {
    origins.push_back({std::move(entry.key), std::move(entry.value), "", 0});
  }
  // Later ones win.
  const auto claim = [&](const std::string& text, const std::string& source,
                         const std::string& prefix) {
    for (const ConfigEntry& entry : config_entries(text, source)) {
      for (ConfigOrigin& origin : origins) {
        if (origin.key == prefix + entry.key) {
          origin.source = source;
          origin.line = entry.line;
        }
      }
    }
  };
  claim(parts.shipped, kShippedName, "");
  claim(parts.vehicle.text, parts.vehicle.source, "vehicle.");
  if (!config_file.empty()) {
    claim(parts.overlay, config_file, "");
  }
  for (const std::string& setting : settings) {
    const std::string key = setting.substr(0, setting.find('='));
    for (ConfigOrigin& origin : origins) {
      if (origin.key == key || origin.key.starts_with(key + ".")) {
        origin.source = "--set " + setting;
        origin.line = 0;
      }
    }
  }
  return origins;
}

PlanningConfig read_recorded_config(const std::string& text, const std::string& name) {
  std::string known = text;
  std::vector<std::string> settings;
  for (const ConfigEntry& entry : config_entries(text, name)) {
    if (entry.key == kHeadingLabels) {
      // Until turn_rule took its place: whether the first route is searched over directed edges.
      known = without_config_key(text, name, kHeadingLabels);
      settings.emplace_back(entry.value == "false" ? "global.turn_rule=insertion"
                                                   : "global.turn_rule=heading_labels");
    }
  }
  return read_planning_config(
      overlay_config(effective_planning_config("", settings), kShippedName, known, name), name);
}

}  // namespace hedgehop::planning
