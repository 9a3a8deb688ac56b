#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "flight/trajectory.hpp"
#include "geo/map_projection.hpp"
#include "map/map.hpp"
#include "verification/area_entry.hpp"
#include "verification/cylinder_distance.hpp"
#include "verification/surface_sweep.hpp"

namespace hedgehop::verification {

/// Whether every number of a state is.
bool is_finite(const flight::FlightState& state);

double distance_m(const geo::MapPoint& a, const geo::MapPoint& b);

struct Velocity {
  double x_mps = 0.0;
  double y_mps = 0.0;
};

Velocity velocity_of(const flight::FlightState& state);
double length_of(const Velocity& velocity);

inline PathPoint path_point(const flight::FlightState& state) {
  return {state.x_m, state.y_m, state.altitude_m};
}

/// How far the flown path may stray from the chord between two states.
///
/// Between states the path is the cubic that has the states' places and velocities at its ends.
/// With d0 and d1 the differences between the velocities at the ends and that of the chord, the
/// cubic lies off the chord by h (d0 t (1-t)^2 - d1 t^2 (1-t)), which is at most h max(|d0|, |d1|)
/// t (1-t), so at most h max(|d0|, |d1|) / 4. For constant acceleration this is the sagitta h^2 a
/// / 8.
struct Sagitta {
  double across_m = 0.0;
  double vertical_m = 0.0;
};

Sagitta sagitta_of(const flight::FlightState& a, const flight::FlightState& b, double step_s);

/// Clearance of the path between two states above the interpolated surface.
struct PieceClearance {
  double least_m = 0.0;  // NaN if nothing of the piece is known; never too great
  double at = 0.0;       // share of the piece
};
PieceClearance piece_clearance(const raster::Grid<float>& surface_m, const Sweep& sweep,
                               const Sagitta& stray);

struct Box {
  double west_m = std::numeric_limits<double>::infinity();
  double east_m = -std::numeric_limits<double>::infinity();
  double south_m = std::numeric_limits<double>::infinity();
  double north_m = -std::numeric_limits<double>::infinity();

  void add(const geo::MapPoint& point) {
    west_m = std::min(west_m, point.x_m);
    east_m = std::max(east_m, point.x_m);
    south_m = std::min(south_m, point.y_m);
    north_m = std::max(north_m, point.y_m);
  }
  [[nodiscard]] bool is_within(double distance_m, const Box& other) const {
    return west_m - distance_m <= other.east_m && other.west_m <= east_m + distance_m &&
           south_m - distance_m <= other.north_m && other.south_m <= north_m + distance_m;
  }
};

/// The pieces of a flight in blocks, so that most things on the map are done with after a few
/// comparisons.
class PieceBlocks {
 public:
  // A path that strays farther off its chord breaks continuity, and has been found there.
  static constexpr double kStrayMax_m = 1.0;

  PieceBlocks(const std::vector<flight::FlightState>& states, double step_s)
      : states_(states), step_s_(step_s) {
    for (std::size_t begin = 0; begin + 1 < states.size(); begin += kBlock) {
      Box box;
      for (std::size_t i = begin; i <= std::min(begin + kBlock, states.size() - 1); ++i) {
        if (is_finite(states[i])) {
          box.add(states[i].point());
        }
      }
      blocks_.push_back(box);
    }
  }

  /// Calls visit(index, from, to, stray_m) for every piece of a block that lies within `reach_m` of
  /// the box; `stray_m` bounds how far the path may leave the straight piece.
  template <typename Visit>
  void visit_near(const Box& box, double reach_m, const Visit& visit) const {
    for (std::size_t k = 0; k < blocks_.size(); ++k) {
      if (!box.is_within(reach_m + 2.0 * kStrayMax_m, blocks_[k])) {
        continue;
      }
      const std::size_t begin = k * kBlock;
      for (std::size_t i = begin; i < std::min(begin + kBlock, states_.size() - 1); ++i) {
        if (is_finite(states_[i]) && is_finite(states_[i + 1])) {
          const Sagitta stray = sagitta_of(states_[i], states_[i + 1], step_s_);
          visit(i, path_point(states_[i]), path_point(states_[i + 1]),
                Sagitta{std::min(stray.across_m, kStrayMax_m),
                        std::min(stray.vertical_m, kStrayMax_m)});
        }
      }
    }
  }

 private:
  static constexpr std::size_t kBlock = 64;
  const std::vector<flight::FlightState>& states_;
  double step_s_;
  std::vector<Box> blocks_;
};

/// A span of wires between two supports: tops AMSL, both infinite if one of them is unknown.
struct Span {
  PathPoint top_a;
  PathPoint top_b;
  Box box;
};
/// The span that ends at support number `end`, from 1 on.
Span span_of(const map::Map& map, const map::OverheadLine& line, std::size_t end);

/// All that may stand where an obstacle is: the higher one of what the map says and of what follows
/// from the ground; without top if neither is known. The radius of the map holds the obstacle's own
/// extent and the error of its position, the height that of its height.
Cylinder cylinder_of(const map::Map& map, const map::Obstacle& obstacle);

/// Around all polygons of an area.
Box box_of(const map::Area& area);

/// Whether a limit of the area refers to the ground.
bool needs_ground(const map::Area& area);

/// A grid of heights upside down: the greatest height above ground is the least one with all signs
/// turned.
raster::Grid<float> turned(const raster::Grid<float>& heights_m);

/// Least and greatest height above a surface over a piece of path, NaN where some of it is unknown.
HeightRange heights_over(const raster::Grid<float>& surface_m,
                         const raster::Grid<float>& turned_surface_m, const PathPoint& from,
                         const PathPoint& to, double stray_vertical_m);

}  // namespace hedgehop::verification
