// Flies the local planner by itself and writes what it sees and does as tables of text, which
// scripts/local_figures draws: the polar histogram on terrain, a purely local flight beside a
// guided one, and flights past an area of high risk with growing weights and several passes.
//
//   local_figures MAP FOLDER
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <numbers>
#include <string>
#include <vector>

#include "base/errors.hpp"
#include "base/observer.hpp"
#include "local_planning/polar_histogram.hpp"
#include "map/map_bundle.hpp"
#include "planning/planning.hpp"

namespace {

using namespace hedgehop;
using local_planning::Flight;
using local_planning::FlownStep;
using local_planning::LocalOptions;

constexpr double kWholeWay_m = 1e6;  // look-ahead that only sees the goal, corridor without end
constexpr double kPassSpacing_m = 50.0;

class Table {
 public:
  Table(const std::string& folder, const std::string& name) : file_(folder + "/" + name) {
    if (!file_) {
      throw DataError("cannot write " + folder + "/" + name, "name a folder that exists");
    }
    file_.precision(10);
  }
  template <typename... Values>
  void row(const Values&... values) {
    ((file_ << values << ' '), ...);
    file_ << '\n';
  }

 private:
  std::ofstream file_;
};

void write_flight(const std::string& folder, const std::string& name, const Flight& flight) {
  Table table(folder, name);
  for (const FlownStep& step : flight.steps) {
    table.row(step.state.x_m, step.state.y_m, step.state.altitude_m, step.state.bank_left_rad);
  }
}

double way_m(const FlownStep& a, const FlownStep& b) {
  return std::hypot(b.state.x_m - a.state.x_m, b.state.y_m - a.state.y_m);
}

double length_m(const Flight& flight) {
  double sum_m = 0.0;
  for (std::size_t i = 1; i < flight.steps.size(); ++i) {
    sum_m += way_m(flight.steps[i - 1], flight.steps[i]);
  }
  return sum_m;
}

// Of the visibility over the way.
double risk_m(const risk::CostModel& costs, const Flight& flight) {
  double sum_m = 0.0;
  for (std::size_t i = 1; i < flight.steps.size(); ++i) {
    sum_m += way_m(flight.steps[i - 1], flight.steps[i]) *
             costs.visibility({flight.steps[i].state.x_m, flight.steps[i].state.y_m});
  }
  return sum_m;
}

double mean_height_m(const map::Map& map, const Flight& flight) {
  double sum_m2 = 0.0;
  for (std::size_t i = 1; i < flight.steps.size(); ++i) {
    const auto& state = flight.steps[i].state;
    sum_m2 += way_m(flight.steps[i - 1], flight.steps[i]) *
              (state.altitude_m - raster::sample_bilinear(map.surface_m, {state.x_m, state.y_m}));
  }
  return sum_m2 / length_m(flight);
}

std::vector<flight::Waypoint> guide_of(const Flight& flight) {
  std::vector<flight::Waypoint> points;
  double since_m = kPassSpacing_m;
  for (std::size_t i = 0; i < flight.steps.size(); ++i) {
    since_m += i > 0 ? way_m(flight.steps[i - 1], flight.steps[i]) : 0.0;
    const auto& state = flight.steps[i].state;
    if (since_m >= kPassSpacing_m || i + 1 == flight.steps.size()) {
      points.push_back({state.x_m, state.y_m, state.altitude_m});
      since_m = 0.0;
    }
  }
  return points;
}

Flight flown(const risk::CostModel& costs, const planning::PlanningConfig& config,
             const LocalOptions& options, const std::vector<flight::Waypoint>& guide) {
  SilentObserver observer;
  auto answer = local_planning::fly_along(
      costs, config.vehicle, options, guide,
      local_planning::state_at_start(guide, config.speed_mps, config.vehicle.limits),
      config.speed_mps, {}, observer);
  if (const auto* none = std::get_if<flight::NoPlan>(&answer)) {
    throw DataError(none->explanation);
  }
  return std::get<Flight>(std::move(answer));
}

LocalOptions purely_local(const planning::PlanningConfig& config) {
  LocalOptions options = config.local;
  options.mode = local_planning::LocalMode::kTvfh;
  options.passes = 1;
  options.steering = local_planning::Steering::kCheapest;
  options.semantics_weight = 0.0;
  options.visibility_weight = 0.0;
  options.weights.climb = 0.0;
  options.weights.climb_relative = 0.0;
  options.look_ahead_m = kWholeWay_m;
  options.corridor_m = kWholeWay_m;
  return options;
}

// Figure 5: where along a flight the terrain asks for most.
void draw_histogram(const map::Map& map, const planning::PlanningConfig& config,
                    const Flight& flight, const std::string& folder) {
  const LocalOptions& local = config.local;
  const risk::CostModel costs = planning::cost_model(map, config);
  const local_planning::LocalGround ground = local_planning::local_ground(costs, local);
  const double disc_m = local.safety_radius_m + 0.5 * std::numbers::sqrt2 * map.geometry.cell_m;
  local_planning::HistogramKernel kernel(
      ground.surroundings,
      {local.window_m, local.sectors, disc_m, local.safety_height_m, local.near_distance_m,
       local.truncation_angle_rad, local.truncation_distance_m, local.arc_radius_max_factor,
       local.is_arc_widened});
  const command_model::CommandModel model(config.vehicle);
  const auto turn_radius_m = [&](const command_model::ModelState& state) {
    return flight::turn_radius_min_m(state.speed_mps, model.bank_command_max_rad());
  };
  const auto limit = [&](const command_model::ModelState& state) {
    return local.climb_share * config.vehicle.limits.climb_rate_max_mps / state.speed_mps;
  };
  local_planning::PolarHistogram histogram;
  std::size_t chosen = 0;
  int most = -1;
  for (std::size_t i = 0; i < flight.steps.size(); i += 40) {
    const auto& state = flight.steps[i].state;
    kernel.compute({state.x_m, state.y_m}, state.altitude_m, state.heading_math_rad,
                   turn_radius_m(state), histogram);
    int masked = 0;
    for (int k = 0; k < local.sectors; ++k) {
      const auto at = static_cast<std::size_t>(k);
      const auto most_climb = static_cast<float>(limit(state));
      masked += histogram.tan_climb[at] > most_climb || histogram.tan_masked[at] > most_climb;
    }
    const int balance = std::min(masked, local.sectors - masked);
    if (balance > most) {
      most = balance;
      chosen = i;
    }
  }
  const auto& state = flight.steps[chosen].state;
  kernel.compute({state.x_m, state.y_m}, state.altitude_m, state.heading_math_rad,
                 turn_radius_m(state), histogram);
  Table sectors(folder, "histogram_sectors.txt");
  for (int k = 0; k < local.sectors; ++k) {
    const auto at = static_cast<std::size_t>(k);
    sectors.row(kernel.sectors().centre_rad(k), histogram.tan_climb[at], histogram.tan_masked[at],
                histogram.tan_masked[at] <= static_cast<float>(limit(state)) ? 1 : 0);
  }
  Table view(folder, "histogram_view.txt");
  view.row(state.x_m, state.y_m, state.altitude_m, state.heading_math_rad, limit(state),
           local.window_m, turn_radius_m(state), local.safety_height_m);
  Table terrain(folder, "histogram_terrain.txt");
  const double reach_m = local.window_m + 150.0;
  for (double y_m = -reach_m; y_m <= reach_m; y_m += 10.0) {
    for (double x_m = -reach_m; x_m <= reach_m; x_m += 10.0) {
      terrain.row(x_m, y_m,
                  raster::sample_bilinear(map.surface_m, {state.x_m + x_m, state.y_m + y_m}));
    }
    terrain.row();
  }
}

// Figure 6, and the flight of figure 5.
Flight draw_guided(const map::Map& map, const planning::PlanningConfig& config,
                   const std::string& folder, Table& numbers) {
  const geo::MapProjection projection(map.crs_wkt);
  const raster::GridGeometry& g = map.geometry;
  const auto at = [&](double east, double north) {
    return geo::MapPoint{g.west_m + east * (g.east_m() - g.west_m),
                         g.south_m + north * (g.north_m() - g.south_m)};
  };
  flight::PlanRequest request;
  request.start.position = projection.to_geodetic(at(0.15, 0.2));
  request.goal.position = projection.to_geodetic(at(0.85, 0.8));
  request.seed = 1;
  SilentObserver observer;
  auto planned = planning::plan_route(map, request, config, {}, observer);
  if (const auto* none = std::get_if<flight::NoPlan>(&planned)) {
    throw DataError(none->explanation);
  }
  const auto& route = std::get<flight::RoutePlan>(planned);
  const risk::CostModel costs = planning::cost_model(map, config);
  LocalOptions options = purely_local(config);
  const Flight local = flown(costs, config, options, {route.start, route.goal});
  options.look_ahead_m = config.local.look_ahead_m;
  const Flight guided = flown(costs, config, options, route.route.guide);
  write_flight(folder, "purely_local.txt", local);
  write_flight(folder, "guided.txt", guided);
  for (const auto& [name, flight] : {std::pair("purely_local", &local), {"guided", &guided}}) {
    numbers.row(name, 0.0, length_m(*flight), risk_m(costs, *flight), mean_height_m(map, *flight));
  }
  Table terrain(folder, "region.txt");
  for (int row = 0; row < g.rows; row += 4) {
    for (int column = 0; column < g.columns; column += 4) {
      const geo::MapPoint centre = g.centre({column, row});
      terrain.row(centre.x_m, centre.y_m, map.surface_m.at(column, row));
    }
    terrain.row();
  }
  return local;
}

// Figure 8: flat ground, and a strip that is seen from everywhere.
void draw_weights(const planning::PlanningConfig& config, const std::string& crs_wkt,
                  const std::string& folder, Table& numbers) {
  map::Map map;
  map.geometry = {0.0, 0.0, 30.0, 320, 280};
  map.crs_wkt = crs_wkt;
  map.reference_height_m = config.reference_height_m;
  map.visibility_radius_m = 1.0;
  map.terrain_m = raster::Grid<float>(map.geometry, 100.0F);
  map.surface_m = map.terrain_m;
  map.semantics = raster::Grid<std::uint16_t>(map.geometry, 0);
  map.visibility = raster::Grid<std::uint16_t>(map.geometry, 0);
  Table seen(folder, "seen.txt");
  for (int row = 0; row < map.geometry.rows; ++row) {
    for (int column = 0; column < map.geometry.columns; ++column) {
      const geo::MapPoint centre = map.geometry.centre({column, row});
      // Off a strip that leads away from the goal: half its width and its edge.
      const double along =
          ((centre.x_m - 3200.0) * 3600.0 + (centre.y_m - 1200.0) * 5400.0) / (6490.0 * 6490.0);
      const double t = std::clamp(along, 0.0, 1.0);
      const double off_m =
          std::hypot(centre.x_m - 3200.0 - 3600.0 * t, centre.y_m - 1200.0 - 5400.0 * t);
      const double share = 0.3 + 0.7 * std::clamp((400.0 - off_m) / 200.0, 0.0, 1.0);
      map.visibility.at(column, row) =
          static_cast<std::uint16_t>(std::lround(share * map::kVisibilityScale));
      if (row % 2 == 0 && column % 2 == 0) {
        seen.row(centre.x_m, centre.y_m, share);
      }
    }
    if (row % 2 == 0) {
      seen.row();
    }
  }
  const risk::CostModel costs(map, config.weights, config.semantics, 1.0);
  const std::vector<flight::Waypoint> straight{{900.0, 3000.0, 140.0}, {8700.0, 3000.0, 140.0}};
  int number = 0;
  for (const double weight : {0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0}) {
    LocalOptions options = purely_local(config);
    options.visibility_weight = weight;
    Flight flight = flown(costs, config, options, straight);
    const std::string name = std::to_string(number++) + ".txt";
    write_flight(folder, "once_" + name, flight);
    numbers.row("once", weight, length_m(flight), risk_m(costs, flight), 40.0);
    options.look_ahead_m = config.local.look_ahead_m;
    for (int pass = 1; pass < 3; ++pass) {
      options.window_m -= options.window_shrink_m;
      flight = flown(costs, config, options, guide_of(flight));
    }
    write_flight(folder, "thrice_" + name, flight);
    numbers.row("thrice", weight, length_m(flight), risk_m(costs, flight), 40.0);
  }
}

void run(const std::string& map_folder, const std::string& folder) {
  const planning::PlanningConfig config = planning::read_planning_config(
      planning::effective_planning_config("", {}), "shipped planning config");
  const map::Map map = map::read_map_bundle(map_folder);
  Table numbers(folder, "numbers.txt");
  const Flight local = draw_guided(map, config, folder, numbers);
  draw_histogram(map, config, local, folder);
  draw_weights(config, map.crs_wkt, folder, numbers);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fputs("usage: local_figures MAP FOLDER\n", stderr);
    return 2;
  }
  try {
    run(argv[1], argv[2]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
  return 0;
}
