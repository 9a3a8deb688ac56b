#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "flight/route.hpp"
#include "flight/trajectory.hpp"
#include "map/map.hpp"

namespace hedgehop::risk {

/// Weights of eq. (1) of the paper.
struct CostWeights {
  double visibility = 0.0;                 // c_vis [-]
  double visibility_per_height_1pm = 0.0;  // c_vis,h [1/m]
  double semantics = 0.0;                  // c_sem [-]
  double height_1pm = 0.0;                 // c_height [1/m]
};

/// Maps a combination of semantic bits to one cost: the first rule whose bits are all set wins.
class SemanticCostTable {
 public:
  struct Rule {
    std::uint16_t all_of = 0;
    double cost = 0.0;  // in [0, 1]
  };
  /// Section `semantics`: list `rules` of {classes: [names], cost: c}, and `otherwise`.
  static SemanticCostTable read(ConfigReader& reader);
  SemanticCostTable(std::vector<Rule> rules, double otherwise);

  [[nodiscard]] double cost(std::uint16_t bits) const { return table_[bits]; }

 private:
  std::vector<float> table_;  // 65536 entries
};

CostWeights read_weights(ConfigReader& reader);

/// Cost layers of one map under one config, ready for fast queries. Holds references to the map.
class CostModel {
 public:
  CostModel(const map::Map& map, const CostWeights& weights, const SemanticCostTable& semantics,
            double unknown_visibility);

  [[nodiscard]] const map::Map& map() const { return *map_; }
  [[nodiscard]] const CostWeights& weights() const { return weights_; }

  /// Visibility share at reference height, unknown replaced as configured; nearest cell.
  /// NaN outside the map, as are the functions below.
  [[nodiscard]] double visibility(const geo::MapPoint& point) const;
  [[nodiscard]] double semantics(const geo::MapPoint& point) const;

  /// Integrand of eq. (1) [-]: cost per metre of path at a height above the surface. >= 1.
  [[nodiscard]] double density(const geo::MapPoint& point, double height_m) const;

  /// The four terms of eq. (1) along straight legs, midpoint rule with steps of at most `step_m`.
  /// Throws std::invalid_argument for a step that is not positive.
  [[nodiscard]] flight::RouteCost route_cost(const std::vector<flight::Waypoint>& waypoints,
                                             double step_m) const;

  /// Measures of a flown path, trapezoidal between states.
  [[nodiscard]] flight::PathMeasures measures(const flight::Trajectory& trajectory,
                                              double ceiling_height_m) const;

  /// Cost layers, for kernels: same geometry as the map.
  [[nodiscard]] const raster::Grid<float>& visibility_layer() const { return visibility_; }
  [[nodiscard]] const raster::Grid<float>& semantics_layer() const { return semantics_; }

 private:
  const map::Map* map_;
  CostWeights weights_;
  raster::Grid<float> visibility_;
  raster::Grid<float> semantics_;
};

}  // namespace hedgehop::risk
