#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <variant>

#include "command_model/command_model.hpp"
#include "command_model/path_follower.hpp"
#include "command_model/rotor_plant.hpp"
#include "command_model/turbulence.hpp"
#include "flight/trajectory.hpp"

namespace hedgehop::command_model {

/// What flies a path.
using Plant = std::variant<std::shared_ptr<const CommandModel>, std::shared_ptr<const RotorPlant>>;

/// How a path was kept.
struct PathRecord {
  double horizontal_max_m = 0.0;  // beside the path
  double above_max_m = 0.0;
  double below_max_m = 0.0;
  double horizontal_square_sum_m2 = 0.0;
  double vertical_square_sum_m2 = 0.0;
  std::int64_t steps = 0;
  double power_max_w = 0.0;  // of a rotor; 0 for a CommandModel
  std::int64_t power_limited_steps = 0;
  [[nodiscard]] double horizontal_rms_m() const;
  [[nodiscard]] double vertical_rms_m() const;
};

/// A flight along a planned path in a wind, with path-following controllers, step by step. Begins
/// trimmed at the path's first state.
class PathFlight {
 public:
  /// The trajectory must outlive the flight. A CommandModel flies in `wind` whatever wind its
  /// vehicle has.
  ///
  /// @param planned_wind  that the trajectory was made for
  PathFlight(const flight::Trajectory& trajectory, Plant plant, const FollowerOptions& options,
             bool has_feed_forward, const Wind& wind, const Wind& planned_wind = {});

  /// Goes on from where another flight of the same kind of plant is, instead of the path's first
  /// state.
  void take_over(const PathFlight& before);

  /// From here on the air is turbulent as well, over the ground that the plan says. A rotor feels
  /// it by its airspeed and lift; the model of the planner is carried along as a leaf would be.
  void add_turbulence(const TurbulenceOptions& options) { turbulence_.emplace(options); }

  /// From here on the commanded heading changes by no more than this.
  void limit_heading_rate(double rate_max_radps) { heading_rate_max_radps_ = rate_max_radps; }

  /// One step of the trajectory's step_s.
  void step();

  /// At the end of the path, or after twice the time that it was planned for.
  [[nodiscard]] bool is_over() const;
  [[nodiscard]] bool has_arrived() const { return follower_.is_over(); }

  /// Speed and heading are those over ground.
  [[nodiscard]] ModelState state() const;
  [[nodiscard]] const Command& command() const { return command_; }
  [[nodiscard]] double plan_time_s() const { return follower_.plan_time_s(); }
  [[nodiscard]] std::int64_t steps() const { return record_.steps; }
  [[nodiscard]] const PathRecord& record() const { return record_; }

 private:
  [[nodiscard]] FollowedState place() const;
  [[nodiscard]] Gust next_gust(double step_s);
  void note();

  const flight::Trajectory* trajectory_;
  Plant plant_;
  PathFollower follower_;
  Wind wind_;
  std::optional<Turbulence> turbulence_;
  ModelState model_state_;
  RotorState rotor_state_;
  Command command_;
  double heading_rate_max_radps_ = std::numeric_limits<double>::infinity();
  PathRecord record_;
};

/// Flies it to its end.
PathFlight flown_path(const flight::Trajectory& trajectory, const Plant& plant,
                      const FollowerOptions& options, bool has_feed_forward, const Wind& wind,
                      const Wind& planned_wind = {}, const TurbulenceOptions& turbulence = {});

}  // namespace hedgehop::command_model
