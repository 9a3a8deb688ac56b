#include "map_sources/mission_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cpl_json.h>
#include <numbers>
#include <ogrsf_frmts.h>

#include "base/angles.hpp"
#include "base/config_reader.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "base/utc_time.hpp"
#include "map_sources/gdal_access.hpp"
#include "map_sources/text_in_files.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;
using Reference = MissionPoint::Reference;

constexpr std::uintmax_t kBytesMax = 16U << 20U;
constexpr double kHeight_m_max = 20'000.0;
constexpr double kSpeed_mps_max = 1000.0;
constexpr double kFenceRadius_m_max = 200'000.0;
constexpr char kKinds[] =
    "a mission is YAML (.yaml), GeoJSON (.geojson), KML (.kml, .kmz), GPX (.gpx), a plan of "
    "QGroundControl (.plan) or QGC WPL 110 (.waypoints)";

std::string number_text(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.10g", value);
  return text;
}

[[noreturn]] void refuse(const std::string& where, const std::string& why,
                         const std::string& what_to_do) {
  throw UsageError(where + " " + why, what_to_do);
}

// Places in degrees, from wherever.
geo::GeodeticPosition position_of(double latitude_deg, double longitude_deg,
                                  const std::string& where) {
  if (!(std::fabs(latitude_deg) <= 90.0) || !(std::fabs(longitude_deg) <= 180.0)) {
    throw DataError(where + " lies at latitude " + number_text(latitude_deg) + ", longitude " +
                        number_text(longitude_deg) + ", which is no place in degrees",
                    "correct it");
  }
  return {radians_from_degrees(latitude_deg), radians_from_degrees(longitude_deg)};
}

double checked_height(double height_m, const std::string& where) {
  if (!(std::fabs(height_m) <= kHeight_m_max)) {
    throw DataError(where + " has the height " + number_text(height_m) + " m", "correct it");
  }
  return height_m;
}

double checked_speed(double speed_mps, const std::string& where) {
  if (!(speed_mps > 0.0) || speed_mps > kSpeed_mps_max) {
    throw DataError(where + " has the speed " + number_text(speed_mps) + " m/s", "correct it");
  }
  return speed_mps;
}

// The ends and what lies between.
Mission mission_from(std::vector<MissionPoint> points, const fs::path& file) {
  if (points.size() < 2) {
    refuse(file.string(),
           "holds " + std::to_string(points.size()) + " point" + (points.size() == 1 ? "" : "s") +
               ", a mission has a start and a goal",
           "add what is missing");
  }
  if (points.size() > kMissionPointsMax) {
    refuse(file.string(),
           "holds " + std::to_string(points.size()) + " points, at most " +
               std::to_string(kMissionPointsMax) + " are planned",
           "keep start, goal and the few places to pass; how to fly between them is what is "
           "planned");
  }
  Mission mission;
  mission.start = points.front();
  mission.goal = points.back();
  mission.via.assign(points.begin() + 1, points.end() - 1);
  return mission;
}

// ---- YAML

constexpr char kNoTime[] =
    "must be a time as ISO 8601 writes it, with its zone: 2026-05-01T06:30:00Z for example";
constexpr char kNoHeading[] =
    "cannot be kept: only the start has a heading; leave it out, or add a via point that makes the "
    "flight arrive from that side";

MissionPoint yaml_point(ConfigReader& reader) {
  MissionPoint point;
  point.place = reader.file_and_line();
  const double latitude_rad = reader.required_angle("latitude_deg");
  const double longitude_rad = reader.required_angle("longitude_deg");
  reader.require(std::fabs(latitude_rad) <= 0.5 * std::numbers::pi, "latitude_deg",
                 "must lie in [-90, 90]");
  reader.require(std::fabs(longitude_rad) <= std::numbers::pi, "longitude_deg",
                 "must lie in [-180, 180]");
  point.position = {latitude_rad, longitude_rad};
  const auto height = [&](const char* key, Reference reference) {
    point.height_m = reader.required_double(key);
    point.reference = reference;
    reader.require(std::fabs(*point.height_m) <= kHeight_m_max, key, "is no height to fly at");
  };
  if (reader.has("height_m")) {
    height("height_m", Reference::kSurface);
  }
  if (reader.has("altitude_m")) {
    if (point.height_m) {
      reader.refuse("altitude_m", "stands beside height_m; give one of them");
    }
    height("altitude_m", Reference::kMapDatum);
  }
  if (reader.has("heading_true_deg")) {
    point.heading_true_rad = wrap_to_two_pi(reader.required_angle("heading_true_deg"));
  }
  if (reader.has("time")) {
    point.time = parse_utc(reader.required_string("time"));
    reader.require(point.time.has_value(), "time", kNoTime);
  }
  for (const char* key : {"speed_mps", "hold_s"}) {
    if (reader.has(key)) {
      reader.refuse(key,
                    "cannot be kept at one place: a flight has one speed_mps, at the top of the "
                    "file, and does not wait");
    }
  }
  reader.finish();
  return point;
}

Mission read_yaml(const fs::path& file) {
  Mission mission;
  ConfigReader reader = ConfigReader::from_text(read_file(file), file.string());
  ConfigReader start = reader.required_section("start");
  mission.start = yaml_point(start);
  if (reader.has("via")) {
    for (ConfigReader& via : reader.required_sections("via")) {
      mission.via.push_back(yaml_point(via));
    }
    reader.require(mission.via.size() + 2 <= kMissionPointsMax, "via",
                   "has more entries than are planned");
  }
  ConfigReader goal = reader.required_section("goal");
  mission.goal = yaml_point(goal);
  if (reader.has("speed_mps")) {
    mission.speed_mps = reader.required_double("speed_mps");
    reader.require(*mission.speed_mps > 0.0 && *mission.speed_mps <= kSpeed_mps_max, "speed_mps",
                   "must be a speed above 0");
  }
  if (reader.has("time_tolerance_s")) {
    mission.time_tolerance_s = reader.required_double("time_tolerance_s");
    reader.require(mission.time_tolerance_s >= 0.5 && mission.time_tolerance_s <= 3600.0,
                   "time_tolerance_s", "must lie between 0.5 and 3600");
  }
  if (reader.has("areas")) {
    for (const std::string& name : reader.required_strings("areas")) {
      mission.areas.push_back({file.parent_path() / name});
    }
  }
  reader.finish();
  return mission;
}

// ---- GeoJSON, KML, GPX

DatasetPointer opened(const fs::path& file, const char* const* drivers,
                      const char* const* options = nullptr) {
  GDALAllRegister();
  const GdalErrors errors;
  // Absolute, because GDAL takes some names for something else than files.
  DatasetPointer dataset(static_cast<GDALDataset*>(GDALOpenEx(
      fs::absolute(file).c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY, drivers, options, nullptr)));
  if (!dataset) {
    throw DataError(file.string() + ": cannot be read as a mission" +
                        (errors.first().empty() ? "" : ": " + errors.first()),
                    kKinds);
  }
  return dataset;
}

// An attribute of a feature by its name in any case; nothing if it is missing or empty.
std::optional<std::string> attribute(const OGRFeature& feature, const char* name) {
  const int index = feature.GetDefnRef()->GetFieldIndex(name);
  if (index < 0 || !feature.IsFieldSetAndNotNull(index)) {
    return std::nullopt;
  }
  std::string text(without_blanks(feature.GetFieldAsString(index)));
  return text.empty() ? std::nullopt : std::optional(text);
}

std::optional<double> number_attribute(const OGRFeature& feature, const char* name,
                                       const std::string& where) {
  const auto text = attribute(feature, name);
  if (!text) {
    return std::nullopt;
  }
  const auto value = number_in(*text);
  if (!value) {
    throw DataError(
        where + ": attribute '" + name + "' is '" + clean_name(*text) + "', which is no number",
        "correct it");
  }
  return value;
}

// Points and lines of a file, before it is known which of them are the mission.
class VectorMission {
 public:
  explicit VectorMission(const fs::path& file) : file_(file) {}

  Mission read(bool is_kml) {
    is_kml_ = is_kml;
    static const char* const kGeoJson[] = {"GeoJSON", nullptr};
    static const char* const kKml[] = {"LIBKML", "KML", nullptr};
    static const char* const kTimesAsText[] = {"DATE_AS_STRING=YES", nullptr};
    const DatasetPointer dataset =
        is_kml ? opened(file_, kKml) : opened(file_, kGeoJson, kTimesAsText);
    {
      const GdalErrors errors;
      for (OGRLayer* layer : dataset->GetLayers()) {
        read_layer(*layer);
      }
      if (!errors.first().empty()) {
        throw DataError(file_.string() + ": " + errors.first(), kKinds);
      }
    }
    if (!lines_.empty() && (lines_.size() > 1 || !points_.empty())) {
      refuse(file_.string(),
             "holds " + std::to_string(lines_.size()) + " line(s) and " +
                 std::to_string(points_.size()) + " point(s), so what is the mission?",
             "keep one line, or points alone");
    }
    Entry ends;
    std::vector<MissionPoint> points;
    if (lines_.empty()) {
      put_roles_in_order();
      for (const Entry& entry : points_) {
        points.push_back(entry.point);
      }
      check_further_points();
      ends = points_.empty() ? Entry{} : points_.front();
    } else {
      points = lines_.front().points;
      ends = lines_.front();
    }
    Mission mission = mission_from(std::move(points), file_);
    mission.speed_mps = ends.speed_mps;
    if (has_polygons_) {
      mission.areas.push_back({file_, true});
    }
    return mission;
  }

 private:
  struct Entry {
    MissionPoint point;                // of a point
    std::vector<MissionPoint> points;  // of a line
    std::string role;
    std::optional<double> speed_mps;
  };

  void read_layer(OGRLayer& layer) {
    const OGRSpatialReference* crs = layer.GetSpatialRef();
    std::unique_ptr<OGRCoordinateTransformation> to_degrees;
    if (crs != nullptr) {
      OGRSpatialReference from(*crs);
      from.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
      to_degrees = transformation(from, wgs84(), file_);
    }
    for (const OGRFeatureUniquePtr& feature : layer) {
      const OGRGeometry* geometry = feature->GetGeometryRef();
      const std::string where =
          file_.string() + ": feature " + std::to_string(features_) + " (counted from 0)";
      ++features_;
      if (geometry == nullptr || geometry->IsEmpty()) {
        continue;
      }
      Entry entry;
      entry.role = role_of(*feature);
      std::optional<double> heading_true_rad;
      if (const auto heading = number_attribute(*feature, "heading_true_deg", where)) {
        heading_true_rad = wrap_to_two_pi(radians_from_degrees(*heading));
      }
      if (const auto speed = number_attribute(*feature, "speed_mps", where)) {
        entry.speed_mps = checked_speed(*speed, where);
      }
      const auto point_at = [&](double x, double y, double z, bool has_z) {
        return placed(*feature, to_degrees.get(), x, y, has_z ? std::optional(z) : std::nullopt,
                      where);
      };
      switch (wkbFlatten(geometry->getGeometryType())) {
        case wkbPoint: {
          const OGRPoint& point = *geometry->toPoint();
          entry.point = point_at(point.getX(), point.getY(), point.getZ(), point.Is3D() != FALSE);
          entry.point.heading_true_rad = heading_true_rad;
          points_.push_back(std::move(entry));
          break;
        }
        case wkbLineString: {
          const OGRLineString& line = *geometry->toLineString();
          for (int i = 0; i < line.getNumPoints(); ++i) {
            entry.points.push_back(
                point_at(line.getX(i), line.getY(i), line.getZ(i), line.Is3D() != FALSE));
            entry.points.back().place = where + ", position " + std::to_string(i);
          }
          if (!entry.points.empty()) {
            entry.points.front().heading_true_rad = heading_true_rad;
          }
          lines_.push_back(std::move(entry));
          break;
        }
        case wkbPolygon:
        case wkbMultiPolygon:
          has_polygons_ = true;
          break;
        default:
          refuse(where,
                 std::string("is a ") + geometry->getGeometryName() +
                     ", a mission consists of points or of one line, and of polygons for areas",
                 "take it out, or make points, a line or polygons of it");
      }
      if (points_.size() > 100 * kMissionPointsMax) {
        (void)mission_from(std::vector<MissionPoint>(points_.size()), file_);
      }
    }
  }

  std::string role_of(const OGRFeature& feature) const {
    for (const char* name : {"role", "name"}) {
      if (const auto text = attribute(feature, name)) {
        const std::string word = lower_case(*text);
        if (word == "start" || word == "goal") {
          return word;
        }
      }
    }
    return "";
  }

  MissionPoint placed(const OGRFeature& feature, OGRCoordinateTransformation* to_degrees, double x,
                      double y, std::optional<double> z, const std::string& where) const {
    if (to_degrees != nullptr && to_degrees->Transform(1, &x, &y) == FALSE) {
      throw DataError(where + " has no place in degrees", "correct its coordinates");
    }
    MissionPoint point;
    point.place = where;
    point.position = position_of(y, x, where);
    if (const auto text = attribute(feature, "time")) {
      point.time = parse_utc(*text);
      if (!point.time) {
        throw DataError(where + ": its time '" + clean_name(*text) + "' cannot be read",
                        std::string("it ") + kNoTime);
      }
    }
    const auto height = number_attribute(feature, "height_m", where);
    const auto altitude = number_attribute(feature, "altitude_m", where);
    if (height && altitude) {
      refuse(where, "has both height_m and altitude_m", "give one of them");
    }
    if (height) {
      point.height_m = checked_height(*height, where);
    } else if (altitude) {
      point.height_m = checked_height(*altitude, where);
      point.reference = Reference::kMapDatum;
    } else if (z && is_kml_) {
      const std::string mode = attribute(feature, "altitudeMode").value_or("clampToGround");
      if (mode == "absolute" || mode == "relativeToGround") {
        point.height_m = checked_height(*z, where);
        point.reference = mode == "absolute" ? Reference::kEgm96 : Reference::kGround;
      }
    } else if (z && *z != 0.0) {  // writers that know no height write 0
      point.height_m = checked_height(*z, where);
      point.reference = Reference::kEllipsoid;
    }
    return point;
  }

  // Start to the front, goal to the end, where points are named so.
  void put_roles_in_order() {
    const auto count = [&](const char* role) {
      return std::count_if(points_.begin(), points_.end(),
                           [&](const Entry& entry) { return entry.role == role; });
    };
    if (count("start") > 1 || count("goal") > 1) {
      refuse(file_.string(), "has more than one start or goal", "keep one of each");
    }
    std::stable_sort(points_.begin(), points_.end(), [](const Entry& a, const Entry& b) {
      const auto rank = [](const Entry& entry) {
        return entry.role == "start" ? 0 : entry.role == "goal" ? 2 : 1;
      };
      return rank(a) < rank(b);
    });
  }

  void check_further_points() const {
    for (std::size_t i = 1; i < points_.size(); ++i) {
      if (points_[i].speed_mps) {
        refuse(points_[i].point.place, "has a speed of its own; a flight has one",
               "give speed_mps to the start alone");
      }
    }
  }

  const fs::path& file_;
  bool is_kml_ = false;
  std::int64_t features_ = 0;
  std::vector<Entry> points_;
  std::vector<Entry> lines_;
  bool has_polygons_ = false;
};

Mission read_gpx(const fs::path& file) {
  static const char* const kGpx[] = {"GPX", nullptr};
  const DatasetPointer dataset = opened(file, kGpx);
  const GdalErrors errors;
  const auto count = [&](const char* name) {
    OGRLayer* layer = dataset->GetLayerByName(name);
    return layer == nullptr ? 0 : layer->GetFeatureCount();
  };
  const auto routes = count("routes");
  const auto waypoints = count("waypoints");
  if (routes > 1) {
    refuse(file.string(), "holds " + std::to_string(routes) + " routes", "keep one");
  }
  if (routes == 0 && waypoints == 0 && count("tracks") > 0) {
    refuse(file.string(), "holds a recorded track, no route",
           "make a route or waypoints of the few places to pass");
  }
  std::vector<MissionPoint> points;
  if (OGRLayer* layer = dataset->GetLayerByName(routes == 1 ? "route_points" : "waypoints")) {
    for (const OGRFeatureUniquePtr& feature : *layer) {
      MissionPoint point;
      point.place = file.string() + (routes == 1 ? ": route point " : ": waypoint ") +
                    std::to_string(points.size());
      const OGRGeometry* geometry = feature->GetGeometryRef();
      if (geometry == nullptr || wkbFlatten(geometry->getGeometryType()) != wkbPoint) {
        throw DataError(point.place + " has no place", "correct it");
      }
      point.position =
          position_of(geometry->toPoint()->getY(), geometry->toPoint()->getX(), point.place);
      if (const auto elevation = number_attribute(*feature, "ele", point.place)) {
        point.height_m = checked_height(*elevation, point.place);
        point.reference = Reference::kEgm96;
      }
      points.push_back(std::move(point));
      if (points.size() > 100 * kMissionPointsMax) {
        break;  // refused below
      }
    }
  }
  if (!errors.first().empty()) {
    throw DataError(file.string() + ": " + errors.first(), kKinds);
  }
  Mission mission = mission_from(std::move(points), file);
  if (routes == 1 && waypoints > 0) {
    mission.remarks.push_back(file.string() + ": its waypoints beside the route are not used");
  }
  return mission;
}

// ---- lists of items for autopilots

/// One item of MAVLink's mission protocol.
struct Item {
  std::string place;
  int command = 0;
  int frame = 0;
  std::array<double, 7> parameters{};  // NaN: not given
};

class ItemMission {
 public:
  ItemMission(const fs::path& file, std::optional<double> home_amsl_m)
      : file_(file), home_amsl_m_(home_amsl_m) {}

  Mission read(const std::vector<Item>& items) {
    for (const Item& item : items) {
      add(item);
    }
    Mission mission = mission_from(std::move(points_), file_);
    mission.speed_mps = speed_mps_;
    mission.remarks = std::move(remarks_);
    return mission;
  }

 private:
  void add(const Item& item) {
    const auto is = [&](std::size_t parameter) {
      const double value = item.parameters[parameter - 1];
      return !std::isnan(value) && value != 0.0;
    };
    switch (item.command) {
      case 16:  // NAV_WAYPOINT
        if (is(1)) {
          refuse(item.place, "waits; a flight of hedgehop goes on", "set its hold time to 0");
        }
        if (is(4)) {
          refuse(item.place, std::string("has a heading, which ") + kNoHeading,
                 "set its yaw to 0 or leave it out");
        }
        refuse_after_landing(item);
        points_.push_back(point_of(item, true));
        break;
      case 22:  // NAV_TAKEOFF
      case 84:  // NAV_VTOL_TAKEOFF
        if (!points_.empty()) {
          refuse(item.place, "takes off in the middle of the mission", "keep one flight in a file");
        }
        // A take-off from where the vehicle stands has no place of its own; the first waypoint then
        // is the start.
        if (has_place(item)) {
          points_.push_back(point_of(item, true));
        }
        remarks_.push_back(item.place +
                           ": the take-off itself is not planned; the flight begins in the air");
        break;
      case 21:  // NAV_LAND
      case 85:  // NAV_VTOL_LAND
        refuse_after_landing(item);
        if (has_place(item)) {
          points_.push_back(point_of(item, false));
        }
        has_landed_ = true;
        remarks_.push_back(item.place +
                           ": the landing itself is not planned; the flight ends in the air");
        break;
      case 178:  // DO_CHANGE_SPEED
        add_speed(item);
        break;
      default:
        refuse(item.place,
               "is the command " + std::to_string(item.command) +
                   ", which is no part of a flight from start to goal",
               "take it out; waypoints (16), take-off (22), landing (21) and one change of speed "
               "(178) are read");
    }
    if (points_.size() > 100 * kMissionPointsMax) {
      (void)mission_from(points_, file_);
    }
  }

  void add_speed(const Item& item) {
    const double speed_mps = item.parameters[1];
    if (std::isnan(speed_mps) || speed_mps <= 0.0) {
      return;  // -1: as it is
    }
    (void)checked_speed(speed_mps, item.place);
    if ((speed_mps_ && *speed_mps_ != speed_mps) || (!speed_mps_ && points_.size() > 1)) {
      refuse(item.place,
             "changes the speed to " + number_text(speed_mps) +
                 " m/s on the way; a flight has one speed",
             "keep one change of speed, before the second waypoint");
    }
    if (item.parameters[0] == 0.0) {
      remarks_.push_back(item.place + ": the airspeed is taken as ground speed");
    }
    speed_mps_ = speed_mps;
  }

  void refuse_after_landing(const Item& item) const {
    if (has_landed_) {
      refuse(item.place, "comes after the landing", "keep one flight in a file");
    }
  }

  static bool has_place(const Item& item) {
    const double latitude_deg = item.parameters[4];
    const double longitude_deg = item.parameters[5];
    return !std::isnan(latitude_deg) && !std::isnan(longitude_deg) &&
           (latitude_deg != 0.0 || longitude_deg != 0.0);
  }

  MissionPoint point_of(const Item& item, bool has_height) const {
    MissionPoint point;
    point.place = item.place;
    point.position = position_of(item.parameters[4], item.parameters[5], item.place);
    if (!has_height) {
      return point;
    }
    const double height_m = checked_height(item.parameters[6], item.place);
    switch (item.frame) {
      case 0:  // MAV_FRAME_GLOBAL and its twin with whole numbers
      case 5:
        point.height_m = height_m;
        point.reference = Reference::kEgm96;
        break;
      case 3:  // MAV_FRAME_GLOBAL_RELATIVE_ALT
      case 6:
        if (!home_amsl_m_) {
          refuse(item.place,
                 "counts its altitude from home, whose altitude the file does not state",
                 "state the altitude of home, or give altitudes above mean sea level");
        }
        point.height_m = *home_amsl_m_ + height_m;
        point.reference = Reference::kEgm96;
        break;
      case 10:  // MAV_FRAME_GLOBAL_TERRAIN_ALT
      case 11:
        point.height_m = height_m;
        point.reference = Reference::kGround;
        break;
      default:
        refuse(item.place, "is in the frame " + std::to_string(item.frame),
               "give places in the frame 0 (above mean sea level), 3 (above home) or 10 (above "
               "ground)");
    }
    return point;
  }

  const fs::path& file_;
  std::optional<double> home_amsl_m_;
  std::vector<MissionPoint> points_;
  std::optional<double> speed_mps_;
  std::vector<std::string> remarks_;
  bool has_landed_ = false;
};

// What a JSON object holds under a name; throws DataError if it is missing or of another kind.
CPLJSONObject member(const CPLJSONObject& object, const std::string& name, const std::string& where,
                     std::initializer_list<CPLJSONObject::Type> types) {
  CPLJSONObject value = object.GetObj(name);
  if (!value.IsValid() || std::find(types.begin(), types.end(), value.GetType()) == types.end()) {
    throw DataError(where + ": '" + name + "' is missing or of the wrong kind",
                    "write the plan again with QGroundControl");
  }
  return value;
}

bool is_filled(const CPLJSONObject& object, const std::string& name) {
  const CPLJSONObject value = object.GetObj(name);
  return value.IsValid() && value.GetType() == CPLJSONObject::Type::Array &&
         value.ToArray().Size() > 0;
}

// A position of QGroundControl: latitude, longitude.
geo::GeodeticPosition qgc_position(const CPLJSONObject& value, const std::string& where) {
  const auto is_number = [](const CPLJSONObject& number) {
    return number.GetType() == CPLJSONObject::Type::Integer ||
           number.GetType() == CPLJSONObject::Type::Long ||
           number.GetType() == CPLJSONObject::Type::Double;
  };
  if (value.GetType() == CPLJSONObject::Type::Array) {
    const CPLJSONArray numbers = value.ToArray();
    if (numbers.Size() == 2 && is_number(numbers[0]) && is_number(numbers[1])) {
      return position_of(numbers[0].ToDouble(), numbers[1].ToDouble(), where);
    }
  }
  throw DataError(where + " has a corner that is no latitude and longitude",
                  "write the plan again with QGroundControl");
}

std::vector<Fence> fences_of(const CPLJSONObject& all, const std::string& where) {
  using Type = CPLJSONObject::Type;
  std::vector<Fence> fences;
  const auto inclusion_of = [](const CPLJSONObject& entry, const std::string& place) {
    return member(entry, "inclusion", place, {Type::Boolean}).ToBool();
  };
  if (is_filled(all, "polygons")) {
    for (const CPLJSONObject& entry : all.GetArray("polygons")) {
      Fence fence;
      fence.place = where + ": fence " + std::to_string(fences.size());
      fence.is_inclusion = inclusion_of(entry, fence.place);
      const CPLJSONArray corners = member(entry, "polygon", fence.place, {Type::Array}).ToArray();
      for (const CPLJSONObject& corner : corners) {
        fence.outline.push_back(qgc_position(corner, fence.place));
      }
      fences.push_back(std::move(fence));
    }
  }
  if (is_filled(all, "circles")) {
    for (const CPLJSONObject& entry : all.GetArray("circles")) {
      const std::string place = where + ": fence " + std::to_string(fences.size());
      const bool is_inclusion = inclusion_of(entry, place);
      const CPLJSONObject circle = member(entry, "circle", place, {Type::Object});
      const double radius_m =
          member(circle, "radius", place, {Type::Integer, Type::Long, Type::Double}).ToDouble();
      if (!(radius_m > 0.0 && radius_m <= kFenceRadius_m_max)) {
        throw DataError(place + " has the radius " + number_text(radius_m) + " m", "correct it");
      }
      fences.push_back(
          circle_fence(qgc_position(member(circle, "center", place, {Type::Array}), place),
                       radius_m, is_inclusion, place));
    }
  }
  return fences;
}

Mission read_plan(const fs::path& file) {
  using Type = CPLJSONObject::Type;
  const std::string where = file.string();
  CPLJSONDocument document;
  {
    const GdalErrors errors;
    if (!document.LoadMemory(read_file(file))) {
      throw DataError(where + ": is no JSON: " + errors.first(), kKinds);
    }
  }
  const CPLJSONObject root = document.GetRoot();
  if (root.GetType() != Type::Object || root.GetString("fileType") != "Plan") {
    throw DataError(where + ": is no plan of QGroundControl", kKinds);
  }
  std::vector<Fence> fences;
  if (const CPLJSONObject all = root.GetObj("geoFence");
      all.IsValid() && all.GetType() == Type::Object) {
    fences = fences_of(all, where);
  }
  const CPLJSONObject mission = member(root, "mission", where, {Type::Object});
  std::optional<double> home_amsl_m;
  const CPLJSONObject home = mission.GetObj("plannedHomePosition");
  if (home.IsValid() && home.GetType() == Type::Array && home.ToArray().Size() == 3 &&
      home.ToArray()[2].GetType() != Type::Null) {
    home_amsl_m = home.ToArray()[2].ToDouble();
  }
  std::vector<Item> items;
  const CPLJSONArray list = member(mission, "items", where, {Type::Array}).ToArray();
  for (int i = 0; i < list.Size(); ++i) {
    const CPLJSONObject entry = list[i];
    Item item;
    item.place = where + ": item " + std::to_string(i + 1);
    if (entry.GetType() != Type::Object) {
      throw DataError(item.place + " is no object", "write the plan again with QGroundControl");
    }
    if (entry.GetString("type") != "SimpleItem") {
      refuse(item.place,
             "is a pattern ('" + clean_name(entry.GetString("complexItemType", "complex"), 40) +
                 "'), not a waypoint",
             "take it out; hedgehop plans the way between places");
    }
    item.command = member(entry, "command", item.place, {Type::Integer}).ToInteger();
    item.frame = member(entry, "frame", item.place, {Type::Integer}).ToInteger();
    const CPLJSONArray parameters = member(entry, "params", item.place, {Type::Array}).ToArray();
    if (parameters.Size() != 7) {
      throw DataError(item.place + " has not 7 params", "write the plan again with QGroundControl");
    }
    for (int k = 0; k < 7; ++k) {
      const CPLJSONObject value = parameters[k];
      const bool is_number = value.GetType() == Type::Integer || value.GetType() == Type::Long ||
                             value.GetType() == Type::Double;
      if (!is_number && value.GetType() != Type::Null) {
        throw DataError(item.place + ": param " + std::to_string(k + 1) + " is no number",
                        "write the plan again with QGroundControl");
      }
      item.parameters[static_cast<std::size_t>(k)] = is_number ? value.ToDouble() : std::nan("");
    }
    items.push_back(std::move(item));
  }
  Mission read = ItemMission(file, home_amsl_m).read(items);
  read.fences = std::move(fences);
  const CPLJSONObject rally = root.GetObj("rallyPoints");
  if (rally.IsValid() && rally.GetType() == Type::Object && is_filled(rally, "points")) {
    read.remarks.push_back(where + ": its rally points are not used");
  }
  return read;
}

Mission read_waypoints(const fs::path& file) {
  const std::string text = read_file(file);
  std::string_view rest = without_mark(text);
  if (without_blanks(take_line(rest)) != "QGC WPL 110") {
    throw DataError(file.string() + ":1: the first line must be 'QGC WPL 110'", kKinds);
  }
  std::vector<Item> items;
  std::optional<double> home_amsl_m;
  for (int line_number = 2; !rest.empty(); ++line_number) {
    std::string_view line = without_blanks(take_line(rest));
    if (line.empty()) {
      continue;
    }
    const std::string where = file.string() + ":" + std::to_string(line_number) + ":";
    std::vector<double> columns;
    while (!line.empty()) {
      const std::size_t end = std::min(line.find_first_of("\t "), line.size());
      const auto value = number_in(line.substr(0, end));
      if (!value) {
        throw DataError(where + " '" + clean_name(line.substr(0, end), 40) + "' is no number",
                        "correct the line");
      }
      columns.push_back(*value);
      line = without_blanks(line.substr(end));
    }
    if (columns.size() != 12) {
      throw DataError(where + " has " + std::to_string(columns.size()) + " columns, not 12",
                      "correct the line");
    }
    if (items.empty() && !home_amsl_m) {
      home_amsl_m = columns[10];  // the first line is home
      continue;
    }
    const auto whole = [&](double value) {
      if (!(value >= 0.0 && value <= 65535.0) || value != std::floor(value)) {
        throw DataError(where + " frame and command must be whole numbers", "correct the line");
      }
      return static_cast<int>(value);
    };
    Item item;
    item.place = where + " this item";
    item.frame = whole(columns[2]);
    item.command = whole(columns[3]);
    std::copy_n(columns.begin() + 4, 7, item.parameters.begin());
    items.push_back(std::move(item));
  }
  return ItemMission(file, home_amsl_m).read(items);
}

Mission mission_in(const fs::path& file) {
  std::error_code error;
  if (!fs::is_regular_file(file, error)) {
    throw DataError(file.string() + ": no such file", "check the path given with --mission");
  }
  if (fs::file_size(file, error) > kBytesMax || error) {
    throw DataError(file.string() + ": is too large for a mission", kKinds);
  }
  const std::string extension = lower_case(file.extension().string());
  if (extension == ".yaml" || extension == ".yml") {
    return read_yaml(file);
  }
  if (extension == ".geojson" || extension == ".json") {
    return VectorMission(file).read(false);
  }
  if (extension == ".kml" || extension == ".kmz") {
    return VectorMission(file).read(true);
  }
  if (extension == ".gpx") {
    return read_gpx(file);
  }
  if (extension == ".plan") {
    return read_plan(file);
  }
  if (extension == ".waypoints") {
    return read_waypoints(file);
  }
  throw DataError(file.string() + ": a mission cannot be read from files of this kind", kKinds);
}

// A place in line before another one.
geo::GeodeticPosition before(const geo::GeodeticPosition& place, double heading_true_rad,
                             double distance_m) {
  return around(place).to_geodetic({-distance_m * elementary::sin(heading_true_rad),
                                    -distance_m * elementary::cos(heading_true_rad)});
}

// Headings of all places but the start become places to pass.
void lead_to_headings(Mission& mission) {
  std::vector<MissionPoint> via;
  const auto lead = [&](MissionPoint& point) {
    if (!point.heading_true_rad) {
      return;
    }
    // A flight that comes from elsewhere turns at the farther one, and is in line at the nearer
    // one.
    for (const double distance_m : {2.0 * kApproach_m, kApproach_m}) {
      MissionPoint approach;
      approach.position = before(point.position, *point.heading_true_rad, distance_m);
      approach.place = point.place + " (before it)";
      via.push_back(approach);
    }
    mission.remarks.push_back(
        point.place + ": the heading of " +
        number_text(std::round(degrees_from_radians(*point.heading_true_rad))) +
        " degrees leads the flight by way of two places before it, in line, the nearer one at " +
        number_text(kApproach_m) + " m");
    point.heading_true_rad.reset();
  };
  for (MissionPoint& point : mission.via) {
    lead(point);
    via.push_back(point);
  }
  lead(mission.goal);
  mission.via = std::move(via);
}

}  // namespace

Mission read_mission(const fs::path& file) {
  Mission mission = mission_in(file);
  lead_to_headings(mission);
  return mission;
}

}  // namespace hedgehop::map_sources
