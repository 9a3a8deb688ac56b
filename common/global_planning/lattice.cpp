#include "global_planning/lattice.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/elementary.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kTurnMax_rad = 0.46364760900080609;  // between (1, 0) and (2, 1)
// A label is as good as another whose interval is smaller by this at either end.
constexpr double kIntervalTolerance_m = 3.0;
constexpr int kLabelsMax = 6;  // of one node and direction

}  // namespace

Lattice::Lattice(const raster::GridGeometry& geometry, const GlobalOptions& options,
                 const geo::MapPoint& origin, const geo::MapPoint& south_west,
                 const geo::MapPoint& north_east, bool is_backward)
    : origin_(origin) {
  const double turn_tangent = elementary::tan(0.5 * kTurnMax_rad);
  spacing_m_ = std::max(options.turn_radius_m * turn_tangent * 1.001, 2.0 * geometry.cell_m);
  // Legs beside a corner hold the tangents of its arc.
  const double unit_tangent = 2.0 * turn_tangent;
  const double knight_tangent =
      2.0 * elementary::tan(0.5 * (0.25 * std::numbers::pi - kTurnMax_rad));
  const TurnLimit turns = options.turns();
  for (int d = 0; d < kLatticeDirections; ++d) {
    const auto& step = kLatticeStep[static_cast<std::size_t>(d)];
    const double length_m =
        spacing_m_ * std::sqrt(static_cast<double>(step[0] * step[0] + step[1] * step[1]));
    const auto radius_beside_m = [&](int turned) {
      const auto& other = kLatticeStep[static_cast<std::size_t>((d + turned) & 15)];
      const double way = is_backward ? -1.0 : 1.0;
      return turns.radius_m(way * step[0], way * step[1], way * other[0], way * other[1]);
    };
    const double radius_m = std::max(radius_beside_m(1), radius_beside_m(kLatticeDirections - 1));
    const double needed_m = radius_m * (d % 4 == 2 ? knight_tangent : unit_tangent);
    repeats_[static_cast<std::size_t>(d)] =
        std::max(1, static_cast<int>(std::ceil(needed_m / length_m)));
  }
  const double west_m = std::max(geometry.west_m, south_west.x_m);
  const double south_m = std::max(geometry.south_m, south_west.y_m);
  const double east_m = std::min(geometry.east_m(), north_east.x_m);
  const double north_m = std::min(geometry.north_m(), north_east.y_m);
  origin_column_ = static_cast<int>(std::floor((origin.x_m - west_m) / spacing_m_));
  origin_row_ = static_cast<int>(std::floor((origin.y_m - south_m) / spacing_m_));
  columns_ = origin_column_ + 1 + static_cast<int>(std::floor((east_m - origin.x_m) / spacing_m_));
  rows_ = origin_row_ + 1 + static_cast<int>(std::floor((north_m - origin.y_m) / spacing_m_));
}

LatticeLabel label_of(const FlightEnvelope::Arrival& arrival, double cost_m, int column, int row,
                      int direction) {
  return {cost_m + arrival.cost_m,
          static_cast<float>(arrival.altitudes.low_m),
          static_cast<float>(arrival.altitudes.high_m),
          static_cast<float>(arrival.owed_m),
          column,
          row,
          -1,
          -1,
          0.0,
          0.0,
          static_cast<std::int8_t>(direction)};
}

bool add_label(std::vector<LatticeLabel>& labels, std::int32_t& chain, LatticeLabel label) {
  int count = 0;
  for (std::int32_t at = chain; at >= 0; at = labels[static_cast<std::size_t>(at)].next) {
    const LatticeLabel& other = labels[static_cast<std::size_t>(at)];
    if (other.cost_m <= label.cost_m &&
        static_cast<double>(other.low_m) <=
            static_cast<double>(label.low_m) + kIntervalTolerance_m &&
        static_cast<double>(other.high_m) >=
            static_cast<double>(label.high_m) - kIntervalTolerance_m) {
      return false;
    }
    ++count;
  }
  if (count >= kLabelsMax) {
    return false;
  }
  label.next = chain;
  chain = static_cast<std::int32_t>(labels.size());
  labels.push_back(label);
  return true;
}

std::vector<geo::MapPoint> lattice_corners(const std::vector<geo::MapPoint>& nodes,
                                           double spacing_m) {
  std::vector<geo::MapPoint> track;
  for (const geo::MapPoint& point : nodes) {
    if (track.size() >= 2) {
      const geo::MapPoint& a = track[track.size() - 2];
      const geo::MapPoint& b = track.back();
      const double cross =
          (b.x_m - a.x_m) * (point.y_m - b.y_m) - (b.y_m - a.y_m) * (point.x_m - b.x_m);
      if (std::fabs(cross) <= 1e-6 * spacing_m * spacing_m &&
          (b.x_m - a.x_m) * (point.x_m - b.x_m) + (b.y_m - a.y_m) * (point.y_m - b.y_m) > 0.0) {
        track.pop_back();
      }
    }
    track.push_back(point);
  }
  return track;
}

}  // namespace hedgehop::global_planning
