#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "flight/route.hpp"
#include "flight/trajectory.hpp"
#include "map/map.hpp"
#include "raster/window.hpp"
#include "risk/area_index.hpp"
#include "risk/named_threats.hpp"
#include "risk/wire_crossings.hpp"

namespace hedgehop::risk {

/// Weights of eq. (1) of the paper, and of what may cost beyond it.
struct CostWeights {
  double visibility = 0.0;                 // c_vis [-]
  double visibility_per_height_1pm = 0.0;  // c_vis,h [1/m]
  double semantics = 0.0;                  // c_sem [-]
  double height_1pm = 0.0;                 // c_height [1/m]
  // Beyond eq. (1): 0 is none, and nothing is worked out for it.
  double soft_ceiling_m = 0.0;    // height above the surface
  double soft_ceiling_1pm = 0.0;  // of a metre of path, for each metre above it
  double threats = 0.0;           // of a metre that a named observer sees, for each of them [-]
  double wire_crossing_m = 0.0;   // of a crossing in the middle of a span
  double slope_along = 0.0;       // of a metre, by the square of the hillside's slope along it [-]

  bool operator==(const CostWeights&) const = default;
};

/// Maps a combination of semantic bits to one cost: the first rule whose bits are all set wins.
class SemanticCostTable {
 public:
  struct Rule {
    std::uint16_t all_of = 0;
    double cost = 0.0;  // in [0, 1]
  };
  /// Section `semantics`: list `rules` of {classes: [names], cost: c}, `otherwise`, and
  /// `soft_area`, the least cost inside a soft area of the map.
  static SemanticCostTable read(ConfigReader& reader);
  SemanticCostTable(std::vector<Rule> rules, double otherwise, double soft_area = 0.0);

  [[nodiscard]] double cost(std::uint16_t bits) const { return table_[bits]; }
  [[nodiscard]] double soft_area() const { return soft_area_; }

 private:
  std::vector<float> table_;  // 65536 entries
  double soft_area_;
};

CostWeights read_weights(ConfigReader& reader);

/// The integrand of eq. (1) without the map: what a kernel needs beside the layers of a cell, and
/// the soft ceiling.
///
///     1 + c_vis seen^2 + c_sem semantics + c_height |h - h_ref| + c_soft max(h - h_soft, 0)
///
/// seen is the visibility at the height h. With one height it is the paper's
/// (1 + c_vis,h max(h - h_ref, 0)) times the visibility at h_ref. With an exposure volume it is
/// interpolated linearly between its heights, and the paper's factor only goes on above the
/// highest.
class CostDensity {
 public:
  CostDensity(const CostWeights& weights, double reference_height_m, std::vector<double> heights_m);

  /// Heights whose visibility a cell must give, ascending; the reference height alone without an
  /// exposure volume.
  [[nodiscard]] const std::vector<double>& heights_m() const { return heights_m_; }
  [[nodiscard]] double reference_height_m() const { return reference_height_m_; }

  /// @param visibility  of the cell at each of heights_m().
  [[nodiscard]] double seen(const float* visibility, double height_m) const {
    const std::size_t last = heights_m_.size() - 1;
    if (!(height_m < heights_m_[last])) {
      const double above_m = height_m - heights_m_[last];
      return (1.0 + weights_.visibility_per_height_1pm * above_m) *
             static_cast<double>(visibility[last]);
    }
    std::size_t i = 0;
    while (i < last && height_m >= heights_m_[i + 1]) {
      ++i;
    }
    const double low = static_cast<double>(visibility[i]);
    if (!(height_m > heights_m_[i])) {
      return low;
    }
    const double share = (height_m - heights_m_[i]) / (heights_m_[i + 1] - heights_m_[i]);
    return low + share * (static_cast<double>(visibility[i + 1]) - low);
  }
  /// The least at any height from this one on: seen() falls between two of heights_m() where the
  /// visibilities do.
  [[nodiscard]] double least_seen_above(const float* visibility, double height_m) const {
    double least = seen(visibility, height_m);
    for (std::size_t i = 0; i < heights_m_.size(); ++i) {
      if (heights_m_[i] > height_m) {
        least = std::fmin(least, static_cast<double>(visibility[i]));
      }
    }
    return least;
  }
  /// The least value at any height from this one on.
  [[nodiscard]] double least_above(const float* visibility, double semantics,
                                   double height_m) const {
    const double here = least_seen_above(visibility, height_m);
    return 1.0 + weights_.visibility * here * here + weights_.semantics * semantics +
           weights_.height_1pm * std::fmax(height_m - reference_height_m_, 0.0) +
           above_soft_ceiling(height_m);
  }
  /// >= 1.
  [[nodiscard]] double operator()(const float* visibility, double semantics,
                                  double height_m) const {
    const double here = seen(visibility, height_m);
    const double sum = 1.0 + weights_.visibility * here * here + weights_.semantics * semantics +
                       weights_.height_1pm * std::fabs(height_m - reference_height_m_);
    return height_m > soft_ceiling_m_ ? sum + above_soft_ceiling(height_m) : sum;
  }
  /// The last term of it.
  [[nodiscard]] double above_soft_ceiling(double height_m) const {
    return height_m > soft_ceiling_m_ ? weights_.soft_ceiling_1pm * (height_m - soft_ceiling_m_)
                                      : 0.0;
  }

 private:
  CostWeights weights_;
  double reference_height_m_;
  double soft_ceiling_m_;  // infinity if nothing is charged above it
  std::vector<double> heights_m_;
};

/// Cost layers of one map under one config, ready for fast queries. Holds references to the map.
///
/// Planners see the visibility without dark patches shorter than `small_patch_m`, see
/// without_small_patches(). This is done here and not in the map, so that the map keeps what was
/// computed, the size can change without preparing it again, and layers for other heights are
/// treated alike.
class CostModel {
 public:
  /// `reference_height_m` is where the height term is zero and visibility() is taken; by default
  /// that of the map. Another one must be covered by the map's exposure volume
  /// (map::covers_height), else std::invalid_argument.
  CostModel(const map::Map& map, const CostWeights& weights, const SemanticCostTable& semantics,
            double unknown_visibility, std::optional<double> reference_height_m = std::nullopt,
            double small_patch_m = 0.0);

  [[nodiscard]] const map::Map& map() const { return *map_; }
  [[nodiscard]] const CostWeights& weights() const { return weights_; }

  /// The same map with other weights of visibility and land use; layers are copied, not computed.
  [[nodiscard]] CostModel reweighted(double visibility, double semantics) const;

  /// Takes in what the visibility and the threats of the map have become inside `changed`: the same
  /// then as a model made anew. O(cells of `changed`).
  /// @return  the cells whose values may have changed: more, as small patches reach beyond.
  raster::Window visibility_changed(const raster::Window& changed);

  /// Takes in what the surface of the map has become at these cells: the same then as a model made
  /// anew. O(cells).
  void surface_changed(const std::vector<raster::CellIndex>& cells);

  /// The integrand for kernels, and the visibilities of a cell for it: one after the other by
  /// density_rule().heights_m().
  [[nodiscard]] const CostDensity& density_rule() const { return density_; }
  [[nodiscard]] const float* visibilities(raster::CellIndex cell) const {
    return visibilities(static_cast<std::size_t>(cell.row) *
                            static_cast<std::size_t>(visibility_.columns()) +
                        static_cast<std::size_t>(cell.column));
  }
  /// Cells by number, row by row from the south.
  [[nodiscard]] const float* visibilities(std::size_t cell) const {
    return visibilities_.data() + cell * density_.heights_m().size();
  }

  // What costs beyond eq. (1) and is not in density_rule(). Cells by their number, row by row from
  // the south.

  [[nodiscard]] bool has_threats() const { return !threats_.is_empty(); }
  /// Cost of a metre for the named observers who see it: `threats` for each [-]. Does not fall with
  /// height.
  [[nodiscard]] double threat_density(std::size_t cell, double height_m) const {
    return weights_.threats * threats_.count_seeing(cell, height_m);
  }
  [[nodiscard]] bool has_slope() const { return !slopes_.empty(); }
  /// Cost of a metre flown in the horizontal direction (east, north), a unit vector u, for going up
  /// or down the hillside rather than across [-]:
  ///
  ///     c_slope (g . u)^2,   g from ground_slopes()
  ///
  /// The square makes it cheaper to climb a hill obliquely: straight up costs its whole slope, at
  /// an angle a from that the way is 1 / cos a longer and its slope cos a times as steep. Where
  /// nothing else counts, the cheapest way up is nowhere steeper than 1 / sqrt(c_slope) along the
  /// track.
  [[nodiscard]] double slope_density(std::size_t cell, double east, double north) const {
    const double along = static_cast<double>(slopes_[cell][0]) * east +
                         static_cast<double>(slopes_[cell][1]) * north;
    return weights_.slope_along * along * along;
  }
  /// slope_density() by direction: {xx, xy, yy} of xx u_east^2 + xy u_east u_north + yy u_north^2.
  [[nodiscard]] std::array<double, 3> slope_form(std::size_t cell) const {
    const auto east = static_cast<double>(slopes_[cell][0]);
    const auto north = static_cast<double>(slopes_[cell][1]);
    return {weights_.slope_along * east * east, 2.0 * weights_.slope_along * east * north,
            weights_.slope_along * north * north};
  }
  [[nodiscard]] bool has_wires() const { return !wires_.is_empty(); }
  /// Cost of the wires that a straight track crosses [m]: wire_crossing_m times
  /// WireCrossings::weight().
  [[nodiscard]] double wire_cost_m(const geo::MapPoint& a, const geo::MapPoint& b) const {
    return weights_.wire_crossing_m * wires_.weight(a, b);
  }
  /// Cost of slope and wires along a short straight piece of track [m], the slope that of its
  /// middle; NaN outside the map.
  [[nodiscard]] double directed_cost_m(const geo::MapPoint& a, const geo::MapPoint& b) const;
  [[nodiscard]] double reference_height_m() const { return density_.reference_height_m(); }

  /// Visibility at a height above the surface, NaN outside the map; see CostDensity::seen().
  [[nodiscard]] double seen(const geo::MapPoint& point, double height_m) const;

  /// Visibility share at reference height as planners see it, unknown replaced as configured;
  /// nearest cell. NaN outside the map, as are the functions below.
  [[nodiscard]] double visibility(const geo::MapPoint& point) const;
  /// The layer below: land use, and soft areas at reference height.
  [[nodiscard]] double semantics(const geo::MapPoint& point) const;
  /// Cost of the land use below, and at least SemanticCostTable::soft_area() in a soft area that
  /// holds the point at that altitude, exactly.
  [[nodiscard]] double semantics(const geo::MapPoint& point, double altitude_m) const;

  /// The areas of the map: soft ones are part of semantics(); hard ones are for planners to avoid.
  [[nodiscard]] const AreaIndex& areas() const { return areas_; }

  /// Integrand of eq. (1) [-]: cost per metre of path at a height above the surface, with soft
  /// ceiling and threats; slope and wires, which depend on the direction, are left out. >= 1.
  [[nodiscard]] double density(const geo::MapPoint& point, double height_m) const;

  /// All terms along straight legs, midpoint rule with steps of at most `step_m`; wires exactly.
  /// Throws std::invalid_argument for a step that is not positive.
  [[nodiscard]] flight::RouteCost route_cost(const std::vector<flight::Waypoint>& waypoints,
                                             double step_m) const;

  /// Measures of a flown path, trapezoidal between states. Visibility is that of the map, small
  /// patches included, so that flights under different settings can be compared.
  [[nodiscard]] flight::PathMeasures measures(const flight::Trajectory& trajectory,
                                              double ceiling_height_m) const;

  /// Cost layers, for kernels: same geometry as the map. A soft area raises every cell that it
  /// touches and whose flight at reference height it may hold.
  [[nodiscard]] const raster::Grid<float>& visibility_layer() const { return visibility_; }
  [[nodiscard]] const raster::Grid<float>& semantics_layer() const { return semantics_; }
  /// The same without soft areas: the least that a cell may cost.
  [[nodiscard]] const raster::Grid<float>& land_use_layer() const { return land_use_; }

 private:
  [[nodiscard]] float semantics_at_reference(raster::CellIndex cell) const;

  const map::Map* map_;
  CostWeights weights_;
  CostDensity density_;
  std::vector<float> visibilities_;  // by cell, then by height of density_
  raster::Grid<float> visibility_;
  double unknown_visibility_;
  double small_patch_m_;
  raster::Grid<float> land_use_;
  raster::Grid<float> semantics_;  // the same with soft areas
  double soft_area_;
  AreaIndex areas_;
  // Empty without a weight
  NamedThreats threats_;
  WireCrossings wires_;
  std::vector<std::array<float, 2>> slopes_;
};

}  // namespace hedgehop::risk
