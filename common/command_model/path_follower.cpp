#include "command_model/path_follower.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::command_model {
namespace {

constexpr double kSpeedShareMin = 0.5;  // of the plan's speed over ground, in a head wind

double course_math_rad(const flight::FlightState& state) {
  return math_angle_from_azimuth_rad(
      grid_from_true_azimuth_rad(state.heading_true_rad, state.convergence_rad));
}

}  // namespace

FollowerOptions read_follower_options(ConfigReader& reader) {
  FollowerOptions options;
  const auto not_negative = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value >= 0.0 && value <= 100.0, key, "must lie in 0 to 100");
    return value;
  };
  options.cross_track_gain_1ps = not_negative("cross_track_gain_1ps");
  options.cross_track_speed_max_mps = not_negative("cross_track_speed_max_mps");
  options.cross_track_integral_gain_1ps2 = not_negative("cross_track_integral_gain_1ps2");
  options.altitude_gain_1ps = not_negative("altitude_gain_1ps");
  options.turn_lead_s = not_negative("turn_lead_s");
  options.climb_lead_s = not_negative("climb_lead_s");
  options.ahead_max_s = not_negative("ahead_max_s");
  reader.require(options.ahead_max_s > 0.0, "ahead_max_s", "must be above 0");
  reader.finish();
  return options;
}

PathFollower::PathFollower(const flight::Trajectory& trajectory, const FollowerOptions& options,
                           bool has_feed_forward, const Wind& planned_wind)
    : trajectory_(&trajectory),
      options_(options),
      has_feed_forward_(has_feed_forward),
      planned_wind_(planned_wind) {
  if (trajectory.states.size() < 2 || !(trajectory.step_s > 0.0)) {
    throw std::invalid_argument("a path to follow has two states at least");
  }
}

PathFollower::Place PathFollower::at(double place) const {
  const auto last = static_cast<double>(trajectory_->states.size() - 1);
  const double within = std::clamp(place, 0.0, last);
  const auto index = static_cast<std::size_t>(std::min(std::floor(within), last - 1.0));
  const double t = within - static_cast<double>(index);
  const flight::FlightState& a = trajectory_->states[index];
  const flight::FlightState& b = trajectory_->states[index + 1];
  const auto between = [t](double from, double to) { return from + t * (to - from); };
  const double course_a = course_math_rad(a);
  Place result{between(a.x_m, b.x_m),
               between(a.y_m, b.y_m),
               between(a.altitude_m, b.altitude_m),
               course_a + t * wrap_to_pi(course_math_rad(b) - course_a),
               between(a.speed_mps, b.speed_mps),
               between(a.climb_rate_mps, b.climb_rate_mps)};
  if (place > last) {  // straight on
    const double beyond_m = (place - last) * trajectory_->step_s * result.speed_mps;
    result.x_m += beyond_m * elementary::cos(result.course_math_rad);
    result.y_m += beyond_m * elementary::sin(result.course_math_rad);
  }
  return result;
}

PathFollower::Place PathFollower::with_chord(const Place& from, const Place& to) {
  Place result = from;
  result.climb_rate_mps = 0.0;
  const double dx_m = to.x_m - from.x_m;
  const double dy_m = to.y_m - from.y_m;
  const double chord_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
  if (chord_m > 0.0) {
    result.course_math_rad = elementary::atan2(dy_m, dx_m);
    result.climb_rate_mps = from.speed_mps * (to.altitude_m - from.altitude_m) / chord_m;
  }
  return result;
}

void PathFollower::advance(const FollowedState& state) {
  const auto states = trajectory_->states.size();
  const auto ahead =
      static_cast<std::size_t>(std::ceil(options_.ahead_max_s / trajectory_->step_s));
  const auto first = static_cast<std::size_t>(std::floor(place_));
  const std::size_t end = std::min(states - 1, first + ahead);
  double least = std::numeric_limits<double>::infinity();
  double best = place_;
  for (std::size_t i = std::min(first, states - 2); i < end; ++i) {
    const flight::FlightState& a = trajectory_->states[i];
    const flight::FlightState& b = trajectory_->states[i + 1];
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    const double squared = dx_m * dx_m + dy_m * dy_m;
    double t =
        squared > 0.0 ? ((state.x_m - a.x_m) * dx_m + (state.y_m - a.y_m) * dy_m) / squared : 0.0;
    t = std::clamp(t, 0.0, 1.0);
    const double ex_m = a.x_m + t * dx_m - state.x_m;
    const double ey_m = a.y_m + t * dy_m - state.y_m;
    const double distance = ex_m * ex_m + ey_m * ey_m;
    const double place = static_cast<double>(i) + t;
    if (distance < least && place >= place_) {
      least = distance;
      best = place;
    }
  }
  place_ = best;
}

bool PathFollower::is_over() const {
  return place_ >= static_cast<double>(trajectory_->states.size() - 1) - 1e-9;
}

Command PathFollower::command(const FollowedState& state, const Wind& wind, double step_s) {
  advance(state);
  const Place here = at(place_);
  const elementary::SineCosine course = elementary::sine_cosine(here.course_math_rad);
  cross_track_m_ = -(state.x_m - here.x_m) * course.sine + (state.y_m - here.y_m) * course.cosine;
  above_m_ = state.altitude_m - here.altitude_m;

  const double wanted_mps = options_.cross_track_gain_1ps * cross_track_m_ + integral_mps_;
  const double across_mps = std::clamp(wanted_mps, -options_.cross_track_speed_max_mps,
                                       options_.cross_track_speed_max_mps);
  if (across_mps == wanted_mps) {
    integral_mps_ += options_.cross_track_integral_gain_1ps2 * cross_track_m_ * step_s;
  }
  // On a circle the chord to a place has the course of the place half as far.
  const auto ahead = [&](double lead_s) {
    const double states = lead_s / trajectory_->step_s;
    return has_feed_forward_ ? at(place_ + states) : with_chord(here, at(place_ + 2.0 * states));
  };
  const Place told = ahead(options_.turn_lead_s);
  const elementary::SineCosine along = elementary::sine_cosine(told.course_math_rad);
  const double east_mps = told.speed_mps * along.cosine + across_mps * along.sine;
  const double north_mps = told.speed_mps * along.sine - across_mps * along.cosine;
  // The plan's speed over ground, but no more airspeed than the plan has: a head wind costs time,
  // not power.
  const double ground_mps = std::sqrt(east_mps * east_mps + north_mps * north_mps);
  const double along_wind_mps =
      ground_mps > 0.0 ? (wind.east_mps * east_mps + wind.north_mps * north_mps) / ground_mps : 0.0;
  const double wind_squared = wind.east_mps * wind.east_mps + wind.north_mps * wind.north_mps;
  // The square of the plan's airspeed.
  const double planned_squared =
      told.speed_mps * told.speed_mps -
      2.0 * told.speed_mps *
          (planned_wind_.east_mps * along.cosine + planned_wind_.north_mps * along.sine) +
      planned_wind_.east_mps * planned_wind_.east_mps +
      planned_wind_.north_mps * planned_wind_.north_mps;
  const double reach = planned_squared - wind_squared + along_wind_mps * along_wind_mps;
  const double reached_mps = along_wind_mps + std::sqrt(std::fmax(reach, 0.0));
  const double share =
      ground_mps > 0.0 ? std::clamp(reached_mps / ground_mps, kSpeedShareMin, 1.0) : 1.0;
  const double air_east_mps = share * east_mps - wind.east_mps;
  const double air_north_mps = share * north_mps - wind.north_mps;
  Command command;
  command.speed_mps = std::sqrt(air_east_mps * air_east_mps + air_north_mps * air_north_mps);
  command.heading_math_rad = elementary::atan2(air_north_mps, air_east_mps);
  const double climb_mps = share * ahead(options_.climb_lead_s).climb_rate_mps;
  command.climb_rate_mps = climb_mps - options_.altitude_gain_1ps * above_m_;
  return command;
}

}  // namespace hedgehop::command_model
