#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "geo/map_projection.hpp"

namespace hedgehop::map_sources {

using OsmTags = std::vector<std::pair<std::string, std::string>>;

/// Collects OSM objects in a metric frame and writes them as OSM XML, numbered from 1.
class OsmDocument {
 public:
  /// Points are offsets from `origin` in the frame of `projection`. `note` becomes the tag `note`
  /// of each tagged object.
  OsmDocument(geo::MapPoint origin, std::string note) : origin_(origin), note_(std::move(note)) {}

  std::int64_t add_node(const geo::MapPoint& point, const OsmTags& tags = {});
  std::int64_t add_way(const std::vector<std::int64_t>& nodes, const OsmTags& tags);
  /// Nodes for the points, then the way; the first node again at the end if `is_closed`.
  std::int64_t add_line(const std::vector<geo::MapPoint>& points, bool is_closed,
                        const OsmTags& tags);
  /// An area: a closed way, or a multipolygon relation if it has holes or too many points for a
  /// way.
  void add_area(const std::vector<geo::MapPoint>& outer,
                const std::vector<std::vector<geo::MapPoint>>& holes, const OsmTags& tags);

  /// Nodes, ways, relations, each by rising id.
  [[nodiscard]] std::string xml(const geo::MapProjection& projection, const std::string& generator,
                                const std::string& comment) const;

 private:
  struct Node {
    geo::MapPoint point;
    OsmTags tags;
  };
  struct Way {
    std::vector<std::int64_t> nodes;
    OsmTags tags;
  };
  struct Relation {
    std::vector<std::pair<std::int64_t, const char*>> members;  // way, role
    OsmTags tags;
  };
  void add_ring(const std::vector<geo::MapPoint>& ring, const char* role, Relation& relation);
  void append_tags(std::string& text, const OsmTags& tags) const;

  geo::MapPoint origin_;
  std::string note_;
  std::vector<Node> nodes_;
  std::vector<Way> ways_;
  std::vector<Relation> relations_;
};

/// A region with its holes; rings are open, without the first point again. Outer rings run
/// counter-clockwise.
struct TracedArea {
  std::vector<geo::MapPoint> outer;
  std::vector<std::vector<geo::MapPoint>> holes;
  double area_m2 = 0.0;  // of the outer ring
};

/// Where a field of nodes is above 0, as areas with straight edges (marching squares).
///
/// Node (i, j) lies at west + i * step, south + j * step. Nodes on the rim count as outside. Rings
/// that enclose less than `area_min_m2` are left out, holes too.
std::vector<TracedArea> trace_areas(const std::vector<double>& field, int columns, int rows,
                                    double west_m, double south_m, double step_m,
                                    double area_min_m2);

/// Whether a point lies inside a ring (even-odd rule).
bool is_inside(const std::vector<geo::MapPoint>& ring, const geo::MapPoint& point);

}  // namespace hedgehop::map_sources
