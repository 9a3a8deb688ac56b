// Faults planted in a plan that the planners made: each must be found, under the right rule.
#include <algorithm>
#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <limits>
#include <random>
#include <set>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "output/plan_bundle.hpp"
#include "planning/planning.hpp"
#include "planning/timetable.hpp"
#include "risk/small_patches.hpp"
#include "support/fresh_seed.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"
#include "verification/figure_check.hpp"
#include "verification/plan_check.hpp"

namespace hedgehop::planning {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// 9 x 6 km of hills with land use, patchy visibility, a power line across, a mast, a no-fly area
// and an area to be avoided, in UTM zone 32.
map::Map region() {
  map::Map map = test::make_map(300, 200, 30.0, [](double x_m, double y_m) {
    return 400.0 + 30.0 * std::sin(x_m / 700.0) + 30.0 * std::cos(y_m / 600.0);
  });
  test::place_in_utm(map);
  for (int row = 0; row < 200; ++row) {
    for (int column = 0; column < 300; ++column) {
      // Dark cells and rows of all lengths, so that small patches matter.
      const int pattern = (column * 7 + row * 13 + (column * row) % 11) % 17;
      map.visibility.at(column, row) = test::stored_visibility(0.02 + 0.01 * pattern);
      if (column / 20 % 4 == 1) {
        map.semantics.at(column, row) = static_cast<std::uint16_t>(
            row % 3 == 0 ? map::SemanticClass::kVillageDesired : map::SemanticClass::kBuilding);
      }
    }
  }
  const auto at = [](double east_m, double north_m) {
    return geo::MapPoint{test::kUtmWest_m + east_m, test::kUtmSouth_m + north_m};
  };
  map::OverheadLine line;
  line.source_id = 77;
  line.supports = {{at(3000.0, 0.5), 12.0}, {at(3000.0, 3000.0), 12.0}, {at(3000.0, 5999.5), 12.0}};
  map.overhead_lines = {line};
  map::Obstacle mast;
  mast.kind = map::ObstacleKind::kMast;
  mast.name = "mast";
  mast.point = at(4500.0, 5500.0);
  mast.radius_m = 10.0;
  mast.height_m = 50.0;
  mast.top_m = 500.0;
  map.obstacles = {mast};
  const auto square = [&](double east_m, double north_m, double side_m) {
    return map::Area::Polygon{
        {at(east_m, north_m), at(east_m + side_m, north_m), at(east_m + side_m, north_m + side_m),
         at(east_m, north_m + side_m), at(east_m, north_m)},
        {}};
  };
  map::Area hard;
  hard.name = "range";
  hard.floor = {-kInfinity, map::AreaLimit::Reference::kAmsl};
  hard.ceiling = {kInfinity, map::AreaLimit::Reference::kAmsl};
  hard.polygons = {square(5000.0, 500.0, 800.0)};
  map::Area soft = hard;
  soft.name = "park";
  soft.is_hard = false;
  soft.floor = {0.0, map::AreaLimit::Reference::kAboveGround};
  soft.ceiling = {60.0, map::AreaLimit::Reference::kAboveGround};
  soft.polygons = {square(4100.0, 0.0, 500.0)};
  soft.polygons.front().outer[2].y_m += 5000.0;
  soft.polygons.front().outer[3].y_m += 5000.0;
  map.areas = {hard, soft};
  test::finish_map(map);
  return map;
}

flight::RequestPoint place(const map::Map& map, double east_m, double north_m) {
  const geo::MapProjection projection(map.crs_wkt);
  return {projection.to_geodetic({test::kUtmWest_m + east_m, test::kUtmSouth_m + north_m}),
          std::nullopt};
}

// A plan and all that it is judged by.
struct Case {
  map::Map map;
  flight::Plan plan;
  std::string csv;
  std::function<void(const std::filesystem::path&)> damage_files;

  std::vector<flight::FlightState>& states() { return plan.trajectory.states; }
  flight::FlightState& middle() { return states()[states().size() / 2]; }

  // What follows from a state's place, after it was moved or the map was changed.
  void refresh() {
    for (flight::FlightState& state : states()) {
      state.surface_m = raster::sample_bilinear(map.surface_m, state.point());
      state.terrain_m = raster::sample_bilinear(map.terrain_m, state.point());
    }
  }
  // The plan was made on the map as it is now.
  void take_map() {
    test::finish_map(map);
    plan.route_plan.map.hash = map.hash;
    refresh();
  }
  // The state where the vehicle banks most.
  std::size_t steepest() {
    const auto found = std::max_element(
        states().begin(), states().end(),
        [](const auto& a, const auto& b) { return std::fabs(a.bank_rad) < std::fabs(b.bank_rad); });
    return static_cast<std::size_t>(found - states().begin());
  }
  // Without its first states, beginning at time 0 again.
  void begin_at(std::size_t first) {
    states().erase(states().begin(), states().begin() + static_cast<std::ptrdiff_t>(first));
    for (std::size_t i = 0; i < states().size(); ++i) {
      states()[i].time_s = static_cast<double>(i) * plan.trajectory.step_s;
    }
  }
};

Case planned_case(map::Map map = region(), std::vector<std::string> settings = {}) {
  Case planned;
  planned.map = std::move(map);
  settings.emplace_back("global.work_budget=40000");
  const PlanningConfig config =
      read_planning_config(effective_planning_config("", settings), "test");
  flight::PlanRequest request;
  request.start = place(planned.map, 1500.0, 1500.0);
  request.goal = place(planned.map, 7500.0, 4000.0);
  request.via = {place(planned.map, 4000.0, 4200.0)};
  request.start_heading_true_rad = 0.5;
  SilentObserver observer;
  auto answer = plan(planned.map, request, config, {}, observer);
  planned.plan = std::get<flight::Plan>(std::move(answer));
  planned.csv = output::trajectory_csv(planned.plan);
  return planned;
}

// As plan_on_time() would state it, for a departure at noon.
flight::Timetable true_timetable(const Case& planned) {
  flight::Timetable table;
  table.tolerance_s = 5.0;
  for (const double time_s : pass_times_s(planned.plan, 60.0)) {
    table.entries.push_back(
        {table.entries.size(), Time{1'777'636'800'000'000} + time_s, std::nullopt});
  }
  return table;
}

// The rules that a case breaks; "file" and "map" if it is refused before.
std::set<std::string> broken_rules(const Case& judged) {
  const test::TemporaryFolder folder;
  std::set<std::string> rules;
  try {
    flight::Plan plan = judged.plan;
    std::string csv = judged.csv.empty() ? output::trajectory_csv(plan) : judged.csv;
    if (judged.damage_files) {
      output::write_plan_bundle(plan, folder.path());
      judged.damage_files(folder.path());
      plan = output::read_plan_bundle(folder.path());
      csv = read_file(folder.path() / output::kTrajectoryFile);
    }
    const verification::PlanCheck check = verification::check_plan(judged.map, plan, csv);
    EXPECT_EQ(check.verdict.is_verified, check.verdict.violations.empty());
    for (const flight::Violation& violation : check.verdict.violations) {
      rules.insert(violation.rule);
    }
  } catch (const DataError&) {
    rules.insert("file");
  } catch (const UsageError&) {
    rules.insert("map");
  }
  return rules;
}

struct Fault {
  std::string name;
  std::string rule;
  std::function<void(Case&)> plant;
};

void replace_in_file(const std::filesystem::path& file, const std::string& what,
                     const std::string& with) {
  std::string text = read_file(file);
  const std::size_t at = text.find(what);
  ASSERT_NE(at, std::string::npos) << what;
  text.replace(at, what.size(), with);
  write_file_atomically(file, text);
}

// Changes one cell of a line of trajectory.csv.
void falsify_column(Case& planned, const std::string& column, double by) {
  std::string& csv = planned.csv;
  const std::string header = csv.substr(0, csv.find('\n'));
  const auto number = std::count(
      header.begin(), header.begin() + static_cast<std::ptrdiff_t>(header.find(column)), ',');
  std::size_t at = csv.find('\n', csv.size() / 2) + 1;
  for (std::ptrdiff_t i = 0; i < number; ++i) {
    at = csv.find(',', at) + 1;
  }
  const std::size_t end = csv.find_first_of(",\n", at);
  char text[40];
  std::snprintf(text, sizeof text, "%.12g", std::stod(csv.substr(at, end - at)) + by);
  csv.replace(at, end - at, text);
}

std::vector<Fault> trajectory_faults() {
  const auto state_fault = [](const char* name, const char* rule, auto change) {
    return Fault{name, rule, [change](Case& c) { change(c.middle()); }};
  };
  const auto from_middle = [](const char* name, const char* rule, auto change) {
    return Fault{name, rule, [change](Case& c) {
                   for (std::size_t i = c.states().size() / 2; i < c.states().size(); ++i) {
                     change(c.states()[i]);
                   }
                   c.refresh();
                 }};
  };
  const auto throughout = [](const char* name, const char* rule, auto change) {
    return Fault{name, rule, [change](Case& c) {
                   std::for_each(c.states().begin(), c.states().end(), change);
                   c.refresh();
                 }};
  };
  return {
      from_middle("teleport by 10 cm", "continuity_position", [](auto& s) { s.x_m += 0.1; }),
      from_middle("altitude step of 5 cm", "continuity_altitude",
                  [](auto& s) { s.altitude_m += 0.05; }),
      {"time step doubled in plan.json", "time_step",
       [](Case& c) { c.plan.trajectory.step_s *= 2; }},
      {"flown at half the time scale", "continuity_position",
       [](Case& c) {
         c.plan.trajectory.step_s *= 2;
         for (auto& s : c.states()) {
           s.time_s *= 2;
         }
       }},
      {"a state left out", "time_step",
       [](Case& c) { c.states().erase(c.states().begin() + 400); }},
      {"a state held, all later ones delayed", "continuity_position",
       [](Case& c) {
         c.states().insert(c.states().begin() + 400, c.states()[400]);
         c.begin_at(0);
       }},
      {"two states exchanged", "continuity_position",
       [](Case& c) {
         std::swap(c.states()[400], c.states()[401]);
         std::swap(c.states()[400].time_s, c.states()[401].time_s);
       }},
      throughout("bank without turn", "continuity_heading", [](auto& s) { s.bank_rad += 0.05; }),
      {"turn without bank", "continuity_heading",
       [](Case& c) {
         const std::size_t middle = c.steepest();
         for (std::size_t i = middle - 20; i < middle + 20; ++i) {
           c.states()[i].bank_rad = 0.0;
           c.states()[i].roll_rate_radps = 0.0;
         }
       }},
      throughout("bank with the wrong sign", "continuity_heading",
                 [](auto& s) {
                   s.bank_rad = -s.bank_rad;
                   s.roll_rate_radps = -s.roll_rate_radps;
                 }),
      state_fault("heading flipped", "continuity_heading",
                  [](auto& s) { s.heading_true_rad = wrap_to_two_pi(s.heading_true_rad + 3.14); }),
      throughout("headings from grid north", "continuity_position",
                 [](auto& s) { s.heading_true_rad -= s.convergence_rad; }),
      throughout("speed column 1 % too great", "continuity_position",
                 [](auto& s) { s.speed_mps *= 1.01; }),
      from_middle("speed jumps by 1 m/s", "continuity_speed", [](auto& s) { s.speed_mps += 1.0; }),
      throughout("climb rate that is not flown", "continuity_altitude",
                 [](auto& s) { s.climb_rate_mps += 0.1; }),
      state_fault("climb rate beyond the limit", "climb_rate",
                  [](auto& s) { s.climb_rate_mps = 8.01; }),
      state_fault("descent rate beyond the limit", "descent_rate",
                  [](auto& s) { s.climb_rate_mps = -8.01; }),
      state_fault("climb rate jumps", "continuity_climb_rate",
                  [](auto& s) { s.climb_rate_mps += 0.5; }),
      state_fault("roll rate steps", "continuity_roll_rate",
                  [](auto& s) { s.roll_rate_radps += s.roll_rate_radps > 0.0 ? -0.52 : 0.52; }),
      state_fault("roll rate beyond the limit", "roll_rate",
                  [](auto& s) { s.roll_rate_radps = -0.62; }),
      throughout("roll rate with the wrong sign", "continuity_bank",
                 [](auto& s) { s.roll_rate_radps = -s.roll_rate_radps; }),
      state_fault("bank beyond the limit", "bank", [](auto& s) { s.bank_rad = -0.53; }),
      state_fault("pitch beyond the limit", "pitch", [](auto& s) { s.pitch_rad = 0.22; }),
      from_middle("pitch that does not follow its rate", "continuity_pitch",
                  [](auto& s) { s.pitch_rad += 0.01; }),
      state_fault("pitch rate steps", "continuity_pitch_rate",
                  [](auto& s) { s.pitch_rate_radps += 0.6; }),
      state_fault("vertical acceleration beyond the limit", "vertical_acceleration",
                  [](auto& s) { s.vertical_acceleration_mps2 = -2.6; }),
      state_fault("load factor beyond the limit", "load_factor",
                  [](auto& s) { s.vertical_acceleration_mps2 = 5.0; }),
      state_fault("slower than the vehicle flies", "speed_min",
                  [](auto& s) { s.speed_mps = 14.9; }),
      state_fault("faster than the vehicle flies", "speed_max",
                  [](auto& s) { s.speed_mps = 62.1; }),
      {"goal not reached", "goal", [](Case& c) { c.states().resize(c.states().size() - 200); }},
      {"begins after the start", "start", [](Case& c) { c.begin_at(10); }},
      {"start moved together with the flight", "request.start",
       [](Case& c) {
         c.begin_at(10);
         const auto& s = c.states().front();
         c.plan.route_plan.start = {s.x_m, s.y_m, s.altitude_m};
       }},
      {"goal moved to where the flight ends", "request.goal",
       [](Case& c) {
         c.states().resize(c.states().size() - 200);
         const auto& s = c.states().back();
         c.plan.route_plan.goal = {s.x_m, s.y_m, s.altitude_m};
       }},
      {"via point not passed", "via",
       [](Case& c) { c.plan.route_plan.request.via = {place(c.map, 4000.0, 4700.0)}; }},
      {"via points in the other order", "via",
       [](Case& c) { c.plan.route_plan.request.via.push_back(place(c.map, 1500.0, 1500.0)); }},
      {"arrival promised a second early", "timetable.arrival_s",
       [](Case& c) {
         c.plan.timetable = true_timetable(c);
         c.plan.timetable->entries.back().expected.utime_us -= 1'000'000;
       }},
      {"via point promised 30 s late", "timetable.via",
       [](Case& c) {
         c.plan.timetable = true_timetable(c);
         c.plan.timetable->entries[1].expected.utime_us += 30'000'000;
       }},
      {"via point left out of the timetable", "timetable.places",
       [](Case& c) {
         c.plan.timetable = true_timetable(c);
         c.plan.timetable->entries.erase(c.plan.timetable->entries.begin() + 1);
       }},
      {"start heading not the one asked for", "request.start_heading_true_rad",
       [](Case& c) { c.plan.route_plan.request.start_heading_true_rad = 0.51; }},
      throughout("the whole flight 10 m lower", "clearance", [](auto& s) { s.altitude_m -= 10.0; }),
      {"the whole flight 20 km east", "outside_map",
       [](Case& c) {
         for (auto& s : c.states()) {
           s.x_m += 20000.0;
         }
       }},
      state_fault("a number that is none", "finite", [](auto& s) { s.climb_rate_mps = kNan; }),
      state_fault("an infinite altitude", "finite", [](auto& s) { s.altitude_m = kInfinity; }),
      {"no states", "states", [](Case& c) { c.states().clear(); }},
      {"surface column 1 cm off", "surface_column", [](Case& c) { c.middle().surface_m += 0.01; }},
      {"terrain column 1 cm off", "terrain_column", [](Case& c) { c.middle().terrain_m += 0.01; }},
      throughout("convergence 0.001 degrees off", "convergence_column",
                 [](auto& s) { s.convergence_rad += 1.7e-5; }),
  };
}

std::vector<Fault> map_faults() {
  return {
      {"spire on the path", "clearance",
       [](Case& c) {
         c.map.surface_m.at(c.map.geometry.cell_at(c.middle().point())) += 60.0F;
         c.take_map();
       }},
      {"mast of 20 cm between two states", "obstacle_clearance",
       [](Case& c) {
         const auto& a = c.states()[500];
         const auto& b = c.states()[501];
         map::Obstacle mast;
         mast.point = {0.5 * (a.x_m + b.x_m), 0.5 * (a.y_m + b.y_m)};
         mast.radius_m = 0.1;
         mast.height_m = a.altitude_m - a.terrain_m;
         mast.top_m = a.altitude_m;
         c.map.obstacles.push_back(mast);
         c.take_map();
       }},
      {"mast whose place is known to 30 m only", "obstacle_clearance",
       [](Case& c) {
         const auto& a = c.middle();
         const double azimuth_rad = a.heading_true_rad - a.convergence_rad;
         map::Obstacle mast;
         mast.point = {a.x_m + 38.0 * std::cos(azimuth_rad), a.y_m - 38.0 * std::sin(azimuth_rad)};
         mast.radius_m = 30.0;
         mast.height_m = 100.0;
         mast.top_m = a.altitude_m + 50.0;
         c.map.obstacles.push_back(mast);
         c.take_map();
       }},
      {"obstacle that is higher than the map said", "obstacle_clearance",
       [](Case& c) {
         c.map.obstacles[0].point = c.middle().point();
         c.map.obstacles[0].top_m = kNan;
         c.map.obstacles[0].height_m = kNan;
         c.take_map();
       }},
      {"wire raised into the path", "wire_clearance",
       [](Case& c) {
         for (auto& support : c.map.overhead_lines[0].supports) {
           support.height_m += 60.0;
         }
         c.take_map();
       }},
      {"wire strung across the path", "wire_clearance",
       [](Case& c) {
         const auto& a = c.middle();
         map::OverheadLine line;
         line.supports = {{{a.x_m - 150.0, a.y_m - 150.0}, 25.0},
                          {{a.x_m + 150.0, a.y_m + 150.0}, 25.0}};
         c.map.overhead_lines.push_back(line);
         c.take_map();
       }},
      {"no-fly area on the path", "no_fly_area",
       [](Case& c) {
         const auto& a = c.middle();
         map::Area area = c.map.areas[0];
         area.polygons = {{{{a.x_m - 20.0, a.y_m - 20.0},
                            {a.x_m + 20.0, a.y_m - 20.0},
                            {a.x_m + 20.0, a.y_m + 20.0},
                            {a.x_m - 20.0, a.y_m + 20.0},
                            {a.x_m - 20.0, a.y_m - 20.0}},
                           {}}};
         c.map.areas.push_back(area);
         c.take_map();
       }},
      {"area to be avoided becomes one that must not be entered", "no_fly_area",
       [](Case& c) {
         c.map.areas[1].is_hard = true;
         c.take_map();
       }},
      {"void below the path", "unknown_surface",
       [](Case& c) {
         const auto cell = c.map.geometry.cell_at(c.middle().point());
         c.map.surface_m.at(cell) = std::numeric_limits<float>::quiet_NaN();
         c.map.terrain_m.at(cell) = std::numeric_limits<float>::quiet_NaN();
         test::finish_map(c.map);
         c.plan.route_plan.map.hash = c.map.hash;
       }},
      {"map exchanged", "map",
       [](Case& c) {
         c.map.surface_m.at(0, 0) += 1.0F;
         test::finish_map(c.map);
       }},
      {"visibility of another map", "route.cost.visibility_m",
       [](Case& c) {
         c.map.visibility = raster::Grid<std::uint16_t>(c.map.geometry, 0);
         c.take_map();
       }},
      {"land use of another map", "measures.semantics_m",
       [](Case& c) {
         c.map.semantics = raster::Grid<std::uint16_t>(c.map.geometry, 0);
         c.take_map();
       }},
  };
}

std::vector<Fault> figure_faults() {
  std::vector<Fault> faults;
  const auto cost = [&](const char* name, double flight::RouteCost::*field) {
    faults.push_back({std::string("cost falsified: ") + name, std::string("route.cost.") + name,
                      [field](Case& c) { c.plan.route_plan.route.cost.*field *= 0.99; }});
  };
  cost("length_m", &flight::RouteCost::length_m);
  cost("visibility_m", &flight::RouteCost::visibility_m);
  cost("semantics_m", &flight::RouteCost::semantics_m);
  faults.push_back({"cost falsified: height_m", "route.cost.height_m",
                    [](Case& c) { c.plan.route_plan.route.cost.height_m -= 2.0; }});
  faults.push_back({"lower bound above the cost", "route.lower_bound_m", [](Case& c) {
                      flight::Route& route = c.plan.route_plan.route;
                      route.lower_bound_m = 1.01 * route.cost.total_m();
                    }});
  faults.push_back({"route that begins elsewhere", "route.waypoints",
                    [](Case& c) { c.plan.route_plan.route.waypoints.front().x_m += 1.0; }});
  const auto measure = [&](const char* name, double flight::PathMeasures::*field) {
    faults.push_back({std::string("measure falsified: ") + name, std::string("measures.") + name,
                      [field](Case& c) { c.plan.measures.*field *= 0.999; }});
  };
  measure("length_m", &flight::PathMeasures::length_m);
  measure("duration_s", &flight::PathMeasures::duration_s);
  measure("visibility_m", &flight::PathMeasures::visibility_m);
  measure("semantics_m", &flight::PathMeasures::semantics_m);
  measure("bank_rad_m", &flight::PathMeasures::bank_rad_m);
  measure("mean_height_m", &flight::PathMeasures::mean_height_m);
  measure("max_height_m", &flight::PathMeasures::max_height_m);
  measure("share_under_ceiling", &flight::PathMeasures::share_under_ceiling);
  const auto claim = [&](const char* name, double flight::Verdict::*field) {
    faults.push_back({std::string("claim falsified: ") + name, std::string("verification.") + name,
                      [field](Case& c) { c.plan.verdict.*field += 0.01; }});
  };
  claim("clearance_min_m", &flight::Verdict::clearance_min_m);
  claim("bank_max_rad", &flight::Verdict::bank_max_rad);
  claim("roll_rate_max_radps", &flight::Verdict::roll_rate_max_radps);
  claim("climb_rate_max_mps", &flight::Verdict::climb_rate_max_mps);
  claim("descent_rate_max_mps", &flight::Verdict::descent_rate_max_mps);
  claim("speed_min_mps", &flight::Verdict::speed_min_mps);
  claim("speed_max_mps", &flight::Verdict::speed_max_mps);
  claim("share_under_ceiling", &flight::Verdict::share_under_ceiling);
  claim("goal_distance_m", &flight::Verdict::goal_distance_m);
  faults.push_back({"clearance claimed at another place", "verification.clearance_min_place",
                    [](Case& c) { c.plan.verdict.clearance_min_place.x_m += 5.0; }});
  faults.push_back({"verified plan that says it is not", "verification.is_verified",
                    [](Case& c) { c.plan.verdict.is_verified = false; }});
  faults.push_back({"wrong number of violations", "verification.violation_count",
                    [](Case& c) { c.plan.verdict.violation_count = 3; }});
  return faults;
}

std::vector<Fault> file_faults() {
  const auto column = [](const char* name, const char* rule, double by) {
    return Fault{std::string("column falsified: ") + name, rule,
                 [name, by](Case& c) { falsify_column(c, name, by); }};
  };
  const auto in_json = [](const char* name, const std::string& what, const std::string& with) {
    return Fault{name, "file", [what, with](Case& c) {
                   c.damage_files = [what, with](const std::filesystem::path& folder) {
                     replace_in_file(folder / output::kPlanFile, what, with);
                   };
                 }};
  };
  const auto cut = [](const char* file) {
    return Fault{std::string(file) + " truncated", "file", [file](Case& c) {
                   c.damage_files = [file](const std::filesystem::path& folder) {
                     const std::string text = read_file(folder / file);
                     write_file_atomically(folder / file, text.substr(0, text.size() * 2 / 3));
                   };
                 }};
  };
  return {
      column("latitude_deg", "position_columns", 2e-7),
      column("longitude_deg", "position_columns", -3e-7),
      column("height_above_surface_m", "height_column", 0.001),
      column("heading_grid_rad", "heading_grid_column", 1e-6),
      {"a line removed from the table", "trajectory_file",
       [](Case& c) { c.csv.erase(c.csv.rfind('\n', c.csv.size() - 2) + 1); }},
      {"a column renamed", "trajectory_file",
       [](Case& c) { c.csv.replace(c.csv.find("height_above"), 6, "HEIGHT"); }},
      cut(output::kPlanFile),
      cut(output::kTrajectoryFile),
      in_json("total cost falsified", "\"total_m\": ", "\"total_m\": 1"),
      in_json("gap falsified", "\"gap\": 0.", "\"gap\": 0.0"),
      in_json("config changed behind its hash", "required_clearance_m: 10",
              "required_clearance_m: 9"),
      in_json("request changed behind its id", "\"seed\": 1", "\"seed\": 2"),
      in_json("verified beside violations", "\"violation_count\": 0", "\"violation_count\": 5"),
  };
}

std::vector<Fault> all_faults() {
  std::vector<Fault> all;
  for (const auto& group : {trajectory_faults(), map_faults(), figure_faults(), file_faults()}) {
    all.insert(all.end(), group.begin(), group.end());
  }
  return all;
}

std::string list_of(const std::set<std::string>& rules) {
  std::string text;
  for (const std::string& rule : rules) {
    text += " " + rule;
  }
  return text;
}

// One test for all, so that the plan is made once.
TEST(PlantedFaults, EachIsFoundUnderItsRuleAndThePlanWithoutThemIsClean) {
  const Case sound = planned_case();
  ASSERT_TRUE(sound.plan.verdict.is_verified);
  ASSERT_GT(sound.plan.measures.semantics_m, 100.0);
  EXPECT_EQ(list_of(broken_rules(sound)), "");
  Case read_back = sound;
  read_back.damage_files = [](const std::filesystem::path&) {};
  EXPECT_EQ(list_of(broken_rules(read_back)), "");
  read_back.plan.timetable = true_timetable(sound);
  EXPECT_EQ(list_of(broken_rules(read_back)), "");

  const std::vector<Fault> faults = all_faults();
  EXPECT_GE(faults.size(), 20U);
  std::set<std::string> names;
  for (const Fault& fault : faults) {
    EXPECT_TRUE(names.insert(fault.name).second) << "planted twice: " << fault.name;
    Case faulty = sound;
    const bool is_in_csv = fault.rule == "trajectory_file" || fault.rule == "height_column" ||
                           fault.rule == "position_columns" || fault.rule == "heading_grid_column";
    if (!is_in_csv) {
      faulty.csv.clear();  // written from the states as they are then
    }
    fault.plant(faulty);
    const std::set<std::string> rules = broken_rules(faulty);
    EXPECT_EQ(rules.count(fault.rule), 1U)
        << fault.name << " should break " << fault.rule << ", breaks:" << list_of(rules);
  }
  RecordProperty("faults", static_cast<int>(faults.size()));
}

TEST(PlantedFaults, CostsOfARealPlanScatterNoMoreThanStepsOfAMetreMakeThem) {
  const Case planned = planned_case();
  const verification::CostRules rules =
      verification::read_cost_rules(planned.plan.route_plan.config_text, "test");
  verification::PathSums sums(planned.map, rules);
  const flight::Route& route = planned.plan.route_plan.route;
  const auto [cost, deviation] = sums.route_cost(route.waypoints);
  EXPECT_NEAR(cost.length_m, route.cost.length_m, 1e-6 * cost.length_m);
  EXPECT_NEAR(cost.visibility_m, route.cost.visibility_m, 5.0 * deviation.visibility_m);
  EXPECT_NEAR(cost.semantics_m, route.cost.semantics_m, 5.0 * deviation.semantics_m);
  EXPECT_NEAR(cost.height_m, route.cost.height_m, 1e-4 * cost.height_m);
  EXPECT_LT(deviation.visibility_m, 1e-3 * cost.visibility_m);
  EXPECT_LT(deviation.semantics_m, 1e-3 * cost.semantics_m);
}

TEST(PlantedFaults, TermsBeyondEquationOneAreFoundFalseOneByOne) {
  map::Map map = region();
  // An observer sees all that flies, but nothing in the west.
  map.threats = {{"tower", raster::Grid<float>(map.geometry, std::nanf(""))}};
  for (int row = 0; row < 200; ++row) {
    for (int column = 60; column < 300; ++column) {
      map.threats[0].height_m.at(column, row) = 15.0F;
    }
  }
  test::finish_map(map);
  const Case sound =
      planned_case(std::move(map),
                   {"weights.soft_ceiling_m=20.5", "weights.soft_ceiling_1pm=0.05",
                    "weights.threats=3", "weights.wire_crossing_m=400", "weights.slope_along=30"});
  EXPECT_EQ(list_of(broken_rules(sound)), "");
  const flight::RouteCost& cost = sound.plan.route_plan.route.cost;
  for (std::size_t i = flight::kPaperCostTerms; i < flight::kCostTerms.size(); ++i) {
    const flight::CostTerm& term = flight::kCostTerms[i];
    EXPECT_GT(cost.*term.value_m, 20.0) << term.name;
    Case faulty = sound;
    faulty.plan.route_plan.route.cost.*term.value_m *= 0.9;
    EXPECT_EQ(broken_rules(faulty).count(std::string("route.cost.") + term.name), 1U) << term.name;
  }
  // Read back from its files it is as sound.
  Case read_back = sound;
  read_back.damage_files = [](const std::filesystem::path&) {};
  EXPECT_EQ(list_of(broken_rules(read_back)), "");
}

TEST(PlantedFaults, DarkPatchesAreFoundSmallByTheirDefinitionAsByTheMorphology) {
  std::mt19937_64 random(test::fresh_seed());
  map::Map map = test::make_map(40, 30, 30.0, [](double, double) { return 0.0; });
  for (std::uint16_t& stored : map.visibility.values()) {
    stored = static_cast<std::uint16_t>(random() % 5 * 10000);
  }
  for (const double patch_m : {50.0, 60.0, 90.0, 200.0, 5000.0}) {
    verification::CostRules rules;
    rules.small_patch_m = patch_m;
    verification::PathSums sums(map, rules);
    raster::Grid<float> shares(map.geometry, 0.0F);
    for (std::size_t i = 0; i < shares.values().size(); ++i) {
      shares.values()[i] = static_cast<float>(map::visibility_share(map.visibility.values()[i]));
    }
    const raster::Grid<float> expected = risk::without_small_patches(shares, patch_m);
    for (int row = 0; row < 30; ++row) {
      for (int column = 0; column < 40; ++column) {
        ASSERT_EQ(static_cast<float>(sums.seen_by_planners(0, {column, row})),
                  expected.at(column, row))
            << patch_m << ": " << column << ", " << row;
      }
    }
  }
}

}  // namespace
}  // namespace hedgehop::planning
