#include "command_model/path_flight.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::command_model {
namespace {

using Model = std::shared_ptr<const CommandModel>;
using Rotor = std::shared_ptr<const RotorPlant>;

Plant in_wind(Plant plant, const Wind& wind) {
  if (auto* model = std::get_if<Model>(&plant); model && (*model)->vehicle().wind != wind) {
    Vehicle vehicle = (*model)->vehicle();
    vehicle.wind = wind;
    return std::make_shared<const CommandModel>(vehicle);
  }
  return plant;
}

double root_mean(double square_sum, std::int64_t count) {
  return count > 0 ? std::sqrt(square_sum / static_cast<double>(count)) : 0.0;
}

}  // namespace

double PathRecord::horizontal_rms_m() const { return root_mean(horizontal_square_sum_m2, steps); }
double PathRecord::vertical_rms_m() const { return root_mean(vertical_square_sum_m2, steps); }

PathFlight::PathFlight(const flight::Trajectory& trajectory, Plant plant,
                       const FollowerOptions& options, bool has_feed_forward, const Wind& wind,
                       const Wind& planned_wind)
    : trajectory_(&trajectory),
      plant_(in_wind(std::move(plant), wind)),
      follower_(trajectory, options, has_feed_forward, planned_wind),
      wind_(wind) {
  const flight::FlightState& first = trajectory.states.front();
  const double course_rad = math_angle_from_azimuth_rad(
      grid_from_true_azimuth_rad(first.heading_true_rad, first.convergence_rad));
  const double east_mps = first.speed_mps * elementary::cos(course_rad) - wind.east_mps;
  const double north_mps = first.speed_mps * elementary::sin(course_rad) - wind.north_mps;
  const double airspeed_mps = std::sqrt(east_mps * east_mps + north_mps * north_mps);
  const double heading_rad = elementary::atan2(north_mps, east_mps);
  model_state_ = trimmed_state(first.x_m, first.y_m, first.altitude_m, airspeed_mps, heading_rad,
                               first.climb_rate_mps);
  if (const auto* rotor = std::get_if<Rotor>(&plant_)) {
    rotor_state_ = (*rotor)->trimmed(first.x_m, first.y_m, first.altitude_m, airspeed_mps,
                                     heading_rad, first.climb_rate_mps, wind);
    record_.power_max_w = rotor_state_.power_w;
  }
  command_ = {airspeed_mps, heading_rad, first.climb_rate_mps};
}

void PathFlight::take_over(const PathFlight& before) {
  if (plant_.index() != before.plant_.index()) {
    throw std::invalid_argument("a flight goes on with the plant that it has");
  }
  model_state_ = before.model_state_;
  rotor_state_ = before.rotor_state_;
  command_ = before.command_;
  turbulence_ = before.turbulence_;
  record_.power_max_w = rotor_state_.power_w;
}

FollowedState PathFlight::place() const {
  if (std::holds_alternative<Rotor>(plant_)) {
    return {rotor_state_.x_m, rotor_state_.y_m, rotor_state_.altitude_m};
  }
  return {model_state_.x_m, model_state_.y_m, model_state_.altitude_m};
}

Gust PathFlight::next_gust(double step_s) {
  if (!turbulence_) {
    return {};
  }
  const bool is_rotor = std::holds_alternative<Rotor>(plant_);
  const double east_mps = rotor_state_.east_mps - wind_.east_mps;
  const double north_mps = rotor_state_.north_mps - wind_.north_mps;
  const double airspeed_mps =
      is_rotor ? std::sqrt(east_mps * east_mps + north_mps * north_mps) : model_state_.speed_mps;
  const auto beside =
      static_cast<std::size_t>(std::max(0.0, follower_.plan_time_s() / trajectory_->step_s));
  const flight::FlightState& planned =
      trajectory_->states[std::min(beside, trajectory_->states.size() - 1)];
  return turbulence_->next(airspeed_mps * step_s, place().altitude_m - planned.terrain_m);
}

void PathFlight::step() {
  const double step_s = trajectory_->step_s;
  const double before_rad = command_.heading_math_rad;
  command_ = follower_.command(place(), wind_, step_s);
  command_.heading_math_rad =
      limited_heading_rad(before_rad, command_.heading_math_rad, heading_rate_max_radps_ * step_s);
  note();
  const Gust gust = next_gust(step_s);
  const elementary::SineCosine heading = elementary::sine_cosine(
      std::holds_alternative<Rotor>(plant_) ? rotor_state_.heading_math_rad
                                            : model_state_.heading_math_rad);
  const double gust_east_mps = gust.along_mps * heading.cosine - gust.left_mps * heading.sine;
  const double gust_north_mps = gust.along_mps * heading.sine + gust.left_mps * heading.cosine;
  if (const auto* rotor = std::get_if<Rotor>(&plant_)) {
    rotor_state_ = (*rotor)->step(
        rotor_state_, command_, {wind_.east_mps + gust_east_mps, wind_.north_mps + gust_north_mps},
        step_s, gust.up_mps);
    record_.power_max_w = std::max(record_.power_max_w, rotor_state_.power_w);
    record_.power_limited_steps += rotor_state_.is_power_limited ? 1 : 0;
    return;
  }
  model_state_ = std::get<Model>(plant_)->step(model_state_, command_, step_s);
  model_state_.x_m += gust_east_mps * step_s;
  model_state_.y_m += gust_north_mps * step_s;
  model_state_.altitude_m += gust.up_mps * step_s;
}

void PathFlight::note() {
  const double beside_m = follower_.cross_track_m();
  const double above_m = follower_.above_m();
  ++record_.steps;
  record_.horizontal_max_m = std::max(record_.horizontal_max_m, std::fabs(beside_m));
  record_.above_max_m = std::max(record_.above_max_m, above_m);
  record_.below_max_m = std::max(record_.below_max_m, -above_m);
  record_.horizontal_square_sum_m2 += beside_m * beside_m;
  record_.vertical_square_sum_m2 += above_m * above_m;
}

bool PathFlight::is_over() const {
  return follower_.is_over() ||
         record_.steps > 2 * static_cast<std::int64_t>(trajectory_->states.size());
}

ModelState PathFlight::state() const {
  ModelState state = model_state_;
  double east_mps = 0.0;
  double north_mps = 0.0;
  if (std::holds_alternative<Rotor>(plant_)) {
    state = {};
    state.x_m = rotor_state_.x_m;
    state.y_m = rotor_state_.y_m;
    state.altitude_m = rotor_state_.altitude_m;
    state.bank_left_rad = rotor_state_.bank_left_rad;
    state.roll_rate_left_radps = rotor_state_.roll_rate_left_radps;
    state.pitch_rad = -rotor_state_.tilt_rad;
    state.pitch_rate_radps = -rotor_state_.tilt_rate_radps;
    state.climb_rate_mps = rotor_state_.climb_rate_mps;
    east_mps = rotor_state_.east_mps;
    north_mps = rotor_state_.north_mps;
  } else {
    const elementary::SineCosine heading = elementary::sine_cosine(model_state_.heading_math_rad);
    east_mps = model_state_.speed_mps * heading.cosine + wind_.east_mps;
    north_mps = model_state_.speed_mps * heading.sine + wind_.north_mps;
  }
  state.speed_mps = std::sqrt(east_mps * east_mps + north_mps * north_mps);
  state.heading_math_rad = elementary::atan2(north_mps, east_mps);
  return state;
}

PathFlight flown_path(const flight::Trajectory& trajectory, const Plant& plant,
                      const FollowerOptions& options, bool has_feed_forward, const Wind& wind,
                      const Wind& planned_wind, const TurbulenceOptions& turbulence) {
  PathFlight flight(trajectory, plant, options, has_feed_forward, wind, planned_wind);
  if (turbulence.wind_6m_mps > 0.0) {
    flight.add_turbulence(turbulence);
  }
  while (!flight.is_over()) {
    flight.step();
  }
  return flight;
}

}  // namespace hedgehop::command_model
