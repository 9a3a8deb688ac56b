#pragma once

#include <cstddef>

#include "base/config_reader.hpp"
#include "command_model/command_model.hpp"
#include "command_model/rotor_plant.hpp"
#include "flight/trajectory.hpp"

namespace hedgehop::command_model {

/// Section `path_following` of config/command_model.yaml.
struct FollowerOptions {
  double cross_track_gain_1ps = 0.0;  // speed towards the path per metre beside it
  double cross_track_speed_max_mps = 0.0;
  double cross_track_integral_gain_1ps2 = 0.0;
  double altitude_gain_1ps = 0.0;
  double turn_lead_s = 0.0;   // how far ahead the course
  double climb_lead_s = 0.0;  // and the climb rate are taken
  double ahead_max_s = 0.0;   // of the plan, in which the place beside is looked for
};
FollowerOptions read_follower_options(ConfigReader& reader);

/// Where a vehicle is, whatever flies it.
struct FollowedState {
  double x_m = 0.0;
  double y_m = 0.0;
  double altitude_m = 0.0;
};

/// Keeps a vehicle on a planned path.
///
/// The place on the path is the nearest one, never behind the last. There the plan's course and
/// speed over ground, and its climb rate, are asked for, and besides
///
///     across  -(k_c e + I),  I' = k_i e,  at most cross_track_speed_max_mps
///     up      k_h (h_plan - h)
///
/// with e the distance to the left of the path. The wind, which a vehicle knows from its airspeed,
/// is taken off, so that the command is one of the air, of no more airspeed than the plan has in
/// the wind that it was made for: against more wind a flight takes longer, as far as half its
/// speed over ground. What the vehicle
/// answers late is told early: with feed-forward the plan's states give course and climb rate some
/// time later; without it the plan is a line in space flown at a speed, and both are those of its
/// chord from here to the place twice as far ahead.
class PathFollower {
 public:
  /// The trajectory must outlive the follower and have two states at least.
  PathFollower(const flight::Trajectory& trajectory, const FollowerOptions& options,
               bool has_feed_forward, const Wind& planned_wind = {});

  /// The command for the next `step_s`.
  Command command(const FollowedState& state, const Wind& wind, double step_s);

  /// Of the last state that was asked about: beside the path (left positive), above it.
  [[nodiscard]] double cross_track_m() const { return cross_track_m_; }
  [[nodiscard]] double above_m() const { return above_m_; }
  /// Seconds into the plan of the place beside the vehicle.
  [[nodiscard]] double plan_time_s() const { return place_ * trajectory_->step_s; }
  /// Whether the end of the path is beside the vehicle or behind it.
  [[nodiscard]] bool is_over() const;

 private:
  struct Place {
    double x_m, y_m, altitude_m, course_math_rad, speed_mps, climb_rate_mps;
  };
  [[nodiscard]] Place at(double place) const;
  /// `from` with course and climb rate of the straight line to `to`.
  [[nodiscard]] static Place with_chord(const Place& from, const Place& to);
  void advance(const FollowedState& state);

  const flight::Trajectory* trajectory_;
  FollowerOptions options_;
  bool has_feed_forward_;
  Wind planned_wind_;
  double place_ = 0.0;  // in states of the trajectory
  double integral_mps_ = 0.0;
  double cross_track_m_ = 0.0;
  double above_m_ = 0.0;
};

}  // namespace hedgehop::command_model
