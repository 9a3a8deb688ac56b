#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <unordered_set>
#include <utility>
#include <vector>

#include "flight/route.hpp"
#include "global_planning/cost_bound.hpp"
#include "global_planning/edge_table.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"
#include "global_planning/random_source.hpp"

namespace hedgehop::global_planning {

/// What a search has spent and reached so far.
struct SearchCounts {
  std::int64_t work_units = 0;  // edge evaluations, coarse and fine, and states drawn
  std::int64_t samples = 0;
  std::int64_t batches = 0;
};

/// Batch informed trees over the flight envelope: an anytime search for the cheapest polyline.
///
/// Batches of random states make an implicit random geometric graph: two states are joined when
/// they lie within a radius r of each other in plan view. Edges are looked at in the order of
/// g(tree, from) + (cost or length) + length to the goal; only an edge that may still improve the
/// best route is evaluated. What differs from the published algorithm:
///  - states are thin in height, so radius and ellipse are those of two dimensions;
///  - an evaluated edge goes back into the queue under its true cost, and states whose cost-to-come
///    fell are expanded again, so that the tree follows the cheapest routes of the graph;
///  - an edge enters the tree only if its turn against the edge of its parent, and on rewiring the
///  turns
///    to all children, are allowed. The verdict depends on the tree, so a refused edge is kept
///    and tried again when the parent gets another edge, and in the next batch;
///  - a route counts as found once each of its edges passes the fine check. An edge that fails it
///  leaves
///    the graph, and the search goes on;
///  - until a first route is known, states are drawn from an ellipse that grows from batch to
///  batch.
///
/// GlobalOptions chooses the bounds that lead it (straight lengths, or those of two CostBounds, to
/// the goal and to the start), the region that states are drawn from (the ellipse of those that a
/// route of the best length could pass, or the level set of the two bounds: no cheaper route leaves
/// it), and whether turns count. Both bounds are made at the beginning of run(), which takes about
/// half a second for a million cells and can be stopped and resumed like the rest.
///
/// Source: J. D. Gammell, S. S. Srinivasa and T. D. Barfoot, "Batch Informed Trees (BIT*)", ICRA
/// 2015, doi:10.1109/ICRA.2015.7139620. Deterministic: a function of its arguments and of the work
/// budget, however the budget is divided over calls of run().
class BitStarSearch {
 public:
  /// Called when a batch begins and when the route improves.
  using OnEvent = std::function<void()>;
  /// Asked every few queue entries and several times while a batch is drawn and joined to the
  /// graph, about each millisecond; true ends run().
  using ShouldStop = std::function<bool()>;

  /// The envelope must outlive the search and contain start and goal.
  BitStarSearch(const FlightEnvelope& envelope, const GlobalOptions& options, std::uint64_t seed);

  /// Searches until `work_budget` work units were spent in total, never more, or the best
  /// route is proved to be optimal, or `should_stop`.
  void run(std::int64_t work_budget, const ShouldStop& should_stop, const OnEvent& on_event);

  [[nodiscard]] bool has_route() const {
    return best_cost_m_ < std::numeric_limits<double>::infinity();
  }
  [[nodiscard]] bool is_optimal() const { return best_cost_m_ <= lower_bound_m_ * (1.0 + 1e-8); }
  /// Infinity without a route; quadrature at check_step_m.
  [[nodiscard]] double best_cost_m() const { return best_cost_m_; }
  [[nodiscard]] double lower_bound_m() const { return lower_bound_m_; }
  [[nodiscard]] const std::vector<flight::Waypoint>& best_route() const { return best_route_; }
  [[nodiscard]] const SearchCounts& counts() const { return counts_; }

  /// States that are in the graph, and the parent of each (-1: none), for inspection.
  [[nodiscard]] std::size_t state_count() const { return x_m_.size(); }
  [[nodiscard]] flight::Waypoint state(std::size_t i) const { return {x_m_[i], y_m_[i], z_m_[i]}; }
  [[nodiscard]] int parent(std::size_t i) const { return parent_[i]; }

  /// Adds a state to the graph before the next batch, if it is in the envelope.
  void add_state(const flight::Waypoint& state);

 private:
  struct Entry {
    double key_m;
    std::int32_t from;
    std::int32_t to;  // -1: expand `from`
  };
  using Evaluated = EdgeTable::Entry;
  struct Label {
    std::int32_t state;
    std::int32_t before;  // label of the edge before, -1: none
    double come_m;
  };
  struct LabelEntry {
    double key_m;
    std::int32_t label;
    std::int32_t to;
  };
  /// One direction of the search for a first route.
  struct LabelSearch {
    std::int32_t target = 0;
    std::vector<Label> labels;
    std::vector<LabelEntry> queue;
    std::unordered_set<std::uint64_t> closed;  // arrivals
  };
  struct Ellipse {
    double centre_x_m, centre_y_m, axis_x, axis_y, half_major_m, half_minor_m;
  };

  static bool is_later(const Entry& a, const Entry& b);
  [[nodiscard]] std::uint64_t edge_id(int a, int b) const;

  int append_state(const flight::Waypoint& state);
  void step_batch();
  void begin_graph();
  void gather_refused();
  void retry_refused();
  static bool is_inside(const Ellipse& ellipse, const geo::MapPoint& point);
  bool draw_samples();
  void build_bins();
  [[nodiscard]] Ellipse sampling_ellipse() const;
  [[nodiscard]] bool draw_from_ellipse(const Ellipse& ellipse, bool is_smaller, double first,
                                       double second, geo::MapPoint& point) const;
  void step_bounds();
  void bound_state(std::size_t i);
  void step_region();
  [[nodiscard]] bool draw_from_level_set(double first, double second, geo::MapPoint& point) const;
  [[nodiscard]] bool is_turn_allowed(int a, int b, int c) const;
  [[nodiscard]] bool may_leave_start(int to) const;
  void push(double key_m, int from, int to);
  void expand(int from);
  void consider(int from, int to);
  void process(const Entry& entry);
  [[nodiscard]] bool is_turn_kept(int from, int to) const;
  void attach(int from, int to, double cost_m);
  void reach(int state, double come_m);
  void detach(int root);
  void unlink_child(int parent, int child);
  void accept_goal();
  double evaluate(int a, int b);
  [[nodiscard]] std::uint64_t arrival_id(int from, int to) const;
  void begin_labels();
  void step_labels();
  [[nodiscard]] std::pair<int, int> flown(const LabelSearch& search, int from, int to) const;
  void open_label(LabelSearch& search, std::int32_t label);
  void install(std::vector<std::int32_t> path);
  template <typename Visit>
  void for_each_neighbour(int of, const Visit& visit) const;

  const FlightEnvelope* envelope_;
  GlobalOptions options_;
  RandomSource random_;
  double climb_tangent_max_;  // of both ways
  bool is_directed_;          // an edge may be allowed one way alone
  double first_inflation_;    // of the bound ahead, in the search for a first route
  double long_leg_m_;

  // Bounds by eq. (1), to the goal and from the start, and their least sum over each cell.
  std::array<std::optional<CostBoundMaking>, 2> making_;
  std::optional<CostBound> to_goal_bound_, from_start_bound_;
  std::vector<float> through_m_;
  bool is_bounded_ = false;  // what there is to be made is complete
  double level_m_ = 0.0;     // of the level set of this batch
  std::size_t region_next_ = 0;
  std::vector<std::uint32_t> level_cells_;

  // States, structure of arrays. 0 is the start, 1 the goal.
  std::vector<double> x_m_, y_m_, z_m_;
  std::vector<double> from_start_m_, to_goal_m_;  // bounds of the cost: lengths or more
  std::vector<double> come_m_;                    // g: cost along the tree, infinity outside
  std::vector<double> edge_cost_m_;               // of the edge from the parent
  std::vector<std::int32_t> parent_, first_child_, next_sibling_;
  std::vector<double> expanded_at_m_;  // value of g at the last expansion, infinity: never
  std::vector<std::uint8_t> is_pruned_;

  std::vector<Entry> queue_;
  std::vector<Entry> refused_;  // by the turn condition; key unused, may hold an edge twice
  EdgeTable table_;

  // Bins of the uniform plan-view grid, by counting sort.
  double bin_m_ = 1.0, bins_west_m_ = 0.0, bins_south_m_ = 0.0, radius_m_ = 0.0;
  int bin_columns_ = 0, bin_rows_ = 0;
  std::vector<std::int32_t> bin_begin_, bin_states_;

  std::array<LabelSearch, 2> label_searches_;  // from the start, from the goal
  bool is_labelling_ = false;
  std::size_t label_turn_ = 0;

  /// What is left to do before a batch can be searched; in small steps, so that run() may stop.
  enum class BatchStep : std::uint8_t { kNone, kRegion, kDraw, kConnect, kRetry };
  BatchStep batch_step_ = BatchStep::kNone;
  std::size_t connect_next_ = 0, connect_end_ = 0;  // new states
  // Edges refused before, to be tried again: where they lead, by the state that they leave.
  std::vector<std::int32_t> again_begin_, again_to_;
  std::size_t retry_next_ = 0;  // state
  std::int64_t work_before_batch_ = 0;
  std::int64_t idle_batches_ = 0;
  std::int64_t drawn_ = 0;  // of the batch being drawn
  std::int64_t attempts_ = 0;
  std::size_t first_new_state_ = 0;
  double sampled_area_m2_ = 0.0;
  double best_cost_m_ = std::numeric_limits<double>::infinity();
  double lower_bound_m_ = 0.0;
  std::vector<flight::Waypoint> best_route_;
  SearchCounts counts_;
  std::int64_t budget_ = 0;
  OnEvent on_event_;
};

}  // namespace hedgehop::global_planning
