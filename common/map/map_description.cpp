#include "map/map_description.hpp"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "map/map_bundle.hpp"
#include "map/source_layer.hpp"

namespace hedgehop::map {
namespace {

using Json = nlohmann::ordered_json;

Json number_or_null(double value, double step) {
  return std::isnan(value) ? Json(nullptr) : Json(std::round(value / step) * step);
}

// What stands in features.gpkg, in the order of print; aerialways, spans and poles only if there
// are any.
std::vector<std::pair<std::string, std::int64_t>> counts_of_features(const Map& map) {
  std::vector<std::pair<std::string, std::int64_t>> counts;
  std::int64_t poles = 0;
  std::int64_t spans = 0;
  for (const OverheadLine& line : map.overhead_lines) {
    spans += static_cast<std::int64_t>(line.supports.size()) - 1;
    poles += std::count_if(line.supports.begin(), line.supports.end(),
                           [](const OverheadLine::Support& support) { return support.is_pole; });
  }
  const auto lines_of = [&](LineKind kind) {
    return std::count_if(map.overhead_lines.begin(), map.overhead_lines.end(),
                         [&](const OverheadLine& line) { return line.kind == kind; });
  };
  counts.emplace_back("power lines",
                      lines_of(LineKind::kPowerLine) + lines_of(LineKind::kMinorPowerLine));
  if (const auto count = lines_of(LineKind::kAerialway); count > 0) {
    counts.emplace_back("aerialways", count);
  }
  if (!map.overhead_lines.empty()) {
    counts.emplace_back("spans", spans);
    counts.emplace_back("poles", poles);
  }
  counts.emplace_back("obstacles", static_cast<std::int64_t>(map.obstacles.size()));
  const auto hard =
      std::count_if(map.areas.begin(), map.areas.end(), [](const Area& a) { return a.is_hard; });
  counts.emplace_back("no-fly areas", hard);
  counts.emplace_back("avoid areas", static_cast<std::int64_t>(map.areas.size()) - hard);
  return counts;
}

Json statistics_of(const Map& map) {
  double lowest_m = std::numeric_limits<double>::infinity();
  double highest_m = -lowest_m;
  double highest_surface_m = -lowest_m;
  double visibility_sum = 0.0;
  std::int64_t known = 0;
  std::int64_t visibility_known = 0;
  for (std::size_t i = 0; i < map.terrain_m.values().size(); ++i) {
    const float terrain_m = map.terrain_m.values()[i];
    if (!std::isnan(terrain_m)) {
      ++known;
      lowest_m = std::min(lowest_m, static_cast<double>(terrain_m));
      highest_m = std::max(highest_m, static_cast<double>(terrain_m));
      highest_surface_m =
          std::max(highest_surface_m, static_cast<double>(map.surface_m.values()[i]));
    }
    const double share = visibility_share(map.visibility.values()[i]);
    if (!std::isnan(share)) {
      visibility_sum += share;
      ++visibility_known;
    }
  }
  const auto cells = static_cast<double>(map.geometry.cell_count());
  Json statistics;
  if (known > 0) {
    statistics["lowest_terrain_m"] = lowest_m;
    statistics["highest_terrain_m"] = highest_m;
    statistics["highest_surface_m"] = highest_surface_m;
  }
  statistics["void_share"] = number_or_null((cells - static_cast<double>(known)) / cells, 1e-6);
  if (visibility_known > 0) {
    statistics["mean_visibility"] =
        number_or_null(visibility_sum / static_cast<double>(visibility_known), 1e-6);
  }
  Json shares = Json::object();
  for (const SemanticName& name : semantic_names()) {
    const auto count = std::count_if(
        map.semantics.values().begin(), map.semantics.values().end(),
        [&](std::uint16_t bits) { return (bits & static_cast<std::uint16_t>(name.bit)) != 0; });
    shares[std::string(name.name)] = number_or_null(static_cast<double>(count) / cells, 1e-6);
  }
  statistics["class_shares"] = std::move(shares);
  Json features = Json::object();
  for (const auto& [what, count] : counts_of_features(map)) {
    std::string key = what;
    std::replace_if(
        key.begin(), key.end(), [](char c) { return c == ' ' || c == '-'; }, '_');
    features[key] = count;
  }
  statistics["features"] = std::move(features);
  return statistics;
}

Json parsed(const std::string& manifest_json) {
  Json manifest = Json::parse(manifest_json, nullptr, false);
  if (!manifest.is_object()) {
    throw DataError("the map's manifest is not a JSON object", "prepare the map again");
  }
  return manifest;
}

// Manifests come from files, so that nothing in them can be taken for granted.
std::string text_at(const Json& object, const char* key) {
  const auto entry = object.find(key);
  if (entry == object.end() || entry->is_null()) {
    return "-";
  }
  return entry->is_string() ? entry->get<std::string>()
                            : entry->dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string percent(const Json& share) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(1)
       << 100.0 * (share.is_number() ? share.get<double>() : 0.0) << " %";
  return text.str();
}

std::string box_text(const Json& box) {
  return text_at(box, "west") + "," + text_at(box, "south") + "," + text_at(box, "east") + "," +
         text_at(box, "north") + " (W,S,E,N)";
}

struct Place {
  geo::MapPoint point;
  raster::CellIndex cell;
  double convergence_rad = 0.0;
};

Place place_of(const Map& map, const geo::GeodeticPosition& position) {
  if (map.crs_wkt.empty()) {
    throw DataError("this map has no coordinate system, so it knows no latitude and longitude");
  }
  const geo::MapProjection projection(map.crs_wkt);
  Place place;
  place.point = projection.to_map(position);
  if (!map.geometry.contains(place.point)) {
    std::ostringstream what;
    what << std::fixed << std::setprecision(5) << degrees_from_radians(position.latitude_rad) << ","
         << degrees_from_radians(position.longitude_rad) << " lies outside the map";
    throw DataError(what.str(), "`hedgehop info` without --at tells what the map covers");
  }
  place.cell = map.geometry.cell_at(place.point);
  place.convergence_rad = projection.convergence_rad(place.point);
  return place;
}

std::string elevation_source_of(const CellSource& source, const Json& manifest) {
  if (source.elevation == 0) {
    return "unknown";
  }
  if (source.elevation == CellSource::kFilled) {
    return "filled in from neighbouring cells";
  }
  int number = 0;
  const auto inputs = manifest.find("inputs");
  if (inputs != manifest.end() && inputs->is_array()) {
    for (const Json& input : *inputs) {
      if (input.is_object() && text_at(input, "kind") == "elevation" &&
          ++number == source.elevation) {
        return text_at(input, "name") + " (" + text_at(input, "used_as") + ", " +
               text_at(input, "vertical_datum") + ")";
      }
    }
  }
  return "elevation file " + std::to_string(source.elevation);
}

// Every value below an entry of the manifest, one line each: "settings.visibility.radius_m 5000.0".
void add_values(const Json& value, const std::string& name, int depth, std::ostream& text) {
  constexpr int kDepthMax = 8;
  if ((value.is_object() || value.is_array()) && !value.empty() && depth < kDepthMax) {
    std::size_t number = 0;
    for (const auto& [key, inner] : value.items()) {
      add_values(inner,
                 name + (value.is_array() ? "[" + std::to_string(number++) + "]" : "." + key),
                 depth + 1, text);
    }
  } else {
    text << std::left << std::setw(24) << name << " "
         << (value.is_string() ? value.get<std::string>()
                               : value.dump(-1, ' ', false, Json::error_handler_t::replace))
         << "\n";
  }
}

// Whether a ring goes around the point: a ray eastwards crosses it an odd number of times.
bool goes_around(const std::vector<geo::MapPoint>& ring, const geo::MapPoint& point) {
  bool is_around = false;
  for (std::size_t i = 1; i < ring.size(); ++i) {
    const geo::MapPoint& a = ring[i - 1];
    const geo::MapPoint& b = ring[i];
    if ((a.y_m > point.y_m) != (b.y_m > point.y_m) &&
        point.x_m < a.x_m + (point.y_m - a.y_m) / (b.y_m - a.y_m) * (b.x_m - a.x_m)) {
      is_around = !is_around;
    }
  }
  return is_around;
}

bool is_over_area(const Area& area, const geo::MapPoint& point) {
  return std::any_of(area.polygons.begin(), area.polygons.end(), [&](const Area::Polygon& polygon) {
    return goes_around(polygon.outer, point) &&
           std::none_of(polygon.holes.begin(), polygon.holes.end(),
                        [&](const auto& hole) { return goes_around(hole, point); });
  });
}

// Null where the area ends at the ground, or nowhere.
Json limit_json(const AreaLimit& limit) {
  if (std::isinf(limit.value_m)) {
    return nullptr;
  }
  return {{"value_m", limit.value_m},
          {"above", limit.reference == AreaLimit::Reference::kAmsl ? "sea level" : "ground"}};
}

Json areas_at(const Map& map, const geo::MapPoint& point) {
  Json areas = Json::array();
  for (const Area& area : map.areas) {
    if (is_over_area(area, point)) {
      areas.push_back({{"name", area.name},
                       {"kind", area.kind},
                       {"is_hard", area.is_hard},
                       {"floor", limit_json(area.floor)},
                       {"ceiling", limit_json(area.ceiling)}});
    }
  }
  return areas;
}

// Whose circle, position error and safety radius included, the point lies in.
Json obstacles_at(const Map& map, const geo::MapPoint& point) {
  Json obstacles = Json::array();
  for (const Obstacle& obstacle : map.obstacles) {
    if (std::hypot(point.x_m - obstacle.point.x_m, point.y_m - obstacle.point.y_m) <=
        obstacle.radius_m) {
      obstacles.push_back({{"name", obstacle.name},
                           {"kind", name_of(obstacle.kind)},
                           {"height_m", number_or_null(obstacle.height_m, 0.1)},
                           {"radius_m", number_or_null(obstacle.radius_m, 0.1)}});
    }
  }
  return obstacles;
}

std::string area_text(const Json& area) {
  const auto limit = [](const Json& end, const char* otherwise) {
    std::ostringstream text;
    if (end.is_null()) {
      return std::string(otherwise);
    }
    text << std::fixed << std::setprecision(0) << end["value_m"].get<double>() << " m above "
         << end["above"].get<std::string>();
    return text.str();
  };
  const std::string name = area["name"].get<std::string>();
  const std::string kind = area["kind"].get<std::string>();
  return (name.empty() ? "without a name" : name) + (kind.empty() ? "" : " (" + kind + ")") +
         (area["is_hard"].get<bool>() ? ", must not be entered, " : ", to be avoided, ") +
         limit(area["floor"], "ground") + " to " + limit(area["ceiling"], "no end");
}

}  // namespace

std::string map_description_json(const Map& map, const std::string& manifest_json) {
  Json description = parsed(manifest_json);
  description["statistics"] = statistics_of(map);
  return description.dump(2, ' ', false, Json::error_handler_t::replace);
}

std::string map_description_text(const Map& map, const std::string& manifest_json) {
  const Json manifest = parsed(manifest_json);
  const Json statistics = statistics_of(map);
  std::ostringstream text;
  const auto line = [&](const char* what, const std::string& value) {
    text << std::left << std::setw(24) << what << value << "\n";
  };
  if (!map.label.empty()) {
    line("label", map.label);
  }
  line("map hash", map.hash.hex());
  if (manifest.contains("extent_deg") && manifest["extent_deg"].is_object()) {
    line("covers", box_text(manifest["extent_deg"]));
  }
  std::ostringstream size;
  size << map.geometry.columns << " x " << map.geometry.rows << " cells of " << map.geometry.cell_m
       << " m, " << std::fixed << std::setprecision(1)
       << map.geometry.columns * map.geometry.cell_m / 1000.0 << " x "
       << map.geometry.rows * map.geometry.cell_m / 1000.0 << " km";
  line("size", size.str());
  line("coordinates", map.crs_wkt.empty() ? "none" : text_at(manifest, "crs_code"));
  line("heights", "above mean sea level, " + map.vertical_datum);
  if (statistics.contains("lowest_terrain_m")) {
    std::ostringstream heights;
    heights << std::fixed << std::setprecision(0) << statistics["lowest_terrain_m"].get<double>()
            << " to " << statistics["highest_terrain_m"].get<double>() << " m, surface up to "
            << statistics["highest_surface_m"].get<double>() << " m";
    line("terrain", heights.str());
  }
  line("without elevation", percent(statistics["void_share"]));
  if (manifest.contains("filled_void_count")) {
    line("filled-in cells", text_at(manifest, "filled_void_count"));
  }
  if (statistics.contains("mean_visibility")) {
    std::ostringstream visibility;
    visibility << percent(statistics["mean_visibility"]) << " of the ground within "
               << map.visibility_radius_m / 1000.0 << " km sees " << map.reference_height_m
               << " m above the surface, on average";
    line("visibility", visibility.str());
  }
  if (manifest.contains("mapped_extent_deg") && manifest["mapped_extent_deg"].is_array()) {
    for (const Json& box : manifest["mapped_extent_deg"]) {
      line("land use mapped", box.is_object() ? box_text(box) : "-");
    }
  }
  for (const SemanticName& name : semantic_names()) {
    const Json& share = statistics["class_shares"][std::string(name.name)];
    if (share.get<double>() > 0.0) {
      line(("  " + std::string(name.name)).c_str(), percent(share));
    }
  }
  for (const auto& [what, count] : counts_of_features(map)) {
    line(what.c_str(), std::to_string(count));
  }
  if (manifest.contains("guessed_height_share")) {
    line("guessed heights", percent(manifest["guessed_height_share"]) + " of all objects");
  }
  if (manifest.contains("inputs") && manifest["inputs"].is_array()) {
    for (const Json& input : manifest["inputs"]) {
      if (input.is_object()) {
        line("made from", text_at(input, "name") + " (" + text_at(input, "kind") + ", " +
                              text_at(input, "bytes") + " bytes)");
        line("  sha-256", text_at(input, "sha256"));
        if (input.contains("used_as")) {
          line("  used as", text_at(input, "used_as") + " (" + text_at(input, "used_as_from") +
                                "), heights in " + text_at(input, "vertical_datum") + " (" +
                                text_at(input, "vertical_datum_from") + ")");
        }
      }
    }
  }
  line("made by", text_at(manifest, "tool") + " " + text_at(manifest, "tool_version"));
  for (const std::string& attribution : map.attributions) {
    line("attribution", attribution);
  }
  // How it was made, word for word.
  for (const char* key : {"settings", "terrain_resampling", "elevation_cells", "visibility_method",
                          "object_heights", "vector_sources", "land_use_statistics"}) {
    if (manifest.contains(key)) {
      add_values(manifest[key], key, 0, text);
    }
  }
  return text.str();
}

std::string place_description_json(const Map& map, const geo::GeodeticPosition& position,
                                   const std::filesystem::path& folder) {
  const Place place = place_of(map, position);
  const double terrain_m = static_cast<double>(map.terrain_m.at(place.cell));
  const double surface_m = static_cast<double>(map.surface_m.at(place.cell));
  Json result;
  result["schema"] = "hedgehop place";
  result["schema_version"] = 1;
  result["latitude_deg"] = number_or_null(degrees_from_radians(position.latitude_rad), 1e-8);
  result["longitude_deg"] = number_or_null(degrees_from_radians(position.longitude_rad), 1e-8);
  result["x_m"] = place.point.x_m;
  result["y_m"] = place.point.y_m;
  result["column"] = place.cell.column;
  result["row_from_south"] = place.cell.row;
  result["convergence_deg"] = number_or_null(degrees_from_radians(place.convergence_rad), 1e-6);
  result["terrain_m"] = std::isnan(terrain_m) ? Json(nullptr) : Json(terrain_m);
  result["surface_m"] = std::isnan(surface_m) ? Json(nullptr) : Json(surface_m);
  result["surface_above_terrain_m"] =
      std::isnan(terrain_m) ? Json(nullptr) : Json(surface_m - terrain_m);
  Json classes = Json::array();
  for (const SemanticName& name : semantic_names()) {
    if ((map.semantics.at(place.cell) & static_cast<std::uint16_t>(name.bit)) != 0) {
      classes.push_back(std::string(name.name));
    }
  }
  result["classes"] = std::move(classes);
  result["areas"] = areas_at(map, place.point);
  result["obstacles"] = obstacles_at(map, place.point);
  result["visibility"] = number_or_null(visibility_share(map.visibility.at(place.cell)), 1e-6);
  result["reference_height_m"] = map.reference_height_m;
  const auto source = folder.empty() ? std::nullopt : read_cell_source(map, folder, place.cell);
  if (source) {
    const Json manifest = parsed(read_map_manifest(folder));
    result["elevation_from"] = elevation_source_of(*source, manifest);
    result["height_from"] = words_of(source->origin);
  }
  return result.dump(2, ' ', false, Json::error_handler_t::replace);
}

std::string place_description_text(const Map& map, const geo::GeodeticPosition& position,
                                   const std::filesystem::path& folder) {
  const Json place = Json::parse(place_description_json(map, position, folder));
  std::ostringstream text;
  const auto line = [&](const char* what, const std::string& value) {
    text << std::left << std::setw(24) << what << value << "\n";
  };
  const auto metres = [&](const char* key) {
    std::ostringstream value;
    if (!place[key].is_number()) {
      return std::string("unknown");
    }
    value << std::fixed << std::setprecision(1) << place[key].get<double>() << " m";
    return value.str();
  };
  line("place", place["latitude_deg"].dump() + "," + place["longitude_deg"].dump());
  line("on the map", place["x_m"].dump() + " m east, " + place["y_m"].dump() + " m north");
  line("terrain", metres("terrain_m"));
  line("surface",
       metres("surface_m") + " (" + metres("surface_above_terrain_m") + " above the terrain)");
  if (place.contains("elevation_from")) {
    line("elevation from", place["elevation_from"].get<std::string>());
    line("height from", place["height_from"].get<std::string>());
  }
  std::string classes;
  for (const Json& name : place["classes"]) {
    classes += (classes.empty() ? "" : ", ") + name.get<std::string>();
  }
  line("land use", classes.empty() ? "none" : classes);
  for (const Json& area : place["areas"]) {
    line("area", area_text(area));
  }
  for (const Json& obstacle : place["obstacles"]) {
    const std::string name = obstacle["name"].get<std::string>();
    line("obstacle", obstacle["kind"].get<std::string>() + (name.empty() ? "" : " " + name) +
                         ", up to " + obstacle["height_m"].dump() + " m above the terrain within " +
                         obstacle["radius_m"].dump() + " m");
  }
  line("visibility", place["visibility"].is_number()
                         ? percent(place["visibility"]) + " of the surroundings see a point " +
                               place["reference_height_m"].dump() + " m above the surface"
                         : "unknown");
  return text.str();
}

}  // namespace hedgehop::map
