#include "map_sources/synthetic_osm.hpp"

#include <algorithm>
#include <cmath>

#include "base/angles.hpp"
#include "base/errors.hpp"

namespace hedgehop::map_sources {
namespace {

constexpr std::size_t kWayNodesMax = 1900;  // OSM allows 2000

void append_escaped(std::string& text, const std::string& value) {
  for (const char c : value) {
    switch (c) {
      case '&':
        text += "&amp;";
        break;
      case '<':
        text += "&lt;";
        break;
      case '"':
        text += "&quot;";
        break;
      default:
        text += c;
    }
  }
}

/// Degrees with seven decimals, as OSM stores them.
void append_degrees(std::string& text, double angle_rad) {
  const auto units = static_cast<std::int64_t>(std::llround(degrees_from_radians(angle_rad) * 1e7));
  const std::int64_t magnitude = units < 0 ? -units : units;
  const std::string fraction = std::to_string(magnitude % 10'000'000);
  text += units < 0 ? "-" : "";
  text += std::to_string(magnitude / 10'000'000);
  text += '.';
  text.append(7 - fraction.size(), '0');
  text += fraction;
}

double signed_area_m2(const std::vector<geo::MapPoint>& ring) {
  double sum = 0.0;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const geo::MapPoint& a = ring[i];
    const geo::MapPoint& b = ring[(i + 1) % ring.size()];
    sum += a.x_m * b.y_m - b.x_m * a.y_m;
  }
  return 0.5 * sum;
}

}  // namespace

std::int64_t OsmDocument::add_node(const geo::MapPoint& point, const OsmTags& tags) {
  nodes_.push_back({point, tags});
  return static_cast<std::int64_t>(nodes_.size());
}

std::int64_t OsmDocument::add_way(const std::vector<std::int64_t>& nodes, const OsmTags& tags) {
  ways_.push_back({nodes, tags});
  return static_cast<std::int64_t>(ways_.size());
}

std::int64_t OsmDocument::add_line(const std::vector<geo::MapPoint>& points, bool is_closed,
                                   const OsmTags& tags) {
  std::vector<std::int64_t> nodes;
  nodes.reserve(points.size() + 1);
  for (const geo::MapPoint& point : points) {
    nodes.push_back(add_node(point));
  }
  if (is_closed) {
    nodes.push_back(nodes.front());
  }
  return add_way(nodes, tags);
}

void OsmDocument::add_ring(const std::vector<geo::MapPoint>& ring, const char* role,
                           Relation& relation) {
  std::vector<std::int64_t> nodes;
  nodes.reserve(ring.size() + 1);
  for (const geo::MapPoint& point : ring) {
    nodes.push_back(add_node(point));
  }
  nodes.push_back(nodes.front());
  for (std::size_t first = 0; first + 1 < nodes.size(); first += kWayNodesMax - 1) {
    const std::size_t last = std::min(first + kWayNodesMax - 1, nodes.size() - 1);
    relation.members.emplace_back(add_way({nodes.begin() + static_cast<std::ptrdiff_t>(first),
                                           nodes.begin() + static_cast<std::ptrdiff_t>(last) + 1},
                                          {}),
                                  role);
  }
}

void OsmDocument::add_area(const std::vector<geo::MapPoint>& outer,
                           const std::vector<std::vector<geo::MapPoint>>& holes,
                           const OsmTags& tags) {
  if (holes.empty() && outer.size() < kWayNodesMax) {
    add_line(outer, true, tags);
    return;
  }
  Relation relation;
  add_ring(outer, "outer", relation);
  for (const auto& hole : holes) {
    add_ring(hole, "inner", relation);
  }
  relation.tags = tags;
  relation.tags.emplace_back("type", "multipolygon");
  relations_.push_back(std::move(relation));
}

void OsmDocument::append_tags(std::string& text, const OsmTags& tags) const {
  for (const auto& [key, value] : tags) {
    text += "    <tag k=\"";
    append_escaped(text, key);
    text += "\" v=\"";
    append_escaped(text, value);
    text += "\"/>\n";
  }
  text += "    <tag k=\"note\" v=\"";
  append_escaped(text, note_);
  text += "\"/>\n";
}

std::string OsmDocument::xml(const geo::MapProjection& projection, const std::string& generator,
                             const std::string& comment) const {
  std::string text;
  text.reserve(nodes_.size() * 72 + ways_.size() * 200);
  text += "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- ";
  text += comment;
  text += " -->\n<osm version=\"0.6\" generator=\"";
  append_escaped(text, generator);
  text += "\" upload=\"never\">\n";
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const Node& node = nodes_[i];
    const geo::GeodeticPosition position =
        projection.to_geodetic({origin_.x_m + node.point.x_m, origin_.y_m + node.point.y_m});
    text += "  <node id=\"" + std::to_string(i + 1) + "\" version=\"1\" lat=\"";
    append_degrees(text, position.latitude_rad);
    text += "\" lon=\"";
    append_degrees(text, position.longitude_rad);
    if (node.tags.empty()) {
      text += "\"/>\n";
      continue;
    }
    text += "\">\n";
    append_tags(text, node.tags);
    text += "  </node>\n";
  }
  for (std::size_t i = 0; i < ways_.size(); ++i) {
    text += "  <way id=\"" + std::to_string(i + 1) + "\" version=\"1\">\n";
    for (const std::int64_t node : ways_[i].nodes) {
      text += "    <nd ref=\"" + std::to_string(node) + "\"/>\n";
    }
    append_tags(text, ways_[i].tags);
    text += "  </way>\n";
  }
  for (std::size_t i = 0; i < relations_.size(); ++i) {
    text += "  <relation id=\"" + std::to_string(i + 1) + "\" version=\"1\">\n";
    for (const auto& [way, role] : relations_[i].members) {
      text +=
          "    <member type=\"way\" ref=\"" + std::to_string(way) + "\" role=\"" + role + "\"/>\n";
    }
    append_tags(text, relations_[i].tags);
    text += "  </relation>\n";
  }
  text += "</osm>\n";
  return text;
}

bool is_inside(const std::vector<geo::MapPoint>& ring, const geo::MapPoint& point) {
  bool inside = false;
  for (std::size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++) {
    const geo::MapPoint& a = ring[i];
    const geo::MapPoint& b = ring[j];
    if ((a.y_m > point.y_m) != (b.y_m > point.y_m) &&
        point.x_m < (b.x_m - a.x_m) * (point.y_m - a.y_m) / (b.y_m - a.y_m) + a.x_m) {
      inside = !inside;
    }
  }
  return inside;
}

std::vector<TracedArea> trace_areas(const std::vector<double>& field, int columns, int rows,
                                    double west_m, double south_m, double step_m,
                                    double area_min_m2) {
  HEDGEHOP_ASSERT(columns >= 3 && rows >= 3 &&
                  field.size() ==
                      static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  const auto value = [&](int i, int j) {
    return i == 0 || j == 0 || i == columns - 1 || j == rows - 1
               ? std::min(-1e-3, field[static_cast<std::size_t>(j * columns + i)])
               : field[static_cast<std::size_t>(j * columns + i)];
  };
  // Crossed edges are named by their lower left node: 2 * node for the one to the east, 2 * node +
  // 1 for the one to the north. Each is left by exactly one segment, with the inside on its left.
  const auto edge_of = [&](int i, int j, int side) {
    switch (side) {
      case 0:
        return 2 * (j * columns + i);
      case 1:
        return 2 * (j * columns + i + 1) + 1;
      case 2:
        return 2 * ((j + 1) * columns + i);
      default:
        return 2 * (j * columns + i) + 1;
    }
  };
  std::vector<int> next(field.size() * 2, -1);
  for (int j = 0; j + 1 < rows; ++j) {
    for (int i = 0; i + 1 < columns; ++i) {
      const std::array<double, 4> corner = {value(i, j), value(i + 1, j), value(i + 1, j + 1),
                                            value(i, j + 1)};
      std::array<bool, 4> starts{};
      std::array<bool, 4> ends{};
      int crossings = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        const bool a = corner[k] > 0.0;
        const bool b = corner[(k + 1) % 4] > 0.0;
        starts[k] = a && !b;
        ends[k] = !a && b;
        crossings += a != b ? 1 : 0;
      }
      const bool is_joined = crossings == 4 && corner[0] + corner[1] + corner[2] + corner[3] > 0.0;
      for (std::size_t k = 0; k < 4; ++k) {
        if (!starts[k]) {
          continue;
        }
        std::size_t end = 0;
        if (crossings == 4) {
          end = is_joined ? (k + 1) % 4 : (k + 3) % 4;
        } else {
          while (!ends[end]) {
            ++end;
          }
        }
        next[static_cast<std::size_t>(edge_of(i, j, static_cast<int>(k)))] =
            edge_of(i, j, static_cast<int>(end));
      }
    }
  }
  const auto crossing = [&](int edge) {
    const int node = edge / 2;
    const int i = node % columns;
    const int j = node / columns;
    const bool is_eastward = edge % 2 == 0;
    const double a = value(i, j);
    const double b = is_eastward ? value(i + 1, j) : value(i, j + 1);
    // Kept away from the nodes, so that rings never touch.
    const double t = std::clamp(a / (a - b), 0.05, 0.95);
    return geo::MapPoint{west_m + (i + (is_eastward ? t : 0.0)) * step_m,
                         south_m + (j + (is_eastward ? 0.0 : t)) * step_m};
  };
  struct Ring {
    std::vector<geo::MapPoint> points;
    double area_m2;
  };
  std::vector<TracedArea> areas;
  std::vector<Ring> holes;
  for (std::size_t first = 0; first < next.size(); ++first) {
    if (next[first] < 0) {
      continue;
    }
    std::vector<geo::MapPoint> ring;
    for (int edge = static_cast<int>(first); next[static_cast<std::size_t>(edge)] >= 0;) {
      ring.push_back(crossing(edge));
      edge = std::exchange(next[static_cast<std::size_t>(edge)], -1);
    }
    const double area_m2 = signed_area_m2(ring);
    if (area_m2 >= area_min_m2) {
      areas.push_back({std::move(ring), {}, area_m2});
    } else if (-area_m2 >= area_min_m2) {
      holes.push_back({std::move(ring), -area_m2});
    }
  }
  for (Ring& hole : holes) {
    TracedArea* owner = nullptr;
    for (TracedArea& area : areas) {
      if (area.area_m2 > hole.area_m2 && (owner == nullptr || area.area_m2 < owner->area_m2) &&
          is_inside(area.outer, hole.points.front())) {
        owner = &area;
      }
    }
    if (owner != nullptr) {
      owner->holes.push_back(std::move(hole.points));
    }
  }
  return areas;
}

}  // namespace hedgehop::map_sources
