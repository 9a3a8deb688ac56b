#include "risk/cost_model.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>

#include "base/errors.hpp"
#include "risk/ground_slope.hpp"
#include "risk/small_patches.hpp"

namespace hedgehop::risk {
namespace {

constexpr std::size_t kCombinations = 65536;

std::uint16_t bit_of(const std::string& name, const ConfigReader& reader) {
  std::vector<std::string> known;
  for (const map::SemanticName& entry : map::semantic_names()) {
    if (entry.name == name) {
      return static_cast<std::uint16_t>(entry.bit);
    }
    known.emplace_back(entry.name);
  }
  const auto nearest = nearest_word(name, known);
  reader.refuse("classes", "names the unknown class '" + name + "'" +
                               (nearest ? "; did you mean '" + *nearest + "'?" : ""));
}

// Heights with a visibility layer, ascending.
std::vector<double> heights_of(const map::Map& map) {
  std::vector<double> heights_m = {map.reference_height_m};
  for (const map::VisibilityBand& band : map.further_visibility) {
    heights_m.push_back(band.height_m);
  }
  std::sort(heights_m.begin(), heights_m.end());
  return heights_m;
}

const raster::Grid<std::uint16_t>& band_at(const map::Map& map, double height_m) {
  for (const map::VisibilityBand& band : map.further_visibility) {
    if (band.height_m == height_m) {
      return band.share;
    }
  }
  return map.visibility;
}

std::size_t number_of(const raster::GridGeometry& geometry, raster::CellIndex cell) {
  return static_cast<std::size_t>(cell.row) * static_cast<std::size_t>(geometry.columns) +
         static_cast<std::size_t>(cell.column);
}

// NaN outside the raster.
double value_at(const raster::Grid<float>& layer, const geo::MapPoint& point) {
  const raster::GridGeometry& geometry = layer.geometry();
  return geometry.contains(point) ? static_cast<double>(layer.at(geometry.cell_at(point)))
                                  : std::numeric_limits<double>::quiet_NaN();
}

double share_of(std::uint16_t stored, double unknown_visibility) {
  return stored == map::kVisibilityUnknown ? unknown_visibility : map::visibility_share(stored);
}

}  // namespace

SemanticCostTable::SemanticCostTable(std::vector<Rule> rules, double otherwise, double soft_area)
    : table_(kCombinations, static_cast<float>(otherwise)), soft_area_(soft_area) {
  for (std::size_t bits = 0; bits < kCombinations; ++bits) {
    const auto rule = std::find_if(rules.begin(), rules.end(), [&](const Rule& candidate) {
      return (bits & candidate.all_of) == candidate.all_of;
    });
    if (rule != rules.end()) {
      table_[bits] = static_cast<float>(rule->cost);
    }
  }
}

SemanticCostTable SemanticCostTable::read(ConfigReader& reader) {
  std::vector<Rule> rules;
  for (ConfigReader& entry : reader.required_sections("rules")) {
    Rule rule;
    for (const std::string& name : entry.required_strings("classes")) {
      rule.all_of = static_cast<std::uint16_t>(rule.all_of | bit_of(name, entry));
    }
    rule.cost = entry.required_double("cost");
    entry.require(rule.all_of != 0, "classes", "must name at least one class");
    entry.require(rule.cost >= 0.0 && rule.cost <= 1.0, "cost", "must lie between 0 and 1");
    entry.finish();
    rules.push_back(rule);
  }
  const double otherwise = reader.required_double("otherwise");
  reader.require(otherwise >= 0.0 && otherwise <= 1.0, "otherwise", "must lie between 0 and 1");
  const double soft_area = reader.required_double("soft_area");
  reader.require(soft_area >= 0.0 && soft_area <= 1.0, "soft_area", "must lie between 0 and 1");
  reader.finish();
  return {std::move(rules), otherwise, soft_area};
}

CostWeights read_weights(ConfigReader& reader) {
  CostWeights weights;
  const auto read = [&](const char* key, double& value) {
    value = reader.required_double(key);
    reader.require(value >= 0.0, key, "must not be negative");
  };
  read("visibility", weights.visibility);
  read("visibility_per_height_1pm", weights.visibility_per_height_1pm);
  read("semantics", weights.semantics);
  read("height_1pm", weights.height_1pm);
  read("soft_ceiling_m", weights.soft_ceiling_m);
  read("soft_ceiling_1pm", weights.soft_ceiling_1pm);
  read("threats", weights.threats);
  read("wire_crossing_m", weights.wire_crossing_m);
  read("slope_along", weights.slope_along);
  reader.finish();
  return weights;
}

CostDensity::CostDensity(const CostWeights& weights, double reference_height_m,
                         std::vector<double> heights_m)
    : weights_(weights),
      reference_height_m_(reference_height_m),
      soft_ceiling_m_(weights.soft_ceiling_1pm > 0.0 ? weights.soft_ceiling_m
                                                     : std::numeric_limits<double>::infinity()),
      heights_m_(std::move(heights_m)) {
  if (heights_m_.empty() || std::adjacent_find(heights_m_.begin(), heights_m_.end(),
                                               std::greater_equal<>()) != heights_m_.end()) {
    throw std::invalid_argument("the heights of a cost density must be ascending");
  }
}

CostModel::CostModel(const map::Map& map, const CostWeights& weights,
                     const SemanticCostTable& semantics, double unknown_visibility,
                     std::optional<double> reference_height_m, double small_patch_m)
    : map_(&map),
      weights_(weights),
      density_(weights, reference_height_m.value_or(map.reference_height_m), heights_of(map)),
      visibility_(map.geometry, 0.0F),
      unknown_visibility_(unknown_visibility),
      small_patch_m_(small_patch_m),
      land_use_(map.geometry, 0.0F),
      soft_area_(semantics.soft_area()),
      areas_(map) {
  if (!map::covers_height(map, density_.reference_height_m())) {
    throw std::invalid_argument("the map knows no visibility at the reference height");
  }
  // What planners see at each height, cell by cell.
  std::vector<raster::Grid<float>> bands;
  for (const double height_m : density_.heights_m()) {
    const raster::Grid<std::uint16_t>& stored = band_at(map, height_m);
    raster::Grid<float> band(map.geometry, 0.0F);
    for (std::size_t i = 0; i < band.values().size(); ++i) {
      band.values()[i] = static_cast<float>(share_of(stored.values()[i], unknown_visibility));
    }
    bands.push_back(without_small_patches(band, small_patch_m));
  }
  visibilities_.reserve(bands.size() * visibility_.values().size());
  for (std::size_t i = 0; i < visibility_.values().size(); ++i) {
    for (const raster::Grid<float>& band : bands) {
      visibilities_.push_back(band.values()[i]);
    }
    visibility_.values()[i] = static_cast<float>(
        density_.seen(visibilities_.data() + i * bands.size(), density_.reference_height_m()));
    land_use_.values()[i] = static_cast<float>(semantics.cost(map.semantics.values()[i]));
  }
  if (weights.threats > 0.0) {
    threats_ = NamedThreats(map);
  }
  if (weights.wire_crossing_m > 0.0) {
    wires_ = WireCrossings(map.overhead_lines);
  }
  if (weights.slope_along > 0.0) {
    slopes_ = ground_slopes(map.terrain_m);
  }
  semantics_ = land_use_;
  for (int row = 0; row < map.geometry.rows && !areas_.is_empty(); ++row) {
    for (int column = 0; column < map.geometry.columns; ++column) {
      semantics_.at(column, row) = semantics_at_reference({column, row});
    }
  }
}

float CostModel::semantics_at_reference(raster::CellIndex cell) const {
  float cost = land_use_.at(cell);
  const auto terrain_m = static_cast<double>(map_->terrain_m.at(cell));
  const double altitude_m =
      static_cast<double>(map_->surface_m.at(cell)) + density_.reference_height_m();
  for (const std::uint32_t number : areas_.areas_of(areas_.list_at(cell))) {
    const map::Area& area = map_->areas[number];
    if (!area.is_hard && !(altitude_m < area.floor.altitude_m(terrain_m)) &&
        !(altitude_m > area.ceiling.altitude_m(terrain_m))) {
      cost = std::max(cost, static_cast<float>(soft_area_));
    }
  }
  return cost;
}

void CostModel::surface_changed(const std::vector<raster::CellIndex>& cells) {
  for (const raster::CellIndex& cell : cells) {
    semantics_.at(cell) = semantics_at_reference(cell);
  }
}

CostModel CostModel::reweighted(double visibility, double semantics) const {
  CostModel other = *this;
  other.weights_.visibility = visibility;
  other.weights_.semantics = semantics;
  other.density_ = CostDensity(other.weights_, density_.reference_height_m(), density_.heights_m());
  return other;
}

raster::Window CostModel::visibility_changed(const raster::Window& changed) {
  // A patch is closed by rows of cells that begin and end this far away at most.
  const int reach = 2 * static_cast<int>(std::ceil(small_patch_m_ / map_->geometry.cell_m));
  const auto grown = [&](const raster::Window& window, int by) {
    const int west = std::max(window.column - by, 0);
    const int south = std::max(window.row - by, 0);
    const int east = std::min(window.column + window.columns + by, map_->geometry.columns);
    const int north = std::min(window.row + window.rows + by, map_->geometry.rows);
    return raster::Window{west, south, std::max(east - west, 0), std::max(north - south, 0)};
  };
  const raster::Window inner = grown(changed, reach);
  const raster::Window outer = grown(changed, 2 * reach);
  const std::vector<double>& heights_m = density_.heights_m();
  for (std::size_t k = 0; k < heights_m.size(); ++k) {
    const raster::Grid<std::uint16_t>& stored = band_at(*map_, heights_m[k]);
    raster::Grid<float> band({0.0, 0.0, map_->geometry.cell_m, outer.columns, outer.rows}, 0.0F);
    for (int row = 0; row < outer.rows; ++row) {
      for (int column = 0; column < outer.columns; ++column) {
        band.at(column, row) = static_cast<float>(
            share_of(stored.at(outer.column + column, outer.row + row), unknown_visibility_));
      }
    }
    const raster::Grid<float> closed = without_small_patches(band, small_patch_m_);
    for (int row = 0; row < inner.rows; ++row) {
      for (int column = 0; column < inner.columns; ++column) {
        const std::size_t cell = static_cast<std::size_t>(inner.row + row) *
                                     static_cast<std::size_t>(map_->geometry.columns) +
                                 static_cast<std::size_t>(inner.column + column);
        visibilities_[cell * heights_m.size() + k] =
            closed.at(inner.column + column - outer.column, inner.row + row - outer.row);
      }
    }
  }
  if (!threats_.is_empty()) {
    threats_.update(*map_, inner);
  }
  for (int row = inner.row; row < inner.row + inner.rows; ++row) {
    for (int column = inner.column; column < inner.column + inner.columns; ++column) {
      visibility_.at(column, row) = static_cast<float>(
          density_.seen(visibilities({column, row}), density_.reference_height_m()));
    }
  }
  return inner;
}

double CostModel::seen(const geo::MapPoint& point, double height_m) const {
  const raster::GridGeometry& geometry = visibility_.geometry();
  return geometry.contains(point) ? density_.seen(visibilities(geometry.cell_at(point)), height_m)
                                  : std::numeric_limits<double>::quiet_NaN();
}

double CostModel::visibility(const geo::MapPoint& point) const {
  return value_at(visibility_, point);
}

double CostModel::semantics(const geo::MapPoint& point) const {
  return value_at(semantics_, point);
}

double CostModel::semantics(const geo::MapPoint& point, double altitude_m) const {
  const double land_use = value_at(land_use_, point);
  return areas_.is_in_soft_area(point, altitude_m) ? std::max(land_use, soft_area_) : land_use;
}

double CostModel::density(const geo::MapPoint& point, double height_m) const {
  const raster::GridGeometry& geometry = visibility_.geometry();
  if (!geometry.contains(point)) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const double altitude_m =
      areas_.is_empty() ? 0.0 : raster::sample_bilinear(map_->surface_m, point) + height_m;
  const raster::CellIndex cell = geometry.cell_at(point);
  const double density = density_(visibilities(cell), semantics(point, altitude_m), height_m);
  return has_threats() ? density + threat_density(number_of(geometry, cell), height_m) : density;
}

double CostModel::directed_cost_m(const geo::MapPoint& a, const geo::MapPoint& b) const {
  double cost_m = has_wires() ? wire_cost_m(a, b) : 0.0;
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  const double length_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
  if (has_slope() && length_m > 0.0) {
    const raster::GridGeometry& geometry = visibility_.geometry();
    const geo::MapPoint middle{0.5 * (a.x_m + b.x_m), 0.5 * (a.y_m + b.y_m)};
    cost_m += geometry.contains(middle)
                  ? length_m * slope_density(number_of(geometry, geometry.cell_at(middle)),
                                             dx_m / length_m, dy_m / length_m)
                  : std::numeric_limits<double>::quiet_NaN();
  }
  return cost_m;
}

flight::RouteCost CostModel::route_cost(const std::vector<flight::Waypoint>& waypoints,
                                        double step_m) const {
  if (!(step_m > 0.0)) {
    throw std::invalid_argument("the step of a route's cost must be above 0");
  }
  flight::RouteCost cost;
  for (std::size_t i = 1; i < waypoints.size(); ++i) {
    const flight::Waypoint& a = waypoints[i - 1];
    const flight::Waypoint& b = waypoints[i];
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    const double dz_m = b.altitude_m - a.altitude_m;
    const double leg_m = std::sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m);
    const int steps = std::max(1, static_cast<int>(std::ceil(leg_m / step_m)));
    const double ds_m = leg_m / steps;
    const double track_m = has_slope() ? std::sqrt(dx_m * dx_m + dy_m * dy_m) : 0.0;
    if (has_wires()) {
      cost.wire_crossings_m += wire_cost_m(a.point(), b.point());
    }
    for (int k = 0; k < steps; ++k) {
      const double t = (k + 0.5) / steps;
      const geo::MapPoint point{a.x_m + t * dx_m, a.y_m + t * dy_m};
      const double height_m =
          a.altitude_m + t * dz_m - raster::sample_bilinear(map_->surface_m, point);
      const double above_m = height_m - reference_height_m();
      const double seen = this->seen(point, height_m);
      cost.length_m += ds_m;
      cost.visibility_m += weights_.visibility * seen * seen * ds_m;
      cost.semantics_m += weights_.semantics * semantics(point, a.altitude_m + t * dz_m) * ds_m;
      cost.height_m += weights_.height_1pm * std::fabs(above_m) * ds_m;
      cost.soft_ceiling_m += density_.above_soft_ceiling(height_m) * ds_m;
      if (has_threats() || track_m > 0.0) {
        const raster::GridGeometry& geometry = visibility_.geometry();
        const bool is_inside = geometry.contains(point);
        const std::size_t cell =
            is_inside ? number_of(geometry, geometry.cell_at(point)) : std::size_t{0};
        constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
        if (has_threats()) {
          cost.threats_m += is_inside ? threat_density(cell, height_m) * ds_m : kNaN;
        }
        if (track_m > 0.0) {
          cost.slope_m +=
              is_inside ? slope_density(cell, dx_m / track_m, dy_m / track_m) * ds_m : kNaN;
        }
      }
    }
  }
  return cost;
}

flight::PathMeasures CostModel::measures(const flight::Trajectory& trajectory,
                                         double ceiling_height_m) const {
  flight::PathMeasures measures;
  if (trajectory.states.empty()) {
    return measures;
  }
  std::vector<const raster::Grid<std::uint16_t>*> stored;
  for (const double height_m : density_.heights_m()) {
    stored.push_back(&band_at(*map_, height_m));
  }
  std::vector<float> shares(stored.size());
  const auto mapped_seen = [&](const geo::MapPoint& point, double height_m) {
    if (!map_->geometry.contains(point)) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    const raster::CellIndex cell = map_->geometry.cell_at(point);
    for (std::size_t i = 0; i < stored.size(); ++i) {
      shares[i] = static_cast<float>(share_of(stored[i]->at(cell), unknown_visibility_));
    }
    return density_.seen(shares.data(), height_m);
  };
  struct Integrand {
    double visibility, semantics, bank_rad, height_m;
  };
  const auto integrand = [&](const flight::FlightState& state) {
    const double height_m = state.altitude_m - state.surface_m;
    return Integrand{mapped_seen(state.point(), height_m),
                     semantics(state.point(), state.altitude_m), std::fabs(state.bank_rad),
                     height_m};
  };
  Integrand before = integrand(trajectory.states.front());
  measures.max_height_m = before.height_m;
  double height_integral_m2 = 0.0;
  double low_m = 0.0;
  for (std::size_t i = 1; i < trajectory.states.size(); ++i) {
    const flight::FlightState& a = trajectory.states[i - 1];
    const flight::FlightState& b = trajectory.states[i];
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    const double ds_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    const Integrand after = integrand(b);
    measures.length_m += ds_m;
    measures.visibility_m += 0.5 * (before.visibility + after.visibility) * ds_m;
    measures.semantics_m += 0.5 * (before.semantics + after.semantics) * ds_m;
    measures.bank_rad_m += 0.5 * (before.bank_rad + after.bank_rad) * ds_m;
    height_integral_m2 += 0.5 * (before.height_m + after.height_m) * ds_m;
    if (0.5 * (before.height_m + after.height_m) <= ceiling_height_m) {
      low_m += ds_m;
    }
    measures.max_height_m = std::max(measures.max_height_m, after.height_m);
    before = after;
  }
  measures.duration_s = trajectory.states.back().time_s - trajectory.states.front().time_s;
  if (measures.length_m > 0.0) {
    measures.mean_height_m = height_integral_m2 / measures.length_m;
    measures.share_under_ceiling = low_m / measures.length_m;
  }
  return measures;
}

}  // namespace hedgehop::risk
