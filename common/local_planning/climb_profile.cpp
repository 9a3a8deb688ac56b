#include "local_planning/climb_profile.hpp"

#include <algorithm>
#include <cmath>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kNearTarget_m = 50.0;  // nearer, the direction to the target says nothing
constexpr double kSpacing_m = 10.0;

float single(double value) { return static_cast<float>(value); }

}  // namespace

ClimbForecast::ClimbForecast(const Surroundings& surroundings, const Guide& guide,
                             const command_model::CommandModel& model, double look_ahead_m,
                             double safety_height_m, const ProfileOptions& options,
                             double speed_mps, const StepKernels& kernels)
    : surroundings_(&surroundings),
      guide_(&guide),
      model_(&model),
      look_ahead_m_(look_ahead_m),
      safety_height_m_(safety_height_m),
      options_(options),
      kernels_(kernels),
      turn_max_(elementary::tan(model.bank_command_max_rad())) {
  const flight::Wind& wind = model.vehicle().wind;
  const auto crab_rad = [&](double course_rad) {
    return wind.is_calm() ? 0.0
                          : wrap_to_pi(flight::heading_for_course_rad(wind, speed_mps, course_rad) -
                                       course_rad);
  };
  double bearing_rad = guide.heading_math_rad(0.0);
  const int count = static_cast<int>(guide.length_m() / kSpacing_m) + 2;
  for (int i = 0; i < count; ++i) {
    const double along_m = i * kSpacing_m;
    const flight::Waypoint here = guide.at(along_m);
    const flight::Waypoint target = guide.at(along_m + look_ahead_m);
    const double dx_m = target.x_m - here.x_m;
    const double dy_m = target.y_m - here.y_m;
    if (dx_m * dx_m + dy_m * dy_m > kNearTarget_m * kNearTarget_m) {
      bearing_rad += wrap_to_pi(elementary::atan2(dy_m, dx_m) - bearing_rad);
    }
    guide_table_.push_back(static_cast<float>(bearing_rad + crab_rad(bearing_rad)));
    guide_table_.push_back(static_cast<float>(here.altitude_m));
  }
  const flight::Limits& limits = model.vehicle().limits;
  const command_model::ModelParameters& constants = model.vehicle().model;
  const raster::GridGeometry& geometry = surroundings.geometry();
  usual_.samples = static_cast<int>(options.horizon_s / options.sample_s + 0.5);
  usual_.table_count = count;
  usual_.end_in_table = single(guide.length_m() / kSpacing_m);
  usual_.sample_s = single(options.sample_s);
  usual_.gain = single(constants.heading_gain_1ps / (1.0 + constants.heading_rate_damping));
  // Share of the turn rate that the bank makes good in one sample.
  usual_.roll_share = single(std::min(1.0, options.sample_s * constants.attitude_frequency_radps /
                                               (2.0 * constants.attitude_damping)));
  usual_.drift_east_cells = single(wind.east_mps * options.sample_s / geometry.cell_m);
  usual_.drift_north_cells = single(wind.north_mps * options.sample_s / geometry.cell_m);
  usual_.columns = geometry.columns;
  usual_.rows = geometry.rows;
  usual_.dilated_m = surroundings.dilated_layer_m().row(0);
  usual_.acceleration_mps2 =
      single(options.acceleration_share * limits.vertical_acceleration_max_mps2);
  usual_.response_s = single(options.response_s);
  usual_.rate_max_mps = single(10.0 * limits.climb_rate_max_mps);
}

ClimbAhead ClimbForecast::ahead(const command_model::ModelState& state,
                                const command_model::StateTrigonometry& trigonometry,
                                const GuideView& view, double commanded_heading_math_rad) {
  ForecastTask question = task(state, trigonometry, view, commanded_heading_math_rad);
  kernels_.forecast(question, scratch_);
  return answer(question, view);
}

double ClimbForecast::ground_speed_mps(const command_model::ModelState& state,
                                       double along_m) const {
  const flight::Wind& wind = model_->vehicle().wind;
  if (wind.is_calm()) {
    return state.speed_mps;
  }
  const flight::Waypoint target = guide_->at(along_m + look_ahead_m_);
  const double dx_m = target.x_m - state.x_m;
  const double dy_m = target.y_m - state.y_m;
  const double target_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
  if (!(target_m > 0.0)) {
    return state.speed_mps;
  }
  return flight::ground_speed_mps(wind, state.speed_mps, dx_m / target_m, dy_m / target_m);
}

ForecastTask ClimbForecast::task(const command_model::ModelState& state,
                                 const command_model::StateTrigonometry& trigonometry,
                                 const GuideView& view, double commanded_heading_math_rad) const {
  const double speed_mps = state.speed_mps;
  const double step_m = speed_mps * options_.sample_s;
  const double ground_step_m = ground_speed_mps(state, view.along_m) * options_.sample_s;
  const raster::GridGeometry& geometry = surroundings_->geometry();

  const double in_table = view.along_m / kSpacing_m;
  const std::size_t count = guide_table_.size() / 2;
  const auto at = std::min(static_cast<std::size_t>(in_table), count - 2);
  const double share = in_table - static_cast<double>(at);
  const float before_rad = guide_table_[2 * at];
  const double bearing_rad = static_cast<double>(before_rad) +
                             share * static_cast<double>(guide_table_[2 * at + 2] - before_rad);

  ForecastTask task = usual_;
  task.guide = guide_table_.data();
  task.from_in_table = single(in_table);
  task.step_in_table = single(ground_step_m / kSpacing_m);
  task.wanted_rad = single(wrap_to_pi(commanded_heading_math_rad - state.heading_math_rad));
  task.bearing_now_rad = single(bearing_rad);
  task.beside_rad =
      view.target_m > kNearTarget_m ? single(wrap_to_pi(view.target_math_rad - bearing_rad)) : 0.0F;
  task.fading = single(look_ahead_m_ / (look_ahead_m_ + ground_step_m));
  task.turn_max_radps = single(kGravity_mps2 * turn_max_ / speed_mps);
  task.turn_radps = single(kGravity_mps2 * trigonometry.tan_bank / speed_mps);
  const double column = (state.x_m - geometry.west_m) / geometry.cell_m;
  const double row = (state.y_m - geometry.south_m) / geometry.cell_m;
  task.column = static_cast<int>(std::floor(column));
  task.row = static_cast<int>(std::floor(row));
  task.part_of_column = single(column - task.column);
  task.part_of_row = single(row - task.row);
  task.east_cells = single(step_m * trigonometry.cos_heading / geometry.cell_m);
  task.north_cells = single(step_m * trigonometry.sin_heading / geometry.cell_m);
  task.floor_m = single(state.altitude_m - safety_height_m_);
  task.guide_floor_m = single(state.altitude_m + options_.guide_allowance_m);
  task.climb_rate_mps = single(state.climb_rate_mps);
  task.rate_min_mps = single(-view.rates.descent_mps);
  return task;
}

}  // namespace hedgehop::local_planning
