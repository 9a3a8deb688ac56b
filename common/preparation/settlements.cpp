#include "preparation/settlements.hpp"

#include <algorithm>
#include <numeric>
#include <ogr_geometry.h>
#include <stdexcept>

#include "geo/gdal_guards.hpp"

namespace hedgehop::preparation {
namespace {

constexpr char kStage[] = "settlements";
constexpr int kQuadrantSegments = 6;  // of round corners: 1 % of the radius too small at most
constexpr std::size_t kUnionBatch = 64;

GeometryPointer buffered(const OGRGeometry& geometry, double distance_m) {
  const geo::GdalErrors quiet;
  GeometryPointer result(geometry.Buffer(distance_m, kQuadrantSegments));
  if (!result) {
    // Rounding to millimetres may have made a ring cross itself.
    const GeometryPointer repaired(geometry.MakeValid());
    if (repaired) {
      result.reset(repaired->Buffer(distance_m, kQuadrantSegments));
    }
  }
  return result;
}

void add_polygons(const OGRGeometry& geometry, OGRMultiPolygon& target) {
  if (wkbFlatten(geometry.getGeometryType()) == wkbPolygon) {
    target.addGeometry(&geometry);
  } else if (OGR_GT_IsSubClassOf(geometry.getGeometryType(), wkbGeometryCollection)) {
    for (const OGRGeometry* part : *geometry.toGeometryCollection()) {
      add_polygons(*part, target);
    }
  }
}

GeometryPointer united(std::vector<GeometryPointer> pieces, Observer& observer) {
  while (pieces.size() > 1) {
    std::vector<GeometryPointer> next;
    for (std::size_t begin = 0; begin < pieces.size(); begin += kUnionBatch) {
      observer.check_stop();
      OGRMultiPolygon batch;
      for (std::size_t i = begin; i < std::min(begin + kUnionBatch, pieces.size()); ++i) {
        add_polygons(*pieces[i], batch);
      }
      GeometryPointer joined(batch.UnionCascaded());
      if (!joined) {
        throw std::runtime_error("uniting settlements failed");
      }
      next.push_back(std::move(joined));
    }
    pieces = std::move(next);
  }
  return pieces.empty() ? nullptr : std::move(pieces.front());
}

// Groups whose boxes touch, each in the order of its members; a sweep from west to east.
std::vector<std::vector<std::size_t>> groups_of(const std::vector<GeometryPointer>& pieces,
                                                Observer& observer) {
  std::vector<OGREnvelope> boxes(pieces.size());
  std::vector<std::size_t> order(pieces.size());
  std::vector<std::size_t> parent(pieces.size());
  std::iota(order.begin(), order.end(), 0);
  std::iota(parent.begin(), parent.end(), 0);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    pieces[i]->getEnvelope(&boxes[i]);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return boxes[a].MinX < boxes[b].MinX; });
  const auto root = [&](std::size_t i) {
    while (parent[i] != i) {
      parent[i] = parent[parent[i]];
      i = parent[i];
    }
    return i;
  };
  std::vector<std::size_t> open;
  for (std::size_t n = 0; n < order.size(); ++n) {
    if (n % 256 == 0) {
      observer.check_stop();
    }
    const std::size_t i = order[n];
    std::erase_if(open, [&](std::size_t j) { return boxes[j].MaxX < boxes[i].MinX; });
    for (const std::size_t j : open) {
      if (boxes[i].Intersects(boxes[j])) {
        parent[root(i)] = root(j);
      }
    }
    open.push_back(i);
  }
  std::vector<std::vector<std::size_t>> groups(pieces.size());
  for (const std::size_t i : order) {
    groups[root(i)].push_back(i);
  }
  std::erase_if(groups, [](const auto& group) { return group.empty(); });
  return groups;
}

}  // namespace

Settlements settlements_of(const std::vector<const OGRGeometry*>& built_up,
                           const SettlementOptions& options, double tolerance_m,
                           Observer& observer) {
  std::vector<GeometryPointer> pieces;
  for (std::size_t i = 0; i < built_up.size(); ++i) {
    if (i % 64 == 0) {
      observer.check_stop();
      observer.progress(kStage, 0.3 * static_cast<double>(i) / static_cast<double>(built_up.size()),
                        1.0);
    }
    GeometryPointer piece = buffered(*built_up[i], options.grow_m);
    if (piece && !piece->IsEmpty()) {
      pieces.push_back(std::move(piece));
    }
  }
  Settlements result;
  const auto groups = groups_of(pieces, observer);
  for (std::size_t g = 0; g < groups.size(); ++g) {
    observer.check_stop();
    observer.progress(kStage,
                      0.3 + 0.7 * static_cast<double>(g) / static_cast<double>(groups.size()), 1.0);
    std::vector<GeometryPointer> members;
    for (const std::size_t i : groups[g]) {
      members.push_back(std::move(pieces[i]));
    }
    const GeometryPointer joined = united(std::move(members), observer);
    if (!joined) {
      continue;
    }
    GeometryPointer shrunk = buffered(*joined, -options.shrink_m);
    if (!shrunk || shrunk->IsEmpty()) {
      continue;
    }
    // Growing and shrinking round every corner; the rings would pay for each vertex.
    const GeometryPointer simple(shrunk->SimplifyPreserveTopology(tolerance_m));
    OGRMultiPolygon parts;
    add_polygons(simple && !simple->IsEmpty() ? *simple : *shrunk, parts);
    for (const OGRPolygon* polygon : parts) {
      auto& target =
          polygon->get_Area() <= options.village_area_max_m2 ? result.villages : result.settlements;
      target.emplace_back(polygon->clone());
    }
  }
  observer.progress(kStage, 1.0, 1.0);
  return result;
}

std::vector<GeometryPointer> grown(const std::vector<GeometryPointer>& pieces, double distance_m,
                                   Observer& observer) {
  std::vector<GeometryPointer> result;
  for (const GeometryPointer& piece : pieces) {
    observer.check_stop();
    GeometryPointer ring = buffered(*piece, distance_m);
    if (ring && !ring->IsEmpty()) {
      result.push_back(std::move(ring));
    }
  }
  return result;
}

}  // namespace hedgehop::preparation
