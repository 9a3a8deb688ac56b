#include "evaluation/local_flights.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <oneapi/tbb/parallel_for.h>
#include <optional>

#include "base/config_reader.hpp"
#include "base/errors.hpp"
#include "command_model/planned_state.hpp"
#include "evaluation/flown_route.hpp"
#include "global_planning/random_source.hpp"

namespace hedgehop::evaluation {
namespace {

using planning::PlanningConfig;
using planning::RouteFlight;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kCostRounding = 1e-9;

// What table 2 needs of a flight.
struct Outcome {
  bool is_reached = false;
  bool is_verified = false;
  bool is_following = false;
  double cost_m = 0.0;
  flight::PathMeasures measures;
};

Outcome outcome_of(const std::optional<RouteFlight>& flight) {
  if (!flight) {
    return {};
  }
  return {true, flight->verdict.is_verified, flight->is_following, flight->cost_m,
          flight->measures};
}

Table2Comparison compared(const std::string& name, const std::vector<Outcome>& optimised,
                          const std::vector<Outcome>& plain, const Table2Options& options,
                          std::uint64_t seed) {
  Table2Comparison result;
  result.name = name;
  struct Column {
    PairedChange* change;
    double (*value)(const Outcome&);
    std::vector<double> values;
    std::vector<double> baseline;
  };
  std::array<Column, 6> columns{
      {{&result.length, [](const Outcome& o) { return o.measures.length_m; }, {}, {}},
       {&result.visibility, [](const Outcome& o) { return o.measures.visibility_m; }, {}, {}},
       {&result.semantics, [](const Outcome& o) { return o.measures.semantics_m; }, {}, {}},
       {&result.height, [](const Outcome& o) { return o.measures.mean_height_m; }, {}, {}},
       {&result.bank, [](const Outcome& o) { return o.measures.bank_rad_m; }, {}, {}},
       {&result.cost, [](const Outcome& o) { return o.cost_m; }, {}, {}}}};
  for (std::size_t i = 0; i < plain.size(); ++i) {
    if (!optimised[i].is_reached || !plain[i].is_reached) {
      continue;
    }
    ++result.pairs;
    result.not_verified += optimised[i].is_verified ? 0 : 1;
    result.plain_taken += optimised[i].is_following ? 1 : 0;
    // A plain flight that breaks a demand is no plan that one could be worse than.
    result.regressions +=
        plain[i].is_verified && optimised[i].cost_m > plain[i].cost_m * (1.0 + kCostRounding) ? 1
                                                                                              : 0;
    for (Column& column : columns) {
      column.values.push_back(column.value(optimised[i]));
      column.baseline.push_back(column.value(plain[i]));
    }
  }
  if (result.pairs > 0) {
    for (Column& column : columns) {
      *column.change = paired_change(column.values, column.baseline, options.bootstrap_draws, seed);
    }
  }
  return result;
}

// What local safety needs of a flight.
struct SafetyOutcome {
  bool is_reached = false;
  bool is_verified = false;
  bool has_way_out = false;
  double clearance_min_m = kNan;
  double length_m = 0.0;
  double height_integral_m2 = 0.0;
  double low_m = 0.0;
  double off_towers_m = 0.0;
  double low_off_towers_m = 0.0;
};

// Cells whose centres lie within `radius_m` of a tower.
raster::Grid<std::uint8_t> near_towers(const raster::GridGeometry& geometry,
                                       const std::vector<geo::MapPoint>& towers, double radius_m) {
  raster::Grid<std::uint8_t> near(geometry, 0);
  const int reach = static_cast<int>(radius_m / geometry.cell_m);
  for (const geo::MapPoint& tower : towers) {
    const raster::CellIndex at = geometry.cell_at(tower);
    for (int row = -reach; row <= reach; ++row) {
      for (int column = -reach; column <= reach; ++column) {
        const raster::CellIndex cell{at.column + column, at.row + row};
        if (geometry.contains(cell) &&
            geometry.cell_m * geometry.cell_m * (row * row + column * column) <=
                radius_m * radius_m) {
          near.at(cell) = 1;
        }
      }
    }
  }
  return near;
}

SafetyOutcome safety_of(const std::optional<RouteFlight>& flight,
                        const raster::Grid<std::uint8_t>& near, double ceiling_m) {
  SafetyOutcome outcome;
  if (!flight) {
    return outcome;
  }
  outcome.is_reached = true;
  outcome.is_verified = flight->verdict.is_verified;
  outcome.clearance_min_m = flight->verdict.clearance_min_m;
  outcome.length_m = flight->measures.length_m;
  outcome.height_integral_m2 = flight->measures.mean_height_m * flight->measures.length_m;
  outcome.low_m = flight->measures.share_under_ceiling * flight->measures.length_m;
  const std::vector<flight::FlightState>& states = flight->trajectory.states;
  for (std::size_t i = 1; i < states.size(); ++i) {
    const raster::CellIndex cell = near.geometry().cell_at(states[i].point());
    if (near.geometry().contains(cell) && near.at(cell) != 0) {
      continue;
    }
    const double dx_m = states[i].x_m - states[i - 1].x_m;
    const double dy_m = states[i].y_m - states[i - 1].y_m;
    const double way_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    outcome.off_towers_m += way_m;
    if (states[i].altitude_m - states[i].surface_m <= ceiling_m) {
      outcome.low_off_towers_m += way_m;
    }
  }
  return outcome;
}

// Whether a flight that is cut off after `share` of its steps has a way out that verifies.
bool has_way_out(const RouteFlight& flown, const map::Map& map, const PlanningConfig& config,
                 const planning::ReactionOptions& options, double share) {
  const std::vector<flight::FlightState>& states = flown.trajectory.states;
  const auto step = static_cast<std::size_t>(share * static_cast<double>(states.size() - 1));
  const flight::FlightState& here = states[step];
  const planning::FlightUnderPlan flight{&flown.trajectory, step,
                                         command_model::model_state_of(here, config.vehicle.wind),
                                         command_model::command_of(here).heading_math_rad};
  const map::Map ground =
      planning::map_part(map, planning::window_of_reaction(map.geometry, options, flight));
  return planning::way_out_from(ground, config, options, flight).kind ==
         planning::ReactionKind::kWayOut;
}

// What flying over one map costs, and the ground that flights look at, made once for all rows that
// have it in common.
class SharedGrounds {
 public:
  SharedGrounds(const map::Map& map, const std::vector<PlanningConfig>& configs,
                const std::vector<std::size_t>& first_alike)
      : map_(map), configs_(configs), first_alike_(first_alike), made_(configs.size()) {}

  void make(std::size_t row) {
    std::unique_ptr<Made>& made = made_[first_alike_[row]];
    if (!made) {
      made = std::make_unique<Made>(planning::cost_model(map_, configs_[row]));
    }
    made->grounds.make(configs_[row].local);
  }
  void surface_changed(const std::vector<raster::CellIndex>& cells) {
    for (const std::unique_ptr<Made>& made : made_) {
      if (made) {
        made->costs.surface_changed(cells);
        made->grounds.surface_changed(cells);
      }
    }
  }
  [[nodiscard]] const planning::RouteGrounds& of(std::size_t row) const {
    return made_[first_alike_[row]]->grounds;
  }

 private:
  struct Made {
    explicit Made(risk::CostModel of) : costs(std::move(of)) {}
    risk::CostModel costs;
    planning::RouteGrounds grounds{costs};
  };
  const map::Map& map_;
  const std::vector<PlanningConfig>& configs_;
  const std::vector<std::size_t>& first_alike_;
  std::vector<std::unique_ptr<Made>> made_;
};

// A map of its own on which towers are put up and taken down again.
class TowerGround {
 public:
  TowerGround(const map::Map& bare, const LocalSafetyOptions& options,
              const std::vector<PlanningConfig>& configs,
              const std::vector<std::size_t>& first_alike)
      : bare_(bare), options_(options), map_(bare), grounds_(map_, configs, first_alike) {
    for (std::size_t r = 0; r < configs.size(); ++r) {
      if (options.rows[r].has_towers) {
        grounds_.make(r);
      }
    }
  }
  TowerGround(const TowerGround&) = delete;
  TowerGround& operator=(const TowerGround&) = delete;

  // Where they stand.
  std::vector<geo::MapPoint> put_up(const DrawnRoute& route, std::uint64_t seed) {
    const std::vector<geo::MapPoint> towers = add_towers(map_, options_, route, seed);
    for (const geo::MapPoint& tower : towers) {
      cells_.push_back(map_.geometry.cell_at(tower));
    }
    grounds_.surface_changed(cells_);
    return towers;
  }
  void take_down() {
    for (const raster::CellIndex& cell : cells_) {
      map_.surface_m.at(cell) = bare_.surface_m.at(cell);
    }
    grounds_.surface_changed(cells_);
    cells_.clear();
  }
  [[nodiscard]] const planning::RouteGrounds& of(std::size_t row) const { return grounds_.of(row); }

 private:
  const map::Map& bare_;
  const LocalSafetyOptions& options_;
  map::Map map_;
  SharedGrounds grounds_;
  std::vector<raster::CellIndex> cells_;
};

// As many as there are flights at the same time.
class TowerGrounds {
 public:
  using Make = std::function<std::unique_ptr<TowerGround>()>;
  explicit TowerGrounds(Make make) : make_(std::move(make)) {}

  std::unique_ptr<TowerGround> borrowed() {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        std::unique_ptr<TowerGround> ground = std::move(idle_.back());
        idle_.pop_back();
        return ground;
      }
    }
    return make_();
  }
  // With its towers taken down.
  void give_back(std::unique_ptr<TowerGround> ground) {
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(ground));
  }

 private:
  Make make_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<TowerGround>> idle_;
};

// For each config the first one that is the same but for its section local.
std::vector<std::size_t> first_alike(const std::vector<PlanningConfig>& configs) {
  std::vector<std::string> rest;
  std::vector<std::size_t> first;
  for (const PlanningConfig& config : configs) {
    rest.push_back(without_config_key(config.text, "planning config", "local"));
    first.push_back(
        static_cast<std::size_t>(std::find(rest.begin(), rest.end(), rest.back()) - rest.begin()));
  }
  return first;
}

/// Runs `work` for 0 to count - 1 in parallel and marks what was finished; throws Interrupted if
/// that is nothing.
template <typename Work>
void for_each_until_stopped(std::size_t count, std::vector<char>& is_done, const Observer& observer,
                            const Work& work) {
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    if (observer.stop_requested()) {
      return;
    }
    try {
      work(i);
    } catch (const Interrupted&) {
      return;
    }
    is_done[i] = observer.stop_requested() ? 0 : 1;  // it may have ended early
  });
  if (std::find(is_done.begin(), is_done.end(), 1) == is_done.end()) {
    observer.check_stop();
  }
}

template <typename T>
void keep_done(const std::vector<char>& is_done, std::vector<T>& values) {
  std::vector<T> kept;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (is_done[i] != 0) {
      kept.push_back(std::move(values[i]));
    }
  }
  values = std::move(kept);
}

LocalSafetyRow row_of(const LocalSafetyOptions::Row& asked,
                      const std::vector<SafetyOutcome>& outcomes, const DrawnRoutes& routes,
                      double required_clearance_m) {
  LocalSafetyRow row;
  row.planner = asked.planner;
  row.has_towers = asked.has_towers;
  row.settings = asked.settings;
  row.flights = static_cast<std::int64_t>(outcomes.size());
  row.min_clearance_m = kNan;
  double height_integral_m2 = 0.0;
  double clearance_sum_m = 0.0;
  double low_m = 0.0;
  double off_towers_m = 0.0;
  double low_off_towers_m = 0.0;
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const SafetyOutcome& outcome = outcomes[i];
    const bool is_clear = outcome.is_reached && outcome.clearance_min_m >= required_clearance_m;
    if (!is_clear) {
      row.unsafe_problems.push_back(routes.routes[i].problem);
    }
    if (!outcome.is_reached) {
      continue;
    }
    ++row.reached;
    row.collisions += outcome.clearance_min_m > 0.0 ? 0 : 1;
    row.clearance_violations += is_clear ? 0 : 1;
    row.not_verified += outcome.is_verified ? 0 : 1;
    row.ways_out += outcome.has_way_out ? 1 : 0;
    row.min_clearance_m = std::fmin(row.min_clearance_m, outcome.clearance_min_m);
    clearance_sum_m += outcome.clearance_min_m;
    row.length_m += outcome.length_m;
    height_integral_m2 += outcome.height_integral_m2;
    low_m += outcome.low_m;
    off_towers_m += outcome.off_towers_m;
    low_off_towers_m += outcome.low_off_towers_m;
  }
  const auto share = [](double part, double whole) { return whole > 0.0 ? part / whole : kNan; };
  row.mean_min_clearance_m = share(clearance_sum_m, static_cast<double>(row.reached));
  row.mean_height_m = share(height_integral_m2, row.length_m);
  row.share_under_ceiling = share(low_m, row.length_m);
  row.share_under_ceiling_off_towers = share(low_off_towers_m, off_towers_m);
  return row;
}

}  // namespace

Table2Options read_table2_options(ConfigReader& reader) {
  Table2Options options;
  options.runs = reader.required_integer("runs");
  options.bootstrap_draws = reader.required_integer("bootstrap_draws");
  options.plain_settings = reader.required_strings("plain_settings");
  options.lateral_settings = reader.required_strings("lateral_settings");
  reader.require(options.runs >= 1 && options.runs <= 100000, "runs",
                 "must lie between 1 and 100000");
  reader.require(options.bootstrap_draws >= 100 && options.bootstrap_draws <= 1000000,
                 "bootstrap_draws", "must lie between 100 and 1000000");
  reader.finish();
  return options;
}

LocalSafetyOptions read_local_safety_options(ConfigReader& reader) {
  LocalSafetyOptions options;
  options.flights = reader.required_integer("flights");
  options.towers_per_km2 = reader.required_double("towers_per_km2");
  options.tower_height_min_m = reader.required_double("tower_height_min_m");
  options.tower_height_max_m = reader.required_double("tower_height_max_m");
  options.tower_free_radius_m = reader.required_double("tower_free_radius_m");
  options.tower_near_m = reader.required_double("tower_near_m");
  for (ConfigReader& section : reader.required_sections("rows")) {
    LocalSafetyOptions::Row row;
    row.planner = section.required_string("planner");
    row.has_towers = section.required_bool("towers");
    row.settings = section.required_strings("settings");
    section.finish();
    options.rows.push_back(std::move(row));
  }
  reader.require(options.flights >= 1 && options.flights <= 100000, "flights",
                 "must lie between 1 and 100000");
  reader.require(options.towers_per_km2 >= 0.0 && options.towers_per_km2 <= 1000.0,
                 "towers_per_km2", "must lie between 0 and 1000");
  reader.require(options.tower_height_min_m >= 0.0, "tower_height_min_m", "must not be negative");
  reader.require(options.tower_height_max_m >= options.tower_height_min_m &&
                     options.tower_height_max_m <= 1000.0,
                 "tower_height_max_m", "must lie between tower_height_min_m and 1000");
  reader.require(options.tower_free_radius_m >= 0.0, "tower_free_radius_m", "must not be negative");
  reader.require(options.tower_near_m >= 0.0 && options.tower_near_m <= 10000.0, "tower_near_m",
                 "must lie between 0 and 10000");
  reader.require(!options.rows.empty(), "rows", "must name a planner");
  reader.finish();
  return options;
}

Table2Result evaluate_table2(const map::Map& map, const PlanningConfig& config,
                             const Table2Options& options, const DrawnRoutes& routes,
                             std::uint64_t seed, Observer& observer) {
  const PlanningConfig plain_config = config_with(config.text, options.plain_settings);
  const PlanningConfig lateral_config = config_with(config.text, options.lateral_settings);
  const risk::CostModel costs = planning::cost_model(map, config);
  planning::RouteGrounds grounds(costs);
  for (const PlanningConfig* of : {&plain_config, &lateral_config, &config}) {
    grounds.make(of->local);
  }
  const std::size_t count = routes.routes.size();
  std::vector<Outcome> plain(count);
  std::vector<Outcome> lateral(count);
  std::vector<Outcome> optimised(count);
  std::vector<char> is_done(count, 0);
  std::atomic<std::size_t> done{0};
  for_each_until_stopped(count, is_done, observer, [&](std::size_t i) {
    const DrawnRoute& route = routes.routes[i];
    plain[i] = outcome_of(flown(grounds, plain_config, route, observer));
    lateral[i] = outcome_of(flown(grounds, lateral_config, route, observer));
    optimised[i] = outcome_of(flown(grounds, config, route, observer));
    observer.progress("flights", static_cast<double>(++done), static_cast<double>(count));
  });
  keep_done(is_done, plain);
  keep_done(is_done, lateral);
  keep_done(is_done, optimised);

  Table2Result result;
  result.seed = seed;
  result.is_stopped = plain.size() < count;
  result.map_hash = map.hash.hex();
  result.runs = static_cast<std::int64_t>(plain.size());
  result.problems = routes.problems;
  for (const Outcome& outcome : plain) {
    result.plain_not_reached += outcome.is_reached ? 0 : 1;
    result.plain_not_verified += outcome.is_reached && !outcome.is_verified ? 1 : 0;
  }
  result.comparisons.push_back(compared("optimised", optimised, plain, options, seed));
  result.comparisons.push_back(compared("lateral", lateral, plain, options, seed));
  return result;
}

std::vector<geo::MapPoint> add_towers(map::Map& map, const LocalSafetyOptions& options,
                                      const DrawnRoute& route, std::uint64_t seed) {
  const raster::GridGeometry& geometry = map.geometry;
  const double area_km2 =
      1e-6 * geometry.cell_m * geometry.cell_m * geometry.columns * geometry.rows;
  const auto count = static_cast<std::int64_t>(std::floor(options.towers_per_km2 * area_km2 + 0.5));
  global_planning::RandomSource random(seed);
  std::vector<geo::MapPoint> towers;
  for (std::int64_t tower = 0; tower < count; ++tower) {
    const raster::CellIndex cell{static_cast<int>(random.unit() * geometry.columns),
                                 static_cast<int>(random.unit() * geometry.rows)};
    const double height_m =
        options.tower_height_min_m +
        random.unit() * (options.tower_height_max_m - options.tower_height_min_m);
    const geo::MapPoint place = geometry.centre(cell);
    const auto is_free = [&](const flight::Waypoint& end) {
      const double dx_m = place.x_m - end.x_m;
      const double dy_m = place.y_m - end.y_m;
      return dx_m * dx_m + dy_m * dy_m >= options.tower_free_radius_m * options.tower_free_radius_m;
    };
    if (is_free(route.start) && is_free(route.goal)) {
      // From the ground: a second tower on the same cell does not stand on the first.
      map.surface_m.at(cell) =
          std::max(map.surface_m.at(cell),
                   static_cast<float>(static_cast<double>(map.terrain_m.at(cell)) + height_m));
      towers.push_back(place);
    }
  }
  return towers;
}

LocalSafetyResult evaluate_local_safety(const map::Map& map, const std::string& config_text,
                                        const LocalSafetyOptions& options,
                                        const planning::ReactionOptions& cut_off,
                                        const DrawnRoutes& routes, std::uint64_t seed,
                                        Observer& observer) {
  std::vector<PlanningConfig> configs;
  for (const LocalSafetyOptions::Row& row : options.rows) {
    configs.push_back(config_with(config_text, row.settings));
  }
  const std::vector<std::size_t> alike = first_alike(configs);
  SharedGrounds bare(map, configs, alike);
  bool has_towers = false;
  for (std::size_t r = 0; r < configs.size(); ++r) {
    if (options.rows[r].has_towers) {
      has_towers = true;
    } else {
      bare.make(r);  // before the threads that share it
    }
  }
  const std::size_t count = routes.routes.size();
  std::vector<std::vector<SafetyOutcome>> outcomes(options.rows.size(),
                                                   std::vector<SafetyOutcome>(count));
  const raster::Grid<std::uint8_t> no_towers(map.geometry, 0);
  std::vector<char> is_done(count, 0);
  std::atomic<std::size_t> done{0};
  TowerGrounds tower_grounds(
      [&] { return std::make_unique<TowerGround>(map, options, configs, alike); });
  for_each_until_stopped(count, is_done, observer, [&](std::size_t i) {
    const DrawnRoute& route = routes.routes[i];
    const std::uint64_t route_seed = seed + static_cast<std::uint64_t>(route.problem);
    const double cut_share = global_planning::RandomSource(~route_seed).unit();
    const auto fly = [&](std::size_t r, const planning::RouteGrounds& grounds,
                         const raster::Grid<std::uint8_t>& near) {
      const std::optional<RouteFlight> flight = flown(grounds, configs[r], route, observer);
      outcomes[r][i] = safety_of(flight, near, configs[r].demands.ceiling_height_m);
      outcomes[r][i].has_way_out =
          flight && has_way_out(*flight, grounds.costs().map(), configs[r], cut_off, cut_share);
    };
    for (std::size_t r = 0; r < options.rows.size(); ++r) {
      if (!options.rows[r].has_towers) {
        fly(r, bare.of(r), no_towers);
      }
    }
    if (has_towers) {
      std::unique_ptr<TowerGround> ground = tower_grounds.borrowed();
      const auto near =
          near_towers(map.geometry, ground->put_up(route, route_seed), options.tower_near_m);
      for (std::size_t r = 0; r < options.rows.size(); ++r) {
        if (options.rows[r].has_towers) {
          fly(r, ground->of(r), near);
        }
      }
      ground->take_down();
      tower_grounds.give_back(std::move(ground));
    }
    observer.progress("flights", static_cast<double>(++done), static_cast<double>(count));
  });
  DrawnRoutes flown_routes = routes;
  keep_done(is_done, flown_routes.routes);
  for (std::vector<SafetyOutcome>& row : outcomes) {
    keep_done(is_done, row);
  }

  LocalSafetyResult result;
  result.seed = seed;
  result.is_stopped = flown_routes.routes.size() < count;
  result.map_hash = map.hash.hex();
  result.problems = routes.problems;
  result.options = options;
  result.cut_off = cut_off;
  for (std::size_t r = 0; r < options.rows.size(); ++r) {
    result.required_clearance_m = configs[r].demands.required_clearance_m;
    result.rows.push_back(row_of(options.rows[r], outcomes[r], flown_routes,
                                 configs[r].demands.required_clearance_m));
  }
  return result;
}

}  // namespace hedgehop::evaluation
