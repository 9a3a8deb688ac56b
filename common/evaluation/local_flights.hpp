#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "evaluation/drawn_routes.hpp"
#include "evaluation/paired_statistics.hpp"
#include "planning/reaction.hpp"
#include "planning/route_flight.hpp"

namespace hedgehop::evaluation {

/// Section `table2` of the evaluation config.
struct Table2Options {
  std::int64_t runs = 0;
  std::int64_t bootstrap_draws = 0;
  std::vector<std::string> plain_settings;    // on top of the planning config: follow the route
  std::vector<std::string> lateral_settings;  // likewise: optimised, but as high as it was flown
};
Table2Options read_table2_options(ConfigReader& reader);

/// Section `local_safety` of the evaluation config.
struct LocalSafetyOptions {
  struct Row {
    std::string planner;
    bool has_towers = false;
    std::vector<std::string> settings;  // on top of the planning config
  };
  std::int64_t flights = 0;
  double towers_per_km2 = 0.0;
  double tower_height_min_m = 0.0;
  double tower_height_max_m = 0.0;
  double tower_free_radius_m = 0.0;  // around start and goal
  double tower_near_m = 0.0;         // the ceiling is not asked for nearer to a tower than this
  std::vector<Row> rows;
};
LocalSafetyOptions read_local_safety_options(ConfigReader& reader);

/// The measures of table 2 of the paper, one optimising arm against plain following.
struct Table2Comparison {
  std::string name;
  std::int64_t pairs = 0;  // both reached the goal
  std::int64_t not_verified = 0;
  std::int64_t regressions = 0;  // total cost above that of a plain flight that verifies
  std::int64_t plain_taken = 0;  // the optimised flight cost more, so the plain one was returned
  PairedChange length;
  PairedChange visibility;
  PairedChange semantics;
  PairedChange height;  // mean above the surface
  PairedChange bank;    // integral of |bank| over the way
  PairedChange cost;    // eq. (1) and roughness
};

struct Table2Result {
  std::uint64_t seed = 0;
  bool is_stopped = false;  // by the observer; then `runs` are those that were finished
  std::string map_hash;
  std::int64_t runs = 0;
  std::int64_t problems = 0;  // drawn for so many routes
  std::int64_t plain_not_reached = 0;
  std::int64_t plain_not_verified = 0;
  std::vector<Table2Comparison> comparisons;
};

/// Local planning with its optimisation against local planning that only follows, on the same
/// global routes (table 2 of the paper).
///
/// Compared are the flights with `config` as it is ("optimised") and the same without the vertical
/// pass ("lateral"), each with the flights under `plain_settings`.
/// @throws Interrupted  if the observer says so.
/// @note  On all threads that oneTBB may use; the result does not depend on how many those are.
Table2Result evaluate_table2(const map::Map& map, const planning::PlanningConfig& config,
                             const Table2Options& options, const DrawnRoutes& routes,
                             std::uint64_t seed, Observer& observer);

struct LocalSafetyRow {
  std::string planner;
  bool has_towers = false;
  std::vector<std::string> settings;
  std::int64_t flights = 0;
  std::int64_t reached = 0;               // the goal; the figures below are of these
  std::int64_t collisions = 0;            // the path between two states touches the surface
  std::int64_t clearance_violations = 0;  // comes nearer to it than is required
  std::int64_t not_verified = 0;          // breaks any demand
  std::int64_t ways_out = 0;              // cut off at a drawn moment, it has one that verifies
  double min_clearance_m = 0.0;           // of all flights; NaN for none
  double mean_min_clearance_m = 0.0;      // mean of each flight's least one
  double mean_height_m = 0.0;             // above the surface, over the length of all flights
  double share_under_ceiling = 0.0;
  double share_under_ceiling_off_towers = 0.0;  // of the way farther from towers than stated
  double length_m = 0.0;                        // of all flights
  std::vector<std::int64_t> unsafe_problems;    // not reached, or nearer than required
};

struct LocalSafetyResult {
  std::uint64_t seed = 0;
  bool is_stopped = false;  // by the observer; then rows hold the flights that were finished
  std::string map_hash;
  std::int64_t problems = 0;
  LocalSafetyOptions options;
  planning::ReactionOptions cut_off;
  double required_clearance_m = 0.0;
  std::vector<LocalSafetyRow> rows;
};

/// How safely local planning flies global routes, with and without towers that the global planner
/// did not know. All rows fly the same routes; all rows with towers fly among the same ones, drawn
/// for each flight anew: places uniform over the cells, heights uniform, none near start and goal.
///
/// Clearance is the independent verifier's, swept along the path between the states. Each flight
/// that reaches the goal is cut off once, at a moment that is drawn uniformly, the same share of it
/// in all rows; the same verifier judges the way out, see planning::way_out_from().
///
/// @param cut_off  what the service command_model has for reactions
/// @throws Interrupted  if the observer says so.
/// @note  As evaluate_table2().
LocalSafetyResult evaluate_local_safety(const map::Map& map, const std::string& config_text,
                                        const LocalSafetyOptions& options,
                                        const planning::ReactionOptions& cut_off,
                                        const DrawnRoutes& routes, std::uint64_t seed,
                                        Observer& observer);

/// Raises the cells of drawn towers in the surface model and returns where they stand. The same
/// seed gives the same towers everywhere.
std::vector<geo::MapPoint> add_towers(map::Map& map, const LocalSafetyOptions& options,
                                      const DrawnRoute& route, std::uint64_t seed);

std::string table2_result_json(const Table2Result& result);
std::string local_safety_result_json(const LocalSafetyResult& result);

}  // namespace hedgehop::evaluation
