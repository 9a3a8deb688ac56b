#include "local_planning/polar_histogram.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/elementary.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr float kNothing = -std::numeric_limits<float>::infinity();

// Adding zero makes -0 a +0: the greater of the two depends on the order they come in.
float tangent_of(float too_high_m, float distance_m, float disc_m, float near_m) {
  return too_high_m /
             (too_high_m > 0.0F ? std::max(distance_m - disc_m, near_m) : distance_m + disc_m) +
         0.0F;
}

}  // namespace

void PolarHistogram::resize(int sectors) {
  const auto size = static_cast<std::size_t>(padded_to_lanes(sectors));
  if (tan_climb.size() == size) {
    return;
  }
  tan_climb.assign(size, kNothing);
  tan_masked.assign(size, std::numeric_limits<float>::infinity());
  tan_mask.assign(size, kNothing);
  risk.assign(size, 0.0F);
  risk_weight.assign(size, 0.0F);
}

HistogramKernel::HistogramKernel(const Surroundings& surroundings, const HistogramOptions& options)
    : surroundings_(&surroundings),
      sectors_(options.sectors),
      constants_(PolarUse::kClimb, options, surroundings.geometry(), surroundings.risk_max()),
      risk_constants_(PolarUse::kRisk, options, surroundings.geometry(), surroundings.risk_max()),
      sector_risk_(static_cast<std::size_t>(options.sectors)),
      sector_weight_(static_cast<std::size_t>(options.sectors)),
      risk_(static_cast<std::size_t>(options.sectors + 1)),
      weight_(static_cast<std::size_t>(options.sectors + 1)) {}

void HistogramKernel::compute(const geo::MapPoint& place, double altitude_m,
                              double heading_math_rad, double turn_radius_min_m,
                              PolarHistogram& histogram, double reach_m) {
  const int count = sectors_.count();
  const auto size = static_cast<std::size_t>(count);
  histogram.resize(count);
  std::fill_n(histogram.tan_climb.begin(), size, kNothing);
  std::fill_n(histogram.tan_mask.begin(), size, kNothing);
  histogram.tan_climb_near = kNothing;

  const PolarConstants& c = constants_;
  const PolarQuestion question(c, altitude_m, heading_math_rad, turn_radius_min_m, reach_m);
  const Viewpoint view = c.viewpoint(place.x_m, place.y_m);
  const double within_x_m = c.within_cell_m(view.sub_column);
  const double within_y_m = c.within_cell_m(view.sub_row);
  const double window_m2 = c.window_m * c.window_m;
  const double cosine = elementary::cos(heading_math_rad);
  const double sine = elementary::sin(heading_math_rad);
  const raster::GridGeometry& geometry = surroundings_->geometry();
  const int reach_cells = static_cast<int>(c.window_m / c.cell_m) + 1;
  const int row_low = std::max(-reach_cells, -view.row);
  const int row_high = std::min(reach_cells, geometry.rows - 1 - view.row);
  const int column_low = std::max(-reach_cells, -view.column);
  const int column_high = std::min(reach_cells, geometry.columns - 1 - view.column);

  for (int row = row_low; row <= row_high; ++row) {
    const double dy_m = (row + 0.5) * c.cell_m - within_y_m;
    const float* surface_m = surroundings_->surface_m().row(view.row + row) + view.column;
    for (int column = column_low; column <= column_high; ++column) {
      const double dx_m = (column + 0.5) * c.cell_m - within_x_m;
      const double d_m2 = dx_m * dx_m + dy_m * dy_m;
      if (d_m2 > window_m2) {
        continue;
      }
      // Cells well off the heading that cannot be truncated need no azimuth.
      const double ahead_m = dx_m * cosine + dy_m * sine;
      const double aside_m = std::fabs(dy_m * cosine - dx_m * sine);
      const bool needs_azimuth =
          ahead_m > 0.9 * aside_m || d_m2 < 1.01 * c.truncation_distance * c.truncation_distance;
      const PolarCell cell = polar_cell(c, sectors_, dx_m, dy_m, needs_azimuth);
      const float d_m = cell.distance_m;
      if (d_m > question.reach_m) {
        continue;
      }
      const float too_high_m = surface_m[column] - question.floor_m;  // N
      const float tangent = too_high_m * (too_high_m > 0.0F ? cell.rise_1pm : cell.fall_1pm) + 0.0F;
      if (d_m <= c.disc) {
        histogram.tan_climb_near = std::max(histogram.tan_climb_near, tangent);
        continue;
      }
      const float turned_rad = cell.azimuth_rad - question.heading_rad;
      const float off_rad = std::min(std::fabs(turned_rad), kTwoPi_f - std::fabs(turned_rad));
      if (needs_azimuth && d_m < c.truncation_distance && off_rad > c.truncation_angle) {
        continue;
      }
      const auto low = static_cast<std::size_t>(cell.low);
      const auto end = static_cast<std::size_t>(cell.high) + 1;
      for (std::size_t k = low; k < end; ++k) {
        float& climb = histogram.tan_climb[k < size ? k : k - size];
        climb = std::max(climb, tangent);
      }

      if (!needs_azimuth || off_rad >= kQuarterPi_f || off_rad < kStraightAhead_rad) {
        continue;
      }
      const float off_rad2 = off_rad * off_rad;
      float series = kArcSeries[5];
      for (int i = 4; i >= 0; --i) {
        series = series * off_rad2 + kArcSeries[i];
      }
      const float arc_m = d_m * (series * off_rad2 + 1.0F);
      if (arc_m < off_rad * question.arc_min ||
          arc_m > off_rad *
                      (question.arc_max + question.arc_spread * (1.0F - off_rad * kFourOverPi_f))) {
        continue;
      }
      // The shorter way round is to the left if the difference is in (0, pi) or below -pi.
      const bool is_left = (turned_rad > 0.0F) == (std::fabs(turned_rad) < kPi_f);
      const float led_to_rad = question.heading_rad + (is_left ? 2.0F * off_rad : -2.0F * off_rad);
      int k = static_cast<int>(std::floor(led_to_rad * c.sectors_per_rad + 0.5F));
      k = k < 0 ? k + count : (k >= count ? k - count : k);
      float& mask = histogram.tan_mask[static_cast<std::size_t>(k)];
      mask = std::max(mask, tangent_of(too_high_m, arc_m, c.disc, c.near));
    }
  }

  const Viewpoint risk_view = risk_constants_.viewpoint(place.x_m, place.y_m);
  if (risk_view_ != risk_view) {
    compute_risk(risk_view);
    risk_view_ = risk_view;
  }
  std::copy(sector_risk_.begin(), sector_risk_.end(), histogram.risk.begin());
  std::copy(sector_weight_.begin(), sector_weight_.end(), histogram.risk_weight.begin());
  apply_mask(sectors_.of_angle(heading_math_rad), count, histogram);
}

void HistogramKernel::compute_risk(const Viewpoint& view) {
  const PolarConstants& c = risk_constants_;
  const auto size = static_cast<std::size_t>(sectors_.count());
  std::fill(risk_.begin(), risk_.end(), 0);
  std::fill(weight_.begin(), weight_.end(), 0);
  const double within_x_m = c.within_cell_m(view.sub_column);
  const double within_y_m = c.within_cell_m(view.sub_row);
  const raster::GridGeometry& geometry = surroundings_->geometry();
  const int reach_cells = static_cast<int>(c.window_m / c.cell_m) + 1;
  for (int row = std::max(-reach_cells, -view.row);
       row <= std::min(reach_cells, geometry.rows - 1 - view.row); ++row) {
    const double dy_m = (row + 0.5) * c.cell_m - within_y_m;
    const float* risk = surroundings_->risk().row(view.row + row) + view.column;
    for (int column = std::max(-reach_cells, -view.column);
         column <= std::min(reach_cells, geometry.columns - 1 - view.column); ++column) {
      const double dx_m = (column + 0.5) * c.cell_m - within_x_m;
      if (dx_m * dx_m + dy_m * dy_m > c.window_m * c.window_m) {
        continue;
      }
      const PolarCell cell = polar_cell(c, sectors_, dx_m, dy_m, false);
      const float d_m = cell.distance_m;
      const float share = std::max(1.0F - d_m * d_m * c.inverse_window2, 0.0F);
      const std::uint32_t weight = nearest_whole(share * c.weight_scale);
      const std::uint32_t weighted_risk = nearest_whole(share * risk[column] * c.risk_scale);
      const auto low = static_cast<std::size_t>(cell.low);
      const auto end = static_cast<std::size_t>(cell.high) + 1;
      if (d_m <= c.disc || end > size) {
        risk_[0] += weighted_risk;
        weight_[0] += weight;
      }
      if (d_m > c.disc) {
        risk_[low] += weighted_risk;
        weight_[low] += weight;
        risk_[end <= size ? end : end - size] -= weighted_risk;
        weight_[end <= size ? end : end - size] -= weight;
      }
    }
  }
  std::int64_t risk_sum = 0;
  std::int64_t weight_sum = 0;
  for (std::size_t k = 0; k < size; ++k) {
    risk_sum += risk_[k];
    weight_sum += weight_[k];
    const auto weight = static_cast<float>(weight_sum);
    sector_weight_[k] = weight / c.weight_scale;
    sector_risk_[k] = weight_sum > 0 ? static_cast<float>(risk_sum) / weight * c.risk_max : 0.0F;
  }
}

void apply_mask(int heading_sector, int count, PolarHistogram& histogram) {
  const auto at = [count](int k) {
    return static_cast<std::size_t>(k < 0 ? k + count : (k >= count ? k - count : k));
  };
  std::copy_n(histogram.tan_climb.begin(), static_cast<std::size_t>(count),
              histogram.tan_masked.begin());
  float left = kNothing;
  float right = kNothing;
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
    float& opposite = histogram.tan_masked[at(heading_sector + i)];
    opposite = std::max(opposite, std::min(left, right));
  }
}

}  // namespace hedgehop::local_planning
