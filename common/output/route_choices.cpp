#include "output/route_choices.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "geo/map_projection.hpp"
#include "output/json_document.hpp"
#include "output/rounding.hpp"
#include "output/route_cost_json.hpp"

namespace hedgehop::output {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Field = JsonDocument::Field;

constexpr char kSchemaName[] = "hedgehop alternatives";
constexpr std::int64_t kSchemaVersion = 1;
constexpr std::size_t kRoutesMax = 100;
constexpr std::size_t kWaypointsMax = 1'000'000;
constexpr double kPosition_m_max = 1e8;

double share(const Field& field) {
  const double value = field.number();
  if (!(value >= 0.0 && value <= 1.0)) {
    field.refuse("must lie between 0 and 1");
  }
  return value;
}

// Becomes a folder's name.
std::string name_of(const Field& field) {
  std::string name = field.text();
  if (name.empty() || name.size() > 40 || name.front() == '-' ||
      !std::all_of(name.begin(), name.end(), [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
      })) {
    field.refuse("must be a word of small letters, digits, '-' and '_'");
  }
  return name;
}

}  // namespace

std::string route_choices_json(const flight::RouteChoices& choices,
                               const std::vector<FlownChoice>& flown) {
  Json json;
  json["schema"] = kSchemaName;
  json["schema_version"] = kSchemaVersion;
  const flight::RoutePlan& main = choices.routes.front().plan;
  json["request_id"] = main.request_id.hex();
  json["map_hash"] = main.map.hash.hex();
  json["shared_within_m"] = choices.shared_within_m;
  json["shared_share_max"] = choices.shared_share_max;
  json["why_no_more"] = choices.why_no_more.empty() ? Json() : Json(choices.why_no_more);
  json["routes"] = Json::array();
  for (std::size_t i = 0; i < choices.routes.size(); ++i) {
    const flight::RouteChoice& choice = choices.routes[i];
    const flight::Route& route = choice.plan.route;
    const double total_m = route.cost.total_m();
    const bool has_bound = route.lower_bound_m > 0.0 && total_m > 0.0;
    Json one = {
        {"name", choice.name},
        {"length_m", choice.measures.length_m},
        {"visibility_m", choice.measures.visibility_m},
        {"semantics_m", choice.measures.semantics_m},
        {"weights",
         {{"visibility", choice.visibility_weight}, {"semantics", choice.semantics_weight}}},
        {"avoidance", choice.avoidance},
        {"cost", cost_json(route.cost)},
        {"lower_bound_m", has_bound ? Json(route.lower_bound_m) : Json()},
        {"gap", has_bound ? Json((total_m - route.lower_bound_m) / total_m) : Json()}};
    Json shared = Json::object();
    for (std::size_t j = 0; j < choices.routes.size(); ++j) {
      if (j != i) {
        shared[choices.routes[j].name] = choices.shared[i][j];
      }
    }
    one["shared"] = std::move(shared);
    const auto flight = std::find_if(flown.begin(), flown.end(), [i](const FlownChoice& candidate) {
      return candidate.route == i;
    });
    Json flight_json;
    if (flight != flown.end() && flight->plan != nullptr) {
      const flight::Plan& plan = *flight->plan;
      flight_json = {
          {"plan", i == 0 ? std::string(".") : std::string(kChoicesFolder) + "/" + choice.name},
          {"is_verified", plan.verdict.is_verified},
          {"violation_count", plan.verdict.violation_count},
          {"length_m", plan.measures.length_m},
          {"duration_s", plan.measures.duration_s},
          {"visibility_m", plan.measures.visibility_m},
          {"semantics_m", plan.measures.semantics_m},
          {"mean_height_m", plan.measures.mean_height_m},
          {"clearance_min_m", plan.verdict.clearance_min_m}};
    } else if (flight != flown.end() && flight->no_plan != nullptr) {
      flight_json = {{"plan", Json()},
                     {"cause", flight::name_of(flight->no_plan->cause)},
                     {"explanation", flight->no_plan->explanation}};
    }
    one["flown"] = std::move(flight_json);
    Json waypoints = Json::array();
    for (const flight::Waypoint& waypoint : route.waypoints) {
      waypoints.push_back(
          {{"x_m", waypoint.x_m}, {"y_m", waypoint.y_m}, {"altitude_m", waypoint.altitude_m}});
    }
    one["waypoints"] = std::move(waypoints);
    json["routes"].push_back(std::move(one));
  }
  return dumped(json);
}

std::string route_choices_geojson(const flight::RouteChoices& choices) {
  const flight::MapIdentity& map = choices.routes.front().plan.map;
  std::optional<geo::MapProjection> projection;
  if (!map.crs_wkt.empty()) {
    projection.emplace(map.crs_wkt);
  }
  Json features = Json::array();
  for (const flight::RouteChoice& choice : choices.routes) {
    Json line = Json::array();
    for (const flight::Waypoint& waypoint : choice.plan.route.waypoints) {
      if (projection) {
        const geo::GeodeticPosition p = projection->to_geodetic(waypoint.point());
        line.push_back({rounded(degrees_from_radians(p.longitude_rad), 1e8),
                        rounded(degrees_from_radians(p.latitude_rad), 1e8),
                        rounded(waypoint.altitude_m, 1e3)});
      }
    }
    features.push_back(
        {{"type", "Feature"},
         {"geometry",
          projection ? Json{{"type", "LineString"}, {"coordinates", std::move(line)}} : Json()},
         {"properties",
          {{"name", choice.name},
           {"length_m", choice.measures.length_m},
           {"visibility_m", choice.measures.visibility_m},
           {"semantics_m", choice.measures.semantics_m},
           {"label", map.label},
           {"altitude_reference",
            "above mean sea level [m], vertical datum " + map.vertical_datum}}}});
  }
  Json json;
  json["type"] = "FeatureCollection";
  json["label"] = map.label;
  json["attributions"] = map.attributions;
  json["request_id"] = choices.routes.front().plan.request_id.hex();
  json["features"] = std::move(features);
  return dumped(json);
}

std::optional<RouteList> read_route_choices(const fs::path& plan_folder) {
  const fs::path file = plan_folder / kChoicesFile;
  std::error_code error;
  if (!fs::exists(file, error)) {
    return std::nullopt;
  }
  const JsonDocument document(read_file(file), file.string());
  const Field root = document.root();
  if (root.at("schema").text() != kSchemaName) {
    root.at("schema").refuse(std::string("must be '") + kSchemaName + "'");
  }
  const std::int64_t version = root.at("schema_version").integer(0, 1'000'000);
  if (version != kSchemaVersion) {
    root.at("schema_version")
        .refuse("is " + std::to_string(version) + ", this program reads " +
                std::to_string(kSchemaVersion));
  }
  RouteList list;
  try {
    list.request_id = hash128_from_hex(root.at("request_id").text());
  } catch (const std::invalid_argument&) {
    root.at("request_id").refuse("must be 32 hexadecimal digits");
  }
  const Field why = root.at("why_no_more");
  list.why_no_more = why.is_null() ? "" : why.text();
  const std::vector<Field> routes = root.at("routes").entries(kRoutesMax);
  std::vector<std::string> names;
  for (const Field& entry : routes) {
    names.push_back(name_of(entry.at("name")));
  }
  for (std::size_t i = 0; i < routes.size(); ++i) {
    const Field& entry = routes[i];
    ListedRoute route;
    route.name = names[i];
    if (std::count(names.begin(), names.end(), route.name) > 1) {
      entry.at("name").refuse("names a route a second time");
    }
    route.measures = {entry.at("length_m").number(), entry.at("visibility_m").number_or_nan(),
                      entry.at("semantics_m").number_or_nan()};
    route.cost_m = entry.at("cost").at("total_m").number_or_nan();
    const Field shared = entry.at("shared");
    for (std::size_t j = 0; j < names.size(); ++j) {
      if (j != i) {
        route.shared_share = std::max(route.shared_share, share(shared.at(names[j].c_str())));
      }
    }
    const Field flown = entry.at("flown");
    route.is_flown = !flown.is_null() && !flown.at("plan").is_null();
    for (const Field& waypoint : entry.at("waypoints").entries(kWaypointsMax)) {
      route.waypoints.push_back({waypoint.at("x_m").number_within(kPosition_m_max),
                                 waypoint.at("y_m").number_within(kPosition_m_max),
                                 waypoint.at("altitude_m").number_within(kPosition_m_max)});
    }
    if (route.waypoints.size() < 2) {
      entry.at("waypoints").refuse("must have at least 2 entries");
    }
    list.routes.push_back(std::move(route));
  }
  return list;
}

}  // namespace hedgehop::output
