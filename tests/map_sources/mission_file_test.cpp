#include "map_sources/mission_file.hpp"

#include <cmath>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "support/fresh_seed.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using Reference = MissionPoint::Reference;

class MissionFiles : public testing::Test {
 protected:
  Mission read(const std::string& name, const std::string& text) const {
    const fs::path path = folder_.path() / name;
    std::ofstream(path, std::ios::binary) << text;
    return read_mission(path);
  }

  /// What the refusal says, with its hint; empty if there is none.
  template <typename Error>
  std::string refusal(const std::string& name, const std::string& text) const {
    try {
      (void)read(name, text);
    } catch (const Error& error) {
      EXPECT_FALSE(error.hint().empty()) << error.what();
      return std::string(error.what()) + " | " + error.hint();
    }
    return "";
  }

  static void expect_at(const MissionPoint& point, double latitude_deg, double longitude_deg) {
    EXPECT_NEAR(degrees_from_radians(point.position.latitude_rad), latitude_deg, 1e-12);
    EXPECT_NEAR(degrees_from_radians(point.position.longitude_rad), longitude_deg, 1e-12);
  }
  static void expect_height(const MissionPoint& point, double height_m, Reference reference) {
    ASSERT_TRUE(point.height_m);
    EXPECT_DOUBLE_EQ(*point.height_m, height_m);
    EXPECT_EQ(point.reference, reference);
  }

  test::TemporaryFolder folder_;
};

constexpr char kYaml[] =
    "start: {latitude_deg: 49.9, longitude_deg: 11.4, height_m: 20, heading_true_deg: -90}\n"
    "via:\n"
    "  - {latitude_deg: 49.92, longitude_deg: 11.45}\n"
    "  - {latitude_deg: 49.94, longitude_deg: -11.5, altitude_m: 512.5}\n"
    "goal: {latitude_deg: -49.98, longitude_deg: 11.57}\n"
    "speed_mps: 35\n";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST_F(MissionFiles, YamlHoldsPlacesHeightsHeadingAndSpeed) {
  const Mission mission = read("m.yaml", kYaml);
  expect_at(mission.start, 49.9, 11.4);
  expect_height(mission.start, 20.0, Reference::kSurface);
  ASSERT_EQ(mission.via.size(), 2U);
  expect_at(mission.via[0], 49.92, 11.45);
  EXPECT_FALSE(mission.via[0].height_m);
  expect_at(mission.via[1], 49.94, -11.5);
  expect_height(mission.via[1], 512.5, Reference::kMapDatum);
  expect_at(mission.goal, -49.98, 11.57);
  EXPECT_FALSE(mission.goal.height_m);
  EXPECT_NEAR(*mission.start.heading_true_rad, radians_from_degrees(270.0), 1e-12);
  EXPECT_EQ(mission.speed_mps, 35.0);
  EXPECT_TRUE(mission.remarks.empty());
}

TEST_F(MissionFiles, ShippedExampleIsRead) {
  const Mission mission = read_mission("docs/examples/mission.yaml");
  EXPECT_EQ(mission.via.size(), 2U);
  EXPECT_TRUE(mission.start.heading_true_rad);
  EXPECT_TRUE(mission.speed_mps);
}

TEST_F(MissionFiles, HeadingOnTheWayBecomesAPlaceInLineBeforeIt) {
  std::string text =
      replaced(kYaml, "longitude_deg: 11.45", "longitude_deg: 11.45, heading_true_deg: 90");
  text = replaced(text, "latitude_deg: -49.98, longitude_deg: 11.57",
                  "latitude_deg: 50.0, longitude_deg: 11.57, heading_true_deg: 180");
  const Mission mission = read("m.yaml", text);
  EXPECT_TRUE(mission.start.heading_true_rad);
  ASSERT_EQ(mission.via.size(), 6U);
  // Heading east: to the west. At 49.92 degrees a degree of longitude is 71,815 m long (WGS 84).
  for (const auto& [at, distance_m] : {std::pair(0U, 1600.0), std::pair(1U, 800.0)}) {
    EXPECT_NEAR(degrees_from_radians(mission.via[at].position.longitude_rad),
                11.45 - distance_m / 71'815.0, 2e-6);
    EXPECT_NEAR(degrees_from_radians(mission.via[at].position.latitude_rad), 49.92, 3e-6);
    EXPECT_FALSE(mission.via[at].height_m);
  }
  expect_at(mission.via[2], 49.92, 11.45);
  expect_at(mission.via[3], 49.94, -11.5);
  // Heading south: to the north. At 50 degrees a degree of latitude is 111,229 m long.
  for (const auto& [at, distance_m] : {std::pair(4U, 1600.0), std::pair(5U, 800.0)}) {
    EXPECT_NEAR(degrees_from_radians(mission.via[at].position.latitude_rad),
                50.0 + distance_m / 111'229.0, 3e-6);
    EXPECT_NEAR(degrees_from_radians(mission.via[at].position.longitude_rad), 11.57, 1e-9);
  }
  expect_at(mission.goal, 50.0, 11.57);
  ASSERT_EQ(mission.remarks.size(), 2U);
  EXPECT_THAT(mission.remarks[1], HasSubstr("heading of 180 degrees leads the flight by way of"));
}

TEST_F(MissionFiles, YamlHoldsTimesAndTheAreasThatLieBesideIt) {
  std::string text = replaced(kYaml, "longitude_deg: 11.57",
                              "longitude_deg: 11.57, time: "
                              "2026-05-01T08:30:02+02:00");
  text = replaced(text, "longitude_deg: 11.4,", "longitude_deg: 11.4, time: 2026-05-01T06:20Z,");
  text += "time_tolerance_s: 2.5\nareas: [today.geojson, /far/away.kml]\n";
  const Mission mission = read("m.yaml", text);
  // 56 years with 14 leap days, then January to April: 20,574 days since 1970
  constexpr std::int64_t kDay_us = 20'574LL * 86'400'000'000LL;
  EXPECT_EQ(mission.start.time->utime_us, kDay_us + (6 * 60 + 20) * 60'000'000LL);
  EXPECT_EQ(mission.goal.time->utime_us, kDay_us + (6 * 60 + 30) * 60'000'000LL + 2'000'000LL);
  EXPECT_FALSE(mission.via[0].time);
  EXPECT_EQ(mission.time_tolerance_s, 2.5);
  ASSERT_EQ(mission.areas.size(), 2U);
  EXPECT_EQ(mission.areas[0].path, folder_.path() / "today.geojson");
  EXPECT_EQ(mission.areas[1].path, "/far/away.kml");
  EXPECT_FALSE(mission.areas[0].others_are_skipped);
}

TEST_F(MissionFiles, YamlThatCannotBeKeptIsRefusedWithItsLine) {
  struct Case {
    const char* from;
    const char* to;
    const char* says;
  };
  for (const Case& fault : {
           Case{"11.45}", "11.45, heading_true_deg: north}", "m.yaml:3: 'via[0].heading_true_deg'"},
           Case{"11.45}", "11.45, speed_mps: 3}", "m.yaml:3: 'via[0].speed_mps' cannot"},
           Case{"11.57}", "11.57, time: 06:30}", "m.yaml:5: 'goal.time' must be a time as ISO"},
           Case{"11.57}", "11.57, time: 2026-05-01T06:30}", "'goal.time' must be a time"},
           Case{"speed_mps: 35", "time_tolerance_s: 0", "'time_tolerance_s' must lie between"},
           Case{"speed_mps: 35", "speed_mps: 35\nareas: x", "m.yaml:7: 'areas'"},
           Case{"speed_mps: 35", "speed_mps: 0", "m.yaml:6: 'speed_mps' must be a speed"},
           Case{"altitude_m: 512.5", "altitude_m: 512.5, height_m: 20", "stands beside height_m"},
           Case{"latitude_deg: 49.9,", "latitude_deg: 99.9,", "'start.latitude_deg' must lie in"},
           Case{"11.57", ".nan", "'goal.longitude_deg'"},
           Case{"speed_mps: 35", "speed_mp: 35", "m.yaml:6: unknown key 'speed_mp'"},
           Case{"goal:", "gaol:", "missing key 'goal'"},
       }) {
    const std::string text = replaced(kYaml, fault.from, fault.to);
    try {
      (void)read("m.yaml", text);
      ADD_FAILURE() << fault.to;
    } catch (const ConfigError& error) {
      EXPECT_THAT(error.what(), HasSubstr(fault.says));
    }
  }
  EXPECT_THAT(refusal<ConfigError>("m.yaml", replaced(kYaml, "speed_mps", "speed_mp")),
              HasSubstr("did you mean 'speed_mps'"));
}

std::string geojson(const std::string& features) {
  return R"({"type":"FeatureCollection","features":[)" + features + "]}";
}
std::string feature(const std::string& geometry, const std::string& properties = "{}") {
  return R"({"type":"Feature","geometry":)" + geometry + R"(,"properties":)" + properties + "}";
}
std::string point(const std::string& coordinates, const std::string& properties = "{}") {
  return feature(R"({"type":"Point","coordinates":[)" + coordinates + "]}", properties);
}

TEST_F(MissionFiles, GeoJsonLineGoesFromItsFirstToItsLastPosition) {
  const Mission mission = read(
      "m.geojson",
      geojson(feature(
          R"({"type":"LineString","coordinates":[[11.4,49.9,540],[11.5,49.95,550],[11.6,50,560]]})",
          R"({"heading_true_deg":10,"speed_mps":30})")));
  expect_at(mission.start, 49.9, 11.4);
  expect_height(mission.start, 540.0, Reference::kEllipsoid);  // RFC 7946, 3.1.1
  ASSERT_EQ(mission.via.size(), 1U);
  expect_at(mission.via[0], 49.95, 11.5);
  expect_at(mission.goal, 50.0, 11.6);
  EXPECT_NEAR(*mission.start.heading_true_rad, radians_from_degrees(10.0), 1e-12);
  EXPECT_EQ(mission.speed_mps, 30.0);
}

TEST_F(MissionFiles, GeoJsonPointsStandInTheirOrderUnlessTheyHaveRoles) {
  const std::string a = point("11.4,49.9", R"({"height_m":25})");
  const std::string b = point("11.5,49.95", R"({"altitude_m":"480"})");
  const std::string c = point("11.6,50");
  const Mission plain = read("m.json", geojson(a + "," + b + "," + c));
  expect_at(plain.start, 49.9, 11.4);
  expect_height(plain.start, 25.0, Reference::kSurface);
  expect_height(plain.via.at(0), 480.0, Reference::kMapDatum);
  expect_at(plain.goal, 50.0, 11.6);
  EXPECT_FALSE(plain.goal.height_m);

  const Mission with_roles =
      read("m.json", geojson(point("11.4,49.9", R"({"role":"Goal"})") + "," + b + "," +
                             point("11.6,50", R"({"name":"start"})") + "," + c));
  expect_at(with_roles.start, 50.0, 11.6);
  expect_at(with_roles.goal, 49.9, 11.4);
  ASSERT_EQ(with_roles.via.size(), 2U);
  expect_at(with_roles.via[0], 49.95, 11.5);
}

TEST_F(MissionFiles, GeoJsonPositionWhoseThirdNumberIsZeroHasNoHeight) {
  const Mission mission =
      read("m.json", geojson(point("11.4,49.9,0") + "," + point("11.6,50,600")));
  EXPECT_FALSE(mission.start.height_m);
  expect_height(mission.goal, 600.0, Reference::kEllipsoid);
}

TEST_F(MissionFiles, GeoJsonPolygonsAreAreasAndPointsHaveTimes) {
  const Mission mission = read(
      "m.json", geojson(point("11.4,49.9") + "," +
                        feature(R"({"type":"Polygon","coordinates":[[[0,0],[1,0],[1,1],[0,0]]]})") +
                        "," + point("11.6,50", R"({"time":"1970-01-02T00:00Z"})")));
  expect_at(mission.goal, 50.0, 11.6);
  EXPECT_EQ(mission.goal.time->utime_us, 86'400'000'000LL);
  EXPECT_FALSE(mission.start.time);
  ASSERT_EQ(mission.areas.size(), 1U);
  EXPECT_EQ(mission.areas[0].path, folder_.path() / "m.json");
  EXPECT_TRUE(mission.areas[0].others_are_skipped);
  EXPECT_TRUE(read("n.json", geojson(point("11.4,49.9") + "," + point("11.6,50"))).areas.empty());
}

TEST_F(MissionFiles, GeoJsonThatIsNoMissionIsRefused) {
  const std::string line =
      feature(R"({"type":"LineString","coordinates":[[11.4,49.9],[11.6,50]]})");
  const std::string ends = point("11.4,49.9") + "," + point("11.6,50");
  EXPECT_THAT(refusal<UsageError>("m.json", geojson(line + "," + ends)),
              HasSubstr("1 line(s) and 2 point(s)"));
  EXPECT_THAT(refusal<UsageError>("m.json", geojson(line + "," + line)), HasSubstr("2 line(s)"));
  EXPECT_THAT(refusal<UsageError>("m.json", geojson(point("11.4,49.9"))),
              HasSubstr("holds 1 point,"));
  EXPECT_THAT(
      refusal<UsageError>(
          "m.json",
          geojson(ends + "," + feature(R"({"type":"MultiPoint","coordinates":[[0,0],[1,0]]})"))),
      HasSubstr("MULTIPOINT"));
  EXPECT_THAT(refusal<DataError>("m.json", geojson(point("11.4,49.9", R"({"time":"soon"})") + "," +
                                                   point("11.6,50"))),
              HasSubstr("its time 'soon' cannot be read"));
  EXPECT_THAT(refusal<UsageError>("m.json", geojson(point("11.4,49.9") + "," +
                                                    point("11.6,50", R"({"speed_mps":4})"))),
              HasSubstr("has a speed of its own"));
  EXPECT_THAT(refusal<UsageError>("m.json", geojson(point("11.4,49.9", R"({"role":"start"})") +
                                                    "," + point("11.6,50", R"({"role":"start"})"))),
              HasSubstr("more than one start"));
  EXPECT_THAT(refusal<DataError>("m.json", geojson(point("11.4,149.9") + "," + point("11.6,50"))),
              HasSubstr("latitude 149.9"));
  EXPECT_THAT(refusal<DataError>("m.json", geojson(point("11.4,49.9", R"({"height_m":"high"})") +
                                                   "," + point("11.6,50"))),
              HasSubstr("'high', which is no number"));
  std::string many = point("11.4,49.9");
  for (std::size_t i = 0; i < kMissionPointsMax; ++i) {
    many += "," + point("11.5,49.9");
  }
  EXPECT_THAT(refusal<UsageError>("m.json", geojson(many)), HasSubstr("holds 201 points"));
  EXPECT_THAT(refusal<DataError>("m.json", "{"), HasSubstr("cannot be read as a mission"));
}

TEST_F(MissionFiles, KmlHeightsCountAsTheirAltitudeModeSays) {
  const auto placemark = [](const std::string& name, const std::string& mode,
                            const std::string& coordinates) {
    return "<Placemark><name>" + name + "</name><Point>" +
           (mode.empty() ? "" : "<altitudeMode>" + mode + "</altitudeMode>") + "<coordinates>" +
           coordinates + "</coordinates></Point></Placemark>";
  };
  const Mission mission =
      read("m.kml", "<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document>" +
                        placemark("Goal", "absolute", "11.6,50,520") + "<Folder>" +
                        placemark("Start", "relativeToGround", "11.4,49.9,30") +
                        placemark("bridge", "", "11.5,49.95,77") +
                        placemark("mill", "clampToGround", "11.55,49.96,78") +
                        "</Folder></Document></kml>");
  expect_at(mission.start, 49.9, 11.4);
  expect_height(mission.start, 30.0, Reference::kGround);
  expect_at(mission.goal, 50.0, 11.6);
  expect_height(mission.goal, 520.0, Reference::kEgm96);
  ASSERT_EQ(mission.via.size(), 2U);
  expect_at(mission.via[0], 49.95, 11.5);
  EXPECT_FALSE(mission.via[0].height_m);
  EXPECT_FALSE(mission.via[1].height_m);
}

TEST_F(MissionFiles, GpxRouteStandsBeforeWaypointsAndTracksAreRefused) {
  const auto gpx = [](const std::string& content) {
    return "<gpx version=\"1.1\" creator=\"t\" xmlns=\"http://www.topografix.com/GPX/1/1\">" +
           content + "</gpx>";
  };
  const std::string waypoints =
      "<wpt lat=\"1\" lon=\"2\"><ele>3</ele></wpt><wpt lat=\"4\" lon=\"5\"/>";
  const std::string route =
      "<rte><rtept lat=\"49.9\" lon=\"11.4\"><ele>500.5</ele></rtept>"
      "<rtept lat=\"49.95\" lon=\"11.5\"/><rtept lat=\"50\" lon=\"11.6\"/></rte>";
  const std::string track =
      "<trk><trkseg><trkpt lat=\"1\" lon=\"2\"/><trkpt lat=\"3\" lon=\"4\"/></trkseg></trk>";
  const Mission by_route = read("m.gpx", gpx(waypoints + route + track));
  expect_at(by_route.start, 49.9, 11.4);
  expect_height(by_route.start, 500.5, Reference::kEgm96);
  ASSERT_EQ(by_route.via.size(), 1U);
  EXPECT_FALSE(by_route.via[0].height_m);
  ASSERT_EQ(by_route.remarks.size(), 1U);
  EXPECT_THAT(by_route.remarks[0], HasSubstr("waypoints beside the route"));
  expect_at(by_route.goal, 50.0, 11.6);
  const Mission by_waypoints = read("m.gpx", gpx(waypoints));
  expect_at(by_waypoints.start, 1.0, 2.0);
  expect_height(by_waypoints.start, 3.0, Reference::kEgm96);
  expect_at(by_waypoints.goal, 4.0, 5.0);
  EXPECT_THAT(refusal<UsageError>("m.gpx", gpx(track)), HasSubstr("recorded track"));
  EXPECT_THAT(refusal<UsageError>("m.gpx", gpx(route + route)), HasSubstr("2 routes"));
}

std::string item(int command, int frame, const std::string& parameters) {
  return R"({"type":"SimpleItem","autoContinue":true,"doJumpId":1,"command":)" +
         std::to_string(command) + ",\"frame\":" + std::to_string(frame) + ",\"params\":[" +
         parameters + "]}";
}
std::string qgc_plan(const std::string& items, const std::string& more = "") {
  return R"({"fileType":"Plan","version":1,"groundStation":"QGroundControl",)" + more +
         R"("mission":{"version":2,"plannedHomePosition":[49.9,11.4,400],"items":[)" + items +
         "]}}";
}

TEST_F(MissionFiles, QgcPlanKeepsFramesSpeedTakeOffAndLanding) {
  const Mission mission = read("m.plan", qgc_plan(item(22, 3, "0,0,0,null,49.9,11.4,50") + "," +
                                                  item(178, 2, "1,32.5,-1,0,0,0,0") + "," +
                                                  item(16, 0, "0,0,0,null,49.92,11.45,470.25") +
                                                  "," + item(16, 10, "0,5,0,0,49.94,11.5,35") +
                                                  "," + item(21, 3, "0,0,0,null,50.0,11.6,0")));
  expect_at(mission.start, 49.9, 11.4);
  expect_height(mission.start, 450.0, Reference::kEgm96);  // 50 m above home, which is 400 m high
  ASSERT_EQ(mission.via.size(), 2U);
  expect_height(mission.via[0], 470.25, Reference::kEgm96);
  expect_height(mission.via[1], 35.0, Reference::kGround);
  expect_at(mission.goal, 50.0, 11.6);
  EXPECT_FALSE(mission.goal.height_m);
  EXPECT_EQ(mission.speed_mps, 32.5);
  ASSERT_EQ(mission.remarks.size(), 2U);
  EXPECT_THAT(mission.remarks[0], HasSubstr("item 1: the take-off itself is not planned"));
  EXPECT_THAT(mission.remarks[1], HasSubstr("item 5: the landing itself is not planned"));
}

TEST_F(MissionFiles, QgcPlanKeepsItsGeofences) {
  const Mission mission = read(
      "m.plan", qgc_plan(item(16, 0, "0,0,0,null,49.9,11.4,450") + "," +
                             item(16, 0, "0,0,0,null,50,11.6,450"),
                         R"("geoFence":{"version":2,"circles":[{"inclusion":false,"version":1,)"
                         R"("circle":{"center":[49.95,11.5],"radius":500}}],)"
                         R"("polygons":[{"inclusion":true,"version":1,)"
                         R"("polygon":[[49.8,11.3],[49.8,11.7],[50.1,11.7]]}]},)"));
  ASSERT_EQ(mission.fences.size(), 2U);
  EXPECT_TRUE(mission.fences[0].is_inclusion);
  ASSERT_EQ(mission.fences[0].outline.size(), 3U);
  EXPECT_NEAR(degrees_from_radians(mission.fences[0].outline[2].latitude_rad), 50.1, 1e-12);
  EXPECT_FALSE(mission.fences[1].is_inclusion);
  EXPECT_GT(mission.fences[1].outline.size(), 8U);
}

TEST_F(MissionFiles, QgcPlanThatCannotBeKeptIsRefusedWithItsItem) {
  const std::string a = item(16, 0, "0,0,0,null,49.9,11.4,450") + ",";
  const std::string b = "," + item(16, 0, "0,0,0,null,50,11.6,450");
  const auto says = [&](const std::string& middle, const std::string& more = "") {
    return refusal<UsageError>("m.plan", qgc_plan(a + middle + b, more));
  };
  EXPECT_THAT(says(item(16, 0, "10,0,0,null,49.92,11.45,470")), HasSubstr("item 2 waits"));
  EXPECT_THAT(says(item(16, 0, "0,0,0,45,49.92,11.45,470")), HasSubstr("item 2 has a heading"));
  EXPECT_THAT(says(item(17, 0, "0,0,0,0,49.92,11.45,470")), HasSubstr("item 2 is the command 17"));
  EXPECT_THAT(says(item(16, 1, "0,0,0,0,49.92,11.45,470")), HasSubstr("item 2 is in the frame 1"));
  EXPECT_THAT(says(item(22, 3, "0,0,0,0,49.92,11.45,47")),
              HasSubstr("item 2 takes off in the middle"));
  EXPECT_THAT(says(item(21, 3, "0,0,0,0,49.92,11.45,0")),
              HasSubstr("item 3 comes after the landing"));
  EXPECT_THAT(says(item(16, 0, "0,0,0,0,49.92,11.45,470") + "," + item(178, 2, "1,20,-1,0,0,0,0")),
              HasSubstr("item 3 changes the speed to 20 m/s"));
  EXPECT_THAT(says(R"({"type":"ComplexItem","complexItemType":"survey"})"),
              HasSubstr("item 2 is a pattern ('survey')"));
  const auto damaged = [&](const std::string& text) { return refusal<DataError>("m.plan", text); };
  const auto fenced = [&](const std::string& polygons, const std::string& circles) {
    const std::string ends = a + item(16, 0, "0,0,0,null,50,11.6,450");
    return damaged(qgc_plan(ends, R"("geoFence":{"version":2,"circles":[)" + circles +
                                      R"(],"polygons":[)" + polygons + "]},"));
  };
  EXPECT_THAT(fenced(R"({"polygon":[]})", ""), HasSubstr("fence 0: 'inclusion'"));
  EXPECT_THAT(fenced(R"({"inclusion":true,"polygon":[[1,2],[3]]})", ""),
              HasSubstr("fence 0 has a corner that is no latitude"));
  EXPECT_THAT(fenced("", R"({"inclusion":true,"circle":{"center":[1,2],"radius":-4}})"),
              HasSubstr("fence 0 has the radius -4 m"));
  EXPECT_THAT(fenced("", R"({"inclusion":true,"circle":{"center":[91,2],"radius":4}})"),
              HasSubstr("latitude 91"));
  EXPECT_THAT(damaged("{\"fileType\": 3}"), HasSubstr("no plan of QGroundControl"));
  EXPECT_THAT(damaged("{\"fileType\": \"Plan\"}"), HasSubstr("'mission'"));
  EXPECT_THAT(damaged("nothing"), HasSubstr("m.plan"));
  EXPECT_THAT(damaged(qgc_plan(item(16, 0, "1,2,3"))), HasSubstr("has not 7 params"));
  EXPECT_THAT(damaged(qgc_plan(item(16, 0, "0,0,0,0,\"x\",1,1"))),
              HasSubstr("param 5 is no number"));
  EXPECT_THAT(damaged(qgc_plan(item(16, 0, "0,0,0,0,null,1,1"))), HasSubstr("no place in degrees"));
  EXPECT_THAT(damaged(qgc_plan("7")), HasSubstr("item 1 is no object"));
  std::string homeless = qgc_plan(a + item(16, 3, "0,0,0,0,49.92,11.45,47"));
  homeless = replaced(homeless, "[49.9,11.4,400]", "[49.9,11.4,null]");
  EXPECT_THAT(refusal<UsageError>("m.plan", homeless), HasSubstr("counts its altitude from home"));
}

TEST_F(MissionFiles, WaypointListKeepsHomeFramesAndSpeed) {
  const Mission mission = read("m.waypoints",
                               "QGC WPL 110\r\n"
                               "0\t1\t0\t16\t0\t0\t0\t0\t49.8\t11.3\t410\t1\r\n"
                               "1\t0\t2\t178\t0\t28\t-1\t0\t0\t0\t0\t1\r\n"
                               "2\t0\t3\t16\t0\t0\t0\t0\t49.9\t11.4\t60\t1\r\n"
                               "3\t0\t0\t16\t0\t0\t0\t0\t50\t11.6\t455.5\t1\r\n");
  expect_at(mission.start, 49.9, 11.4);
  expect_height(mission.start, 470.0, Reference::kEgm96);
  expect_at(mission.goal, 50.0, 11.6);
  expect_height(mission.goal, 455.5, Reference::kEgm96);
  EXPECT_EQ(mission.speed_mps, 28.0);
  ASSERT_EQ(mission.remarks.size(), 1U);
  EXPECT_THAT(mission.remarks[0], HasSubstr("airspeed"));
  EXPECT_THAT(refusal<DataError>("m.waypoints", "QGC WPL 120\n"), HasSubstr("m.waypoints:1:"));
  EXPECT_THAT(refusal<DataError>("m.waypoints", "QGC WPL 110\n0\t1\t0\n"),
              HasSubstr("3 columns, not 12"));
  EXPECT_THAT(refusal<DataError>("m.waypoints", "QGC WPL 110\n0 1 x\n"),
              HasSubstr("'x' is no number"));
}

TEST_F(MissionFiles, GarbledFilesAreReadOrRefusedButNothingElse) {
  std::mt19937_64 generator(test::fresh_seed());
  const std::vector<std::pair<std::string, std::string>> samples = {
      {"m.yaml", kYaml},
      {"m.geojson", geojson(point("11.4,49.9", R"({"role":"start","height_m":25})") + "," +
                            point("11.6,50,600"))},
      {"m.kml",
       "<kml "
       "xmlns=\"http://www.opengis.net/kml/2.2\"><Document><Placemark><LineString><altitudeMode>"
       "absolute</altitudeMode><coordinates>11.4,49.9,500 11.6,50,600</coordinates></LineString>"
       "</Placemark></Document></kml>"},
      {"m.gpx",
       "<gpx version=\"1.1\" creator=\"t\" xmlns=\"http://www.topografix.com/GPX/1/1\"><rte><rtept "
       "lat=\"49.9\" lon=\"11.4\"><ele>500.5</ele></rtept><rtept lat=\"50\" "
       "lon=\"11.6\"/></rte></gpx>"},
      {"m.plan", qgc_plan(item(22, 3, "0,0,0,null,49.9,11.4,50") + "," +
                          item(16, 0, "0,0,0,null,49.92,11.45,470.25"))},
      {"m.waypoints",
       "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t49.8\t11.3\t410\t1\n"
       "1\t0\t3\t16\t0\t0\t0\t0\t49.9\t11.4\t60\t1\n2\t0\t0\t16\t0\t0\t0\t0\t50\t11.6\t455."
       "5\t1\n"}};
  int refused = 0;
  for (const auto& [name, sample] : samples) {
    for (int attempt = 0; attempt < 25; ++attempt) {
      std::string text = sample;
      for (int change = 0; change < 3; ++change) {
        const auto at = std::uniform_int_distribution<std::size_t>(0, text.size() - 1)(generator);
        switch (generator() % 3) {
          case 0:
            text[at] = static_cast<char>(generator());
            break;
          case 1:
            text.erase(at, 1 + generator() % 20);
            text += ' ';
            break;
          default:
            text.insert(at, text.substr(generator() % text.size(), generator() % 20));
        }
      }
      try {
        const Mission mission = read(name, text);
        EXPECT_LE(std::fabs(mission.start.position.latitude_rad), 1.6) << text;
        EXPECT_LE(std::fabs(mission.goal.height_m.value_or(0.0)), 50000.0) << text;
      } catch (const UserError&) {
        ++refused;
      }
    }
  }
  EXPECT_GT(refused, 40);
}

TEST_F(MissionFiles, MissingLargeAndStrangeFilesAreRefused) {
  EXPECT_THROW(read_mission(folder_.path() / "none.yaml"), DataError);
  EXPECT_THAT(refusal<DataError>("m.docx", "x"), HasSubstr("of this kind"));
  const fs::path large = folder_.path() / "large.gpx";
  std::ofstream(large) << "<gpx>";
  fs::resize_file(large, 20U << 20U);
  EXPECT_THROW(read_mission(large), DataError);
}

}  // namespace
}  // namespace hedgehop::map_sources
