#include "evaluation/flight_evaluation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <utility>

#include "base/errors.hpp"

namespace hedgehop::evaluation {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::int64_t kTriesPerPlan = 4;

DrawingRules read_drawing(ConfigReader& reader) {
  DrawingRules rules;
  rules.margin_m = reader.required_double("margin_m");
  reader.require(rules.margin_m >= 0.0, "margin_m", "must not be negative");
  rules.distance_min_m = reader.required_double("distance_min_m");
  reader.require(rules.distance_min_m > 0.0, "distance_min_m", "must be above 0");
  rules.draws_max = reader.required_integer("draws_max");
  reader.require(rules.draws_max >= 1, "draws_max", "must be at least 1");
  return rules;
}

Json number_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(); }

}  // namespace

BusOptions read_bus_options(ConfigReader& reader) {
  BusOptions options;
  options.lockstep_steps = reader.required_integer("lockstep_steps");
  reader.require(options.lockstep_steps >= 1, "lockstep_steps", "must be at least 1");
  options.plans = reader.required_integer("plans");
  reader.require(options.plans >= 0 && options.plans <= 1000, "plans", "must lie in 0 to 1000");
  options.repeats = reader.required_integer("repeats");
  reader.require(options.repeats >= 1 && options.repeats <= 100, "repeats", "must lie in 1 to 100");
  options.drawing = read_drawing(reader);
  options.loss_percents = reader.required_doubles("loss_percents");
  for (const double percent : options.loss_percents) {
    reader.require(percent >= 0.0 && percent <= 90.0, "loss_percents", "must lie in 0 to 90");
  }
  options.timeout_s = reader.required_double("timeout_s");
  reader.require(options.timeout_s >= 1.0, "timeout_s", "must be at least 1");
  options.cell_m = reader.required_double("cell_m");
  reader.require(options.cell_m >= 5.0 && options.cell_m <= 100.0, "cell_m",
                 "must lie in 5 to 100");
  reader.finish();
  return options;
}

FlightOptions read_flight_options(ConfigReader& reader) {
  FlightOptions options;
  options.plans = reader.required_integer("plans");
  reader.require(options.plans >= 1 && options.plans <= 100000, "plans", "must lie in 1 to 100000");
  options.drawing = read_drawing(reader);
  options.wind_mps = reader.required_double("wind_mps");
  reader.require(options.wind_mps >= 0.0 && options.wind_mps <= 30.0, "wind_mps",
                 "must lie in 0 to 30");
  options.turbulence_wind_6m_mps = reader.required_double("turbulence_wind_6m_mps");
  reader.require(options.turbulence_wind_6m_mps >= 0.0 && options.turbulence_wind_6m_mps <= 40.0,
                 "turbulence_wind_6m_mps", "must lie in 0 to 40");
  const auto margin = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value > 0.0, key, "must be above 0");
    return value;
  };
  options.horizontal_margin_m = margin("horizontal_margin_m");
  options.below_margin_m = margin("below_margin_m");
  options.above_margin_m = margin("above_margin_m");
  reader.finish();
  return options;
}

FlightResult evaluate_flight(const map::Map& map, const planning::PlanningConfig& config,
                             const FlightOptions& options,
                             const command_model::RotorParameters& rotor,
                             const command_model::FollowerOptions& follower, std::uint64_t seed,
                             Observer& observer) {
  const geo::MapProjection projection(map.crs_wkt);
  const DrawnProblems drawn =
      draw_problems(map, options.drawing, kTriesPerPlan * options.plans, seed);
  std::vector<flight::Plan> plans;
  FlightResult result;
  result.seed = seed;
  for (const DrawnProblem& problem : drawn.problems) {
    if (static_cast<std::int64_t>(plans.size()) == options.plans) {
      break;
    }
    observer.check_stop();
    observer.progress("planning", static_cast<double>(plans.size()),
                      static_cast<double>(options.plans));
    ++result.problems;
    flight::PlanRequest request;
    request.start.position = projection.to_geodetic(problem.start);
    request.goal.position = projection.to_geodetic(problem.goal);
    request.seed = seed;
    SilentObserver silent;
    auto planned = planning::plan(map, request, config, {}, silent);
    if (auto* plan = std::get_if<flight::Plan>(&planned); plan && plan->verdict.is_verified) {
      plans.push_back(std::move(*plan));
    }
  }
  if (static_cast<std::int64_t>(plans.size()) < options.plans) {
    throw DataError("of " + std::to_string(result.problems) + " drawn problems only " +
                        std::to_string(plans.size()) + " have a verified plan",
                    "another --seed, fewer --plans or a larger map");
  }
  result.plans = static_cast<std::int64_t>(plans.size());
  result.wind_mps = options.wind_mps;
  result.turbulence_wind_6m_mps = options.turbulence_wind_6m_mps;
  result.horizontal_margin_m = options.horizontal_margin_m;
  result.below_margin_m = options.below_margin_m;
  result.above_margin_m = options.above_margin_m;

  std::mt19937_64 random(seed);
  std::vector<command_model::Wind> winds;
  for (std::size_t i = 0; i < plans.size(); ++i) {
    // Not std::uniform_real_distribution, whose draws are each library's own.
    const double angle_rad =
        2.0 * std::numbers::pi * static_cast<double>(random() >> 11) / 9007199254740992.0;
    winds.push_back(
        {options.wind_mps * std::cos(angle_rad), options.wind_mps * std::sin(angle_rad)});
  }

  std::vector<flight::Wind> planned_winds;
  for (const flight::Plan& plan : plans) {
    planned_winds.push_back(
        planning::in_wind(config, map.crs_wkt, plan.route_plan.start.point()).vehicle.wind);
  }

  const auto model = std::make_shared<const command_model::CommandModel>(config.vehicle);
  const auto rotor_plant = std::make_shared<const command_model::RotorPlant>(rotor);
  result.rotor_power_kw = 1e-3 * rotor_plant->power_max_w();
  result.is_held = true;
  std::vector<std::pair<bool, bool>> airs = {{false, false}, {true, false}};
  if (options.turbulence_wind_6m_mps > 0.0) {
    airs.emplace_back(true, true);
  }
  for (const bool is_rotor : {false, true}) {
    for (const bool has_feed_forward : {true, false}) {
      for (const auto& [has_wind, has_turbulence] : airs) {
        const command_model::Plant plant =
            is_rotor ? command_model::Plant(rotor_plant) : command_model::Plant(model);
        FlightRow row;
        row.plant = is_rotor ? "rotor" : "closed_loop";
        row.has_feed_forward = has_feed_forward;
        row.has_wind = has_wind;
        row.has_turbulence = has_turbulence;
        for (std::size_t i = 0; i < plans.size(); ++i) {
          observer.check_stop();
          const flight::Wind& planned = planned_winds[i];
          const flight::Wind wind = has_wind ? flight::Wind{planned.east_mps + winds[i].east_mps,
                                                            planned.north_mps + winds[i].north_mps}
                                             : planned;
          const command_model::PathFlight flight = command_model::flown_path(
              plans[i].trajectory, plant, follower, has_feed_forward, wind, planned,
              {has_turbulence ? options.turbulence_wind_6m_mps : 0.0, seed + i});
          const command_model::PathRecord& record = flight.record();
          ++row.flights;
          row.arrived += flight.has_arrived() ? 1 : 0;
          const bool is_within = record.horizontal_max_m <= options.horizontal_margin_m &&
                                 record.below_max_m <= options.below_margin_m &&
                                 record.above_max_m <= options.above_margin_m;
          row.within_margins += is_within && flight.has_arrived() ? 1 : 0;
          row.horizontal_max_m = std::max(row.horizontal_max_m, record.horizontal_max_m);
          row.below_max_m = std::max(row.below_max_m, record.below_max_m);
          row.above_max_m = std::max(row.above_max_m, record.above_max_m);
          row.horizontal_rms_m += record.horizontal_rms_m() / static_cast<double>(plans.size());
          row.vertical_rms_m += record.vertical_rms_m() / static_cast<double>(plans.size());
          row.power_share_max =
              std::max(row.power_share_max, record.power_max_w / rotor_plant->power_max_w());
          row.power_limited_flights += record.power_limited_steps > 0 ? 1 : 0;
        }
        if (!is_rotor) {
          row.power_share_max = std::numeric_limits<double>::quiet_NaN();
        }
        row.torque_margin_min = 1.0 - row.power_share_max;
        // NaN without a rotor
        const bool has_power = !(row.torque_margin_min < 0.0);
        if (!has_turbulence) {
          result.is_held = result.is_held && row.within_margins == row.flights &&
                           (has_power || !has_feed_forward);
        }
        result.rows.push_back(row);
      }
    }
  }
  return result;
}

std::string flight_result_json(const FlightResult& result) {
  Json json = {{"schema", "hedgehop evaluate flight"},
               {"schema_version", 1},
               {"seed", result.seed},
               {"problems", result.problems},
               {"plans", result.plans},
               {"wind_mps", result.wind_mps},
               {"turbulence_wind_6m_mps", result.turbulence_wind_6m_mps},
               {"horizontal_margin_m", result.horizontal_margin_m},
               {"below_margin_m", result.below_margin_m},
               {"above_margin_m", result.above_margin_m},
               {"rotor_power_kw", result.rotor_power_kw},
               {"is_held", result.is_held},
               {"rows", Json::array()}};
  for (const FlightRow& row : result.rows) {
    json["rows"].push_back({{"plant", row.plant},
                            {"feed_forward", row.has_feed_forward},
                            {"wind", row.has_wind},
                            {"turbulence", row.has_turbulence},
                            {"flights", row.flights},
                            {"arrived", row.arrived},
                            {"within_margins", row.within_margins},
                            {"horizontal_max_m", row.horizontal_max_m},
                            {"horizontal_rms_m", row.horizontal_rms_m},
                            {"below_max_m", row.below_max_m},
                            {"above_max_m", row.above_max_m},
                            {"vertical_rms_m", row.vertical_rms_m},
                            {"power_share_max", number_or_null(row.power_share_max)},
                            {"torque_margin_min", number_or_null(row.torque_margin_min)},
                            {"power_limited_flights", row.power_limited_flights}});
  }
  return json.dump(2) + "\n";
}

}  // namespace hedgehop::evaluation
