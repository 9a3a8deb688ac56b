#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "command_model/command_model.hpp"
#include "local_planning/climb_profile.hpp"
#include "local_planning/decision.hpp"
#include "local_planning/direction.hpp"
#include "local_planning/guide.hpp"
#include "local_planning/histogram_table.hpp"
#include "local_planning/indicator.hpp"
#include "local_planning/local_planner.hpp"
#include "local_planning/polar_histogram.hpp"
#include "local_planning/rollout.hpp"
#include "local_planning/surroundings.hpp"

namespace hedgehop::local_planning {

/// How a state moves over the ground.
struct GroundMotion {
  double course_math_rad = 0.0;
  double cos_course = 1.0;
  double sin_course = 0.0;
  double speed_mps = 0.0;
  double cos_crab = 1.0;  // of the angle between heading and course
};

/// Decides the command of each step of one pass along a guide, see fly_along(). Holds references to
/// what it is given.
///
/// In wind, the ground is asked about in courses, and what is commanded and remembered are headings
/// of the nose that make them good. Climb tangents are climb rates over the airspeed: those over
/// the ground times ground speed over airspeed in their direction.
class Decider {
 public:
  /// @param tables  of the histogram; null for rollouts
  Decider(const Surroundings& surroundings, std::shared_ptr<const HistogramTables> tables,
          const Guide& guide, const command_model::CommandModel& model, const LocalOptions& options,
          const HistogramOptions& histogram_options, double speed_mps,
          const command_model::ModelState& initial, const HeadingCommand& heading, Kernel kernel);

  /// The next step; states must come in the order of the flight.
  ///
  /// @param trigonometry  of the state
  FlownStep decide(const command_model::ModelState& state,
                   const command_model::StateTrigonometry& trigonometry);

  /// What one step leaves behind for the next.
  struct Memory {
    double along_m = 0.0;
    double commanded_rad = 0.0;     // heading of the step before
    double before_rad = 0.0;        // direction chosen in the step before
    double before_climb_rad = 0.0;  // likewise its climb angle, of the three-dimensional VFH
    Indicator heading;
    Indicator climb;
    bool is_outbound = false;
    double outbound_rad = 0.0;  // course
  };
  [[nodiscard]] const Memory& memory() const { return memory_; }
  /// Goes back to a step before.
  void restore(const Memory& memory) { memory_ = memory; }
  /// A step that was commanded by somebody else.
  void follow(const command_model::ModelState& state, const command_model::Command& command);

  /// Where the flight is along the guide.
  [[nodiscard]] double along_m() const { return memory_.along_m; }
  /// Whether the guide ends within what it is searched ahead and the last stretch, on which the
  /// goal alone counts.
  [[nodiscard]] bool is_on_final_part() const { return is_on_final_part(memory_.along_m); }
  [[nodiscard]] std::int64_t infeasible_decisions() const { return infeasible_decisions_; }

  /// What the last step was decided by; without number and state.
  [[nodiscard]] Decision last_decision() const;

 private:
  [[nodiscard]] bool is_on_final_part(double along_m) const;
  /// What the terrain asks for, and the ground ahead of the commanded heading.
  struct Judgement {
    double needed = 0.0;
    std::optional<ClimbAhead> ahead;
    std::optional<double> wanted;  // instead of the climb towards the target
  };
  Judgement judge_by_histogram(const command_model::ModelState& state,
                               const command_model::StateTrigonometry& trigonometry,
                               const RolloutView& seen, const GroundMotion& motion,
                               double turn_radius_m, FlownStep& step);
  Judgement judge_by_rollout(const command_model::ModelState& state,
                             const command_model::StateTrigonometry& trigonometry,
                             const RolloutView& seen, FlownStep& step);
  /// What a place along the guide asks for; the guide's target is the goal direction.
  [[nodiscard]] RolloutView view(const command_model::ModelState& state, const GroundMotion& motion,
                                 double along_m) const;
  /// What the vehicle climbs at most here, a little at least.
  [[nodiscard]] static double climb_rate_max_mps(const GuideView& view);
  /// No direction is feasible: the target is commanded, slowly; returns all the climb there is.
  double give_way(const command_model::ModelState& state, const GuideView& view, FlownStep& step);
  bool is_going_around(const command_model::ModelState& state, const GroundMotion& motion);
  [[nodiscard]] float needed_towards(double course_rad) const {
    return histogram_.tan_masked[static_cast<std::size_t>(sectors_.of_angle(course_rad))];
  }
  /// Whether costs turn the indicator themselves, towards no target but the goal.
  [[nodiscard]] bool is_turned_by_costs() const {
    return options_.steering == Steering::kTorque && options_.mode == LocalMode::kTvfh;
  }
  /// The course to follow; nothing if no sector is feasible.
  std::optional<double> direction_of_histogram(const DirectionQuestion& question);
  double followed_heading_rad(double chosen_rad, const DirectionQuestion& question,
                              const command_model::ModelState& state, double turn_rate_radps);
  [[nodiscard]] GroundMotion motion_of(const command_model::ModelState& state,
                                       const command_model::StateTrigonometry& trigonometry) const;
  [[nodiscard]] const flight::Wind& wind() const { return model_.vehicle().wind; }
  [[nodiscard]] double heading_for_rad(double course_rad, double airspeed_mps) const {
    return flight::heading_for_course_rad(wind(), airspeed_mps, course_rad);
  }
  [[nodiscard]] double course_of_rad(double heading_rad, double airspeed_mps) const {
    return flight::over_ground(wind(), {airspeed_mps, heading_rad}).direction_math_rad;
  }
  /// From tangents over the ground to climb rates over the airspeed.
  void take_wind(const GroundMotion& motion, double airspeed_mps);

  const Guide& guide_;
  const command_model::CommandModel& model_;
  const LocalOptions& options_;
  Sectors sectors_;
  std::optional<HistogramKernel> plain_;
  std::optional<HistogramTable> table_;
  int (*cheapest_)(const DirectionTask&);
  float (*torque_)(const TorqueTask&);
  std::optional<ClimbForecast> forecast_;
  std::optional<Rollout> rollout_;
  HeadingCommand heading_;
  double speed_mps_;
  double disc_radius_m_;
  double tangent_min_;
  double turn_max_;  // tangent of the steepest bank
  Memory memory_;
  PolarHistogram histogram_;
  DirectionScratch scratch_;
  DirectionQuestion question_;  // of the last step
  double chosen_rad_ = 0.0;     // likewise
  double airspeed_mps_ = 0.0;   // likewise
  bool has_given_way_ = false;  // likewise
  std::int64_t infeasible_decisions_ = 0;
};

}  // namespace hedgehop::local_planning
