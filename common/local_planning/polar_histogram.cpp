#include "local_planning/polar_histogram.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kNothing = -std::numeric_limits<double>::infinity();
constexpr double kQuarterPi = 0.25 * std::numbers::pi;

// Grows with the angle of (x, y) from 0 to 4, one a quadrant: no transcendental function is needed.
double pseudo_angle(double x, double y) {
  const double sum = std::fabs(x) + std::fabs(y);
  if (sum == 0.0) {
    return 0.0;
  }
  const double share = y / sum;
  if (x < 0.0) {
    return 2.0 - share;
  }
  return share < 0.0 ? 4.0 + share : share;
}

}  // namespace

Sectors::Sectors(int count) : count_(count), width_rad_(kTwoPi / count), slots_per_unit_(count) {
  if (count < 8 || count > 1024) {
    throw std::invalid_argument("a polar histogram has 8 to 1024 sectors, not " +
                                std::to_string(count));
  }
  for (int k = 0; k < count; ++k) {
    const double edge_rad = (k + 0.5) * width_rad_;
    bounds_.push_back(pseudo_angle(elementary::cos(edge_rad), elementary::sin(edge_rad)));
  }
  bounds_.push_back(5.0);
  for (int slot = 0; slot <= 4 * count; ++slot) {
    const auto above =
        std::upper_bound(bounds_.begin(), bounds_.end(), slot / slots_per_unit_) - bounds_.begin();
    first_.push_back(static_cast<std::int16_t>(above));
  }
}

int Sectors::of_angle(double angle_rad) const {
  const int sector = static_cast<int>(std::floor(wrap_to_two_pi(angle_rad) / width_rad_ + 0.5));
  return sector >= count_ ? sector - count_ : sector;
}

int Sectors::of_direction(double x, double y) const {
  const double angle = pseudo_angle(x, y);
  int sector = first_[static_cast<std::size_t>(angle * slots_per_unit_)];
  while (bounds_[static_cast<std::size_t>(sector)] <= angle) {
    ++sector;
  }
  return sector == count_ ? 0 : sector;
}

HistogramKernel::HistogramKernel(const Surroundings& surroundings, const HistogramOptions& options)
    : surroundings_(&surroundings),
      options_(options),
      sectors_(options.sectors),
      truncation_cosine_(elementary::cos(options.truncation_angle_rad)),
      climb_(static_cast<std::size_t>(2 * options.sectors)),
      risk_(static_cast<std::size_t>(2 * options.sectors + 2)),
      weight_(static_cast<std::size_t>(2 * options.sectors + 2)) {}

void HistogramKernel::compute(const geo::MapPoint& place, double altitude_m,
                              double heading_math_rad, double turn_radius_min_m,
                              PolarHistogram& histogram, double reach_m) {
  const int count = sectors_.count();
  const auto size = static_cast<std::size_t>(count);
  std::fill(climb_.begin(), climb_.end(), kNothing);
  std::fill(risk_.begin(), risk_.end(), 0.0);
  std::fill(weight_.begin(), weight_.end(), 0.0);
  histogram.tan_mask.assign(size, kNothing);
  histogram.tan_climb_near = kNothing;

  const raster::GridGeometry& geometry = surroundings_->geometry();
  const double cell_m = geometry.cell_m;
  const double window_m = options_.window_m;
  const double window_m2 = window_m * window_m;
  const double range_m = std::min(window_m, reach_m);
  const double range_m2 = range_m * range_m;
  const double disc_m = options_.disc_radius_m;
  const double disc_m2 = disc_m * disc_m;
  const double truncation_m2 = options_.truncation_distance_m * options_.truncation_distance_m;
  const double cosine = elementary::cos(heading_math_rad);
  const double sine = elementary::sin(heading_math_rad);
  const double floor_m = altitude_m - options_.safety_height_m;
  const double widened_m = options_.is_arc_widened ? disc_m : 0.0;
  const double arc_min_m = turn_radius_min_m - widened_m;
  const double arc_spread_m = (options_.arc_radius_max_factor - 1.0) * turn_radius_min_m;
  double near_risk = 0.0;
  double near_weight = 0.0;

  const auto first_index = [&](double low_m) {
    return static_cast<int>(std::ceil(low_m / cell_m - 0.5));
  };
  const auto last_index = [&](double high_m) {
    return static_cast<int>(std::floor(high_m / cell_m - 0.5));
  };
  const int row_low = std::max(0, first_index(place.y_m - range_m - geometry.south_m));
  const int row_high =
      std::min(geometry.rows - 1, last_index(place.y_m + range_m - geometry.south_m));
  for (int row = row_low; row <= row_high; ++row) {
    const double dy_m = geometry.south_m + (row + 0.5) * cell_m - place.y_m;
    const double half_m = std::sqrt(std::max(0.0, range_m2 - dy_m * dy_m));
    const int column_low = std::max(0, first_index(place.x_m - half_m - geometry.west_m));
    const int column_high =
        std::min(geometry.columns - 1, last_index(place.x_m + half_m - geometry.west_m));
    const float* surface_m = surroundings_->surface_m().row(row);
    const float* risk = surroundings_->risk().row(row);
    for (int column = column_low; column <= column_high; ++column) {
      const double dx_m = geometry.west_m + (column + 0.5) * cell_m - place.x_m;
      const double d_m2 = dx_m * dx_m + dy_m * dy_m;
      if (d_m2 > range_m2) {
        continue;
      }
      const double too_high_m = static_cast<double>(surface_m[column]) - floor_m;  // N
      const double weight = 1.0 - d_m2 / window_m2;
      const double weighted_risk = weight * static_cast<double>(risk[column]);
      const double d_m = std::sqrt(d_m2);
      if (d_m2 <= disc_m2) {
        const double tangent =
            too_high_m > 0.0 ? too_high_m / options_.near_distance_m : too_high_m / (d_m + disc_m);
        histogram.tan_climb_near = std::max(histogram.tan_climb_near, tangent);
        near_risk += weighted_risk;
        near_weight += weight;
        continue;
      }
      const double ahead_m = dx_m * cosine + dy_m * sine;
      if (d_m2 < truncation_m2 && ahead_m < d_m * truncation_cosine_) {
        continue;
      }
      const double tangent = too_high_m > 0.0
                                 ? too_high_m / std::max(d_m - disc_m, options_.near_distance_m)
                                 : too_high_m / (d_m + disc_m);
      const double q_m = std::sqrt(d_m2 - disc_m2);
      const int low = sectors_.of_direction(dx_m * q_m + dy_m * disc_m, dy_m * q_m - dx_m * disc_m);
      int high = sectors_.of_direction(dx_m * q_m - dy_m * disc_m, dy_m * q_m + dx_m * disc_m);
      if (high < low) {
        high += count;
      }
      double* const climb = climb_.data();
      for (int k = low; k <= high; ++k) {
        climb[k] = std::max(climb[k], tangent);
      }
      risk_[static_cast<std::size_t>(low)] += weighted_risk;
      risk_[static_cast<std::size_t>(high) + 1] -= weighted_risk;
      weight_[static_cast<std::size_t>(low)] += weight;
      weight_[static_cast<std::size_t>(high) + 1] -= weight;

      const double aside_m = dy_m * cosine - dx_m * sine;
      const double aside_abs_m = std::fabs(aside_m);
      if (ahead_m <= aside_abs_m || aside_abs_m < 1e-6 * d_m ||
          d_m2 < 2.0 * arc_min_m * aside_abs_m) {
        continue;
      }
      const double delta_rad = elementary::atan2(aside_m, ahead_m);
      const double radius_m = d_m2 / (2.0 * aside_abs_m);
      const double radius_max_m =
          turn_radius_min_m + widened_m + arc_spread_m * (1.0 - std::fabs(delta_rad) / kQuarterPi);
      if (radius_m > radius_max_m) {
        continue;
      }
      const double arc_m = d_m2 * std::fabs(delta_rad) / aside_abs_m;
      const double arc_tangent =
          too_high_m > 0.0 ? too_high_m / std::max(arc_m - disc_m, options_.near_distance_m)
                           : too_high_m / (arc_m + disc_m);
      double& mask = histogram.tan_mask[static_cast<std::size_t>(
          sectors_.of_angle(heading_math_rad + 2.0 * delta_rad))];
      mask = std::max(mask, arc_tangent);
    }
  }

  histogram.tan_climb.resize(size);
  histogram.risk.resize(size);
  histogram.risk_weight.resize(size);
  double risk_sum = near_risk;
  double weight_sum = near_weight;
  double wrapped_risk = 0.0;
  double wrapped_weight = 0.0;
  for (std::size_t k = 0; k < size; ++k) {
    risk_sum += risk_[k];
    weight_sum += weight_[k];
    histogram.risk[k] = risk_sum;
    histogram.risk_weight[k] = weight_sum;
    histogram.tan_climb[k] = std::max(climb_[k], climb_[k + size]);
  }
  // What is still open at K - 1 goes on in the wrapped half.
  wrapped_risk = risk_sum - near_risk;
  wrapped_weight = weight_sum - near_weight;
  for (std::size_t k = 0; k < size; ++k) {
    wrapped_risk += risk_[k + size];
    wrapped_weight += weight_[k + size];
    histogram.risk[k] += wrapped_risk;
    histogram.risk_weight[k] += wrapped_weight;
  }
  for (std::size_t k = 0; k < size; ++k) {
    // Differences leave rounding where no cell is; a cell at the window's edge weighs more than
    // that.
    const bool is_empty = histogram.risk_weight[k] < 1e-9;
    histogram.risk_weight[k] = is_empty ? 0.0 : histogram.risk_weight[k];
    histogram.risk[k] = is_empty ? 0.0 : histogram.risk[k] / histogram.risk_weight[k];
  }
  apply_mask(sectors_.of_angle(heading_math_rad), histogram);
}

void HistogramKernel::apply_mask(int heading_sector, PolarHistogram& histogram) const {
  const int count = sectors_.count();
  const auto at = [count](int k) {
    return static_cast<std::size_t>(k < 0 ? k + count : (k >= count ? k - count : k));
  };
  histogram.tan_masked = histogram.tan_climb;
  double left = kNothing;
  double right = kNothing;
  int i = 1;
  for (; 2 * i < count; ++i) {
    const std::size_t k_left = at(heading_sector + i);
    const std::size_t k_right = at(heading_sector - i);
    left = std::max(left, histogram.tan_mask[k_left]);
    right = std::max(right, histogram.tan_mask[k_right]);
    histogram.tan_masked[k_left] = std::max(histogram.tan_masked[k_left], left);
    histogram.tan_masked[k_right] = std::max(histogram.tan_masked[k_right], right);
  }
  if (2 * i == count) {
    double& opposite = histogram.tan_masked[at(heading_sector + i)];
    opposite = std::max(opposite, std::min(left, right));
  }
}

}  // namespace hedgehop::local_planning
