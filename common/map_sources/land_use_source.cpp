#include "map_sources/land_use_source.hpp"

#include <algorithm>
#include <cmath>
#include <osmium/area/assembler.hpp>
#include <osmium/area/assembler_legacy.hpp>
#include <osmium/area/multipolygon_manager.hpp>
#include <osmium/area/multipolygon_manager_legacy.hpp>
#include <osmium/handler/check_order.hpp>
#include <osmium/handler/node_locations_for_ways.hpp>
#include <osmium/index/map/flex_mem.hpp>
#include <osmium/io/bzip2_compression.hpp>
#include <osmium/io/gzip_compression.hpp>
#include <osmium/io/pbf_input.hpp>
#include <osmium/io/reader.hpp>
#include <osmium/io/xml_input.hpp>
#include <osmium/osm/area.hpp>
#include <osmium/tags/tags_filter.hpp>
#include <osmium/visitor.hpp>
#include <set>
#include <unordered_map>
#include <unordered_set>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "map_sources/height_text.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;

constexpr char kStage[] = "land use";
constexpr std::size_t kNamedRelationsMax = 1000;

bool is_one_of(const char* value, std::initializer_list<std::string_view> words) {
  return value != nullptr && std::find(words.begin(), words.end(), value) != words.end();
}

std::optional<ObjectClass> class_of_area(const osmium::TagList& tags) {
  const char* building = tags.get_value_by_key("building");
  if (building != nullptr && !is_one_of(building, {"no", "entrance"})) {
    return ObjectClass::kBuilding;
  }
  if (is_one_of(tags.get_value_by_key("man_made"),
                {"mast", "tower", "chimney", "communications_tower", "water_tower", "silo",
                 "storage_tank", "gasometer", "cooling_tower"})) {
    return ObjectClass::kStructure;
  }
  const char* natural = tags.get_value_by_key("natural");
  const char* land_use = tags.get_value_by_key("landuse");
  if (is_one_of(natural, {"wood"}) || is_one_of(land_use, {"forest"})) {
    return ObjectClass::kForest;
  }
  if (is_one_of(land_use, {"residential", "commercial", "industrial", "retail", "garages",
                           "farmyard", "institutional", "construction", "education"})) {
    return ObjectClass::kBuiltUpArea;
  }
  if (is_one_of(natural, {"water"}) || is_one_of(land_use, {"reservoir", "basin"}) ||
      is_one_of(tags.get_value_by_key("waterway"), {"riverbank"})) {
    return ObjectClass::kWater;
  }
  return std::nullopt;
}

std::optional<ObjectClass> class_of_node(const osmium::TagList& tags) {
  if (is_one_of(tags.get_value_by_key("natural"), {"tree"})) {
    return ObjectClass::kTree;
  }
  if (is_one_of(tags.get_value_by_key("man_made"),
                {"mast", "tower", "chimney", "communications_tower", "water_tower", "silo",
                 "storage_tank", "gasometer", "cooling_tower"}) ||
      is_one_of(tags.get_value_by_key("generator:source"), {"wind"})) {
    return ObjectClass::kStructure;
  }
  const char* building = tags.get_value_by_key("building");
  if (building != nullptr && !is_one_of(building, {"no", "entrance"})) {
    return ObjectClass::kBuilding;
  }
  return std::nullopt;
}

StructureKind structure_kind_of(const osmium::TagList& tags) {
  if (is_one_of(tags.get_value_by_key("generator:source"), {"wind"})) {
    return StructureKind::kWindTurbine;
  }
  const char* man_made = tags.get_value_by_key("man_made");
  if (is_one_of(man_made, {"mast"})) {
    return StructureKind::kMast;
  }
  if (is_one_of(man_made, {"tower", "communications_tower"})) {
    return StructureKind::kTower;
  }
  if (is_one_of(man_made, {"chimney"})) {
    return StructureKind::kChimney;
  }
  return StructureKind::kStructure;
}

bool is_aerialway(const char* value) {
  return is_one_of(value, {"cable_car", "gondola", "mixed_lift", "chair_lift", "goods", "zip_line",
                           "drag_lift", "t-bar", "j-bar", "platter", "rope_tow", "yes"});
}

bool is_low_aerialway(const char* value) {
  return is_one_of(value, {"drag_lift", "t-bar", "j-bar", "platter", "rope_tow"});
}

// What the assembler has to look at.
osmium::TagsFilter area_filter() {
  osmium::TagsFilter filter{false};
  for (const char* key : {"building", "man_made", "natural", "landuse", "waterway"}) {
    filter.add_rule(true, key);
  }
  return filter;
}

struct Box {
  double west_deg = 1e9, south_deg = 1e9, east_deg = -1e9, north_deg = -1e9;

  void add(const osmium::Location& location) {
    west_deg = std::min(west_deg, location.lon_without_check());
    east_deg = std::max(east_deg, location.lon_without_check());
    south_deg = std::min(south_deg, location.lat_without_check());
    north_deg = std::max(north_deg, location.lat_without_check());
  }
  [[nodiscard]] bool touches(const Box& other) const {
    return west_deg <= other.east_deg && other.west_deg <= east_deg &&
           south_deg <= other.north_deg && other.south_deg <= north_deg;
  }
  [[nodiscard]] geo::GeodeticBox to_radians() const {
    return {radians_from_degrees(west_deg), radians_from_degrees(south_deg),
            radians_from_degrees(east_deg), radians_from_degrees(north_deg)};
  }
};

// Collects what is wanted out of all files.
class Collector {
 public:
  Collector(const geo::MapProjection& projection, const geo::GeodeticBox& region, LandUse& land_use)
      : projection_(projection), land_use_(land_use) {
    region_.west_deg = degrees_from_radians(region.west_rad);
    region_.south_deg = degrees_from_radians(region.south_rad);
    region_.east_deg = degrees_from_radians(region.east_rad);
    region_.north_deg = degrees_from_radians(region.north_rad);
  }

  void node(const osmium::Node& node) {
    ++land_use_.node_count;
    if (!node.location().valid()) {
      return;
    }
    nodes_box_.add(node.location());
    if (node.tags().empty()) {
      return;
    }
    if (is_one_of(node.tags().get_value_by_key("power"),
                  {"tower", "pole", "portal", "catenary_mast"}) ||
        is_one_of(node.tags().get_value_by_key("aerialway"), {"pylon", "station"})) {
      poles_.insert(node.id());
      const auto height_m = height_of(node.tags());
      if (height_m) {
        support_heights_m_[node.id()] = *height_m;
      }
    }
    const auto object_class = class_of_node(node.tags());
    Box box;
    box.add(node.location());
    if (object_class && box.touches(region_) && seen_nodes_.insert(node.id()).second) {
      LineObject object{
          *object_class, node.id(), height_of(node.tags()), {to_map(node.location())}};
      if (*object_class == ObjectClass::kStructure) {
        object.structure_kind = structure_kind_of(node.tags());
        const char* diameter = node.tags().get_value_by_key("rotor:diameter");
        if (const auto diameter_m = diameter ? height_in_text_m(diameter) : std::nullopt) {
          object.radius_m = 0.5 * *diameter_m;
        }
      }
      land_use_.lines.push_back(std::move(object));
    }
  }

  void way(const osmium::Way& way) {
    const bool is_row = is_one_of(way.tags().get_value_by_key("natural"), {"tree_row"});
    const char* power = way.tags().get_value_by_key("power");
    const char* aerialway = way.tags().get_value_by_key("aerialway");
    const bool is_overhead_line =
        (is_one_of(power, {"line", "minor_line"}) &&
         !is_one_of(way.tags().get_value_by_key("location"), {"underground", "underwater"})) ||
        is_aerialway(aerialway);
    if (!is_row && !is_overhead_line) {
      if (!way.nodes().empty() && !way.tags().empty() &&
          std::any_of(way.nodes().begin(), way.nodes().end(),
                      [](const osmium::NodeRef& ref) { return !ref.location().valid(); }) &&
          class_of_area(way.tags())) {
        ++land_use_.incomplete_way_count;
      }
      return;
    }
    // A node that the file does not hold ends one piece of the line and begins the next.
    std::vector<std::vector<const osmium::NodeRef*>> pieces(1);
    Box box;
    bool is_complete = true;
    for (const osmium::NodeRef& ref : way.nodes()) {
      if (ref.location().valid()) {
        pieces.back().push_back(&ref);
        box.add(ref.location());
      } else {
        is_complete = false;
        pieces.emplace_back();
      }
    }
    if (!box.touches(region_) || !seen_lines_.insert(way.id()).second) {
      return;
    }
    if (!is_complete) {
      ++land_use_.incomplete_way_count;
    }
    const auto height_m = height_of(way.tags());
    for (const auto& piece : pieces) {
      if (is_row && !piece.empty()) {
        LineObject row{ObjectClass::kTree, way.id(), height_m, {}};
        for (const osmium::NodeRef* ref : piece) {
          row.vertices.push_back(to_map(ref->location()));
        }
        land_use_.lines.push_back(std::move(row));
      }
      if (is_overhead_line && piece.size() >= 2) {
        PowerLineObject line{way.id(), is_one_of(power, {"minor_line"}), {}};
        if (is_aerialway(aerialway)) {
          line.is_aerialway = true;
          line.is_minor = is_low_aerialway(aerialway);
        }
        for (const osmium::NodeRef* ref : piece) {
          const auto tagged = support_heights_m_.find(ref->ref());
          line.supports.push_back(
              {to_map(ref->location()),
               tagged != support_heights_m_.end() ? std::optional(tagged->second) : height_m,
               poles_.contains(ref->ref())});
        }
        land_use_.power_lines.push_back(std::move(line));
      }
    }
  }

  void area(const osmium::Area& area, bool is_old_style) {
    if (is_old_style && area.from_way()) {
      return;
    }
    const auto object_class = class_of_area(area.tags());
    if (!object_class) {
      return;
    }
    if (area.num_rings().first == 0) {
      ++land_use_.invalid_area_count;
      return;
    }
    Box box;
    for (const auto& outer : area.outer_rings()) {
      for (const osmium::NodeRef& ref : outer) {
        box.add(ref.location());
      }
    }
    if (!box.touches(region_) || !seen_areas_.insert(area.id()).second) {
      return;
    }
    AreaObject object;
    object.object_class = *object_class;
    object.source_id = area.id();
    object.structure_kind = structure_kind_of(area.tags());
    object.height_m = height_of(area.tags());
    const char* levels = area.tags().get_value_by_key("building:levels");
    if (levels != nullptr) {
      object.levels = levels_in_text(levels);
      if (!object.levels) {
        ++land_use_.unreadable_height_count;
      }
    }
    const char* roof_levels = area.tags().get_value_by_key("roof:levels");
    if (object.levels && roof_levels != nullptr) {
      *object.levels += levels_in_text(roof_levels).value_or(0.0);
    }
    const auto ring_of = [&](const auto& ring) {
      MapLine line;
      for (const osmium::NodeRef& ref : ring) {
        line.push_back(to_map(ref.location()));
      }
      return line;
    };
    for (const auto& outer : area.outer_rings()) {
      MapPolygon polygon{ring_of(outer), {}};
      for (const auto& inner : area.inner_rings(outer)) {
        polygon.holes.push_back(ring_of(inner));
      }
      object.polygons.push_back(std::move(polygon));
    }
    land_use_.areas.push_back(std::move(object));
  }

  void remove_ways_of_old_style_relations(
      const std::unordered_map<osmium::object_id_type, ObjectClass>& ways) {
    std::erase_if(land_use_.areas, [&](const AreaObject& area) {
      if (area.source_id % 2 != 0) {
        return false;  // odd numbers are areas of relations
      }
      const auto way = ways.find(osmium::area_id_to_object_id(area.source_id));
      return way != ways.end() && way->second == area.object_class;
    });
  }

  void begin_file() { nodes_box_ = Box(); }
  [[nodiscard]] const Box& nodes_box() const { return nodes_box_; }

 private:
  geo::MapPoint to_map(const osmium::Location& location) const {
    return projection_.to_map(
        {radians_from_degrees(location.lat()), radians_from_degrees(location.lon())});
  }

  std::optional<double> height_of(const osmium::TagList& tags) {
    for (const char* key : {"height", "building:height", "est_height"}) {
      const char* text = tags.get_value_by_key(key);
      if (text != nullptr) {
        const auto height_m = height_in_text_m(text);
        if (height_m) {
          return height_m;
        }
        ++land_use_.unreadable_height_count;
      }
    }
    return std::nullopt;
  }

  const geo::MapProjection& projection_;
  LandUse& land_use_;
  Box region_;
  Box nodes_box_;
  std::unordered_map<osmium::object_id_type, double> support_heights_m_;
  std::unordered_set<osmium::object_id_type> poles_;
  std::unordered_set<osmium::object_id_type> seen_nodes_;
  std::unordered_set<osmium::object_id_type> seen_lines_;
  std::unordered_set<osmium::object_id_type> seen_areas_;
};

struct CollectorHandler : osmium::handler::Handler {
  explicit CollectorHandler(Collector& collector_) : collector(collector_) {}
  void node(const osmium::Node& node) {
    if (had_way) {
      throw osmium::out_of_order_error("a node stands behind a way", node.id());
    }
    collector.node(node);
  }
  void way(const osmium::Way& way) {
    had_way = true;
    collector.way(way);
  }
  Collector& collector;
  bool had_way = false;
};

using NewStyle = osmium::area::MultipolygonManager<osmium::area::Assembler>;
using OldStyle = osmium::area::MultipolygonManagerLegacy<osmium::area::AssemblerLegacy>;
using LocationIndex =
    osmium::index::map::FlexMem<osmium::unsigned_object_id_type, osmium::Location>;

void read_file(const fs::path& given, Collector& collector, LandUse& land_use, double share_begin,
               double share, Observer& observer) {
  // Absolute, because libosmium takes a name that looks like a web address for one.
  const osmium::io::File file(fs::absolute(given).string());
  const double bytes = std::max(1.0, static_cast<double>(fs::file_size(given)));

  osmium::area::AssemblerConfig config;
  NewStyle new_style(config, area_filter());
  osmium::area::AssemblerConfig old_config;
  old_config.create_way_polygons = false;
  old_config.create_new_style_polygons = false;
  OldStyle old_style(old_config);
  std::unordered_map<osmium::object_id_type, std::vector<osmium::object_id_type>> old_members;

  const osmium::TagsFilter filter = area_filter();
  {
    osmium::io::Reader reader(file, osmium::osm_entity_bits::relation);
    while (osmium::memory::Buffer buffer = reader.read()) {
      observer.check_stop();
      observer.progress(
          kStage, share_begin + 0.3 * share * static_cast<double>(reader.offset()) / bytes, 1.0);
      for (const osmium::Relation& relation : buffer.select<osmium::Relation>()) {
        if (!is_one_of(relation.tags().get_value_by_key("type"), {"multipolygon"})) {
          continue;
        }
        if (osmium::tags::match_any_of(relation.tags(), filter)) {
          new_style.relation(relation);
        } else {
          old_style.relation(relation);
          auto& members = old_members[relation.id()];
          for (const osmium::RelationMember& member : relation.members()) {
            if (member.type() == osmium::item_type::way && !is_one_of(member.role(), {"inner"})) {
              members.push_back(member.ref());
            }
          }
        }
      }
    }
    reader.close();
  }
  new_style.prepare_for_lookup();
  old_style.prepare_for_lookup();

  collector.begin_file();
  LocationIndex index;
  osmium::handler::NodeLocationsForWays<LocationIndex> locations(index);
  locations.ignore_errors();
  std::unordered_map<osmium::object_id_type, ObjectClass> ways_of_old_style;
  const auto collect = [&](osmium::memory::Buffer&& buffer, bool is_old_style) {
    for (const osmium::Area& area : buffer.select<osmium::Area>()) {
      collector.area(area, is_old_style);
      const auto object_class = class_of_area(area.tags());
      const auto members = old_members.find(area.orig_id());
      if (is_old_style && !area.from_way() && area.num_rings().first > 0 && object_class &&
          members != old_members.end()) {
        for (const osmium::object_id_type way : members->second) {
          ways_of_old_style[way] = *object_class;
        }
      }
    }
  };
  auto& new_handler =
      new_style.handler([&](osmium::memory::Buffer&& b) { collect(std::move(b), false); });
  auto& old_handler =
      old_style.handler([&](osmium::memory::Buffer&& b) { collect(std::move(b), true); });
  CollectorHandler own_handler(collector);

  osmium::io::Reader reader(file, osmium::osm_entity_bits::node | osmium::osm_entity_bits::way,
                            osmium::io::read_meta::no);
  if (reader.header().get("generator").rfind("hedgehop", 0) != 0) {
    land_use.is_openstreetmap = true;
  }
  const osmium::Box header_box = reader.header().joined_boxes();
  const std::int64_t nodes_before = land_use.node_count;
  while (osmium::memory::Buffer buffer = reader.read()) {
    observer.check_stop();
    observer.progress(
        kStage, share_begin + share * (0.3 + 0.7 * static_cast<double>(reader.offset()) / bytes),
        1.0);
    osmium::apply(buffer, locations, own_handler, new_handler, old_handler);
  }
  reader.close();
  new_handler.flush();
  old_handler.flush();
  collect(new_style.read(), false);
  collect(old_style.read(), true);
  collector.remove_ways_of_old_style_relations(ways_of_old_style);

  if (land_use.node_count == nodes_before) {
    throw DataError(given.string() + ": holds no nodes, so it says nothing about any place",
                    "take an extract with nodes and ways, sorted by type and then by number");
  }
  for (const auto& manager_count : {0, 1}) {
    const auto count = [&](const osmium::relations::RelationHandle& handle) {
      ++land_use.incomplete_relation_count;
      if (land_use.incomplete_relation_ids.size() < kNamedRelationsMax) {
        land_use.incomplete_relation_ids.push_back(handle->id());
      }
    };
    if (manager_count == 0) {
      new_style.for_each_incomplete_relation(count);
    } else {
      old_style.for_each_incomplete_relation(count);
    }
  }
  Box mapped = collector.nodes_box();
  if (header_box.valid() && header_box.bottom_left().valid() && header_box.top_right().valid()) {
    mapped = Box();
    mapped.add(header_box.bottom_left());
    mapped.add(header_box.top_right());
  }
  land_use.mapped.push_back(mapped.to_radians());
}

}  // namespace

LandUse read_land_use(const std::vector<fs::path>& files, const geo::MapProjection& projection,
                      const geo::GeodeticBox& region, Observer& observer) {
  LandUse land_use;
  Collector collector(projection, region, land_use);
  observer.progress(kStage, 0.0, 1.0);
  for (std::size_t i = 0; i < files.size(); ++i) {
    const fs::path& path = files[i];
    std::error_code error;
    if (!fs::exists(path, error)) {
      throw DataError(path.string() + ": no such file", "check the path given with --osm");
    }
    if (!fs::is_regular_file(path, error)) {
      throw DataError(path.string() + ": is not a file", "give OpenStreetMap files one by one");
    }
    const double share = 1.0 / static_cast<double>(files.size());
    try {
      read_file(path, collector, land_use, share * static_cast<double>(i), share, observer);
    } catch (const UserError&) {
      throw;
    } catch (const osmium::out_of_order_error& caught) {
      throw DataError(path.string() + ": is not sorted: " + caught.what(),
                      "sort it first, for example with osmium sort");
    } catch (const std::bad_alloc&) {
      throw;
    } catch (const std::exception& caught) {
      throw DataError(path.string() + ": cannot be read as OpenStreetMap data: " + caught.what(),
                      "--osm takes .osm, .osm.gz, .osm.bz2 and .osm.pbf; a file that was cut off "
                      "must be fetched again");
    }
  }
  observer.progress(kStage, 1.0, 1.0);
  return land_use;
}

}  // namespace hedgehop::map_sources
