#include "local_planning/vertical_pass.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "base/elementary.hpp"
#include "local_planning/lowest_profile.hpp"

namespace hedgehop::local_planning {
namespace {

using command_model::Command;
using command_model::CommandModel;
using command_model::ModelState;

constexpr double kSample_m = 2.5;      // along the middle line and the edges of a strip
constexpr double kKnotSag_m = 0.1;     // what a profile between knots may lie lower than at them
constexpr double kPullBack_1ps = 0.5;  // of the altitude towards the profile
constexpr double kPullBackMax_mps = 1.0;

struct Profile {
  std::vector<double> altitude_m;  // by step of the flight
  std::vector<double> climb_rate_mps;
};

double distance_m(const ModelState& a, const ModelState& b) {
  const double dx_m = a.x_m - b.x_m;
  const double dy_m = a.y_m - b.y_m;
  return std::sqrt(dx_m * dx_m + dy_m * dy_m);
}

std::size_t nearest_step(const std::vector<FlownStep>& steps, const flight::Waypoint& place) {
  std::size_t nearest = 0;
  double nearest_m2 = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const double dx_m = steps[i].state.x_m - place.x_m;
    const double dy_m = steps[i].state.y_m - place.y_m;
    if (dx_m * dx_m + dy_m * dy_m < nearest_m2) {
      nearest_m2 = dx_m * dx_m + dy_m * dy_m;
      nearest = i;
    }
  }
  return nearest;
}

// Altitudes and rates of each step: the climb rate is linear between the middles of the intervals
// between knots.
Profile sampled(const std::vector<double>& knots_m, double knot_s, double start_rate_mps,
                std::size_t steps, double step_s) {
  Profile profile;
  const auto rate_of = [&](std::size_t interval) {
    return (knots_m[interval + 1] - knots_m[interval]) / knot_s;
  };
  const std::size_t intervals = knots_m.size() - 1;
  double altitude_m = knots_m.front();
  double rate_mps = start_rate_mps;
  for (std::size_t i = 0; i < steps; ++i) {
    const double middles = static_cast<double>(i) * step_s / knot_s - 0.5;
    double next_mps = 0.0;
    if (middles < 0.0) {
      next_mps = start_rate_mps + (rate_of(0) - start_rate_mps) * (middles + 0.5) / 0.5;
    } else {
      const auto interval = std::min(static_cast<std::size_t>(middles), intervals - 1);
      const std::size_t after = std::min(interval + 1, intervals - 1);
      const double share = std::min(1.0, middles - static_cast<double>(interval));
      next_mps = rate_of(interval) + share * (rate_of(after) - rate_of(interval));
    }
    if (i > 0) {
      altitude_m += 0.5 * step_s * (rate_mps + next_mps);
    }
    rate_mps = next_mps;
    profile.altitude_m.push_back(altitude_m);
    profile.climb_rate_mps.push_back(rate_mps);
  }
  return profile;
}

// The climb-rate command that makes the model's next climb rate `next_mps`, see CommandModel.
double command_for(const ModelState& state, double next_mps, const CommandModel& model,
                   double response) {
  const flight::Limits& limits = model.vehicle().limits;
  const command_model::ModelParameters& constants = model.vehicle().model;
  const double collective_mps = state.climb_rate_mps + (next_mps - state.climb_rate_mps) / response;
  const double command_mps = state.climb_rate_mps + (collective_mps - state.climb_integral_mps +
                                                     constants.climb_derivative_gain_s *
                                                         state.vertical_acceleration_mps2) /
                                                        constants.climb_gain;
  return std::clamp(command_mps, -limits.descent_rate_max_mps, limits.climb_rate_max_mps);
}

}  // namespace

double highest_beside_m(const raster::Grid<float>& surface_m, const geo::MapPoint& from,
                        const geo::MapPoint& to, double margin_m) {
  const raster::GridGeometry& geometry = surface_m.geometry();
  const double dx_m = to.x_m - from.x_m;
  const double dy_m = to.y_m - from.y_m;
  const double length_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
  double highest_m = -std::numeric_limits<double>::infinity();
  bool is_known = true;
  const auto count = [&](double height_m) {
    is_known = is_known && !std::isnan(height_m);
    highest_m = std::max(highest_m, height_m);
  };

  const raster::CellIndex low = geometry.cell_at(
      {std::min(from.x_m, to.x_m) - margin_m, std::min(from.y_m, to.y_m) - margin_m});
  const raster::CellIndex high = geometry.cell_at(
      {std::max(from.x_m, to.x_m) + margin_m, std::max(from.y_m, to.y_m) + margin_m});
  if (!geometry.contains(low) || !geometry.contains(high)) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  for (int row = low.row; row <= high.row; ++row) {
    for (int column = low.column; column <= high.column; ++column) {
      const geo::MapPoint centre = geometry.centre({column, row});
      const double cx_m = centre.x_m - from.x_m;
      const double cy_m = centre.y_m - from.y_m;
      const double share =
          length_m > 0.0 ? std::clamp((cx_m * dx_m + cy_m * dy_m) / (length_m * length_m), 0.0, 1.0)
                         : 0.0;
      const double off_x_m = cx_m - share * dx_m;
      const double off_y_m = cy_m - share * dy_m;
      if (off_x_m * off_x_m + off_y_m * off_y_m <= margin_m * margin_m) {
        count(static_cast<double>(surface_m.at(column, row)));
      }
    }
  }
  const double side_x_m = length_m > 0.0 ? -dy_m / length_m * margin_m : 0.0;
  const double side_y_m = length_m > 0.0 ? dx_m / length_m * margin_m : 0.0;
  const int samples = std::max(1, static_cast<int>(std::ceil(length_m / kSample_m)));
  for (int i = 0; i <= samples; ++i) {
    const double share = static_cast<double>(i) / samples;
    const geo::MapPoint middle{from.x_m + share * dx_m, from.y_m + share * dy_m};
    for (const double side : {-1.0, 0.0, 1.0}) {
      count(raster::sample_bilinear(surface_m,
                                    {middle.x_m + side * side_x_m, middle.y_m + side * side_y_m}));
    }
  }
  return is_known ? highest_m : std::numeric_limits<double>::quiet_NaN();
}

std::optional<Flight> lowered_flight(const raster::Grid<float>& surface_m,
                                     const CommandModel& model, const VerticalPassOptions& options,
                                     const Flight& flight,
                                     const std::vector<flight::Waypoint>& held,
                                     const StepModel& step_model) {
  const std::vector<FlownStep>& steps = flight.steps;
  if (steps.size() < 2) {
    throw std::invalid_argument("a flight to lower needs two steps");
  }
  const auto stride =
      static_cast<std::size_t>(std::max(1.0, std::floor(options.knot_s / flight.step_s + 0.5)));
  const double knot_s = static_cast<double>(stride) * flight.step_s;
  const std::size_t intervals = (steps.size() + stride - 2) / stride;
  const auto state_at = [&](std::size_t knot) -> const ModelState& {
    return steps[std::min(knot * stride, steps.size() - 1)].state;
  };

  // Each knot answers for the intervals on both its sides.
  std::vector<double> floor_m(intervals + 1, -std::numeric_limits<double>::infinity());
  std::vector<double> weights(intervals + 1, 1.0);
  for (std::size_t k = 0; k < intervals; ++k) {
    const ModelState& from = state_at(k);
    const ModelState& to = state_at(k + 1);
    const double highest_m = highest_beside_m(surface_m, {from.x_m, from.y_m}, {to.x_m, to.y_m},
                                              options.lateral_margin_m);
    const double wanted_m = std::isnan(highest_m) ? std::max(from.altitude_m, to.altitude_m)
                                                  : highest_m + options.clearance_m + kKnotSag_m;
    floor_m[k] = std::max(floor_m[k], wanted_m);
    floor_m[k + 1] = std::max(floor_m[k + 1], wanted_m);
    weights[k + 1] = std::max(1e-3, distance_m(from, to) / (knot_s * from.speed_mps));
  }
  for (const flight::Waypoint& place : held) {
    const std::size_t nearest = nearest_step(steps, place);
    const double held_m = std::min(place.altitude_m, steps[nearest].state.altitude_m);
    const std::size_t before = nearest / stride;
    const std::size_t after = (nearest + stride - 1) / stride;
    floor_m[before] = std::max(floor_m[before], held_m);
    floor_m[after] = std::max(floor_m[after], held_m);
  }

  const flight::Limits& limits = model.vehicle().limits;
  const command_model::ModelParameters& constants = model.vehicle().model;
  const ModelState& initial = steps.front().state;
  ProfileLimits profile_limits{
      options.rate_share * limits.climb_rate_max_mps,
      options.rate_share * limits.descent_rate_max_mps,
      options.acceleration_share * limits.vertical_acceleration_max_mps2,
      // What the loop asks for to accelerate: at once (T + K_d) / K, and for long 1 / K_i.
      std::max(
          (constants.heave_time_constant_s + constants.climb_derivative_gain_s) /
              constants.climb_gain,
          constants.climb_integral_gain_1ps > 0.0 ? 1.0 / constants.climb_integral_gain_1ps : 0.0)};
  if (model.vehicle().power_limits) {
    // At the speeds and altitudes of the flight; below it there is more power. Where there is none
    // to climb with there is nothing to lower either.
    for (std::size_t k = 0; k < intervals; ++k) {
      const flight::VerticalRates from =
          model.vehicle().vertical_rates(state_at(k).speed_mps, state_at(k).altitude_m);
      const flight::VerticalRates to =
          model.vehicle().vertical_rates(state_at(k + 1).speed_mps, state_at(k + 1).altitude_m);
      const double climb_mps = options.rate_share * std::min(from.climb_mps, to.climb_mps);
      if (!(climb_mps > 0.0)) {
        return std::nullopt;
      }
      profile_limits.climb_rates_mps.push_back(climb_mps);
      profile_limits.descent_rates_mps.push_back(options.rate_share *
                                                 std::min(from.descent_mps, to.descent_mps));
    }
  }
  const std::optional<std::vector<double>> knots_m = lowest_profile(
      floor_m, weights, initial.altitude_m, initial.climb_rate_mps, knot_s, profile_limits);
  if (!knots_m) {
    return std::nullopt;
  }
  const Profile profile =
      sampled(*knots_m, knot_s, initial.climb_rate_mps, steps.size(), flight.step_s);

  Flight lowered;
  lowered.step_s = flight.step_s;
  lowered.decisions = flight.decisions;
  lowered.infeasible_decisions = flight.infeasible_decisions;
  lowered.steps.reserve(steps.size());
  const double response = 1.0 - elementary::exp(-flight.step_s / constants.heave_time_constant_s);
  ModelState state = initial;
  for (std::size_t i = 0; i + 1 < steps.size(); ++i) {
    const double astray_m = profile.altitude_m[i] - state.altitude_m;
    if (std::fabs(astray_m) > kFollowed_m || distance_m(state, steps[i].state) > kFollowed_m) {
      return std::nullopt;
    }
    const double next_mps =
        std::clamp(profile.climb_rate_mps[i + 1] +
                       std::clamp(kPullBack_1ps * astray_m, -kPullBackMax_mps, kPullBackMax_mps),
                   state.climb_rate_mps - limits.vertical_acceleration_max_mps2 * flight.step_s,
                   state.climb_rate_mps + limits.vertical_acceleration_max_mps2 * flight.step_s);
    FlownStep step = steps[i];
    step.state = state;
    step.command.climb_rate_mps = command_for(state, next_mps, model, response);
    step.commanded_climb_angle_rad =
        elementary::atan(step.command.climb_rate_mps / state.speed_mps);
    lowered.steps.push_back(step);
    state = step_model ? step_model(state, step.command, flight.step_s)
                       : model.step(state, step.command, flight.step_s);
  }
  FlownStep last = lowered.steps.back();
  last.state = state;
  lowered.steps.push_back(last);
  return lowered;
}

}  // namespace hedgehop::local_planning
