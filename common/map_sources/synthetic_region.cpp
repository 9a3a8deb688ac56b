#include "map_sources/synthetic_region.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <functional>
#include <gdal_priv.h>
#include <limits>
#include <memory>
#include <ogr_spatialref.h>
#include <vector>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "map_sources/synthetic_osm.hpp"
#include "map_sources/synthetic_terrain.hpp"

namespace hedgehop::map_sources {
namespace {

constexpr int kEpsg = 32632;
constexpr geo::MapPoint kOrigin{330000.0, 6140000.0};  // open sea, 55.4 N 6.5 E
constexpr double kCell_m = 25.0;
constexpr int kCells = 960;
constexpr double kExtent_m = kCells * kCell_m;
constexpr double kSlopeP90 = 0.297;  // before streams and noise round it to about 16 degrees
constexpr char kNote[] = "synthetic";

using geo::MapPoint;

double distance_m(const MapPoint& a, const MapPoint& b) {
  const double dx_m = a.x_m - b.x_m;
  const double dy_m = a.y_m - b.y_m;
  return std::sqrt(dx_m * dx_m + dy_m * dy_m);
}

double distance_to_segment_m(const MapPoint& p, const MapPoint& a, const MapPoint& b) {
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  const double along =
      ((p.x_m - a.x_m) * dx_m + (p.y_m - a.y_m) * dy_m) / std::max(dx_m * dx_m + dy_m * dy_m, 1e-9);
  const double t = std::clamp(along, 0.0, 1.0);
  return distance_m(p, {a.x_m + t * dx_m, a.y_m + t * dy_m});
}

/// Numbers one after the other, each a function of the seed and its place in the row.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : seed_(seed) {}
  double uniform() { return lattice_noise(seed_, ++count_, 7); }
  double between(double low, double high) { return low + (high - low) * uniform(); }
  std::int64_t integer(std::int64_t low, std::int64_t high) {
    return low + static_cast<std::int64_t>(uniform() * static_cast<double>(high - low + 1));
  }
  /// A unit vector.
  MapPoint direction() {
    for (;;) {
      const double x = between(-1.0, 1.0);
      const double y = between(-1.0, 1.0);
      const double length = std::sqrt(x * x + y * y);
      if (length > 0.1 && length < 1.0) {
        return {x / length, y / length};
      }
    }
  }

 private:
  std::uint64_t seed_;
  std::int64_t count_ = 0;
};

struct Settlement {
  MapPoint centre;
  double radius_m = 0.0;
  bool is_town = false;
  std::uint64_t seed = 0;
};

/// Builds the land cover of one region, step by step; later steps keep clear of earlier ones.
class LandCover {
 public:
  LandCover(const SyntheticTerrain& terrain, std::uint64_t seed)
      : terrain_(terrain), seed_(seed), document_(kOrigin, kNote) {}

  void build() {
    choose_settlements();
    route_power_line();
    add_settlements();
    choose_farmsteads();
    add_power_lines();
    add_forest();
    add_waters();
    add_trees();
    choose_flight();
  }

  [[nodiscard]] const OsmDocument& document() const { return document_; }
  [[nodiscard]] const MapPoint& start() const { return start_; }
  [[nodiscard]] const MapPoint& goal() const { return goal_; }

 private:
  [[nodiscard]] static bool is_within(const MapPoint& p, double margin_m) {
    return p.x_m >= margin_m && p.y_m >= margin_m && p.x_m <= kExtent_m - margin_m &&
           p.y_m <= kExtent_m - margin_m;
  }
  [[nodiscard]] double at(const raster::Grid<float>& grid, const MapPoint& p) const {
    const raster::CellIndex cell = grid.geometry().cell_at(p);
    return static_cast<double>(grid.at(std::clamp(cell.column, 0, grid.columns() - 1),
                                       std::clamp(cell.row, 0, grid.rows() - 1)));
  }
  [[nodiscard]] double slope(const MapPoint& p) const { return at(terrain_.slope, p); }

  [[nodiscard]] double mean_slope(const MapPoint& p, double radius_m) const {
    double sum = 0.0;
    int count = 0;
    for (int j = -3; j <= 3; ++j) {
      for (int i = -3; i <= 3; ++i) {
        if (i * i + j * j <= 10) {
          sum += slope({p.x_m + i * radius_m / 3.0, p.y_m + j * radius_m / 3.0});
          ++count;
        }
      }
    }
    return sum / count;
  }

  /// Above 0 inside the built-up area, 1 in its middle, falling by 1 for each radius outwards.
  [[nodiscard]] double builtness(const Settlement& settlement, const MapPoint& p) const {
    const double off = distance_m(p, settlement.centre) / settlement.radius_m;
    if (off > 2.5) {
      return 1.0 - off;
    }
    return 1.0 - off +
           0.45 * fractal_noise(settlement.seed, p.x_m, p.y_m, 1.1 * settlement.radius_m, 2, 0.5) -
           2.5 * std::max(0.0, slope(p) - 0.16);
  }

  /// Distance to the nearest built-up area, about; negative inside.
  [[nodiscard]] double settlement_distance_m(const MapPoint& p) const {
    double nearest_m = 1e9;
    for (const Settlement& settlement : settlements_) {
      if (std::fabs(p.x_m - settlement.centre.x_m) < nearest_m + 2.0 * settlement.radius_m) {
        nearest_m = std::min(nearest_m, -builtness(settlement, p) * settlement.radius_m);
      }
    }
    return nearest_m;
  }

  [[nodiscard]] double power_line_distance_m(const MapPoint& p) const {
    double nearest_m = 1e9;
    for (std::size_t i = 1; i < line_bends_.size(); ++i) {
      nearest_m = std::min(nearest_m, distance_to_segment_m(p, line_bends_[i - 1], line_bends_[i]));
    }
    return nearest_m;
  }

  void choose_settlements() {
    struct Site {
      double merit;
      MapPoint point;
    };
    std::vector<Site> sites;
    Site best_town{1e9, {}};
    for (double y_m = 1200.0; y_m <= kExtent_m - 1200.0; y_m += 150.0) {
      for (double x_m = 1200.0; x_m <= kExtent_m - 1200.0; x_m += 150.0) {
        const MapPoint p{x_m, y_m};
        const double chance = lattice_noise(seed_ + 1, static_cast<std::int64_t>(x_m),
                                            static_cast<std::int64_t>(y_m));
        const double merit =
            mean_slope(p, 300.0) + 0.0012 * at(terrain_.above_stream_m, p) + 0.04 * chance;
        if (merit < 0.24) {
          sites.push_back({merit, p});
        }
        if (is_within(p, 5000.0)) {
          const double town_merit = mean_slope(p, 1000.0) + 0.0008 * at(terrain_.above_stream_m, p);
          if (town_merit < best_town.merit) {
            best_town = {town_merit, p};
          }
        }
      }
    }
    settlements_.push_back({best_town.point, 950.0, true, seed_ + 50});
    std::stable_sort(sites.begin(), sites.end(),
                     [](const Site& a, const Site& b) { return a.merit < b.merit; });
    Dice dice(seed_ + 2);
    for (const Site& site : sites) {
      if (settlements_.size() >= 27) {
        break;
      }
      const bool is_free =
          std::all_of(settlements_.begin(), settlements_.end(), [&](const Settlement& other) {
            return distance_m(site.point, other.centre) > (other.is_town ? 3200.0 : 2300.0);
          });
      if (is_free) {
        settlements_.push_back(
            {site.point, dice.between(170.0, 330.0), false, seed_ + 60 + settlements_.size()});
      }
    }
  }

  /// From west to east, straight where it can, around settlements: shortest path over a lattice.
  void route_power_line() {
    constexpr int kColumns = 12;
    constexpr int kRows = 56;
    const double column_m = (kExtent_m - 400.0) / (kColumns - 1);
    const auto place = [&](int column, int row) {
      return MapPoint{200.0 + column * column_m, 1000.0 + row * 400.0};
    };
    const auto leg_cost_m = [&](const MapPoint& a, const MapPoint& b) {
      const double length_m = distance_m(a, b);
      double cost_m = length_m + 3.0 * std::fabs(a.y_m - b.y_m);
      for (int k = 0; k <= 20; ++k) {
        const MapPoint p{a.x_m + (b.x_m - a.x_m) * k / 20.0, a.y_m + (b.y_m - a.y_m) * k / 20.0};
        cost_m += settlement_distance_m(p) < 250.0 ? 2000.0 : 0.0;
      }
      return cost_m;
    };
    std::vector<std::vector<double>> cost_m(kColumns, std::vector<double>(kRows, 1e18));
    std::vector<std::vector<int>> from(kColumns, std::vector<int>(kRows, -1));
    cost_m[0][12] = 0.0;
    for (int column = 1; column < kColumns; ++column) {
      for (int row = 0; row < kRows; ++row) {
        for (int before = std::max(0, row - 4); before <= std::min(kRows - 1, row + 4); ++before) {
          const double total_m = cost_m[column - 1][before] +
                                 leg_cost_m(place(column - 1, before), place(column, row));
          if (total_m < cost_m[column][row]) {
            cost_m[column][row] = total_m;
            from[column][row] = before;
          }
        }
      }
    }
    const auto& last = cost_m[kColumns - 1];
    int row = 0;
    for (int candidate = 0; candidate < kRows; ++candidate) {
      const double detour_m = 500.0 * std::abs(candidate - 34);
      const double best_detour_m = 500.0 * std::abs(row - 34);
      if (last[static_cast<std::size_t>(candidate)] + detour_m <
          last[static_cast<std::size_t>(row)] + best_detour_m) {
        row = candidate;
      }
    }
    for (int column = kColumns - 1; column >= 0; --column) {
      line_bends_.push_back(place(column, row));
      row = from[column][row];
    }
    std::reverse(line_bends_.begin(), line_bends_.end());
  }

  void add_building(const MapPoint& centre, const MapPoint& axis, double length_m, double width_m,
                    const OsmTags& tags) {
    const double u = 0.5 * length_m;
    const double v = 0.5 * width_m;
    const auto corner = [&](double a, double b) {
      return MapPoint{centre.x_m + a * axis.x_m - b * axis.y_m,
                      centre.y_m + a * axis.y_m + b * axis.x_m};
    };
    document_.add_line({corner(-u, -v), corner(u, -v), corner(u, v), corner(-u, v)}, true, tags);
  }

  /// A third of the buildings has a height, a third a number of storeys, a third neither.
  static OsmTags building_tags(const char* kind, std::int64_t levels, Dice& dice) {
    OsmTags tags = {{"building", kind}};
    const double chance = dice.uniform();
    if (chance < 0.34) {
      const auto decimetres = levels * 29 + 24 + dice.integer(0, 9);
      tags.emplace_back("height",
                        std::to_string(decimetres / 10) + "." + std::to_string(decimetres % 10));
    } else if (chance < 0.67) {
      tags.emplace_back("building:levels", std::to_string(levels));
    }
    return tags;
  }

  void add_area_field(const MapPoint& centre, double half_m, double step_m, double area_min_m2,
                      const OsmTags& tags, const std::function<double(const MapPoint&)>& field_at) {
    const int nodes = 2 * static_cast<int>(half_m / step_m) + 1;
    const double west_m = centre.x_m - half_m;
    const double south_m = centre.y_m - half_m;
    std::vector<double> field;
    field.reserve(static_cast<std::size_t>(nodes) * static_cast<std::size_t>(nodes));
    for (int j = 0; j < nodes; ++j) {
      for (int i = 0; i < nodes; ++i) {
        field.push_back(field_at({west_m + i * step_m, south_m + j * step_m}));
      }
    }
    for (const TracedArea& area :
         trace_areas(field, nodes, nodes, west_m, south_m, step_m, area_min_m2)) {
      document_.add_area(area.outer, area.holes, tags);
    }
  }

  void add_settlements() {
    int number = 0;
    for (const Settlement& settlement : settlements_) {
      Dice dice(settlement.seed + 500);
      const std::string name = settlement.is_town ? std::string("Synthetic Town")
                                                  : "Synthetic Village " + std::to_string(++number);
      document_.add_node(settlement.centre,
                         {{"place", settlement.is_town ? "town" : "village"}, {"name", name}});
      add_area_field(settlement.centre, 2.0 * settlement.radius_m, settlement.is_town ? 40.0 : 25.0,
                     8000.0, {{"landuse", "residential"}, {"name", name}},
                     [&](const MapPoint& p) { return builtness(settlement, p); });
      const MapPoint axis = dice.direction();
      const auto place = [&](double u, double v) {
        return MapPoint{settlement.centre.x_m + u * axis.x_m - v * axis.y_m,
                        settlement.centre.y_m + u * axis.y_m + v * axis.x_m};
      };
      add_building(place(-20.0, 60.0), axis, settlement.is_town ? 52.0 : 28.0,
                   settlement.is_town ? 22.0 : 13.0,
                   {{"building", "church"}, {"height", settlement.is_town ? "46" : "27"}});
      const double reach_m = 1.6 * settlement.radius_m;
      for (double v = -reach_m; v <= reach_m; v += 76.0) {
        for (const double side : {-19.0, 19.0}) {
          double u = -reach_m;
          while (u <= reach_m) {
            u += dice.between(23.0, 36.0);
            const MapPoint p = place(u, v + side + dice.between(-3.0, 3.0));
            const double chance = dice.uniform();
            const double length_m = dice.between(10.0, 15.0);
            const double width_m = dice.between(8.0, 11.0);
            const std::int64_t levels = dice.integer(1, 2);
            const double inside = builtness(settlement, p);
            const double off_m = distance_m(p, settlement.centre);
            if (inside < 0.04 || chance > 0.5 + 0.5 * inside || slope(p) > 0.22 || off_m < 75.0 ||
                !is_within(p, 50.0) || is_river(p)) {
              continue;
            }
            if (settlement.is_town && off_m < 0.38 * settlement.radius_m) {
              add_building(p, axis, length_m + 8.0, width_m + 4.0,
                           building_tags("apartments", levels + 2, dice));
              u += 8.0;
            } else {
              add_building(p, axis, length_m, width_m, building_tags("house", levels, dice));
            }
          }
        }
      }
      if (settlement.is_town) {
        add_industry(settlement, dice);
      }
    }
  }

  /// Halls on the flattest ground at the edge of the town.
  void add_industry(const Settlement& town, Dice& dice) {
    MapPoint best;
    double best_slope = 1e9;
    for (int k = 0; k < 24; ++k) {
      const MapPoint direction = dice.direction();
      const MapPoint p{town.centre.x_m + 1.25 * town.radius_m * direction.x_m,
                       town.centre.y_m + 1.25 * town.radius_m * direction.y_m};
      if (mean_slope(p, 250.0) < best_slope) {
        best_slope = mean_slope(p, 250.0);
        best = p;
      }
    }
    const Settlement estate{best, 280.0, false, town.seed + 7};
    add_area_field(best, 2.0 * estate.radius_m, 25.0, 8000.0,
                   {{"landuse", "industrial"}, {"name", "Synthetic Works"}},
                   [&](const MapPoint& p) {
                     return std::min(builtness(estate, p), -builtness(town, p) - 0.05);
                   });
    const MapPoint axis = dice.direction();
    for (double v = -400.0; v <= 400.0; v += 80.0) {
      for (double u = -400.0; u <= 400.0; u += 110.0) {
        const MapPoint p{best.x_m + u * axis.x_m - v * axis.y_m,
                         best.y_m + u * axis.y_m + v * axis.x_m};
        if (builtness(estate, p) > 0.25 && builtness(town, p) < -0.1 && slope(p) < 0.2 &&
            !is_river(p)) {
          add_building(p, axis, dice.between(50.0, 80.0), dice.between(25.0, 45.0),
                       building_tags("industrial", dice.integer(2, 3), dice));
        }
      }
    }
    settlements_.push_back(estate);
  }

  void choose_farmsteads() {
    Dice dice(seed_ + 3);
    for (int attempt = 0; attempt < 4000 && farmsteads_.size() < 48; ++attempt) {
      const MapPoint p{dice.between(500.0, kExtent_m - 500.0),
                       dice.between(500.0, kExtent_m - 500.0)};
      const bool is_free =
          std::all_of(farmsteads_.begin(), farmsteads_.end(),
                      [&](const MapPoint& other) { return distance_m(p, other) > 1300.0; });
      if (!is_free || mean_slope(p, 90.0) > 0.13 || settlement_distance_m(p) < 500.0 ||
          power_line_distance_m(p) < 120.0 || is_river(p)) {
        continue;
      }
      farmsteads_.push_back(p);
      const MapPoint axis = dice.direction();
      const auto place = [&](double u, double v) {
        return MapPoint{p.x_m + u * axis.x_m - v * axis.y_m, p.y_m + u * axis.y_m + v * axis.x_m};
      };
      add_building(p, axis, 18.0, 11.0, building_tags("farm", 2, dice));
      add_building(place(8.0, 28.0), axis, dice.between(25.0, 40.0), 14.0,
                   building_tags("barn", 2, dice));
      if (dice.uniform() < 0.6) {
        add_building(place(-26.0, 14.0), axis, 12.0, 26.0, building_tags("barn", 1, dice));
        document_.add_line(
            {place(-40.0, -16.0), place(36.0, -16.0), place(36.0, 44.0), place(-40.0, 44.0)}, true,
            {{"landuse", "farmyard"}});
      }
    }
  }

  void add_power_lines() {
    Dice dice(seed_ + 4);
    std::vector<std::int64_t> towers;
    std::vector<MapPoint> tower_points;
    const auto add_tower = [&](const MapPoint& p) {
      OsmTags tags = {{"power", "tower"}};
      if (dice.uniform() < 0.6) {
        tags.emplace_back("height", std::to_string(dice.integer(36, 52)));
      }
      towers.push_back(document_.add_node(p, tags));
      tower_points.push_back(p);
    };
    add_tower(line_bends_.front());
    for (std::size_t i = 1; i < line_bends_.size(); ++i) {
      const MapPoint& a = line_bends_[i - 1];
      const MapPoint& b = line_bends_[i];
      const int spans = static_cast<int>(std::ceil(distance_m(a, b) / 330.0));
      for (int k = 1; k <= spans; ++k) {
        add_tower({a.x_m + (b.x_m - a.x_m) * k / spans, a.y_m + (b.y_m - a.y_m) * k / spans});
      }
    }
    document_.add_way(
        towers,
        {{"power", "line"}, {"voltage", "220000"}, {"cables", "6"}, {"name", "Synthetic Line"}});

    // A minor line from the nearest tower to the edge of the town.
    const Settlement& town = settlements_.front();
    const auto nearest = std::min_element(
        tower_points.begin(), tower_points.end(), [&](const MapPoint& a, const MapPoint& b) {
          return distance_m(a, town.centre) < distance_m(b, town.centre);
        });
    std::vector<std::int64_t> poles = {
        towers[static_cast<std::size_t>(nearest - tower_points.begin())]};
    const double span_m = distance_m(*nearest, town.centre);
    for (double along_m = 85.0; along_m < span_m; along_m += 85.0) {
      const double t = along_m / span_m;
      const MapPoint p{nearest->x_m + t * (town.centre.x_m - nearest->x_m),
                       nearest->y_m + t * (town.centre.y_m - nearest->y_m)};
      poles.push_back(document_.add_node(p, {{"power", "pole"}}));
      if (builtness(town, p) > -0.02) {
        break;
      }
    }
    document_.add_way(poles, {{"power", "minor_line"}});
  }

  /// Above 0 in forest; sharp steps between the blocks that foresters plant and fell.
  [[nodiscard]] double forest(const MapPoint& p) const {
    const double u = (0.8 * p.x_m + 0.6 * p.y_m) / 430.0;
    const double v = (-0.6 * p.x_m + 0.8 * p.y_m) / 290.0;
    const double block = lattice_noise(seed_ + 71, static_cast<std::int64_t>(std::floor(u)),
                                       static_cast<std::int64_t>(std::floor(v)));
    double wood = 4.5 * (slope(p) - 0.185) +
                  0.9 * fractal_noise(seed_ + 70, p.x_m, p.y_m, 3200.0, 3, 0.5) +
                  0.75 * (block - 0.5);
    wood -= std::max(0.0, 8.0 - at(terrain_.above_stream_m, p)) / 8.0 * 0.6;
    wood = std::min(wood, (power_line_distance_m(p) - 40.0) / 60.0);
    for (const MapPoint& farm : farmsteads_) {
      if (std::fabs(farm.x_m - p.x_m) < 300.0) {
        wood = std::min(wood, (distance_m(p, farm) - 130.0) / 150.0);
      }
    }
    return std::min(wood, (settlement_distance_m(p) - 90.0) / 300.0);
  }

  void add_forest() {
    constexpr double kStep_m = 40.0;
    Dice dice(seed_ + 5);
    const int nodes = static_cast<int>(kExtent_m / kStep_m) + 1;
    std::vector<double> field;
    field.reserve(static_cast<std::size_t>(nodes) * static_cast<std::size_t>(nodes));
    for (int j = 0; j < nodes; ++j) {
      for (int i = 0; i < nodes; ++i) {
        field.push_back(forest({i * kStep_m, j * kStep_m}));
      }
    }
    for (const TracedArea& area : trace_areas(field, nodes, nodes, 0.0, 0.0, kStep_m, 12000.0)) {
      OsmTags tags =
          dice.uniform() < 0.5 ? OsmTags{{"landuse", "forest"}} : OsmTags{{"natural", "wood"}};
      if (dice.uniform() < 0.25) {
        tags.emplace_back("height", std::to_string(dice.integer(14, 26)));
      }
      document_.add_area(area.outer, area.holes, tags);
    }
  }

  [[nodiscard]] bool is_river(const MapPoint& p) const {
    const raster::CellIndex cell = terrain_.catchment_km2.geometry().cell_at(p);
    for (int dr = -1; dr <= 1; ++dr) {
      for (int dc = -1; dc <= 1; ++dc) {
        const raster::CellIndex near{cell.column + dc, cell.row + dr};
        if (terrain_.catchment_km2.geometry().contains(near) &&
            terrain_.catchment_km2.at(near) > kRiver_km2) {
          return true;
        }
      }
    }
    return false;
  }

  void add_waters() {
    const int side = kCells;
    // The river as an area.
    std::vector<double> field(terrain_.catchment_km2.values().size());
    std::transform(terrain_.catchment_km2.values().begin(), terrain_.catchment_km2.values().end(),
                   field.begin(), [](float km2) { return km2 > kRiver_km2 ? 0.7 : -0.65; });
    for (const TracedArea& area :
         trace_areas(field, side, side, 0.5 * kCell_m, 0.5 * kCell_m, kCell_m, 4000.0)) {
      document_.add_area(area.outer, area.holes,
                         {{"natural", "water"}, {"water", "river"}, {"name", "Synthetic River"}});
    }
    // Streams as lines, from each source or confluence to the next.
    const auto& catchment = terrain_.catchment_km2.values();
    std::vector<int> donors(catchment.size(), 0);
    const auto is_stream = [&](std::size_t cell) {
      return static_cast<double>(catchment[cell]) > kStream_km2;
    };
    for (std::size_t cell = 0; cell < catchment.size(); ++cell) {
      if (is_stream(cell) && terrain_.receiver[cell] >= 0) {
        ++donors[static_cast<std::size_t>(terrain_.receiver[cell])];
      }
    }
    const auto centre = [&](std::size_t cell) {
      return MapPoint{(static_cast<double>(cell % kCells) + 0.5) * kCell_m,
                      (static_cast<double>(cell / kCells) + 0.5) * kCell_m};
    };
    for (std::size_t source = 0; source < catchment.size(); ++source) {
      if (!is_stream(source) || donors[source] == 1) {
        continue;
      }
      std::vector<MapPoint> points = {centre(source)};
      const bool is_a_river = static_cast<double>(catchment[source]) > kRiver_km2;
      for (int cell = terrain_.receiver[source]; cell >= 0;
           cell = terrain_.receiver[static_cast<std::size_t>(cell)]) {
        points.push_back(centre(static_cast<std::size_t>(cell)));
        if (donors[static_cast<std::size_t>(cell)] != 1) {
          break;
        }
      }
      if (points.size() < 3) {
        continue;
      }
      std::vector<MapPoint> line = {points.front()};
      for (std::size_t i = 1; i + 1 < points.size(); i += 2) {
        line.push_back({(points[i - 1].x_m + 2.0 * points[i].x_m + points[i + 1].x_m) / 4.0,
                        (points[i - 1].y_m + 2.0 * points[i].y_m + points[i + 1].y_m) / 4.0});
      }
      line.push_back(points.back());
      document_.add_line(line, false, {{"waterway", is_a_river ? "river" : "stream"}});
    }
  }

  void add_trees() {
    Dice dice(seed_ + 6);
    int rows = 0;
    int trees = 0;
    for (int attempt = 0; attempt < 6000 && (rows < 90 || trees < 500); ++attempt) {
      const MapPoint p{dice.between(300.0, kExtent_m - 300.0),
                       dice.between(300.0, kExtent_m - 300.0)};
      const MapPoint direction = dice.direction();
      const double length_m = dice.between(120.0, 320.0);
      const MapPoint q{p.x_m + length_m * direction.x_m, p.y_m + length_m * direction.y_m};
      const double chance = dice.uniform();
      const std::int64_t height_m = dice.integer(8, 24);
      if (!is_within(q, 100.0) || forest(p) > -0.1 || slope(p) > 0.2 || is_river(p) ||
          settlement_distance_m(p) < 30.0 || power_line_distance_m(p) < 400.0) {
        continue;
      }
      OsmTags height;
      if (chance < 0.4) {
        height = {{"height", std::to_string(height_m)}};
      }
      if (attempt % 5 == 0 && rows < 90 && forest(q) < -0.1 && settlement_distance_m(q) > 30.0) {
        height.emplace_back("natural", "tree_row");
        document_.add_line({p, q}, false, height);
        ++rows;
      } else if (trees < 500) {
        height.emplace_back("natural", "tree");
        document_.add_node(p, height);
        ++trees;
      }
    }
  }

  [[nodiscard]] bool is_open(const MapPoint& p, double slope_max, double spacing_m) const {
    for (int j = -2; j <= 2; ++j) {
      for (int i = -2; i <= 2; ++i) {
        const MapPoint near{p.x_m + spacing_m * i, p.y_m + spacing_m * j};
        if (forest(near) > -0.05 || slope(near) > slope_max) {
          return false;
        }
      }
    }
    return settlement_distance_m(p) > 500.0 && power_line_distance_m(p) > 500.0 &&
           std::none_of(farmsteads_.begin(), farmsteads_.end(),
                        [&](const MapPoint& farm) { return distance_m(p, farm) < 300.0; });
  }

  /// Two open, low places, about 18 km apart, one in the south-west and one in the north-east.
  void choose_flight() {
    std::vector<MapPoint> starts;
    std::vector<MapPoint> goals;
    // Where a region has no wide, level clearing, a narrower and steeper one must do.
    for (double slope_max = 0.12, spacing_m = 75.0;
         (starts.empty() || goals.empty()) && slope_max < 2.0; slope_max *= 1.5, spacing_m *= 0.8) {
      starts.clear();
      goals.clear();
      for (double y_m = 2600.0; y_m <= kExtent_m - 2600.0; y_m += 200.0) {
        for (double x_m = 2600.0; x_m <= kExtent_m - 2600.0; x_m += 200.0) {
          const bool is_start = x_m < 7500.0 && y_m < 10000.0;
          const bool is_goal = x_m > 15500.0 && y_m > 11000.0;
          if ((is_start || is_goal) && is_open({x_m, y_m}, slope_max, spacing_m)) {
            (is_start ? starts : goals).push_back({x_m, y_m});
          }
        }
      }
    }
    HEDGEHOP_ASSERT(!starts.empty() && !goals.empty());
    double best = std::numeric_limits<double>::infinity();
    for (const MapPoint& start : starts) {
      for (const MapPoint& goal : goals) {
        const double merit =
            std::fabs(distance_m(start, goal) - 18000.0) +
            15.0 * (at(terrain_.above_stream_m, start) + at(terrain_.above_stream_m, goal));
        if (merit < best) {
          best = merit;
          start_ = start;
          goal_ = goal;
        }
      }
    }
  }

  static constexpr double kRiver_km2 = 60.0;
  static constexpr double kStream_km2 = 2.5;

  const SyntheticTerrain& terrain_;
  std::uint64_t seed_;
  OsmDocument document_;
  std::vector<Settlement> settlements_;  // the town first
  std::vector<MapPoint> line_bends_;
  std::vector<MapPoint> farmsteads_;
  MapPoint start_;
  MapPoint goal_;
};

/// A GeoTIFF in memory; without dates, so that the same heights are the same bytes.
std::string geotiff(const raster::Grid<float>& elevation_m, const std::string& description) {
  GDALAllRegister();
  const auto fail = [](const char* what) {
    throw SystemFailure(std::string("synthetic terrain: ") + what + ": " + CPLGetLastErrorMsg());
  };
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
  if (driver == nullptr) {
    fail("GDAL has no GeoTIFF driver");
  }
  // The address of a local object is a name that no other thread uses.
  std::string name = "/vsimem/hedgehop_synthetic_" +
                     std::to_string(reinterpret_cast<std::uintptr_t>(&name)) + ".tif";
  CPLStringList creation;
  creation.SetNameValue("COMPRESS", "DEFLATE");
  creation.SetNameValue("PREDICTOR", "3");
  creation.SetNameValue("TILED", "YES");
  creation.SetNameValue("NUM_THREADS", "1");
  std::unique_ptr<GDALDataset> dataset(driver->Create(
      name.c_str(), elevation_m.columns(), elevation_m.rows(), 1, GDT_Float32, creation.List()));
  if (dataset == nullptr) {
    fail("cannot create the raster");
  }
  OGRSpatialReference reference;
  reference.importFromEPSG(kEpsg);
  dataset->SetSpatialRef(&reference);
  std::array<double, 6> transform = {kOrigin.x_m, kCell_m, 0.0, kOrigin.y_m + kExtent_m,
                                     0.0,         -kCell_m};
  dataset->SetGeoTransform(transform.data());
  dataset->SetMetadataItem("TIFFTAG_IMAGEDESCRIPTION", description.c_str());
  dataset->SetMetadataItem("TIFFTAG_SOFTWARE", "hedgehop synthetic region");
  dataset->SetMetadataItem("SYNTHETIC", "YES");
  GDALRasterBand* band = dataset->GetRasterBand(1);
  band->SetDescription("SYNTHETIC elevation");
  band->SetUnitType("m");
  std::vector<float> line(static_cast<std::size_t>(elevation_m.columns()));
  for (int row = 0; row < elevation_m.rows(); ++row) {
    const float* source = elevation_m.row(elevation_m.rows() - 1 - row);
    std::copy(source, source + elevation_m.columns(), line.begin());
    if (band->RasterIO(GF_Write, 0, row, elevation_m.columns(), 1, line.data(),
                       elevation_m.columns(), 1, GDT_Float32, 0, 0, nullptr) != CE_None) {
      fail("cannot write the raster");
    }
  }
  dataset.reset();
  vsi_l_offset size = 0;
  GByte* bytes = VSIGetMemFileBuffer(name.c_str(), &size, TRUE);
  if (bytes == nullptr || size == 0) {
    fail("the raster is empty");
  }
  std::string text(reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size));
  CPLFree(bytes);
  return text;
}

/// The largest box of parallels and meridians inside the raster, up to its corners' bend.
geo::GeodeticBox inner_box(const geo::MapProjection& projection) {
  geo::GeodeticBox box{-10.0, -10.0, 10.0, 10.0};
  for (int k = 0; k <= 32; ++k) {
    const double along_m = kExtent_m * k / 32.0;
    const double low_m = 30.0;
    const double high_m = kExtent_m - 30.0;
    const auto at = [&](double x_m, double y_m) {
      return projection.to_geodetic({kOrigin.x_m + x_m, kOrigin.y_m + y_m});
    };
    box.west_rad = std::max(box.west_rad, at(low_m, along_m).longitude_rad);
    box.east_rad = std::min(box.east_rad, at(high_m, along_m).longitude_rad);
    box.south_rad = std::max(box.south_rad, at(along_m, low_m).latitude_rad);
    box.north_rad = std::min(box.north_rad, at(along_m, high_m).latitude_rad);
  }
  return box;
}

}  // namespace

SyntheticRegion write_synthetic_region(const std::filesystem::path& folder,
                                       const SyntheticOptions& options) {
  const SyntheticTerrain terrain =
      make_synthetic_terrain({0.0, 0.0, kCell_m, kCells, kCells}, options.seed * 7919, kSlopeP90);
  LandCover cover(terrain, options.seed * 7919 + 1'000'000);
  cover.build();

  SyntheticRegion region;
  region.label = kSyntheticLabel;
  region.attribution = "Synthetic region made by hedgehop, seed " + std::to_string(options.seed) +
                       ": not a real place";
  region.crs = "EPSG:" + std::to_string(kEpsg);
  region.dem_file = folder / "synthetic_terrain.tif";
  region.osm_file = folder / "synthetic_landcover.osm";

  const geo::MapProjection projection(region.crs);
  const auto position = [&](const MapPoint& p) {
    return projection.to_geodetic({kOrigin.x_m + p.x_m, kOrigin.y_m + p.y_m});
  };
  region.start = position(cover.start());
  region.goal = position(cover.goal());
  region.extent = inner_box(projection);

  const std::string description = std::string(kSyntheticLabel) + ". " + region.attribution + ".";
  write_file_atomically(region.dem_file, geotiff(terrain.elevation_m, description));
  write_file_atomically(region.osm_file,
                        cover.document().xml(projection, "hedgehop synthetic region", description));
  return region;
}

}  // namespace hedgehop::map_sources
