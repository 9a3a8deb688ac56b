#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "flight/route.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"

namespace hedgehop::global_planning {

/// Planners of the Open Motion Planning Library that serve as baselines.
enum class StockMethod : std::uint8_t {
  kBitStar,
  kAbitStar,
  kAitStar,
  kRrtStar,
  kInformedRrtStar,
  kPrmStar,  // uses a second thread
  kDubins,   // BIT* over Dubins curves in plan view
};
inline constexpr std::array<StockMethod, 7> kStockMethods = {
    StockMethod::kBitStar, StockMethod::kAbitStar,        StockMethod::kAitStar,
    StockMethod::kRrtStar, StockMethod::kInformedRrtStar, StockMethod::kPrmStar,
    StockMethod::kDubins};

/// "ompl_bitstar" and so on; "dubins".
std::string_view name_of(StockMethod method);

/// Headings that Dubins curves begin and end with, counter-clockwise from east; without one, that
/// of the line from start to goal.
struct EndHeadings {
  std::optional<double> start_math_rad;
  std::optional<double> goal_math_rad;
};

/// One of the library's own planners at work on the problem that our planners solve: eq. (1) over
/// straight legs, the same envelope, the same climb limit, checked as exactly.
///
/// The planners keep the library's default settings. What they are given beyond it: the straight
/// length as heuristic, states drawn inside the height band (over the whole map at first, then
/// inside the ellipse of the best cost), and a distance for the choice of neighbours that counts
/// altitude as the way it takes to climb so far (with the plain one RRT* often never joins the
/// goal). An edge counts only if FlightEnvelope::is_clear() holds.
/// The library has no place for a rule about turns, as an edge is judged without its neighbours,
/// so routes may turn anyhow.
///
/// Dubins: edges are Dubins curves of one radius whose altitude is linear along the curve, so that
/// all turns can be flown. States have a heading; those of start and goal are EndHeadings.
/// The word of an edge is solved once, then eq. (1) is integrated along it. Routes are polylines
/// with steps of final_check_step_m.
///
/// The library's random numbers are seeded for the whole process, and only before the first use:
/// to repeat a run, give it a process. Some planners look at `should_stop` rarely, and failed
/// assertions in the library abort the process.
class StockPlanner {
 public:
  /// A better route than before, start and goal included.
  using OnRoute = std::function<void(const std::vector<flight::Waypoint>&)>;

  /// The envelope must outlive the planner. `turn_radius_m` is that of the Dubins curves.
  /// @throws std::invalid_argument  for a radius that is not positive with kDubins
  StockPlanner(const FlightEnvelope& envelope, const GlobalOptions& options, StockMethod method,
               double turn_radius_m, std::uint64_t seed, const EndHeadings& headings = {});
  ~StockPlanner();
  StockPlanner(const StockPlanner&) = delete;
  StockPlanner& operator=(const StockPlanner&) = delete;

  /// Goes on until `should_stop`, which must be safe to call from two threads. Routes that the
  /// planner tells of only at the end come then; ABIT*, AIT* and PRM* may do that.
  void run(const std::function<bool()>& should_stop, const OnRoute& on_route);

  /// How often the planner asked for the cost of an edge.
  [[nodiscard]] std::int64_t edge_evaluations() const;

 private:
  class Search;
  std::unique_ptr<Search> search_;
};

}  // namespace hedgehop::global_planning
