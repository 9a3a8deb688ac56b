#include "risk/area_index.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "raster/segment_walk.hpp"

namespace hedgehop::risk {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <typename Visit>
void for_each_ring(const map::Area& area, const Visit& visit) {
  for (const map::Area::Polygon& polygon : area.polygons) {
    visit(polygon.outer);
    for (const auto& hole : polygon.holes) {
      visit(hole);
    }
  }
}

template <typename Visit>
void for_each_edge(const map::Area& area, const Visit& visit) {
  for_each_ring(area, [&](const std::vector<geo::MapPoint>& ring) {
    for (std::size_t i = 1; i < ring.size(); ++i) {
      visit(ring[i - 1], ring[i]);
    }
  });
}

// Whether a ray to the east from the point crosses the edge: half open, so that a corner counts
// once.
bool is_crossed(const geo::MapPoint& a, const geo::MapPoint& b, const geo::MapPoint& point) {
  if ((a.y_m > point.y_m) == (b.y_m > point.y_m)) {
    return false;
  }
  const double x_m = a.x_m + (point.y_m - a.y_m) / (b.y_m - a.y_m) * (b.x_m - a.x_m);
  return point.x_m < x_m;
}

bool is_on_edge(const geo::MapPoint& a, const geo::MapPoint& b, const geo::MapPoint& point) {
  const double cross =
      (b.x_m - a.x_m) * (point.y_m - a.y_m) - (b.y_m - a.y_m) * (point.x_m - a.x_m);
  return cross == 0.0 && point.x_m >= std::min(a.x_m, b.x_m) &&
         point.x_m <= std::max(a.x_m, b.x_m) && point.y_m >= std::min(a.y_m, b.y_m) &&
         point.y_m <= std::max(a.y_m, b.y_m);
}

// Polygons of one area may overlap, so each answers for itself.
bool is_inside(const map::Area& area, const geo::MapPoint& point) {
  for (const map::Area::Polygon& polygon : area.polygons) {
    bool inside = false;
    bool is_on = false;
    const auto add = [&](const std::vector<geo::MapPoint>& ring) {
      for (std::size_t i = 1; i < ring.size(); ++i) {
        inside ^= is_crossed(ring[i - 1], ring[i], point);
        is_on = is_on || is_on_edge(ring[i - 1], ring[i], point);
      }
    };
    add(polygon.outer);
    std::for_each(polygon.holes.begin(), polygon.holes.end(), add);
    if (inside || is_on) {
      return true;
    }
  }
  return false;
}

bool needs_ground(const map::Area& area) {
  const auto is_above_ground = [](const map::AreaLimit& limit) {
    return limit.reference == map::AreaLimit::Reference::kAboveGround &&
           std::isfinite(limit.value_m);
  };
  return is_above_ground(area.floor) || is_above_ground(area.ceiling);
}

// Calls visit(cell) for every cell that the area touches; cells may come more than once.
template <typename Visit>
void for_each_cell_of(const map::Area& area, const raster::GridGeometry& g, const Visit& visit) {
  for_each_edge(area, [&](const geo::MapPoint& a, const geo::MapPoint& b) {
    raster::walk_segment(g, a, b, [&](raster::CellIndex cell, double, double) { visit(cell); });
    if (g.contains(a)) {
      visit(g.cell_at(a));  // a corner on a border between cells
    }
  });
  // Cells without an edge are inside or outside as a whole, so their centres tell.
  for (const map::Area::Polygon& polygon : area.polygons) {
    double south_m = kInfinity;
    double north_m = -kInfinity;
    for (const geo::MapPoint& corner : polygon.outer) {
      south_m = std::min(south_m, corner.y_m);
      north_m = std::max(north_m, corner.y_m);
    }
    const auto bound = [&](double row) {
      return static_cast<int>(std::clamp(row, 0.0, static_cast<double>(g.rows)));
    };
    for (int row = bound(std::floor((south_m - g.south_m) / g.cell_m));
         row < bound(std::ceil((north_m - g.south_m) / g.cell_m)); ++row) {
      const double y_m = g.centre({0, row}).y_m;
      std::vector<double> crossings;
      const auto add = [&](const std::vector<geo::MapPoint>& ring) {
        for (std::size_t i = 1; i < ring.size(); ++i) {
          const geo::MapPoint& a = ring[i - 1];
          const geo::MapPoint& b = ring[i];
          if ((a.y_m > y_m) != (b.y_m > y_m)) {
            crossings.push_back(a.x_m + (y_m - a.y_m) / (b.y_m - a.y_m) * (b.x_m - a.x_m));
          }
        }
      };
      add(polygon.outer);
      std::for_each(polygon.holes.begin(), polygon.holes.end(), add);
      std::sort(crossings.begin(), crossings.end());
      for (std::size_t i = 0; i + 1 < crossings.size(); i += 2) {
        const auto column = [&](double x_m) {
          return std::clamp((x_m - g.west_m) / g.cell_m - 0.5, -1.0,
                            static_cast<double>(g.columns));
        };
        const int last =
            std::min(static_cast<int>(std::floor(column(crossings[i + 1]))), g.columns - 1);
        for (int c = std::max(static_cast<int>(std::ceil(column(crossings[i]))), 0); c <= last;
             ++c) {
          visit(raster::CellIndex{c, row});
        }
      }
    }
  }
}

// Shares of the leg at which it crosses an edge of the area.
void add_crossings(const map::Area& area, const flight::Waypoint& a, const flight::Waypoint& b,
                   std::vector<double>& shares) {
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  const double west_m = std::min(a.x_m, b.x_m);
  const double east_m = std::max(a.x_m, b.x_m);
  const double south_m = std::min(a.y_m, b.y_m);
  const double north_m = std::max(a.y_m, b.y_m);
  for_each_edge(area, [&](const geo::MapPoint& p, const geo::MapPoint& q) {
    if (std::max(p.x_m, q.x_m) < west_m || std::min(p.x_m, q.x_m) > east_m ||
        std::max(p.y_m, q.y_m) < south_m || std::min(p.y_m, q.y_m) > north_m) {
      return;
    }
    const double ex_m = q.x_m - p.x_m;
    const double ey_m = q.y_m - p.y_m;
    const double determinant = dx_m * ey_m - dy_m * ex_m;
    if (determinant == 0.0) {
      // Parallel: where the leg runs along the edge, its ends cut the leg.
      const double square = dx_m * dx_m + dy_m * dy_m;
      if (square > 0.0 && is_on_edge({a.x_m, a.y_m}, {b.x_m, b.y_m}, p)) {
        shares.push_back(((p.x_m - a.x_m) * dx_m + (p.y_m - a.y_m) * dy_m) / square);
      }
      if (square > 0.0 && is_on_edge({a.x_m, a.y_m}, {b.x_m, b.y_m}, q)) {
        shares.push_back(((q.x_m - a.x_m) * dx_m + (q.y_m - a.y_m) * dy_m) / square);
      }
      return;
    }
    const double t = ((p.x_m - a.x_m) * ey_m - (p.y_m - a.y_m) * ex_m) / determinant;
    const double s = ((p.x_m - a.x_m) * dy_m - (p.y_m - a.y_m) * dx_m) / determinant;
    if (t >= 0.0 && t <= 1.0 && s >= 0.0 && s <= 1.0) {
      shares.push_back(t);
    }
  });
}

// Greatest and least value on [0, 1] of the parabola through (0, f0), (1/2, fm), (1, f1).
struct Range {
  double low = 0.0;
  double high = 0.0;
};
Range range_of_parabola(double f0, double fm, double f1) {
  Range range{std::min({f0, fm, f1}), std::max({f0, fm, f1})};
  const double quadratic = 2.0 * (f0 + f1) - 4.0 * fm;
  const double linear = 4.0 * fm - 3.0 * f0 - f1;
  if (quadratic != 0.0) {
    const double vertex = -linear / (2.0 * quadratic);
    if (vertex > 0.0 && vertex < 1.0) {
      const double value = f0 - linear * linear / (4.0 * quadratic);
      range.low = std::min(range.low, value);
      range.high = std::max(range.high, value);
    }
  }
  return range;
}

}  // namespace

AreaIndex::AreaIndex(const map::Map& map) : map_(&map), lists_(1) {
  if (map.areas.empty()) {
    return;
  }
  cells_ = raster::Grid<std::uint32_t>(map.geometry, 0);
  // The list that comes of a list and one more area.
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> longer;
  for (std::uint32_t number = 0; number < map.areas.size(); ++number) {
    for_each_cell_of(map.areas[number], map.geometry, [&](raster::CellIndex cell) {
      std::uint32_t& list = cells_.at(cell);
      if (!lists_[list].empty() && lists_[list].back() == number) {
        return;
      }
      const auto [entry, is_new] = longer.try_emplace({list, number}, 0);
      if (is_new) {
        entry->second = static_cast<std::uint32_t>(lists_.size());
        std::vector<std::uint32_t> areas = lists_[list];
        areas.push_back(number);
        lists_.push_back(std::move(areas));
      }
      list = entry->second;
    });
  }
}

bool AreaIndex::holds(const map::Area& area, const geo::MapPoint& point, double altitude_m) const {
  const double ground_m =
      needs_ground(area) ? raster::sample_bilinear(map_->terrain_m, point) : 0.0;
  // Written so that NaN, over unknown ground, counts as inside.
  return !(altitude_m < area.floor.altitude_m(ground_m)) &&
         !(altitude_m > area.ceiling.altitude_m(ground_m)) && is_inside(area, point);
}

const map::Area* AreaIndex::hard_area_at(const geo::MapPoint& point, double altitude_m) const {
  if (is_empty() || !map_->geometry.contains(point)) {
    return nullptr;
  }
  for (const std::uint32_t number : lists_[cells_.at(map_->geometry.cell_at(point))]) {
    const map::Area& area = map_->areas[number];
    if (area.is_hard && holds(area, point, altitude_m)) {
      return &area;
    }
  }
  return nullptr;
}

bool AreaIndex::is_in_soft_area(const geo::MapPoint& point, double altitude_m) const {
  if (is_empty() || !map_->geometry.contains(point)) {
    return false;
  }
  const auto& list = lists_[cells_.at(map_->geometry.cell_at(point))];
  return std::any_of(list.begin(), list.end(), [&](std::uint32_t number) {
    const map::Area& area = map_->areas[number];
    return !area.is_hard && holds(area, point, altitude_m);
  });
}

bool AreaIndex::is_entered(const map::Area& area, const flight::Waypoint& a,
                           const flight::Waypoint& b) const {
  std::vector<double> crossings;
  add_crossings(area, a, b, crossings);
  std::vector<double> shares = crossings;
  shares.insert(shares.end(), {0.0, 1.0});
  std::sort(shares.begin(), shares.end());
  const auto at = [&](double t) {
    return flight::Waypoint{a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
                            a.altitude_m + t * (b.altitude_m - a.altitude_m)};
  };
  const bool is_ground_needed = needs_ground(area);
  const auto overlaps = [&](const Range& altitude_m, const Range& height_m) {
    const auto is_above = [&](const map::AreaLimit& limit) {
      const bool is_ground = limit.reference == map::AreaLimit::Reference::kAboveGround;
      return (is_ground ? height_m.low : altitude_m.low) > limit.value_m;
    };
    const auto is_below = [&](const map::AreaLimit& limit) {
      const bool is_ground = limit.reference == map::AreaLimit::Reference::kAboveGround;
      return (is_ground ? height_m.high : altitude_m.high) < limit.value_m;
    };
    return !is_above(area.ceiling) && !is_below(area.floor);
  };
  const auto height_at = [&](double t) {
    const flight::Waypoint point = at(t);
    return is_ground_needed
               ? point.altitude_m - raster::sample_bilinear(map_->terrain_m, point.point())
               : 0.0;
  };
  // The piece between two shares, which lies inside as a whole.
  const auto meets = [&](double begin, double end) {
    if (!is_ground_needed) {
      const double first_m = at(begin).altitude_m;
      const double last_m = at(end).altitude_m;
      return overlaps({std::min(first_m, last_m), std::max(first_m, last_m)}, {0.0, 0.0});
    }
    // Cut where the leg passes from one patch between four cell centres to the next.
    raster::GridGeometry patches = map_->geometry;
    patches.west_m -= 0.5 * patches.cell_m;
    patches.south_m -= 0.5 * patches.cell_m;
    ++patches.columns;
    ++patches.rows;
    bool is_met = false;
    const flight::Waypoint p = at(begin);
    const flight::Waypoint q = at(end);
    const auto test = [&](double t_in, double t_out) {
      const double first = begin + t_in * (end - begin);
      const double last = begin + t_out * (end - begin);
      const Range height_m =
          range_of_parabola(height_at(first), height_at(0.5 * (first + last)), height_at(last));
      const double first_m = at(first).altitude_m;
      const double last_m = at(last).altitude_m;
      if (std::isnan(height_at(first)) || std::isnan(height_at(last)) ||
          overlaps({std::min(first_m, last_m), std::max(first_m, last_m)}, height_m)) {
        is_met = true;
      }
    };
    if (p.point().x_m == q.point().x_m && p.point().y_m == q.point().y_m) {
      test(0.0, 1.0);
    } else {
      raster::walk_segment(
          patches, p.point(), q.point(),
          [&](raster::CellIndex, double t_in, double t_out) { test(t_in, t_out); });
    }
    return is_met;
  };
  // An edge belongs to the area, also where the leg only touches it.
  if (std::any_of(crossings.begin(), crossings.end(), [&](double t) { return meets(t, t); })) {
    return true;
  }
  for (std::size_t i = 0; i + 1 < shares.size(); ++i) {
    if (is_inside(area, at(0.5 * (shares[i] + shares[i + 1])).point()) &&
        meets(shares[i], shares[i + 1])) {
      return true;
    }
  }
  return false;
}

const map::Area* AreaIndex::hard_area_on(const flight::Waypoint& a,
                                         const flight::Waypoint& b) const {
  if (is_empty()) {
    return nullptr;
  }
  std::vector<std::uint32_t> near;
  std::uint32_t before = 0;
  raster::walk_segment(map_->geometry, a.point(), b.point(),
                       [&](raster::CellIndex cell, double, double) {
                         const std::uint32_t list = cells_.at(cell);
                         if (list != before) {
                           near.insert(near.end(), lists_[list].begin(), lists_[list].end());
                           before = list;
                         }
                       });
  if (map_->geometry.contains(b.point())) {
    const std::uint32_t list = cells_.at(map_->geometry.cell_at(b.point()));
    near.insert(near.end(), lists_[list].begin(), lists_[list].end());
  }
  std::sort(near.begin(), near.end());
  near.erase(std::unique(near.begin(), near.end()), near.end());
  for (const std::uint32_t number : near) {
    const map::Area& area = map_->areas[number];
    if (area.is_hard && is_entered(area, a, b)) {
      return &area;
    }
  }
  return nullptr;
}

double AreaIndex::wall_top_m(raster::CellIndex cell, double height_m) const {
  double top_m = -kInfinity;
  if (is_empty()) {
    return top_m;
  }
  for (const std::uint32_t number : lists_[cells_.at(cell)]) {
    const map::Area& area = map_->areas[number];
    const auto terrain_m = static_cast<double>(map_->terrain_m.at(cell));
    const auto surface_m = static_cast<double>(map_->surface_m.at(cell));
    if (area.is_hard && !(area.floor.altitude_m(terrain_m) > surface_m + height_m)) {
      const double ceiling_m = area.ceiling.altitude_m(terrain_m);
      top_m = std::max(top_m, std::isnan(ceiling_m) ? kInfinity : ceiling_m);
    }
  }
  return top_m;
}

AreaIndex::Span AreaIndex::ground_around(raster::CellIndex cell) const {
  Span ground{kInfinity, -kInfinity};
  for (int row = cell.row - 1; row <= cell.row + 1; ++row) {
    for (int column = cell.column - 1; column <= cell.column + 1; ++column) {
      if (!map_->geometry.contains(raster::CellIndex{column, row})) {
        continue;
      }
      const auto here_m = static_cast<double>(map_->terrain_m.at(column, row));
      if (std::isnan(here_m)) {
        return {here_m, here_m};
      }
      ground.low_m = std::min(ground.low_m, here_m);
      ground.high_m = std::max(ground.high_m, here_m);
    }
  }
  return ground;
}

AreaIndex::Span AreaIndex::free_over(raster::CellIndex cell, double low_m) const {
  Span free{low_m, kInfinity};
  if (!has_hard(cell)) {
    return free;
  }
  const Span ground_m = ground_around(cell);
  std::vector<Span> claims;
  for (const std::uint32_t number : lists_[cells_.at(cell)]) {
    const map::Area& area = map_->areas[number];
    if (area.is_hard) {
      Span claim{area.floor.altitude_m(ground_m.low_m), area.ceiling.altitude_m(ground_m.high_m)};
      claims.push_back({std::isnan(claim.low_m) ? -kInfinity : claim.low_m,
                        std::isnan(claim.high_m) ? kInfinity : claim.high_m});
    }
  }
  std::sort(claims.begin(), claims.end(),
            [](const Span& a, const Span& b) { return a.low_m < b.low_m; });
  for (const Span& claim : claims) {
    if (claim.low_m > free.low_m) {
      free.high_m = claim.low_m;
      break;
    }
    // The ceiling belongs to the area.
    if (claim.high_m >= free.low_m) {
      free.low_m = std::nextafter(claim.high_m, kInfinity);
    }
  }
  return free;
}

const map::Area* AreaIndex::closing(raster::CellIndex cell, const Span& altitudes) const {
  if (!has_hard(cell)) {
    return nullptr;
  }
  const raster::GridGeometry& g = map_->geometry;
  const geo::MapPoint centre = g.centre(cell);
  const double west_m = g.west_m + g.cell_m * cell.column;
  const double south_m = g.south_m + g.cell_m * cell.row;
  const Span ground_m = ground_around(cell);
  for (const std::uint32_t number : lists_[cells_.at(cell)]) {
    const map::Area& area = map_->areas[number];
    // Limits over the ground that is least favourable to the claim; NaN makes no claim.
    if (!area.is_hard || !(area.floor.altitude_m(ground_m.high_m) <= altitudes.low_m) ||
        !(area.ceiling.altitude_m(ground_m.low_m) >= altitudes.high_m) ||
        !is_inside(area, centre)) {
      continue;
    }
    // No edge near the cell means that it is inside as a whole, as its centre is.
    bool is_cut = false;
    for_each_edge(area, [&](const geo::MapPoint& a, const geo::MapPoint& b) {
      is_cut = is_cut ||
               (std::max(a.x_m, b.x_m) >= west_m && std::min(a.x_m, b.x_m) <= west_m + g.cell_m &&
                std::max(a.y_m, b.y_m) >= south_m && std::min(a.y_m, b.y_m) <= south_m + g.cell_m);
    });
    if (!is_cut) {
      return &area;
    }
  }
  return nullptr;
}

bool AreaIndex::has_hard(raster::CellIndex cell) const {
  const std::vector<std::uint32_t>& list = lists_[list_at(cell)];
  return std::any_of(list.begin(), list.end(),
                     [&](std::uint32_t number) { return map_->areas[number].is_hard; });
}

bool AreaIndex::has_soft(raster::CellIndex cell) const {
  const std::vector<std::uint32_t>& list = lists_[list_at(cell)];
  return std::any_of(list.begin(), list.end(),
                     [&](std::uint32_t number) { return !map_->areas[number].is_hard; });
}

}  // namespace hedgehop::risk
