#include "verification/surface_sweep.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace hedgehop::verification {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Cell centres around a patch. Where the grid ends, both sides are the same cell: the surface is
// flat across its edge.
struct Patch {
  int west = 0;
  int east = 0;
  int south = 0;
  int north = 0;
};

// Sides of the patch that holds coordinate `u`, counted in cells from the first centre.
std::array<int, 2> patch_sides(double u, int cells) {
  const double floor_u = std::floor(u);
  if (floor_u < 0.0) {
    return {0, 0};
  }
  if (floor_u >= cells - 1) {
    return {cells - 1, cells - 1};
  }
  const int low = static_cast<int>(floor_u);
  return {low, low + 1};
}

struct Fractions {
  double u = 0.0;
  double v = 0.0;
};

// Heights at the four corners; a void stays in only if it takes part in one of the given points.
struct Corners {
  double south_west = 0.0;
  double south_east = 0.0;
  double north_west = 0.0;
  double north_east = 0.0;

  [[nodiscard]] bool is_known() const {
    return !std::isnan(south_west + south_east + north_west + north_east);
  }
  [[nodiscard]] double at(const Fractions& f) const {
    return (1.0 - f.v) * ((1.0 - f.u) * south_west + f.u * south_east) +
           f.v * ((1.0 - f.u) * north_west + f.u * north_east);
  }
};

Corners corners_of(const raster::Grid<float>& grid, const Patch& patch,
                   std::initializer_list<Fractions> points) {
  double west = 0.0;
  double east = 0.0;
  double south = 0.0;
  double north = 0.0;
  for (const Fractions& f : points) {
    west = std::max(west, 1.0 - f.u);
    east = std::max(east, f.u);
    south = std::max(south, 1.0 - f.v);
    north = std::max(north, f.v);
  }
  const auto corner = [&](int column, int row, double column_weight, double row_weight) {
    return column_weight > 0.0 && row_weight > 0.0 ? static_cast<double>(grid.at(column, row))
                                                   : 0.0;
  };
  return {
      corner(patch.west, patch.south, west, south), corner(patch.east, patch.south, east, south),
      corner(patch.west, patch.north, west, north), corner(patch.east, patch.north, east, north)};
}

// The gradient of a bilinear patch lies between the differences along its sides, so the differences
// between neighbouring cells of the patch and of those around it bound it there.
double gradient_around(const raster::Grid<float>& grid, const Patch& patch) {
  const int west = std::max(patch.west - 1, 0);
  const int east = std::min(patch.east + 1, grid.columns() - 1);
  const int south = std::max(patch.south - 1, 0);
  const int north = std::min(patch.north + 1, grid.rows() - 1);
  double along_x_m = 0.0;
  double along_y_m = 0.0;
  for (int row = south; row <= north; ++row) {
    for (int column = west; column <= east; ++column) {
      const auto here_m = static_cast<double>(grid.at(column, row));
      if (column < east) {
        // A difference with a void is NaN and is passed over by fmax.
        along_x_m = std::fmax(along_x_m, std::fabs(grid.at(column + 1, row) - here_m));
      }
      if (row < north) {
        along_y_m = std::fmax(along_y_m, std::fabs(grid.at(column, row + 1) - here_m));
      }
    }
  }
  return std::sqrt(along_x_m * along_x_m + along_y_m * along_y_m) / grid.geometry().cell_m;
}

// q(s) = start + linear s + quadratic s^2 on [0, 1].
struct Quadratic {
  double start = 0.0;
  double linear = 0.0;
  double quadratic = 0.0;

  [[nodiscard]] double at(double s) const { return start + s * (linear + s * quadratic); }
};

struct Least {
  double value = 0.0;
  double at = 0.0;
};

Least least_of(const Quadratic& q) {
  Least least{q.start, 0.0};
  if (const double end = q.at(1.0); end < least.value) {
    least = {end, 1.0};
  }
  if (q.quadratic > 0.0 && q.linear < 0.0 && -q.linear < 2.0 * q.quadratic) {
    const double vertex = -q.linear / (2.0 * q.quadratic);
    if (const double value = q.at(vertex); value < least.value) {
      least = {value, vertex};
    }
  }
  return least;
}

// Length of { s in [0, 1] : q(s) <= level }.
double share_at_most(const Quadratic& q, double level) {
  std::array<double, 4> cuts{0.0, 1.0, 1.0, 1.0};
  std::size_t count = 1;
  const double c = q.start - level;
  const double discriminant = q.linear * q.linear - 4.0 * q.quadratic * c;
  if (discriminant >= 0.0) {
    // The form without cancellation; a coefficient of 0 gives infinities or NaN, which are no cuts.
    const double half =
        -0.5 * (q.linear + (q.linear < 0.0 ? -std::sqrt(discriminant) : std::sqrt(discriminant)));
    for (const double root : {half / q.quadratic, c / half}) {
      if (root > 0.0 && root < 1.0) {
        cuts[count++] = root;
      }
    }
  }
  cuts[count++] = 1.0;
  std::sort(cuts.begin(), cuts.begin() + static_cast<std::ptrdiff_t>(count));
  double share = 0.0;
  for (std::size_t i = 1; i < count; ++i) {
    if (q.at(0.5 * (cuts[i - 1] + cuts[i])) <= level) {
      share += cuts[i] - cuts[i - 1];
    }
  }
  return share;
}

// Shares of [0, 1] at which a coordinate passes one of the first `cells` centres.
void add_cuts(double from, double to, int cells, std::vector<double>& cuts) {
  const double first = std::max(std::ceil(std::min(from, to)), 0.0);
  const double last = std::min(std::floor(std::max(from, to)), cells - 1.0);
  for (double centre = first; centre <= last && from != to; centre += 1.0) {
    cuts.push_back(std::clamp((centre - from) / (to - from), 0.0, 1.0));
  }
}

// The part of the piece within `from + t (to - from)` in [low, high].
void clip(double from, double to, double low, double high, double& enter, double& leave) {
  if (from == to) {
    if (from < low || from > high) {
      leave = -1.0;
    }
    return;
  }
  const double a = (low - from) / (to - from);
  const double b = (high - from) / (to - from);
  enter = std::max(enter, std::min(a, b));
  leave = std::min(leave, std::max(a, b));
}

}  // namespace

double interpolated_height_m(const raster::Grid<float>& heights_m, const geo::MapPoint& point) {
  const raster::GridGeometry& geometry = heights_m.geometry();
  if (!geometry.contains(point)) {
    return kNan;
  }
  const double u = (point.x_m - geometry.west_m) / geometry.cell_m - 0.5;
  const double v = (point.y_m - geometry.south_m) / geometry.cell_m - 0.5;
  const auto [west, east] = patch_sides(u, geometry.columns);
  const auto [south, north] = patch_sides(v, geometry.rows);
  const Fractions fractions{west == east ? 0.0 : u - west, south == north ? 0.0 : v - south};
  return corners_of(heights_m, {west, east, south, north}, {fractions}).at(fractions);
}

Sweep sweep_surface(const raster::Grid<float>& surface_m, const PathPoint& from,
                    const PathPoint& to, double low_height_m) {
  const raster::GridGeometry& geometry = surface_m.geometry();
  Sweep sweep{kNan, kNan, 0.0, 0.0, kNan, kNan};

  double enter = 0.0;
  double leave = 1.0;
  clip(from.x_m, to.x_m, geometry.west_m, geometry.east_m(), enter, leave);
  clip(from.y_m, to.y_m, geometry.south_m, geometry.north_m(), enter, leave);
  if (enter > leave) {
    sweep.outside_at = 0.0;
    return sweep;
  }
  if (enter > 0.0 || leave < 1.0) {
    sweep.outside_at = enter > 0.0 ? 0.0 : leave;
  }

  const double u_from = (from.x_m - geometry.west_m) / geometry.cell_m - 0.5;
  const double u_to = (to.x_m - geometry.west_m) / geometry.cell_m - 0.5;
  const double v_from = (from.y_m - geometry.south_m) / geometry.cell_m - 0.5;
  const double v_to = (to.y_m - geometry.south_m) / geometry.cell_m - 0.5;
  const auto u_at = [&](double t) { return u_from + t * (u_to - u_from); };
  const auto v_at = [&](double t) { return v_from + t * (v_to - v_from); };

  std::vector<double> cuts{enter, leave};
  add_cuts(u_from, u_to, geometry.columns, cuts);
  add_cuts(v_from, v_to, geometry.rows, cuts);
  std::sort(cuts.begin(), cuts.end());

  for (std::size_t i = 1; i < cuts.size(); ++i) {
    const double begin = cuts[i - 1];
    const double end = cuts[i];
    if (begin < enter || end > leave || (begin == end && cuts.size() > 2)) {
      continue;
    }
    const double middle = 0.5 * (begin + end);
    const auto [west, east] = patch_sides(u_at(middle), geometry.columns);
    const auto [south, north] = patch_sides(v_at(middle), geometry.rows);
    const Patch patch{west, east, south, north};
    const auto fractions_at = [&](double t) {
      return Fractions{
          patch.west == patch.east ? 0.0 : std::clamp(u_at(t) - patch.west, 0.0, 1.0),
          patch.south == patch.north ? 0.0 : std::clamp(v_at(t) - patch.south, 0.0, 1.0)};
    };
    const Fractions first = fractions_at(begin);
    const Fractions last = fractions_at(end);
    const Corners corners = corners_of(surface_m, patch, {first, last});
    if (!corners.is_known()) {
      sweep.unknown_at = std::fmin(sweep.unknown_at, begin);
      continue;
    }
    const double twist =
        corners.south_west - corners.south_east - corners.north_west + corners.north_east;
    const double climb_m = to.altitude_m - from.altitude_m;
    Quadratic clearance;
    clearance.start = from.altitude_m + begin * climb_m - corners.at(first);
    clearance.quadratic = -twist * (last.u - first.u) * (last.v - first.v);
    clearance.linear =
        from.altitude_m + end * climb_m - corners.at(last) - clearance.start - clearance.quadratic;

    const Least least = least_of(clearance);
    if (!(least.value >= sweep.clearance_min_m)) {
      sweep.clearance_min_m = least.value;
      sweep.clearance_min_at = begin + least.at * (end - begin);
    }
    sweep.share_low += share_at_most(clearance, low_height_m) * (end - begin);
    sweep.gradient_max = std::max(sweep.gradient_max, gradient_around(surface_m, patch));
  }
  return sweep;
}

}  // namespace hedgehop::verification
