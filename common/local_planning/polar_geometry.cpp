#include "local_planning/polar_geometry.hpp"

#include <algorithm>
#include <numbers>
#include <stdexcept>
#include <string>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::local_planning {
namespace {

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

// Power of two, at most 2^21, so that the sum of one for each cell of the window stays below 2^30.
float fixed_point_scale(double window_m, double cell_m) {
  const double radius_cells = window_m / cell_m + 2.0;
  const double cells = std::numbers::pi * radius_cells * radius_cells;
  double scale = 1.0;
  while (scale * cells < 536870912.0 && scale < 2097152.0) {
    scale *= 2.0;
  }
  return static_cast<float>(scale);
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

PolarConstants::PolarConstants(PolarUse use, const HistogramOptions& options,
                               const raster::GridGeometry& geometry, double greatest_risk)
    : west_m(geometry.west_m),
      south_m(geometry.south_m),
      cell_m(geometry.cell_m),
      subcells(std::max(
          1, static_cast<int>(std::ceil(geometry.cell_m /
                                        (use == PolarUse::kClimb ? kSubcell_m : kRiskSubcell_m))))),
      subcell_m(geometry.cell_m / subcells),
      window_m(options.window_m),
      disc_m(options.disc_radius_m +
             (use == PolarUse::kClimb ? 0.5 * std::numbers::sqrt2 * subcell_m : 0.0)),
      safety_height_m(options.safety_height_m),
      arc_radius_max_factor(options.arc_radius_max_factor),
      widened_m(options.is_arc_widened ? disc_m : 0.0),
      disc(static_cast<float>(disc_m)),
      near(static_cast<float>(options.near_distance_m)),
      truncation_angle(static_cast<float>(options.truncation_angle_rad)),
      truncation_distance(static_cast<float>(options.truncation_distance_m)),
      inverse_window2(static_cast<float>(1.0 / (options.window_m * options.window_m))),
      sectors_per_rad(static_cast<float>(options.sectors / kTwoPi)),
      weight_scale(fixed_point_scale(options.window_m, geometry.cell_m)),
      risk_scale(greatest_risk > 0.0 ? weight_scale / static_cast<float>(greatest_risk) : 0.0F),
      risk_max(static_cast<float>(greatest_risk)) {}

Viewpoint PolarConstants::viewpoint(double x_m, double y_m) const {
  const auto part = [this](double from_edge_m, int& cell, int& sub) {
    const double in_cells = from_edge_m / cell_m;
    const double whole = std::floor(in_cells);
    cell = static_cast<int>(whole);
    sub = std::min(subcells - 1, static_cast<int>((in_cells - whole) * subcells));
  };
  Viewpoint view;
  part(x_m - west_m, view.column, view.sub_column);
  part(y_m - south_m, view.row, view.sub_row);
  return view;
}

PolarCell polar_cell(const PolarConstants& constants, const Sectors& sectors, double dx_m,
                     double dy_m, bool needs_azimuth) {
  PolarCell cell;
  const double d_m2 = dx_m * dx_m + dy_m * dy_m;
  cell.distance_m = static_cast<float>(std::sqrt(d_m2));
  if (needs_azimuth) {
    cell.azimuth_rad = static_cast<float>(elementary::atan2(dy_m, dx_m));
  }
  cell.rise_1pm = 1.0F / std::max(cell.distance_m - constants.disc, constants.near);
  cell.fall_1pm = 1.0F / (cell.distance_m + constants.disc);
  if (cell.distance_m <= constants.disc) {
    return cell;
  }
  const double disc_m = constants.disc_m;
  const double q_m = std::sqrt(std::max(0.0, d_m2 - disc_m * disc_m));
  cell.low = sectors.of_direction(dx_m * q_m + dy_m * disc_m, dy_m * q_m - dx_m * disc_m);
  cell.high = sectors.of_direction(dx_m * q_m - dy_m * disc_m, dy_m * q_m + dx_m * disc_m);
  if (cell.high < cell.low) {
    cell.high += sectors.count();
  }
  return cell;
}

PolarQuestion::PolarQuestion(const PolarConstants& constants, double altitude_m,
                             double heading_math_rad, double turn_radius_min_m, double reach)
    : floor_m(static_cast<float>(altitude_m - constants.safety_height_m)),
      heading_rad(static_cast<float>(wrap_to_pi(heading_math_rad))),
      reach_m(static_cast<float>(reach)) {
  const double spread_m = (constants.arc_radius_max_factor - 1.0) * turn_radius_min_m;
  arc_min = static_cast<float>(2.0 * (turn_radius_min_m - constants.widened_m));
  arc_max = static_cast<float>(2.0 * (turn_radius_min_m + constants.widened_m));
  arc_spread = static_cast<float>(2.0 * spread_m);
}

}  // namespace hedgehop::local_planning
