#include "local_planning/decider.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::local_planning {
namespace {

using command_model::CommandModel;
using command_model::ModelState;
using command_model::StateTrigonometry;

constexpr double kGoalDistanceMin_m = 50.0;  // in the climb towards the target
constexpr double kReachMin_m =
    100.0;  // the histogram looks at least this far when the goal is near
constexpr double kGoAroundRadii =
    3.5;  // of the turning circle, before the flight turns back to a goal
constexpr double kFallbackReach_rad = 108.0 * kDegree_rad;

double distance_m(double dx_m, double dy_m) { return std::sqrt(dx_m * dx_m + dy_m * dy_m); }

}  // namespace

Decider::Decider(const Surroundings& surroundings, std::shared_ptr<const HistogramTables> tables,
                 const Guide& guide, const CommandModel& model, const LocalOptions& options,
                 const HistogramOptions& histogram_options, double speed_mps,
                 const ModelState& initial, const HeadingCommand& heading, Kernel kernel)
    : guide_(guide),
      model_(model),
      options_(options),
      sectors_(histogram_options.sectors),
      cheapest_(kernel == Kernel::kPlain ? &plain_cheapest : step_kernels(kernel).cheapest),
      torque_(kernel == Kernel::kPlain ? &plain_torque : step_kernels(kernel).torque),
      heading_(heading),
      speed_mps_(speed_mps),
      disc_radius_m_(histogram_options.disc_radius_m),
      tangent_min_(elementary::tan(options.climb_angle_min_rad)),
      turn_max_(elementary::tan(model.bank_command_max_rad())) {
  memory_.commanded_rad =
      std::isnan(heading.before_rad) ? initial.heading_math_rad : heading.before_rad;
  memory_.before_rad = initial.heading_math_rad;
  if (options.mode == LocalMode::kRollout) {
    rollout_.emplace(surroundings, guide, model, options.look_ahead_m, options.safety_height_m,
                     options.climb_ahead, options.rollout, options.weights, speed_mps, kernel);
  } else if (kernel == Kernel::kPlain) {
    plain_.emplace(surroundings, histogram_options);
  } else {
    table_.emplace(surroundings, histogram_options, std::move(tables), kernel);
  }
  if (options.mode != LocalMode::kRollout && options.climb_ahead.is_used) {
    forecast_.emplace(surroundings, guide, model, options.look_ahead_m, options.safety_height_m,
                      options.climb_ahead, speed_mps, step_kernels(kernel));
  }
  memory_.heading.reset(initial.heading_math_rad);
  memory_.climb.reset(initial.climb_rate_mps / initial.speed_mps);
}

double Decider::climb_rate_max_mps(const GuideView& view) {
  constexpr double kLeast_mps = 0.1;  // where there is no power to climb, every slope is too steep
  return std::max(view.rates.climb_mps, kLeast_mps);
}

GroundMotion Decider::motion_of(const ModelState& state,
                                const StateTrigonometry& trigonometry) const {
  if (wind().is_calm()) {
    return {state.heading_math_rad, trigonometry.cos_heading, trigonometry.sin_heading,
            state.speed_mps, 1.0};
  }
  const double east_mps = state.speed_mps * trigonometry.cos_heading + wind().east_mps;
  const double north_mps = state.speed_mps * trigonometry.sin_heading + wind().north_mps;
  const double speed_mps = distance_m(east_mps, north_mps);
  const double cosine = east_mps / speed_mps;
  const double sine = north_mps / speed_mps;
  return {elementary::atan2(north_mps, east_mps), cosine, sine, speed_mps,
          cosine * trigonometry.cos_heading + sine * trigonometry.sin_heading};
}

RolloutView Decider::view(const ModelState& state, const GroundMotion& motion,
                          double along_m) const {
  const double speed_mps = state.speed_mps;
  const flight::Waypoint target = guide_.at(along_m + options_.look_ahead_m);
  const double target_dx_m = target.x_m - state.x_m;
  const double target_dy_m = target.y_m - state.y_m;
  const double target_m = distance_m(target_dx_m, target_dy_m);
  RolloutView view;
  view.guide = {
      along_m,
      target_m > 0.0 ? elementary::atan2(target_dy_m, target_dx_m) : motion.course_math_rad,
      target_m, model_.vehicle().vertical_rates(speed_mps, state.altitude_m)};
  const double tangent_max = options_.climb_share * (climb_rate_max_mps(view.guide) / speed_mps);
  const double tangent_min = tangent_min_ * (motion.speed_mps / speed_mps);
  DirectionQuestion& question = view.question;
  question.heading_math_rad = motion.course_math_rad;
  question.goal_math_rad = view.guide.target_math_rad;
  const double target_speed_mps =
      target_m > 0.0 ? flight::ground_speed_mps(wind(), speed_mps, target_dx_m / target_m,
                                                target_dy_m / target_m)
                     : motion.speed_mps;
  question.goal_tangent =
      std::clamp((target.altitude_m - state.altitude_m) / std::max(target_m, kGoalDistanceMin_m) *
                     (target_speed_mps / speed_mps),
                 tangent_min, tangent_max);
  question.tangent_min = tangent_min;
  question.tangent_max = tangent_max;
  const flight::Waypoint nearest = guide_.at(along_m);
  const double offset =
      distance_m(nearest.x_m - state.x_m, nearest.y_m - state.y_m) / options_.corridor_m;
  // A guide may come by its goal long before it ends there, on a round trip for example.
  const double to_goal_m = is_on_final_part(along_m) ? distance_m(guide_.goal().x_m - state.x_m,
                                                                  guide_.goal().y_m - state.y_m)
                                                     : std::numeric_limits<double>::infinity();
  question.polar_share =
      to_goal_m < options_.goal_only_distance_m ? 0.0 : std::max(0.0, 1.0 - offset * offset);
  // Ground beyond the goal is never flown over.
  view.reach_m = std::max(to_goal_m, kReachMin_m) + disc_radius_m_;
  return view;
}

FlownStep Decider::decide(const ModelState& state, const StateTrigonometry& trigonometry) {
  const geo::MapPoint place{state.x_m, state.y_m};
  const double speed_mps = state.speed_mps;
  memory_.along_m = guide_.project(place, memory_.along_m - options_.projection_back_m,
                                   memory_.along_m + options_.projection_ahead_m, memory_.along_m);
  const GroundMotion motion = motion_of(state, trigonometry);
  const double turn_radius_m =
      motion.speed_mps * motion.speed_mps / (kGravity_mps2 * turn_max_ * motion.cos_crab);
  RolloutView seen = view(state, motion, memory_.along_m);
  DirectionQuestion& question = seen.question;
  const double tangent_min = question.tangent_min;
  const double climb_max_mps = climb_rate_max_mps(seen.guide);
  const double limit_tangent = climb_max_mps / speed_mps;
  if (is_going_around(state, motion)) {
    question.goal_math_rad = memory_.outbound_rad;
    seen.reach_m = std::numeric_limits<double>::infinity();
  }
  question_ = question;
  has_given_way_ = false;
  FlownStep step;
  step.state = state;
  step.command.speed_mps = speed_mps_;
  const Judgement judgement =
      rollout_ ? judge_by_rollout(state, trigonometry, seen, step)
               : judge_by_histogram(state, trigonometry, seen, motion, turn_radius_m, step);
  step.command.heading_math_rad =
      heading_.limited_rad(memory_.commanded_rad, step.command.heading_math_rad, options_.step_s);
  memory_.commanded_rad = step.command.heading_math_rad;
  memory_.before_rad = step.target_heading_math_rad;
  chosen_rad_ = step.target_heading_math_rad;
  airspeed_mps_ = speed_mps;
  double needed = std::max(judgement.needed, tangent_min);
  if (judgement.ahead) {
    needed = std::max(needed, judgement.ahead->climb_rate_mps / speed_mps);
    const double shortfall_mps = judgement.ahead->shortfall_rate_mps;
    if (shortfall_mps > climb_max_mps) {
      step.command.speed_mps = std::clamp(speed_mps * climb_max_mps / shortfall_mps,
                                          std::min(options_.slow_speed_mps, step.command.speed_mps),
                                          step.command.speed_mps);
    }
  }
  needed = std::clamp(needed, tangent_min, limit_tangent);

  // The indicator works on tangents: climb angles are small.
  memory_.climb.step(std::max(judgement.wanted.value_or(question.goal_tangent), needed),
                     state.climb_rate_mps / speed_mps, state.vertical_acceleration_mps2 / speed_mps,
                     options_.climb_indicator, options_.step_s);
  const double followed = std::max(memory_.climb.angle_rad, tangent_min);
  const double tangent = std::clamp(std::max(followed, needed), tangent_min, limit_tangent);
  step.commanded_climb_angle_rad = elementary::atan(tangent);
  step.command.climb_rate_mps = speed_mps * tangent;
  return step;
}

void Decider::follow(const ModelState& state, const command_model::Command& command) {
  memory_.along_m =
      guide_.project({state.x_m, state.y_m}, memory_.along_m - options_.projection_back_m,
                     memory_.along_m + options_.projection_ahead_m, memory_.along_m);
  memory_.commanded_rad = command.heading_math_rad;
  memory_.before_rad = command.heading_math_rad;
  memory_.heading.reset(command.heading_math_rad);
  memory_.climb.reset(state.climb_rate_mps / state.speed_mps);
  memory_.is_outbound = false;
}

void Decider::take_wind(const GroundMotion& motion, double airspeed_mps) {
  if (wind().is_calm()) {
    return;
  }
  const auto factor = [&](double cosine, double sine) {
    return static_cast<float>(flight::ground_speed_mps(wind(), airspeed_mps, cosine, sine) /
                              airspeed_mps);
  };
  const int count = sectors_.count();
  const float now = factor(motion.cos_course, motion.sin_course);
  histogram_.tan_climb_near *= now;
  for (int k = 0; k < count; ++k) {
    const elementary::SineCosine centre = elementary::sine_cosine(sectors_.centre_rad(k));
    const float along = factor(centre.cosine, centre.sine);
    const auto at = static_cast<std::size_t>(k);
    histogram_.tan_climb[at] *= along;
    // An arc from the present course: by its greatest speed, or its least one downwards.
    float& mask = histogram_.tan_mask[at];
    mask *= mask > 0.0F ? std::max(now, along) : std::min(now, along);
  }
  apply_mask(sectors_.of_angle(motion.course_math_rad), count, histogram_);
}

Decider::Judgement Decider::judge_by_histogram(const ModelState& state,
                                               const StateTrigonometry& trigonometry,
                                               const RolloutView& seen, const GroundMotion& motion,
                                               double turn_radius_m, FlownStep& step) {
  const DirectionQuestion& question = seen.question;
  const geo::MapPoint place{state.x_m, state.y_m};
  if (plain_) {
    plain_->compute(place, state.altitude_m, motion.course_math_rad, turn_radius_m, histogram_,
                    seen.reach_m);
  } else {
    table_->compute(place, state.altitude_m, motion.course_math_rad, turn_radius_m, histogram_,
                    seen.reach_m);
  }
  take_wind(motion, state.speed_mps);
  Judgement judgement;
  std::optional<double> chosen_rad;
  if (options_.mode == LocalMode::kVfh3d) {
    const SphericalDirection now{motion.course_math_rad,
                                 elementary::atan(state.climb_rate_mps / state.speed_mps)};
    const auto chosen = cheapest_spherical(
        histogram_, sectors_, options_.vfh_3d, options_.weights.polar_offset_rad3, question, now,
        {course_of_rad(memory_.before_rad, state.speed_mps), memory_.before_climb_rad});
    if (chosen) {
      chosen_rad = chosen->azimuth_math_rad;
      memory_.before_climb_rad = chosen->elevation_rad;
      judgement.wanted = elementary::tan(chosen->elevation_rad);
    }
  } else {
    chosen_rad = direction_of_histogram(question);
  }
  judgement.needed = std::max(
      static_cast<double>(histogram_.tan_climb_near),
      std::min(static_cast<double>(needed_towards(motion.course_math_rad)), question.tangent_max));
  if (chosen_rad) {
    step.target_heading_math_rad = heading_for_rad(*chosen_rad, state.speed_mps);
    step.command.heading_math_rad =
        followed_heading_rad(step.target_heading_math_rad, question, state,
                             kGravity_mps2 * trigonometry.tan_bank / state.speed_mps);
    if (is_turned_by_costs()) {
      step.target_heading_math_rad = step.command.heading_math_rad;
    }
    judgement.needed =
        std::max(judgement.needed, static_cast<double>(needed_towards(course_of_rad(
                                       step.command.heading_math_rad, state.speed_mps))));
  } else {
    step.target_heading_math_rad =
        heading_for_rad(least_climb_direction_rad(histogram_, sectors_, motion.course_math_rad,
                                                  question.goal_math_rad, kFallbackReach_rad),
                        state.speed_mps);
    judgement.needed = give_way(state, seen.guide, step);
  }
  if (forecast_) {
    GuideView in_headings = seen.guide;
    in_headings.target_math_rad = heading_for_rad(in_headings.target_math_rad, state.speed_mps);
    judgement.ahead =
        forecast_->ahead(state, trigonometry, in_headings, step.command.heading_math_rad);
  }
  return judgement;
}

Decider::Judgement Decider::judge_by_rollout(const ModelState& state,
                                             const StateTrigonometry& trigonometry,
                                             const RolloutView& seen, FlownStep& step) {
  const DirectionQuestion& question = seen.question;
  const auto in_headings = [this](RolloutView courses, const ModelState& at) {
    courses.question.heading_math_rad = at.heading_math_rad;
    courses.question.goal_math_rad = heading_for_rad(courses.question.goal_math_rad, at.speed_mps);
    courses.guide.target_math_rad = heading_for_rad(courses.guide.target_math_rad, at.speed_mps);
    return courses;
  };
  const bool is_branching = options_.rollout.tree_depth > 1 && !memory_.is_outbound;
  const ViewAt view_at = [&](const ModelState& later, const StateTrigonometry& then, double along_m,
                             double run_m) {
    return in_headings(
        view(later, motion_of(later, then),
             guide_.project({later.x_m, later.y_m}, along_m - options_.projection_back_m,
                            along_m + run_m + options_.projection_ahead_m, along_m + run_m)),
        later);
  };
  const RolloutChoice choice =
      rollout_->choose(state, trigonometry, in_headings(seen, state), memory_.commanded_rad,
                       memory_.before_rad, is_branching ? view_at : ViewAt());
  Judgement judgement;
  judgement.needed =
      std::max(choice.needed_near, std::min(choice.needed_commanded, question.tangent_max));
  if (choice.direction_rad) {
    step.target_heading_math_rad = *choice.direction_rad;
    if (choice.needed_commanded <= question.tangent_max) {
      memory_.heading.step(*choice.direction_rad, state.heading_math_rad,
                           kGravity_mps2 * trigonometry.tan_bank / state.speed_mps,
                           options_.heading_indicator, options_.step_s);
      step.command.heading_math_rad = memory_.heading.angle_rad;
    } else {
      // The indicator goes on from there: from the present heading it would lead back at once.
      memory_.heading.reset(*choice.direction_rad);
      step.command.heading_math_rad = *choice.direction_rad;
    }
  } else {
    step.target_heading_math_rad = choice.least_climb_rad;
    judgement.needed = give_way(state, seen.guide, step);
    memory_.heading.reset(choice.least_climb_rad);
  }
  if (options_.climb_ahead.is_used) {
    judgement.ahead = choice.ahead;
  }
  return judgement;
}

double Decider::give_way(const ModelState& state, const GuideView& view, FlownStep& step) {
  ++infeasible_decisions_;
  has_given_way_ = true;
  step.command.heading_math_rad = step.target_heading_math_rad;
  memory_.heading.reset(state.heading_math_rad);
  step.command.speed_mps = std::min(speed_mps_, options_.slow_speed_mps);
  return climb_rate_max_mps(view) / state.speed_mps;
}

Decision Decider::last_decision() const {
  Decision decision;
  if (rollout_) {
    return decision;
  }
  const std::vector<float> costs =
      direction_costs(histogram_, sectors_, options_.weights, question_);
  const auto tangent_max = static_cast<float>(question_.tangent_max);
  for (std::size_t k = 0; k < costs.size(); ++k) {
    Decision::Sector sector;
    const bool has_cells = histogram_.risk_weight[k] > 0.0F;
    const float tangent = histogram_.tan_masked[k];
    sector.climb_tangent = std::isfinite(tangent) ? static_cast<double>(tangent)
                                                  : std::numeric_limits<double>::quiet_NaN();
    sector.cost = costs[k];
    sector.mask = histogram_.tan_climb[k] > tangent_max ? DirectionMask::kClimb
                  : tangent > tangent_max               ? DirectionMask::kTurn
                  : has_cells                           ? DirectionMask::kFree
                                                        : DirectionMask::kUnknown;
    decision.sectors.push_back(sector);
  }
  if (!has_given_way_) {
    decision.chosen_sector = sectors_.of_angle(course_of_rad(chosen_rad_, airspeed_mps_));
  }
  return decision;
}

bool Decider::is_on_final_part(double along_m) const {
  return guide_.length_m() - along_m <= options_.projection_ahead_m + options_.goal_only_distance_m;
}

// A goal that was passed too far aside lies within the turning circle: flying towards it would
// orbit it forever. Straight on until it can be reached, then back.
bool Decider::is_going_around(const ModelState& state, const GroundMotion& motion) {
  // Downwind, where the circle is widest.
  const double speed_max_mps = state.speed_mps + wind().speed_mps();
  const double turn_radius_m = speed_max_mps * speed_max_mps / (kGravity_mps2 * turn_max_);
  const double dx_m = guide_.goal().x_m - state.x_m;
  const double dy_m = guide_.goal().y_m - state.y_m;
  const double goal_m = distance_m(dx_m, dy_m);
  const double ahead_m = dx_m * motion.cos_course + dy_m * motion.sin_course;
  const bool is_missed = memory_.along_m >= guide_.length_m() - kGoalDistanceMin_m &&
                         ahead_m <= 0.0 && goal_m > options_.goal_radius_m &&
                         goal_m < 2.0 * turn_radius_m;
  if (is_missed && !memory_.is_outbound) {
    memory_.is_outbound = true;
    memory_.outbound_rad = motion.course_math_rad;
  } else if (memory_.is_outbound && goal_m > kGoAroundRadii * turn_radius_m) {
    memory_.is_outbound = false;
  }
  return memory_.is_outbound;
}

std::optional<double> Decider::direction_of_histogram(const DirectionQuestion& question) {
  if (is_turned_by_costs()) {
    const auto tangent_max = static_cast<float>(question.tangent_max);
    return needed_towards(question.goal_math_rad) <= tangent_max
               ? question.goal_math_rad
               : nearest_feasible_rad(histogram_, sectors_, question.goal_math_rad, tangent_max);
  }
  return options_.steering == Steering::kOpenings
             ? cheapest_opening_rad(histogram_, sectors_, options_.weights,
                                    options_.opening_wide_rad, question, scratch_, cheapest_)
             : cheapest_direction_rad(histogram_, sectors_, options_.weights, question, scratch_,
                                      cheapest_);
}

double Decider::followed_heading_rad(double chosen_rad, const DirectionQuestion& question,
                                     const ModelState& state, double turn_rate_radps) {
  double pull_rad = wrap_to_pi(chosen_rad - memory_.heading.angle_rad);
  if (is_turned_by_costs()) {
    pull_rad += cost_torque_rad(histogram_, sectors_, options_.weights, question,
                                course_of_rad(memory_.heading.angle_rad, state.speed_mps),
                                options_.repulsion_width_rad, scratch_, torque_);
  }
  memory_.heading.turn(options_.heading_indicator.spring_1ps2 * pull_rad, state.heading_math_rad,
                       turn_rate_radps, options_.heading_indicator, options_.step_s);
  const auto tangent_max = static_cast<float>(question.tangent_max);
  const double course_rad = course_of_rad(memory_.heading.angle_rad, state.speed_mps);
  if (needed_towards(course_rad) <= tangent_max) {
    return memory_.heading.angle_rad;
  }
  const std::optional<double> nearest_rad =
      nearest_feasible_rad(histogram_, sectors_, course_rad, tangent_max);
  memory_.heading.reset(state.heading_math_rad);
  return nearest_rad ? heading_for_rad(*nearest_rad, state.speed_mps) : chosen_rad;
}

}  // namespace hedgehop::local_planning
