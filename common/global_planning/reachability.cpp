#include "global_planning/reachability.hpp"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace hedgehop::global_planning {
namespace {

using raster::CellIndex;
using raster::GridGeometry;

}  // namespace

std::optional<Disconnection> prove_disconnected(const FlightEnvelope& envelope) {
  // Patch (c, r) lies between the centres (c, r) and (c + 1, r + 1).
  const GridGeometry& cells = envelope.geometry();
  const GridGeometry geometry{cells.west_m + 0.5 * cells.cell_m, cells.south_m + 0.5 * cells.cell_m,
                              cells.cell_m, cells.columns - 1, cells.rows - 1};
  const CellIndex start = geometry.cell_at(envelope.start().point());
  const CellIndex goal = geometry.cell_at(envelope.goal().point());
  if (!geometry.contains(start) || !geometry.contains(goal)) {
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
      const map::Area* area = envelope.area_that_closes_patch({column, row}, band);
      if (area != nullptr && CellIndex{column, row} != start && CellIndex{column, row} != goal) {
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
          if (std::max(band.low_m, other.low_m) <= std::min(band.high_m, other.high_m)) {
            seen[index(next)] = 1;
            open.push_back(next);
          }
        }
      }
    }
    return false;
  };
  if (fill(start, goal)) {
    return std::nullopt;
  }
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
