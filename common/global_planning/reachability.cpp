#include "global_planning/reachability.hpp"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace hedgehop::global_planning {
namespace {

using raster::CellIndex;
using raster::GridGeometry;

// The patches between cell centres: (c, r) lies between the centres (c, r) and (c + 1, r + 1).
GridGeometry patches_of(const GridGeometry& cells) {
  return {cells.west_m + 0.5 * cells.cell_m, cells.south_m + 0.5 * cells.cell_m, cells.cell_m,
          cells.columns - 1, cells.rows - 1};
}

bool do_meet(const AltitudeBand& a, const AltitudeBand& b) {
  return std::max(a.low_m, b.low_m) <= std::min(a.high_m, b.high_m);
}

// The area that closes a patch; start and goal stay open.
const map::Area* closing_area(const FlightEnvelope& envelope, CellIndex at,
                              const AltitudeBand& band, CellIndex start, CellIndex goal) {
  return at == start || at == goal ? nullptr : envelope.area_that_closes_patch(at, band);
}

// Whether patches lead from start to goal, looked for towards the goal first: mostly few are looked
// at.
bool are_connected(const FlightEnvelope& envelope, CellIndex start, CellIndex goal) {
  const GridGeometry geometry = patches_of(envelope.geometry());
  struct Open {
    std::int64_t square;  // of the distance to the goal
    CellIndex at;
    AltitudeBand band;
  };
  const auto is_farther = [](const Open& a, const Open& b) { return a.square > b.square; };
  const auto band_of = [&](CellIndex at) {
    const AltitudeBand band = envelope.widest_band_over_patch(at);
    return closing_area(envelope, at, band, start, goal) != nullptr ? AltitudeBand{1.0, 0.0} : band;
  };
  std::vector<std::uint8_t> seen(geometry.cell_count(), 0);
  const auto index = [&](CellIndex at) {
    return static_cast<std::size_t>(at.row) * static_cast<std::size_t>(geometry.columns) +
           static_cast<std::size_t>(at.column);
  };
  std::vector<Open> open;
  const auto see = [&](CellIndex at, const AltitudeBand& band) {
    seen[index(at)] = 1;
    const std::int64_t columns = at.column - goal.column;
    const std::int64_t rows = at.row - goal.row;
    open.push_back({columns * columns + rows * rows, at, band});
    std::push_heap(open.begin(), open.end(), is_farther);
  };
  see(start, band_of(start));
  while (!open.empty()) {
    std::pop_heap(open.begin(), open.end(), is_farther);
    const Open here = open.back();
    open.pop_back();
    if (here.at == goal) {
      return true;
    }
    for (int row = here.at.row - 1; row <= here.at.row + 1; ++row) {
      for (int column = here.at.column - 1; column <= here.at.column + 1; ++column) {
        const CellIndex next{column, row};
        if (!geometry.contains(next) || seen[index(next)] != 0) {
          continue;
        }
        const AltitudeBand band = band_of(next);
        if (do_meet(here.band, band)) {
          see(next, band);
        }
      }
    }
  }
  return false;
}

}  // namespace

std::optional<Disconnection> prove_disconnected(const FlightEnvelope& envelope) {
  const GridGeometry geometry = patches_of(envelope.geometry());
  const CellIndex start = geometry.cell_at(envelope.start().point());
  const CellIndex goal = geometry.cell_at(envelope.goal().point());
  if (!geometry.contains(start) || !geometry.contains(goal)) {
    return std::nullopt;
  }
  if (are_connected(envelope, start, goal)) {
    return std::nullopt;
  }
  std::vector<AltitudeBand> bands;
  bands.reserve(geometry.cell_count());
  struct Closed {
    CellIndex patch;
    AltitudeBand band;
    const map::Area* area;
  };
  std::vector<Closed> closed;
  for (int row = 0; row < geometry.rows; ++row) {
    for (int column = 0; column < geometry.columns; ++column) {
      AltitudeBand band = envelope.widest_band_over_patch({column, row});
      const map::Area* area = closing_area(envelope, {column, row}, band, start, goal);
      if (area != nullptr) {
        closed.push_back({{column, row}, band, area});
        band = {1.0, 0.0};
      }
      bands.push_back(band);
    }
  }
  std::vector<std::uint8_t> seen;
  const auto index = [&](CellIndex at) {
    return static_cast<std::size_t>(at.row) * static_cast<std::size_t>(geometry.columns) +
           static_cast<std::size_t>(at.column);
  };
  // Fills from `from`; true when it arrives at `to`.
  std::vector<CellIndex> open;
  const auto fill = [&](CellIndex from, CellIndex to) {
    seen.assign(geometry.cell_count(), 0);
    open.assign(1, from);
    seen[index(from)] = 1;
    for (std::size_t k = 0; k < open.size(); ++k) {
      const CellIndex at = open[k];
      if (at == to) {
        return true;
      }
      const AltitudeBand& band = bands[index(at)];
      for (int row = at.row - 1; row <= at.row + 1; ++row) {
        for (int column = at.column - 1; column <= at.column + 1; ++column) {
          const CellIndex next{column, row};
          if (!geometry.contains(next) || seen[index(next)] != 0) {
            continue;
          }
          const AltitudeBand& other = bands[index(next)];
          if (do_meet(band, other)) {
            seen[index(next)] = 1;
            open.push_back(next);
          }
        }
      }
    }
    return false;
  };
  fill(start, goal);
  Disconnection result;
  result.reachable_patches = open.size();
  const auto square_m2 = [&](CellIndex at) {
    const geo::MapPoint centre = geometry.centre(at);
    const double dx_m = centre.x_m - envelope.goal().x_m;
    const double dy_m = centre.y_m - envelope.goal().y_m;
    return dx_m * dx_m + dy_m * dy_m;
  };
  CellIndex nearest = start;
  for (const CellIndex at : open) {
    if (square_m2(at) < square_m2(nearest)) {
      nearest = at;
    }
  }
  result.nearest_to_goal = geometry.centre(nearest);
  fill(goal, start);
  result.is_goal_enclosed = open.size() < result.reachable_patches;
  if (!closed.empty()) {
    fill(result.is_goal_enclosed ? goal : start, result.is_goal_enclosed ? start : goal);
    const std::vector<std::uint8_t> enclosed = seen;
    for (const Closed& patch : closed) {
      bands[index(patch.patch)] = patch.band;
    }
    if (fill(start, goal)) {
      const auto borders = [&](CellIndex at) {
        for (int row = at.row - 1; row <= at.row + 1; ++row) {
          for (int column = at.column - 1; column <= at.column + 1; ++column) {
            if (geometry.contains(CellIndex{column, row}) && enclosed[index({column, row})] != 0) {
              return true;
            }
          }
        }
        return false;
      };
      const auto at_border = std::find_if(
          closed.begin(), closed.end(), [&](const Closed& patch) { return borders(patch.patch); });
      result.area = at_border == closed.end() ? nullptr : at_border->area;
    }
  }
  return result;
}

}  // namespace hedgehop::global_planning
