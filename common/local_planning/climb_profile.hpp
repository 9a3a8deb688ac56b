#pragma once

#include <algorithm>
#include <vector>

#include "command_model/command_model.hpp"
#include "local_planning/guide.hpp"
#include "local_planning/step_kernels.hpp"
#include "local_planning/surroundings.hpp"

namespace hedgehop::local_planning {

/// Look-ahead of the vertical axis, see ClimbForecast.
struct ProfileOptions {
  bool is_used = false;
  double horizon_s = 0.0;
  double sample_s = 0.0;            // time between the places looked at
  double response_s = 0.0;          // dead time of the heave response
  double acceleration_share = 0.0;  // of the acceleration limit that the forecast counts on, (0, 1]
  double guide_allowance_m = 0.0;   // how far below the guide's altitude the flight may sink
};

/// Where a state is along the guide, and what the vehicle can do there.
struct GuideView {
  double along_m = 0.0;
  double target_math_rad = 0.0;  // direction to the guide's target, for a forecast the heading
  double target_m = 0.0;         // distance to it
  flight::VerticalRates rates;
};

/// What the flight ahead needs from the vertical axis.
struct ClimbAhead {
  double climb_rate_mps = 0.0;  // least climb rate to command now; may be negative
  double shortfall_rate_mps =
      0.0;  // the same without the limit, for places that braking still helps
};

/// Climb rate to command now so that the flight ahead clears the terrain and does not sink far
/// below the guide, given how fast the vehicle can change its climb rate.
///
/// The histogram takes a climb to start at once. A real one starts late: to change the climb rate
/// by D with acceleration a costs D^2 / (2 a) of height plus the dead time. The path of the next
/// seconds is forecast as a turn towards the commanded heading that goes on along the guide: the
/// heading wanted turns with the direction from the guide to its own target, and what the place
/// beside the guide adds to that fades over the look-ahead. For a place reached after time t that
/// asks for the height N above the present altitude, the least rate is h' + D with
///
///     h' t + D (t - t_r) - D^2 / (2 a) = N
///
/// and the greatest of all places counts. Where N <= h' t the rate N / t is enough.
///
/// h' present climb rate, a = acceleration_share of the limit, t_r = response_s. In wind the path
/// drifts, and the guide's directions are the headings that make them good.
///
/// N is the greatest surface within the safety disc plus the safety height, or the guide's altitude
/// less the allowance, whichever is higher. Unknown terrain asks for nothing. Single precision.
class ClimbForecast {
 public:
  /// Holds references to all but the options. The guide is written down every 10 m.
  ///
  /// @param speed_mps  airspeed that is flown at mostly
  ClimbForecast(const Surroundings& surroundings, const Guide& guide,
                const command_model::CommandModel& model, double look_ahead_m,
                double safety_height_m, const ProfileOptions& options, double speed_mps,
                const StepKernels& kernels);

  /// @param trigonometry  of the state
  ClimbAhead ahead(const command_model::ModelState& state,
                   const command_model::StateTrigonometry& trigonometry, const GuideView& view,
                   double commanded_heading_math_rad);

  /// The question to the kernel.
  [[nodiscard]] ForecastTask task(const command_model::ModelState& state,
                                  const command_model::StateTrigonometry& trigonometry,
                                  const GuideView& view, double commanded_heading_math_rad) const;
  /// Towards the guide's target.
  [[nodiscard]] double ground_speed_mps(const command_model::ModelState& state,
                                        double along_m) const;
  /// What its answer means.
  [[nodiscard]] static ClimbAhead answer(const ForecastTask& task, const GuideView& view) {
    return {std::min(static_cast<double>(task.greatest_mps), view.rates.climb_mps),
            static_cast<double>(task.greatest_later_mps)};
  }

 private:
  const Surroundings* surroundings_;
  const Guide* guide_;
  const command_model::CommandModel* model_;
  double look_ahead_m_;
  double safety_height_m_;
  ProfileOptions options_;
  StepKernels kernels_;
  std::vector<float> guide_table_;  // by place: bearing to its target without jumps, altitude
  FlightScratch scratch_;
  double turn_max_;     // tangent of the steepest bank
  ForecastTask usual_;  // what is the same in each question
};

}  // namespace hedgehop::local_planning
