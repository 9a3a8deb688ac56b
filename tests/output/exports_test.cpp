// Each format read back by another reader than its writer: GDAL, a JSON parser, columns as
// documented.
#include "output/exports.hpp"

#include <cmath>
#include <cpl_vsi.h>
#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>
#include <nlohmann/json.hpp>
#include <ogrsf_frmts.h>
#include <sstream>

#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "base/utc_time.hpp"
#include "map/map_bundle.hpp"
#include "output/sample_plan.hpp"
#include "output/trajectory_columns.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::output {
namespace {

using testing::HasSubstr;
using Json = nlohmann::json;

const map::Map& sample_map() {
  static const map::Map map = [] {
    map::Map made = test::make_sample_map();
    made.further_visibility.push_back({30.0, made.visibility});
    made.surface_m.at(2, 2) = std::nanf("");
    test::finish_map(made);
    return made;
  }();
  return map;
}

const flight::Plan& sample() {
  static const flight::Plan plan = [] {
    flight::Plan made = test::make_sample_plan(sample_map());
    made.route_plan.map.label = "A <label> & \"more\" \xff";  // no valid UTF-8
    return made;
  }();
  return plan;
}

ExportOptions shipped_options() {
  ConfigReader reader = ConfigReader::from_text(shipped_config("export.yaml"), "export.yaml");
  return read_export_options(reader);
}

constexpr char kStart[] = "2026-05-01T06:30:00Z";
constexpr double kClearance_m = 11.5;

/// The sample flight is made to keep away from the ground, not from the wire.
const map::Map& map_without_wires() {
  static const map::Map map = [] {
    map::Map made = sample_map();
    made.overhead_lines.clear();
    test::finish_map(made);
    return made;
  }();
  return map;
}

ExportedFile exported(ExportFormat format, const flight::Plan& plan = sample(),
                      const std::filesystem::path& map_folder = {}) {
  ExportRequest request;
  request.start_time = parse_utc(kStart);
  request.map = &map_without_wires();
  request.map_folder = map_folder;
  request.clearance_m = kClearance_m;
  return export_plan(plan, format, request, shipped_options());
}

/// From the map's frame with heights above mean sea level to the ellipsoid and the earth's axes, by
/// GDAL.
class Oracle {
 public:
  Oracle() {
    map_.SetFromUserInput("EPSG:32632+5773");
    amsl_.SetFromUserInput("EPSG:4326+5773");
    ellipsoid_.importFromEPSG(4979);
    earth_.importFromEPSG(4978);
    for (OGRSpatialReference* reference : {&map_, &amsl_, &ellipsoid_, &earth_}) {
      reference->SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    }
    OGRCoordinateTransformationOptions options;
    options.SetBallparkAllowed(false);
    from_amsl_.reset(OGRCreateCoordinateTransformation(&amsl_, &map_, options));
    from_ellipsoid_.reset(OGRCreateCoordinateTransformation(&ellipsoid_, &map_, options));
    to_earth_.reset(OGRCreateCoordinateTransformation(&map_, &earth_, options));
  }
  struct Place {
    double x_m, y_m, altitude_m;
  };
  Place from_amsl(double longitude_deg, double latitude_deg, double height_m) const {
    EXPECT_TRUE(from_amsl_->Transform(1, &longitude_deg, &latitude_deg, &height_m));
    return {longitude_deg, latitude_deg, height_m};
  }
  Place from_ellipsoid(double longitude_deg, double latitude_deg, double height_m) const {
    EXPECT_TRUE(from_ellipsoid_->Transform(1, &longitude_deg, &latitude_deg, &height_m));
    return {longitude_deg, latitude_deg, height_m};
  }
  std::array<double, 3> on_earth(double x_m, double y_m, double altitude_m) const {
    EXPECT_TRUE(to_earth_->Transform(1, &x_m, &y_m, &altitude_m));
    return {x_m, y_m, altitude_m};
  }

 private:
  OGRSpatialReference map_, amsl_, ellipsoid_, earth_;
  std::unique_ptr<OGRCoordinateTransformation> from_amsl_, from_ellipsoid_, to_earth_;
};

const Oracle& oracle() {
  static const Oracle made;
  return made;
}

template <typename Point>
void expect_there(const Oracle::Place& place, const Point& wanted) {
  EXPECT_NEAR(place.x_m, wanted.x_m, 0.002);
  EXPECT_NEAR(place.y_m, wanted.y_m, 0.002);
  EXPECT_NEAR(place.altitude_m, wanted.altitude_m, 0.003);
}

/// The state of a whole second, as positions of a track are a second apart; the last one may not
/// be.
const flight::FlightState& state_of(std::size_t second) {
  const auto& states = sample().trajectory.states;
  return states[std::min(20 * second, states.size() - 1)];
}
std::size_t track_size() { return (sample().trajectory.states.size() - 2) / 20 + 2; }

/// A file of GDAL's in memory.
class GdalFile {
 public:
  GdalFile(const std::string& content, const std::string& name)
      : content_(content), path_("/vsimem/exports_test_" + name) {
    GDALAllRegister();
    VSIFCloseL(VSIFileFromMemBuffer(path_.c_str(), reinterpret_cast<GByte*>(content_.data()),
                                    content_.size(), FALSE));
    dataset_.reset(GDALDataset::Open(path_.c_str(), GDAL_OF_VECTOR, nullptr, nullptr, nullptr));
    EXPECT_NE(dataset_, nullptr) << name;
  }
  ~GdalFile() {
    dataset_.reset();
    VSIUnlink(path_.c_str());
  }
  GdalFile(const GdalFile&) = delete;
  GdalFile& operator=(const GdalFile&) = delete;
  [[nodiscard]] GDALDataset& dataset() const { return *dataset_; }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] OGRLayer& layer(const char* name) const {
    OGRLayer* layer = dataset_->GetLayerByName(name);
    if (layer == nullptr) {
      throw std::runtime_error(std::string("no layer ") + name);
    }
    return *layer;
  }

 private:
  std::string content_;
  std::string path_;
  std::unique_ptr<GDALDataset> dataset_;
};

OGRFeatureUniquePtr named_feature(OGRLayer& layer, const std::string& name) {
  for (auto& feature : layer) {
    if (feature->GetFieldAsString("Name") == name) {
      return std::move(feature);
    }
  }
  ADD_FAILURE() << "no feature " << name;
  return nullptr;
}

void expect_track(const OGRGeometry& geometry, bool is_amsl) {
  const OGRLineString& line = *geometry.toLineString();
  ASSERT_EQ(static_cast<std::size_t>(line.getNumPoints()), track_size());
  for (int i = 0; i < line.getNumPoints(); ++i) {
    const double x = line.getX(i);
    const double y = line.getY(i);
    const double z = line.getZ(i);
    expect_there(is_amsl ? oracle().from_amsl(x, y, z) : oracle().from_ellipsoid(x, y, z),
                 state_of(static_cast<std::size_t>(i)));
  }
}

void expect_route(const OGRGeometry& geometry, bool is_amsl) {
  const OGRLineString& line = *geometry.toLineString();
  const auto& waypoints = sample().route_plan.route.waypoints;
  ASSERT_EQ(static_cast<std::size_t>(line.getNumPoints()), waypoints.size());
  for (int i = 0; i < line.getNumPoints(); ++i) {
    const double x = line.getX(i);
    const double y = line.getY(i);
    const double z = line.getZ(i);
    expect_there(is_amsl ? oracle().from_amsl(x, y, z) : oracle().from_ellipsoid(x, y, z),
                 waypoints[static_cast<std::size_t>(i)]);
  }
}

void expect_kml(const GdalFile& file) {
  OGRLayer& layer = file.layer("hedgehop flight");
  const auto flown = named_feature(layer, "Flight");
  EXPECT_STREQ(flown->GetFieldAsString("altitudeMode"), "absolute");
  EXPECT_EQ(flown->GetFieldAsInteger("extrude"), 1);
  expect_track(*flown->GetGeometryRef(), true);
  expect_route(*named_feature(layer, "Planned route")->GetGeometryRef(), true);
  const auto timed = named_feature(layer, "Flight over time");
  expect_track(*timed->GetGeometryRef(), true);
  EXPECT_STREQ(timed->GetFieldAsString("begin"), "2026/05/01 06:30:00+00");
  const auto start = named_feature(layer, "Start");
  EXPECT_STREQ(start->GetFieldAsString("timestamp"), "2026/05/01 06:30:00+00");
  EXPECT_EQ(static_cast<std::size_t>(file.layer("Waypoints of the route").GetFeatureCount()),
            sample().route_plan.route.waypoints.size());
}

TEST(Exports, KmlHoldsExtrudedPathAndTimedTrackAboveMeanSeaLevel) {
  const ExportedFile file = exported(ExportFormat::kKml);
  expect_kml(GdalFile(file.content, "flight.kml"));
  EXPECT_THAT(file.content, HasSubstr("A &lt;label&gt; &amp; &quot;more&quot; ?;"));
  EXPECT_THAT(file.content, HasSubstr("NOT VERIFIED"));
  // One time, one place, one attitude for each second.
  const auto count = [&](const std::string& tag) {
    std::size_t found = 0;
    for (std::size_t at = 0; (at = file.content.find(tag, at)) != std::string::npos; ++at) {
      ++found;
    }
    return found;
  };
  EXPECT_EQ(count("<gx:coord>"), track_size());
  EXPECT_EQ(count("<gx:angles>"), track_size());
  EXPECT_EQ(count("<when>"), track_size() + 2);
}

TEST(Exports, KmzIsTheKmlInAnArchive) {
  expect_kml(GdalFile(exported(ExportFormat::kKmz).content, "flight.kmz"));
}

TEST(Exports, GpxHoldsRouteAndTrackWithElevationAndTime) {
  const ExportedFile exported_file = exported(ExportFormat::kGpx);
  const GdalFile file(exported_file.content, "flight.gpx");
  std::size_t i = 0;
  for (const auto& feature : file.layer("track_points")) {
    const OGRPoint& point = *feature->GetGeometryRef()->toPoint();
    expect_there(oracle().from_amsl(point.getX(), point.getY(), feature->GetFieldAsDouble("ele")),
                 state_of(i));
    if (i == 61) {
      EXPECT_STREQ(feature->GetFieldAsString("time"), "2026/05/01 06:31:01+00");
    }
    ++i;
  }
  EXPECT_EQ(i, track_size());
  i = 0;
  for (const auto& feature : file.layer("route_points")) {
    const OGRPoint& point = *feature->GetGeometryRef()->toPoint();
    expect_there(oracle().from_amsl(point.getX(), point.getY(), feature->GetFieldAsDouble("ele")),
                 sample().route_plan.route.waypoints[i]);
    ++i;
  }
  EXPECT_EQ(i, sample().route_plan.route.waypoints.size());
}

TEST(Exports, WithoutAStartTimeKmlAndGpxHoldNoTimes) {
  ExportRequest request;
  const ExportOptions options = shipped_options();
  for (const ExportFormat format : {ExportFormat::kKml, ExportFormat::kGpx}) {
    const std::string text = export_plan(sample(), format, request, options).content;
    EXPECT_THAT(text, testing::Not(HasSubstr("<when>")));
    EXPECT_THAT(text, testing::Not(HasSubstr("<time>")));
  }
}

TEST(Exports, GeoJsonHasHeightsAboveTheEllipsoidAndNoCoordinateSystemOfItsOwn) {
  const ExportedFile exported_file = exported(ExportFormat::kGeoJson);
  const Json json = Json::parse(exported_file.content);
  EXPECT_EQ(json["type"], "FeatureCollection");
  EXPECT_FALSE(json.contains("crs"));  // RFC 7946, section 4
  const GdalFile file(exported_file.content, "flight.geojson");
  OGRLayer& layer = *file.dataset().GetLayer(0);
  std::size_t waypoints = 0;
  for (const auto& feature : layer) {
    const std::string kind = feature->GetFieldAsString("kind");
    if (kind == "flight") {
      expect_track(*feature->GetGeometryRef(), false);
    } else if (kind == "route") {
      expect_route(*feature->GetGeometryRef(), false);
    } else {
      EXPECT_EQ(kind, "waypoint");
      ++waypoints;
    }
  }
  EXPECT_EQ(waypoints, sample().route_plan.route.waypoints.size());
  const Json& flown = json["features"][1];
  EXPECT_EQ(flown["properties"]["times_s"].size(), track_size());
  EXPECT_EQ(flown["properties"]["coordTimes"][61], "2026-05-01T06:31:01.000Z");
  // The geoid lies 46 to 48 m above the ellipsoid in the north of Bavaria.
  const double above_m = flown["geometry"]["coordinates"][0][2].get<double>() -
                         sample().trajectory.states[0].altitude_m;
  EXPECT_GT(above_m, 44.0);
  EXPECT_LT(above_m, 49.0);
}

TEST(Exports, GeoPackageHoldsEveryNumberOfTheStatesAndSaysItsVerticalDatum) {
  const ExportedFile exported_file = exported(ExportFormat::kGpkg);
  const GdalFile file(exported_file.content, "flight.gpkg");
  OGRLayer& trajectory = file.layer("trajectory");
  const auto& states = sample().trajectory.states;
  ASSERT_EQ(static_cast<std::size_t>(trajectory.GetFeatureCount()), states.size());
  std::size_t i = 0;
  for (const auto& feature : trajectory) {
    const OGRPoint& point = *feature->GetGeometryRef()->toPoint();
    EXPECT_EQ(point.getX(), states[i].x_m);
    EXPECT_EQ(point.getY(), states[i].y_m);
    EXPECT_EQ(point.getZ(), states[i].altitude_m);
    if (i % 97 == 0) {
      for (const TrajectoryColumn& column : kTrajectoryColumns) {
        if (column.member != nullptr) {
          EXPECT_EQ(feature->GetFieldAsDouble(column.name), states[i].*column.member)
              << column.name;
        }
      }
      EXPECT_NEAR(feature->GetFieldAsDouble("height_above_surface_m"),
                  states[i].altitude_m - states[i].surface_m, 1e-12);
    }
    ++i;
  }
  EXPECT_EQ(std::string(trajectory.GetNextFeature() ? "" : "end"), "end");
  const OGRSpatialReference* reference = trajectory.GetSpatialRef();
  ASSERT_NE(reference, nullptr);
  OGRSpatialReference vertical;
  EXPECT_TRUE(reference->IsCompound());
  EXPECT_STREQ(reference->GetAuthorityCode("COMPD_CS|VERT_CS"), "5773");
  EXPECT_EQ(file.layer("route").GetFeatureCount(), 1);
  EXPECT_EQ(file.layer("flight").GetFeatureCount(), 1);
  EXPECT_EQ(file.layer("flight").GetGeomType(), wkbLineString25D);
  EXPECT_EQ(static_cast<std::size_t>(file.layer("waypoints").GetFeatureCount()),
            sample().route_plan.route.waypoints.size());
  EXPECT_EQ(exported(ExportFormat::kGpkg).content, exported_file.content);  // same bytes
}

TEST(Exports, GeoPackageHoldsTheLayersOfTheMapWhenItIsGiven) {
  const test::TemporaryFolder folder;
  map::write_map_bundle(sample_map(), "{}", folder.path());
  const ExportedFile exported_file = exported(ExportFormat::kGpkg, sample(), folder.path());
  const GdalFile file(exported_file.content, "layers.gpkg");
  EXPECT_EQ(file.layer("overhead_lines").GetFeatureCount(), 1);
  EXPECT_EQ(file.layer("line_supports").GetFeatureCount(), 3);
  EXPECT_GT(file.layer("trajectory").GetFeatureCount(), 1000);
  const auto expect_layer = [&](const char* table, const auto& grid, GDALDataType type) {
    const std::unique_ptr<GDALDataset> raster(GDALDataset::Open(
        ("GPKG:" + file.path() + ":" + table).c_str(), GDAL_OF_RASTER, nullptr, nullptr, nullptr));
    ASSERT_NE(raster, nullptr) << table;
    ASSERT_EQ(raster->GetRasterXSize(), grid.columns());
    ASSERT_EQ(raster->GetRasterYSize(), grid.rows());
    auto values = grid.values();
    ASSERT_EQ(raster->GetRasterBand(1)->RasterIO(GF_Read, 0, 0, grid.columns(), grid.rows(),
                                                 values.data(), grid.columns(), grid.rows(), type,
                                                 0, 0, nullptr),
              CE_None);
    std::size_t different = 0;
    for (int row = 0; row < grid.rows(); ++row) {
      for (int column = 0; column < grid.columns(); ++column) {
        // Rasters begin in the north.
        const auto read = values[static_cast<std::size_t>(grid.rows() - 1 - row) *
                                     static_cast<std::size_t>(grid.columns()) +
                                 static_cast<std::size_t>(column)];
        const auto wanted = grid.at(column, row);
        different += read == wanted || (read != read && wanted != wanted) ? 0U : 1U;
      }
    }
    EXPECT_EQ(different, 0U) << table;
  };
  expect_layer("terrain", sample_map().terrain_m, GDT_Float32);
  expect_layer("surface", sample_map().surface_m, GDT_Float32);
  expect_layer("semantics", sample_map().semantics, GDT_UInt16);
  expect_layer("visibility", sample_map().visibility, GDT_UInt16);
  expect_layer("visibility_band_2", sample_map().visibility, GDT_UInt16);
}

TEST(Exports, CsvHasAColumnOfTimesBesideTheFullStates) {
  std::istringstream text(exported(ExportFormat::kCsv).content);
  std::string header;
  std::string line;
  ASSERT_TRUE(std::getline(text, header));
  EXPECT_THAT(header, testing::StartsWith("time_s,latitude_deg,longitude_deg,altitude_m,"));
  EXPECT_THAT(header, testing::EndsWith(",terrain_m,time_utc"));
  std::size_t rows = 0;
  while (std::getline(text, line)) {
    if (rows == 21) {
      EXPECT_THAT(line, testing::EndsWith(",2026-05-01T06:30:01.050Z"));
    }
    EXPECT_EQ(std::count(line.begin(), line.end(), ','),
              std::count(header.begin(), header.end(), ','));
    ++rows;
  }
  EXPECT_EQ(rows, sample().trajectory.states.size());
}

TEST(Exports, CzmlHoldsPlacesAndAttitudesOnTheEarth) {
  const Json json = Json::parse(exported(ExportFormat::kCzml).content);
  EXPECT_EQ(json[0]["id"], "document");
  EXPECT_EQ(json[0]["version"], "1.0");
  const Json& flown = json[1];
  EXPECT_EQ(flown["position"]["epoch"], "2026-05-01T06:30:00.000Z");
  const std::string availability = flown["availability"];
  EXPECT_THAT(availability, testing::StartsWith("2026-05-01T06:30:00.000Z/2026-05-01T06:"));
  const Json& places = flown["position"]["cartographicDegrees"];
  const Json& attitudes = flown["orientation"]["unitQuaternion"];
  ASSERT_EQ(places.size(), 4 * track_size());
  ASSERT_EQ(attitudes.size(), 5 * track_size());
  for (std::size_t i = 0; i < track_size(); ++i) {
    const auto number = [&](std::size_t k) { return places[4 * i + k].get<double>(); };
    const flight::FlightState& state = state_of(i);
    EXPECT_NEAR(number(0), state.time_s, 1e-6);
    expect_there(oracle().from_ellipsoid(number(1), number(2), number(3)), state);

    // Axes of the helicopter as the quaternion turns them, against small steps on the earth.
    const auto component = [&](std::size_t k) { return attitudes[5 * i + 1 + k].get<double>(); };
    const double x = component(0), y = component(1), z = component(2), w = component(3);
    EXPECT_NEAR(x * x + y * y + z * z + w * w, 1.0, 1e-9);
    const std::array<double, 3> forward = {1 - 2 * (y * y + z * z), 2 * (x * y + z * w),
                                           2 * (x * z - y * w)};
    const std::array<double, 3> left = {2 * (x * y - z * w), 1 - 2 * (x * x + z * z),
                                        2 * (y * z + x * w)};
    const auto direction = [&](double east_m, double north_m, double up_m) {
      const auto a = oracle().on_earth(state.x_m, state.y_m, state.altitude_m);
      const auto b =
          oracle().on_earth(state.x_m + east_m, state.y_m + north_m, state.altitude_m + up_m);
      std::array<double, 3> d = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
      const double length = std::hypot(d[0], d[1], d[2]);
      for (double& part : d) {
        part /= length;
      }
      return d;
    };
    const auto dot = [](const std::array<double, 3>& a, const std::array<double, 3>& b) {
      return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    };
    const double grid_rad = state.heading_true_rad - state.convergence_rad;
    const auto ahead = direction(20.0 * std::sin(grid_rad), 20.0 * std::cos(grid_rad), 0.0);
    const auto up = direction(0.0, 0.0, 20.0);
    const auto right = direction(20.0 * std::cos(grid_rad), -20.0 * std::sin(grid_rad), 0.0);
    EXPECT_NEAR(dot(forward, ahead), std::cos(state.pitch_rad), 1e-4);
    EXPECT_NEAR(dot(forward, up), std::sin(state.pitch_rad), 1e-4);
    EXPECT_NEAR(dot(forward, right), 0.0, 1e-4);
    // The right side goes down in a bank to the right.
    EXPECT_NEAR(dot(left, up), std::sin(state.bank_rad) * std::cos(state.pitch_rad), 1e-4);
    EXPECT_NEAR(dot(left, right), -std::cos(state.bank_rad), 1e-4);
  }
  const Json& route = json[2]["polyline"]["positions"]["cartographicDegrees"];
  ASSERT_EQ(route.size(), 3 * sample().route_plan.route.waypoints.size());
  expect_there(oracle().from_ellipsoid(route[3], route[4], route[5]),
               sample().route_plan.route.waypoints[1]);
}

TEST(Exports, CzmlWithoutAStartTimeBeginsWithTheMillenniumAndSaysSo) {
  const ExportedFile file =
      export_plan(sample(), ExportFormat::kCzml, ExportRequest{}, shipped_options());
  EXPECT_EQ(Json::parse(file.content)[1]["position"]["epoch"], "2000-01-01T00:00:00.000Z");
  ASSERT_EQ(file.remarks.size(), 1U);
}

/// A waypoint list read back: the legs that an autopilot would fly, tried against the map.
void expect_legs(const std::vector<Oracle::Place>& corners, const StraightLegs& legs) {
  ASSERT_EQ(corners.size(), legs.states.size());
  double least_m = 1e9;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const flight::FlightState& state = sample().trajectory.states[legs.states[k]];
    expect_there(corners[k], state);
    EXPECT_GE(corners[k].altitude_m, state.altitude_m - 1e-3);
    if (k == 0) {
      continue;
    }
    const Oracle::Place& a = corners[k - 1];
    const Oracle::Place& b = corners[k];
    const int steps = 2 + static_cast<int>(std::hypot(b.x_m - a.x_m, b.y_m - a.y_m));
    for (int i = 0; i <= steps; ++i) {
      const double t = static_cast<double>(i) / steps;
      const geo::MapPoint point{a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)};
      least_m = std::min(least_m, a.altitude_m + t * (b.altitude_m - a.altitude_m) -
                                      raster::sample_bilinear(sample_map().surface_m, point));
    }
  }
  EXPECT_EQ(legs.clearance_demanded_m, kClearance_m);
  EXPECT_GE(least_m, kClearance_m - 1e-3);
  EXPECT_NEAR(legs.clearance_min_m, least_m, 0.3);  // sampled: a little more than the least
  EXPECT_LE(legs.clearance_min_m, least_m + 5e-3);
  EXPECT_GT(legs.added, 0U);
}

TEST(Exports, QgcPlanHasTheStructureThatItsDocumentationDemandsAndSafeLegs) {
  const ExportedFile file = exported(ExportFormat::kQgcPlan);
  const Json json = Json::parse(file.content);
  // docs.qgroundcontrol.com, "Plan File Format": top level.
  EXPECT_EQ(json["fileType"], "Plan");
  EXPECT_EQ(json["version"], 1);
  EXPECT_TRUE(json["groundStation"].is_string());
  EXPECT_EQ(json["geoFence"]["version"], 2);
  EXPECT_TRUE(json["geoFence"]["circles"].is_array());
  EXPECT_TRUE(json["geoFence"]["polygons"].is_array());
  EXPECT_EQ(json["rallyPoints"]["version"], 2);
  EXPECT_TRUE(json["rallyPoints"]["points"].is_array());
  // The mission.
  const Json& mission = json["mission"];
  EXPECT_EQ(mission["version"], 2);
  EXPECT_EQ(mission["firmwareType"], 3);            // MAV_AUTOPILOT_ARDUPILOTMEGA
  EXPECT_EQ(mission["vehicleType"], 4);             // MAV_TYPE_HELICOPTER
  EXPECT_EQ(mission["globalPlanAltitudeMode"], 2);  // absolute
  EXPECT_NEAR(mission["cruiseSpeed"].get<double>(), 40.0, 1.0);
  EXPECT_TRUE(mission["hoverSpeed"].is_number());
  ASSERT_EQ(mission["plannedHomePosition"].size(), 3U);
  const Oracle::Place home =
      oracle().from_amsl(mission["plannedHomePosition"][1], mission["plannedHomePosition"][0],
                         mission["plannedHomePosition"][2]);
  const flight::FlightState& first = sample().trajectory.states.front();
  EXPECT_NEAR(home.x_m, first.x_m, 0.01);
  EXPECT_NEAR(home.altitude_m, first.terrain_m, 0.01);
  // Its items.
  std::vector<Oracle::Place> corners;
  int number = 0;
  for (const Json& item : mission["items"]) {
    EXPECT_EQ(item["type"], "SimpleItem");
    EXPECT_EQ(item["autoContinue"], true);
    EXPECT_EQ(item["doJumpId"], ++number);
    ASSERT_EQ(item["params"].size(), 7U);
    if (item["command"] == 178) {  // MAV_CMD_DO_CHANGE_SPEED
      EXPECT_EQ(item["frame"], 2);
      EXPECT_EQ(item["params"][0], 1);  // ground speed
      EXPECT_NEAR(item["params"][1].get<double>(), 40.0, 2.0);
      EXPECT_EQ(item["params"][2], -1);  // throttle as it is
      continue;
    }
    EXPECT_EQ(item["command"], 16);  // MAV_CMD_NAV_WAYPOINT
    EXPECT_EQ(item["frame"], 0);     // MAV_FRAME_GLOBAL: above mean sea level
    EXPECT_EQ(item["AltitudeMode"], 2);
    EXPECT_EQ(item["Altitude"], item["params"][6]);
    EXPECT_TRUE(item["AMSLAltAboveTerrain"].is_null());
    EXPECT_TRUE(item["params"][3].is_null());  // yaw: along the path
    corners.push_back(oracle().from_amsl(item["params"][5], item["params"][4], item["params"][6]));
  }
  EXPECT_EQ(mission["items"][0]["command"], 178);
  expect_legs(corners, *file.legs);
}

TEST(Exports, WaypointListHasTwelveColumnsALineAndSafeLegs) {
  const ExportedFile file = exported(ExportFormat::kWaypoints);
  std::istringstream text(file.content);
  std::string line;
  ASSERT_TRUE(std::getline(text, line));
  EXPECT_EQ(line, "QGC WPL 110");
  std::vector<Oracle::Place> corners;
  int number = 0;
  while (std::getline(text, line)) {
    // index, current, frame, command, parameters 1 to 4, latitude, longitude, altitude, continue
    EXPECT_EQ(std::count(line.begin(), line.end(), '\t'), 11);
    std::istringstream columns(line);
    std::array<double, 12> values{};
    for (double& value : values) {
      ASSERT_TRUE(columns >> value) << line;
    }
    EXPECT_EQ(values[0], number);
    EXPECT_EQ(values[1], number == 0 ? 1 : 0);
    EXPECT_EQ(values[11], 1);
    if (number == 0) {  // home: where the ground is
      EXPECT_EQ(values[3], 16);
      EXPECT_NEAR(oracle().from_amsl(values[9], values[8], values[10]).altitude_m,
                  sample().trajectory.states.front().terrain_m, 0.01);
    } else if (values[3] == 178) {
      EXPECT_EQ(values[2], 2);
      EXPECT_EQ(values[4], 1);
      EXPECT_NEAR(values[5], 40.0, 2.0);
    } else {
      EXPECT_EQ(values[3], 16);
      EXPECT_EQ(values[2], 0);
      corners.push_back(oracle().from_amsl(values[9], values[8], values[10]));
    }
    ++number;
  }
  expect_legs(corners, *file.legs);
}

TEST(Exports, HeightsInAnotherDatumAreConvertedOrRefused) {
  flight::Plan plan = sample();
  plan.route_plan.map.vertical_datum = "ellipsoid";
  ExportRequest request;
  const ExportOptions options = shipped_options();
  const Json as_it_is =
      Json::parse(export_plan(plan, ExportFormat::kGeoJson, request, options).content);
  EXPECT_NEAR(as_it_is["features"][1]["geometry"]["coordinates"][0][2].get<double>(),
              plan.trajectory.states[0].altitude_m, 5.1e-4);
  const GdalFile kml(export_plan(plan, ExportFormat::kKml, request, options).content,
                     "ellipsoid.kml");
  const auto flown = named_feature(kml.layer("hedgehop flight"), "Flight");
  const OGRLineString& line = *flown->GetGeometryRef()->toLineString();
  EXPECT_GT(plan.trajectory.states[0].altitude_m - line.getZ(0), 44.0);
  EXPECT_LT(plan.trajectory.states[0].altitude_m - line.getZ(0), 49.0);

  plan.route_plan.map.vertical_datum = "barometer";
  EXPECT_THROW(export_plan(plan, ExportFormat::kKml, request, options), DataError);
  plan.route_plan.map.crs_wkt.clear();
  try {
    export_plan(plan, ExportFormat::kKml, request, options);
    FAIL();
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(), HasSubstr("no coordinate system"));
  }
  EXPECT_FALSE(export_plan(plan, ExportFormat::kCsv, request, options).content.empty());
}

TEST(Exports, UnknownFormatNamesTheNearestAndTheList) {
  for (const ExportFormatEntry& entry : export_formats()) {
    EXPECT_EQ(export_format(entry.name), entry.format);
  }
  try {
    (void)export_format("geojsn");
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_THAT(error.hint(), HasSubstr("did you mean 'geojson'"));
    EXPECT_THAT(error.hint(), HasSubstr("czml"));
  }
}

}  // namespace
}  // namespace hedgehop::output
