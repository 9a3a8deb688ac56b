#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "local_planning/climb_profile.hpp"
#include "local_planning/direction.hpp"
#include "local_planning/step_kernels.hpp"

namespace hedgehop::local_planning {

/// Section `rollout` of the local options.
struct RolloutOptions {
  double horizon_s = 0.0;     // of the flights ahead
  double sample_s = 0.0;      // between the places looked at
  double reach_rad = 0.0;     // candidates lie within this of the heading
  double lag_s = 0.0;         // flown before a climb begins
  double gain = 0.0;          // of risk and climb costs beside the cost of the goal
  double change_1prad = 0.0;  // cost of a direction per radian from the one chosen before
  int tree_depth = 1;         // decisions looked ahead over, one after the other
  double branch_s = 0.0;      // flown between two of them
  double later_weight = 0.0;  // of the cost after a decision beside that before it
};

/// What a place along the guide asks of a rollout from there.
struct RolloutView {
  DirectionQuestion question;
  GuideView guide;
  double reach_m = 0.0;  // ground further away is not looked at
};
/// The view from a state that `run_m` of flight lead to from the place `along_m` of the guide.
using ViewAt = std::function<RolloutView(const command_model::ModelState& state,
                                         const command_model::StateTrigonometry& trigonometry,
                                         double along_m, double run_m)>;

/// What the rolled-out flights say.
struct RolloutChoice {
  std::optional<double> direction_rad;  // cheapest feasible one
  double least_climb_rad = 0.0;         // the one with the least climb, feasible or not
  double needed_commanded = 0.0;  // tangent along the heading commanded before, beyond the lag
  double needed_near = 0.0;       // the same within the lag
  ClimbAhead ahead;               // along the heading commanded before
};

/// The rollout histogram: directions judged by flying them.
///
/// kCandidates headings are rolled out over the horizon: kCandidates - 2 around the present
/// heading, closer together near it, the goal direction, and the heading commanded before. The turn
/// rate follows the heading error like the command model's,
///
///     r' = clamp(k (chi_c + bend - chi), +- g tan(bank limit) / V),  made good by the roll
///     response
///
/// where `bend` is how the guide turns ahead: flights go on along it. Every sample looks up the
/// ground packed by Surroundings::pack(), the greatest within the safety tube however the flight
/// lies in its cell. For a candidate
///
///     t    = max over samples of N / max(s - lag V, V / 2)   (N > 0),  N / (s + lag V)   (N <= 0)
///     cost = c_goal g(chi_c - chi_goal) + gain share (mean risk + c_climb t + c_climb,rel max(t -
///            t_goal, 0)) + change |chi_c - chi_before|
///
/// N  height of the ground and the safety height above the present altitude; s distance flown
/// through the air: a climb takes the time that this takes. In wind the flights drift over the
/// ground, headings are those of the nose, and tangents are climb rates over the airspeed.
///
/// Samples within the lag do not decide whether a candidate is feasible, t <= t_max: no choice can
/// change them. The risk is the mean along what can be flown, not of a sector: a cell counts as
/// much as it is flown over. Costs are compared in single precision; ties go to the lowest
/// candidate.
///
/// With a `tree_depth` D above 1, feasible candidates are flown for `branch_s` only, and from there
/// 32 more are rolled out, D - 1 times. What counts then is
///
///     cost = cost of the part that is flown + later_weight (least such cost after it)
///
/// with the risk as the mean over that part, and for the last decision the cost above. The climb
/// is the one that the candidate needs, or the goal's. A candidate whose branches all end before
/// something too high is taken only if all do. Candidates that cannot become the cheapest whatever
/// comes after them are not followed. What is feasible, needed and ahead stays as without a tree.
///
/// Source of the tree: I. Ulrich and J. Borenstein, "VFH*: local obstacle avoidance with look-ahead
/// verification", IEEE ICRA 2000, doi:10.1109/ROBOT.2000.846405.
class Rollout {
 public:
  /// Holds references to all but the options; the surroundings must be packed.
  Rollout(const Surroundings& surroundings, const Guide& guide,
          const command_model::CommandModel& model, double look_ahead_m, double safety_height_m,
          const ProfileOptions& profile, const RolloutOptions& options,
          const DirectionWeights& weights, double speed_mps, Kernel kernel);

  /// @param view           directions as headings; the question as for cheapest_direction_rad()
  /// @param commanded_rad  heading commanded before
  /// @param before_rad     direction chosen before
  /// @param view_at        of later decisions; empty: there are none, as where one of them could
  ///                       lie beyond what is looked at
  RolloutChoice choose(const command_model::ModelState& state,
                       const command_model::StateTrigonometry& trigonometry,
                       const RolloutView& view, double commanded_rad, double before_rad,
                       const ViewAt& view_at = {});

 private:
  /// One decision.
  struct Node {
    command_model::ModelState state;
    RolloutView view;
    double commanded_rad = 0.0;
    std::array<float, kCandidates> wanted_rad{};
    std::array<float, kCandidates> needed{};
    std::array<float, kCandidates> risk{};
    float near = 0.0F;
    RolloutTask task;
  };
  struct Best {
    int candidate = kNoDirection;
    double cost = 0.0;
  };
  /// Where a part of a flight ends.
  struct PartEnd {
    double east_m = 0.0;  // from where it began
    double north_m = 0.0;
    double turned_rad = 0.0;
    double turn_rate_radps = 0.0;
    double run_m = 0.0;
  };
  /// Rolls out from the state and view of a node.
  void ask(Node& node, const command_model::StateTrigonometry& trigonometry, double before_rad);
  /// The node after a candidate's part.
  void ask_after(std::size_t depth, int candidate, const PartEnd& end, const ViewAt& view_at);
  [[nodiscard]] static double direction_rad(const Node& node, int candidate);
  /// The cheapest candidate of the node at a depth, with what comes after; none if nothing costs
  /// less than `bound`.
  Best best_of(std::size_t depth, double bound, const ViewAt& view_at);

  const Surroundings* surroundings_;
  ClimbForecast forecast_;
  RolloutOptions options_;
  DirectionWeights weights_;
  void (*rollout_)(RolloutTask& task, FlightScratch& scratch);
  std::array<float, kCandidates> offsets_rad_{};
  std::vector<Node> nodes_;  // by depth
  std::vector<std::vector<float>> bends_;
  FlightScratch scratch_;
};

/// The rollout in plain form.
void plain_rollout(RolloutTask& task, FlightScratch& scratch);

}  // namespace hedgehop::local_planning
