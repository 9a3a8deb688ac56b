#include "global_planning/enclosure.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::global_planning {
namespace {

using raster::CellIndex;
using raster::GridGeometry;

constexpr int kSectors = 48;
constexpr double kSector_rad = 2.0 * std::numbers::pi / kSectors;
// Heading changes by at most this much in one step: long enough to feel the turn radius, short
// enough to feel the ground.
constexpr double kStepTurn_rad = 0.8;
constexpr int kQuadrature = 64;
// Intervals grow outwards to multiples of this, so that each state is visited few times.
constexpr double kAltitudeStep_m = 2.0;
constexpr double kRounding = 1e-6;

struct Step {
  int sector;  // of the heading afterwards
  int columns, rows;
};

// The patches and sectors that one step of length `step_m` may lead to, per sector of departure.
std::array<std::vector<Step>, kSectors> steps_of(double step_m, double radius_m, double cell_m) {
  std::array<std::vector<Step>, kSectors> result;
  const double turn_rad = step_m / radius_m;
  const int sectors = static_cast<int>(std::ceil(turn_rad / kSector_rad + 1.0));
  for (int change = -sectors; change <= sectors; ++change) {
    const double change_rad = change * kSector_rad;
    // Extent of the displacement, in the frame that lies halfway between both headings. Between two
    // points of the quadrature a heading bound moves by at most slack.
    const double slack_rad = turn_rad / kQuadrature;
    double along_low_m = 0.0;
    double along_high_m = 0.0;
    double across_low_m = 0.0;
    double across_high_m = 0.0;
    bool is_possible = true;
    for (int k = 0; k < kQuadrature; ++k) {
      const double done_rad = turn_rad * (k + 0.5) / kQuadrature;
      const double left_rad = turn_rad - done_rad;
      const double half = 0.5 * kSector_rad;
      const double low_rad =
          std::max(-half - done_rad, change_rad - half - left_rad) - 0.5 * change_rad - slack_rad;
      const double high_rad =
          std::min(half + done_rad, change_rad + half + left_rad) - 0.5 * change_rad + slack_rad;
      if (low_rad > high_rad) {
        is_possible = false;
        break;
      }
      const double piece_m = step_m / kQuadrature;
      along_low_m += piece_m * elementary::cos(std::max(std::fabs(low_rad), std::fabs(high_rad)));
      along_high_m +=
          piece_m * (low_rad <= 0.0 && high_rad >= 0.0
                         ? 1.0
                         : elementary::cos(std::min(std::fabs(low_rad), std::fabs(high_rad))));
      across_low_m += piece_m * elementary::sin(low_rad);
      across_high_m += piece_m * elementary::sin(high_rad);
    }
    if (!is_possible) {
      continue;
    }
    const double half_along_m = 0.5 * (along_high_m - along_low_m) + kRounding;
    const double half_across_m = 0.5 * (across_high_m - across_low_m) + kRounding;
    for (int sector = 0; sector < kSectors; ++sector) {
      const double frame_rad = (sector + 0.5 * change) * kSector_rad;
      const double ux = elementary::cos(frame_rad);
      const double uy = elementary::sin(frame_rad);
      const double along_m = 0.5 * (along_high_m + along_low_m);
      const double across_m = 0.5 * (across_high_m + across_low_m);
      const double x_m = along_m * ux - across_m * uy;
      const double y_m = along_m * uy + across_m * ux;
      const int reach = static_cast<int>(std::ceil(step_m / cell_m)) + 1;
      for (int row = -reach; row <= reach; ++row) {
        for (int column = -reach; column <= reach; ++column) {
          // Displacements between the two patches fill a square of two cells around this one; the
          // displacements of the step fill a rectangle. Separating axes tell whether they meet.
          const double dx_m = column * cell_m - x_m;
          const double dy_m = row * cell_m - y_m;
          const double extent_x_m = half_along_m * std::fabs(ux) + half_across_m * std::fabs(uy);
          const double extent_y_m = half_along_m * std::fabs(uy) + half_across_m * std::fabs(ux);
          const double square_m = cell_m * (std::fabs(ux) + std::fabs(uy));
          if (std::fabs(dx_m) <= cell_m + extent_x_m && std::fabs(dy_m) <= cell_m + extent_y_m &&
              std::fabs(dx_m * ux + dy_m * uy) <= square_m + half_along_m &&
              std::fabs(dy_m * ux - dx_m * uy) <= square_m + half_across_m) {
            const int after = ((sector + change) % kSectors + kSectors) % kSectors;
            result[static_cast<std::size_t>(sector)].push_back({after, column, row});
          }
        }
      }
    }
  }
  return result;
}

// What a metre away from an end may be higher or lower than the end.
struct Ways {
  double rise, fall;
};
Ways ways_of(const SlopeLimits::Tangents& limit, bool is_departure) {
  const double up = std::max(limit.up, 0.0);
  const double down = std::max(limit.down, 0.0);
  return is_departure ? Ways{up, down} : Ways{down, up};
}

// The same by sector of heading away from the end, at altitudes from `low_m` on. Legs that a step
// belongs to lie within `spread_rad` of its sector.
std::array<Ways, kSectors> ways_by_sector(const SlopeLimits& slopes, double low_m,
                                          double spread_rad, bool is_departure) {
  const double upwind_rad = elementary::atan2(-slopes.wind().north_mps, -slopes.wind().east_mps);
  std::array<Ways, kSectors> result{};
  for (int sector = 0; sector < kSectors; ++sector) {
    const double flown_rad = sector * kSector_rad + (is_departure ? 0.0 : std::numbers::pi);
    const double off_rad = std::fabs(wrap_to_pi(flown_rad - upwind_rad));
    const double nearest_rad = upwind_rad + std::max(0.0, off_rad - 0.5 * kSector_rad - spread_rad);
    result[static_cast<std::size_t>(sector)] = ways_of(
        slopes.at(low_m, elementary::cos(nearest_rad), elementary::sin(nearest_rad)), is_departure);
  }
  return result;
}

// Squares of which a patch is made where an end is looked at from near.
constexpr int kParts = 8;
// Beyond this share of the turn radius a route may have flown much farther than it got.
constexpr double kHollowReach = 0.9;

// A hollow that the climb limit alone closes. See prove_enclosed().
std::optional<Enclosure> prove_hollow(const FlightEnvelope& envelope, const GlobalOptions& options,
                                      const flight::Waypoint& end, const flight::Waypoint& other,
                                      bool is_departure) {
  const double radius_m = options.turns().least_m();
  const double reach_m = kHollowReach * radius_m;
  const double to_other_x_m = other.x_m - end.x_m;
  const double to_other_y_m = other.y_m - end.y_m;
  if (to_other_x_m * to_other_x_m + to_other_y_m * to_other_y_m <= reach_m * reach_m) {
    return std::nullopt;
  }
  const GridGeometry& cells = envelope.geometry();
  const double part_m = cells.cell_m / kParts;
  // No leg from here ends lower than this, so none is steeper than slopes allow there.
  const SlopeLimits slopes = options.slopes();
  const double flown_max_m = radius_m * elementary::asin(kHollowReach) + kRounding;
  const Ways ways = ways_of(
      slopes.at_most(end.altitude_m - std::max(slopes.greatest().up, slopes.greatest().down) *
                                          (1.0 + kRounding) * flown_max_m),
      is_departure);
  // Squares count from the one that holds the end.
  const double end_column = (end.x_m - cells.west_m - 0.5 * cells.cell_m) / part_m;
  const double end_row = (end.y_m - cells.south_m - 0.5 * cells.cell_m) / part_m;
  const int middle_column = static_cast<int>(std::floor(end_column));
  const int middle_row = static_cast<int>(std::floor(end_row));
  const int reach = static_cast<int>(std::ceil(reach_m / part_m)) + 2;
  const int side = 2 * reach + 1;
  const auto floor_divide = [](int a, int b) { return a >= 0 ? a / b : -((b - 1 - a) / b); };
  // Distances from the end to the nearest and the farthest point of a square.
  const auto distances_m = [&](int column, int row) {
    const double west_m = (middle_column + column - end_column) * part_m;
    const double south_m = (middle_row + row - end_row) * part_m;
    const double near_x_m = std::clamp(0.0, west_m, west_m + part_m);
    const double near_y_m = std::clamp(0.0, south_m, south_m + part_m);
    const double far_x_m = std::max(std::fabs(west_m), std::fabs(west_m + part_m));
    const double far_y_m = std::max(std::fabs(south_m), std::fabs(south_m + part_m));
    return std::array<double, 2>{std::sqrt(near_x_m * near_x_m + near_y_m * near_y_m),
                                 std::sqrt(far_x_m * far_x_m + far_y_m * far_y_m)};
  };
  const auto is_open = [&](int column, int row, double far_m) {
    const int from_west = middle_column + column;
    const int from_south = middle_row + row;
    const CellIndex patch{floor_divide(from_west, kParts), floor_divide(from_south, kParts)};
    if (patch.column < 0 || patch.row < 0 || patch.column + 1 >= cells.columns ||
        patch.row + 1 >= cells.rows) {
      return false;  // nothing is known there, so nothing flies there
    }
    const double west = static_cast<double>(from_west - patch.column * kParts) / kParts;
    const double south = static_cast<double>(from_south - patch.row * kParts) / kParts;
    const AltitudeBand band = envelope.widest_band_over_part(
        patch, west, south, west + 1.0 / kParts, south + 1.0 / kParts);
    const double flown_m = radius_m * elementary::asin(std::min(far_m / radius_m, 1.0)) + kRounding;
    return band.low_m <= end.altitude_m + ways.rise * (1.0 + kRounding) * flown_m &&
           band.high_m >= end.altitude_m - ways.fall * (1.0 + kRounding) * flown_m;
  };
  std::vector<std::uint8_t> is_seen(static_cast<std::size_t>(side) * static_cast<std::size_t>(side),
                                    0);
  std::vector<CellIndex> open;
  Enclosure result;
  const auto visit = [&](int column, int row) {
    std::uint8_t& seen =
        is_seen[static_cast<std::size_t>(row + reach) * static_cast<std::size_t>(side) +
                static_cast<std::size_t>(column + reach)];
    if (seen != 0) {
      return true;
    }
    seen = 1;
    const auto [near_m, far_m] = distances_m(column, row);
    if (near_m > 0.0 && !is_open(column, row, far_m)) {
      return true;
    }
    open.push_back({column, row});
    result.reach_m = std::max(result.reach_m, far_m);
    return far_m < reach_m;
  };
  visit(0, 0);
  for (std::size_t k = 0; k < open.size(); ++k) {
    const CellIndex at = open[k];
    for (int row = at.row - 1; row <= at.row + 1; ++row) {
      for (int column = at.column - 1; column <= at.column + 1; ++column) {
        if (!visit(column, row)) {
          return std::nullopt;
        }
      }
    }
  }
  result.states = static_cast<std::int64_t>(open.size());
  return result;
}

}  // namespace

std::optional<Enclosure> prove_enclosed(const FlightEnvelope& envelope,
                                        const GlobalOptions& options, const flight::Waypoint& end,
                                        const flight::Waypoint& other, double reach_max_m,
                                        std::int64_t work_max) {
  const double half_turn_rad = 0.5 * options.turn_angle_max_rad;
  const bool is_departure = end == envelope.start();
  if (!(options.turn_radius_m > 0.0) || !(half_turn_rad < 0.25 * std::numbers::pi + kRounding)) {
    return std::nullopt;
  }
  if (auto hollow = prove_hollow(envelope, options, end, other, is_departure)) {
    return hollow;
  }
  const GridGeometry& cells = envelope.geometry();
  const double cell_m = cells.cell_m;
  const TurnLimit turns = options.turns();
  const double aside_m =
      turns.greatest_m() * (1.0 / elementary::cos(half_turn_rad) - 1.0) + kRounding;
  const double step_m = kStepTurn_rad * turns.least_m();

  // The patches between cell centres around the end, with the bands of all patches within aside_m.
  const int reach = static_cast<int>(std::ceil((reach_max_m + step_m) / cell_m)) + 1;
  const int aside = static_cast<int>(std::ceil(aside_m / cell_m)) + 1;
  const GridGeometry patches{cells.west_m + 0.5 * cell_m, cells.south_m + 0.5 * cell_m, cell_m,
                             cells.columns - 1, cells.rows - 1};
  const CellIndex middle = patches.cell_at(end.point());
  const int side = 2 * reach + 1;
  const int wide = side + 2 * aside;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  std::vector<AltitudeBand> own(static_cast<std::size_t>(wide) * static_cast<std::size_t>(wide),
                                AltitudeBand{kInfinity, -kInfinity});
  for (int row = 0; row < wide; ++row) {
    for (int column = 0; column < wide; ++column) {
      const CellIndex patch{middle.column - reach - aside + column,
                            middle.row - reach - aside + row};
      if (patches.contains(patch)) {
        own[static_cast<std::size_t>(row * wide + column)] = envelope.widest_band_over_patch(patch);
      }
    }
  }
  const auto place = [&](int column, int row) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(side) +
           static_cast<std::size_t>(column);
  };
  std::vector<AltitudeBand> bands(place(0, side), AltitudeBand{kInfinity, -kInfinity});
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      AltitudeBand& band = bands[place(column, row)];
      for (int dy = -aside; dy <= aside; ++dy) {
        for (int dx = -aside; dx <= aside; ++dx) {
          const double gap_x_m = std::max(std::abs(dx) - 1, 0) * cell_m;
          const double gap_y_m = std::max(std::abs(dy) - 1, 0) * cell_m;
          if (gap_x_m * gap_x_m + gap_y_m * gap_y_m > aside_m * aside_m) {
            continue;
          }
          const AltitudeBand& near =
              own[static_cast<std::size_t>((row + aside + dy) * wide + column + aside + dx)];
          if (near.is_flyable()) {
            band.low_m = std::min(band.low_m, near.low_m);
            band.high_m = std::max(band.high_m, near.high_m);
          }
        }
      }
    }
  }

  double lowest_m = kInfinity;
  for (const AltitudeBand& band : bands) {
    lowest_m = std::min(lowest_m, band.low_m);
  }
  // Each point of the curve belongs to a leg whose course is at most half a turn off its heading.
  const auto ways =
      ways_by_sector(options.slopes(), lowest_m, kStepTurn_rad + half_turn_rad, is_departure);
  const double along_m = step_m * elementary::tan(half_turn_rad) / half_turn_rad;

  const auto steps = steps_of(step_m, turns.least_m(), cell_m);
  struct Interval {
    float low_m = std::numeric_limits<float>::infinity();
    float high_m = -std::numeric_limits<float>::infinity();
  };
  // Altitudes relative to the end, which are exact in float: multiples of kAltitudeStep_m.
  std::vector<Interval> reached(bands.size() * kSectors);
  std::vector<std::uint8_t> is_queued(reached.size(), 0);
  std::vector<std::uint32_t> queue;
  const double reach_in_patches = reach_max_m / cell_m;
  const double other_column = (other.x_m - patches.west_m) / cell_m - (middle.column - reach);
  const double other_row = (other.y_m - patches.south_m) / cell_m - (middle.row - reach);
  const auto square_to = [](double column, double row, double to_column, double to_row) {
    const double dx = to_column - std::clamp(to_column, column, column + 1.0);
    const double dy = to_row - std::clamp(to_row, row, row + 1.0);
    return dx * dx + dy * dy;
  };
  const double step_in_patches = step_m / cell_m;
  Enclosure result;
  double farthest = 0.0;
  // False when the state shows that the end is not enclosed.
  const auto reach_state = [&](int column, int row, int sector, double low_m, double high_m) {
    const AltitudeBand& band = bands[place(column, row)];
    low_m = std::max(low_m, band.low_m - end.altitude_m);
    high_m = std::min(high_m, band.high_m - end.altitude_m);
    if (!(low_m <= high_m)) {
      return true;
    }
    const std::size_t state = place(column, row) * kSectors + static_cast<std::size_t>(sector);
    Interval& interval = reached[state];
    if (low_m >= static_cast<double>(interval.low_m) &&
        high_m <= static_cast<double>(interval.high_m)) {
      return true;
    }
    if (interval.low_m > interval.high_m) {
      ++result.states;
      const double square = (column - reach) * static_cast<double>(column - reach) +
                            (row - reach) * static_cast<double>(row - reach);
      farthest = std::max(farthest, square);
      if (square > reach_in_patches * reach_in_patches ||
          square_to(column, row, other_column, other_row) <= step_in_patches * step_in_patches) {
        return false;
      }
    }
    interval.low_m = std::min(
        interval.low_m, static_cast<float>(std::floor(low_m / kAltitudeStep_m) * kAltitudeStep_m));
    interval.high_m = std::max(
        interval.high_m, static_cast<float>(std::ceil(high_m / kAltitudeStep_m) * kAltitudeStep_m));
    if (is_queued[state] == 0) {
      is_queued[state] = 1;
      queue.push_back(static_cast<std::uint32_t>(state));
    }
    return true;
  };
  for (int sector = 0; sector < kSectors; ++sector) {
    if (!reach_state(reach, reach, sector, 0.0, 0.0)) {
      return std::nullopt;
    }
  }
  std::int64_t work = 0;
  std::vector<std::uint32_t> wave;
  while (!queue.empty()) {
    wave.swap(queue);
    queue.clear();
    for (const std::uint32_t state : wave) {
      is_queued[state] = 0;
      const int sector = static_cast<int>(state % kSectors);
      const int column = static_cast<int>(state / kSectors) % side;
      const int row = static_cast<int>(state / kSectors) / side;
      const Interval here = reached[state];
      const auto& onwards = steps[static_cast<std::size_t>(sector)];
      const Ways& way = ways[static_cast<std::size_t>(sector)];
      const double low_m = static_cast<double>(here.low_m) - (way.fall * along_m + kRounding);
      const double high_m = static_cast<double>(here.high_m) + (way.rise * along_m + kRounding);
      work += static_cast<std::int64_t>(onwards.size());
      if (work > work_max) {
        return std::nullopt;
      }
      for (const Step& step : onwards) {
        const int to_column = column + step.columns;
        const int to_row = row + step.rows;
        if (to_column < 0 || to_column >= side || to_row < 0 || to_row >= side) {
          return std::nullopt;
        }
        if (!reach_state(to_column, to_row, step.sector, low_m, high_m)) {
          return std::nullopt;
        }
      }
    }
  }
  result.reach_m = (std::sqrt(farthest) + 2.0) * cell_m + step_m + aside_m;
  return result;
}

}  // namespace hedgehop::global_planning
