#include "global_planning/bit_star_search.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "base/elementary.hpp"
#include "base/errors.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kStart = 0;
constexpr int kGoal = 1;
constexpr int kStopInterval = 64;
constexpr int kBatchStepSize = 64;  // draws or refused edges
constexpr std::size_t kCellStepSize = std::size_t{1} << 16U;
constexpr double kFloatRounding = 1.0 - 1e-6;  // never upwards
constexpr std::int64_t kIdleBatchesMax = 20;
constexpr std::size_t kQueueReserve = std::size_t{1} << 20U;

// Before a route is known, the ellipse of batch n holds all polylines of at most this many times
// the straight length; after some batches it covers any map.
constexpr double kFirstEllipse = 1.25;
constexpr double kEllipseGrowth = 1.25;
// The level set of batch n, likewise, all that routes of at most this many times the bound of the
// cost could pass: first routes seldom cost less.
constexpr double kFirstLevel = 1.8;
constexpr std::int64_t kGrowthsMax = 100;

// In the search for a first route the heuristic counts this many times: a metre of path costs
// several metres, and any route serves to begin with.
constexpr double kFirstInflation = 30.0;
constexpr double kFirstFieldInflation = 3.0;  // of bounds that know what a metre costs

// Before a route is known, two states of this many are drawn near start and goal.
constexpr std::int64_t kEndSampleInterval = 10;

constexpr auto kIsLaterLabel = [](const auto& a, const auto& b) {
  if (a.key_m != b.key_m) {
    return a.key_m > b.key_m;
  }
  return a.label != b.label ? a.label > b.label : a.to > b.to;
};

}  // namespace

BitStarSearch::BitStarSearch(const FlightEnvelope& envelope, const GlobalOptions& options,
                             std::uint64_t seed)
    : envelope_(&envelope),
      options_(options),
      random_(seed),
      climb_tangent_max_(
          std::max(envelope.slopes().greatest().up, envelope.slopes().greatest().down)),
      is_directed_(!envelope.slopes().is_symmetric()),
      first_inflation_(options.heuristic == SearchHeuristic::kCostField ? kFirstFieldInflation
                                                                        : kFirstInflation),
      long_leg_m_(2.0 * options.turn_radius_m * elementary::tan(0.5 * options.turn_angle_max_rad)) {
  queue_.reserve(kQueueReserve);
  append_state(envelope.start());
  append_state(envelope.goal());
  come_m_[kStart] = 0.0;
  // Rounding of long sums must not make the bound exceed the cost of the straight leg.
  lower_bound_m_ = to_goal_m_[kStart] * (1.0 - 1e-9);
  if (options.heuristic == SearchHeuristic::kCostField ||
      options.sampler == SamplingRegion::kLevelSet) {
    const geo::MapPoint start = envelope.start().point();
    const geo::MapPoint goal = envelope.goal().point();
    making_[0].emplace(envelope, goal, start);
    making_[1].emplace(envelope, start, goal);
  } else {
    is_bounded_ = true;
  }
}

// Some of the bounds that lead the search.
void BitStarSearch::step_bounds() {
  const std::array<std::optional<CostBound>*, 2> bounds = {&to_goal_bound_, &from_start_bound_};
  for (std::size_t i = 0; i < making_.size(); ++i) {
    if (making_[i]) {
      if (making_[i]->step()) {
        *bounds[i] = std::move(*making_[i]).take();
        making_[i].reset();
      }
      return;
    }
  }
  const raster::GridGeometry& geometry = envelope_->geometry();
  if (options_.sampler == SamplingRegion::kLevelSet && through_m_.size() < geometry.cell_count()) {
    through_m_.reserve(geometry.cell_count());
    const int row =
        static_cast<int>(through_m_.size() / static_cast<std::size_t>(geometry.columns));
    const auto at = [&](int column, int above) {
      return to_goal_bound_->corner_cost_m(column, row + above) +
             from_start_bound_->corner_cost_m(column, row + above);
    };
    // Linear over triangles between the corners, hence least in one of them.
    for (int column = 0; column < geometry.columns; ++column) {
      through_m_.push_back(static_cast<float>(
          std::min({at(column, 0), at(column + 1, 0), at(column, 1), at(column + 1, 1)}) *
          kFloatRounding));
    }
    return;
  }
  if (options_.heuristic == SearchHeuristic::kCostField) {
    for (std::size_t i = 0; i < x_m_.size(); ++i) {
      bound_state(i);
    }
    lower_bound_m_ = to_goal_m_[kStart] * (1.0 - 1e-9);
  }
  is_bounded_ = true;
}

// Bounds of a state by the fields, where they are more than lengths.
void BitStarSearch::bound_state(std::size_t i) {
  const geo::MapPoint point{x_m_[i], y_m_[i]};
  from_start_m_[i] = std::max(from_start_m_[i], from_start_bound_->cost_m(point));
  to_goal_m_[i] = std::max(to_goal_m_[i], to_goal_bound_->cost_m(point));
}

int BitStarSearch::append_state(const flight::Waypoint& state) {
  const auto distance_m = [&](const flight::Waypoint& other) {
    const double dx_m = state.x_m - other.x_m;
    const double dy_m = state.y_m - other.y_m;
    const double dz_m = state.altitude_m - other.altitude_m;
    return std::sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m);
  };
  x_m_.push_back(state.x_m);
  y_m_.push_back(state.y_m);
  z_m_.push_back(state.altitude_m);
  from_start_m_.push_back(distance_m(envelope_->start()));
  to_goal_m_.push_back(distance_m(envelope_->goal()));
  come_m_.push_back(kInfinity);
  edge_cost_m_.push_back(0.0);
  parent_.push_back(-1);
  first_child_.push_back(-1);
  next_sibling_.push_back(-1);
  expanded_at_m_.push_back(kInfinity);
  is_pruned_.push_back(0);
  if (is_bounded_ && options_.heuristic == SearchHeuristic::kCostField) {
    bound_state(x_m_.size() - 1);
  }
  return static_cast<int>(x_m_.size()) - 1;
}

void BitStarSearch::add_state(const flight::Waypoint& state) {
  if (envelope_->contains(state)) {
    append_state(state);
    ++counts_.samples;
  }
}

// --- the table of evaluated edges: open addressing, linear probing
// ---------------------------------

std::uint64_t BitStarSearch::edge_id(int a, int b) const {
  if (is_directed_) {
    return (static_cast<std::uint64_t>(a) << 32U) | static_cast<std::uint64_t>(b);
  }
  const auto low = static_cast<std::uint64_t>(std::min(a, b));
  const auto high = static_cast<std::uint64_t>(std::max(a, b));
  return (low << 32U) | high;
}

// --- batches
// --------------------------------------------------------------------------------------

BitStarSearch::Ellipse BitStarSearch::sampling_ellipse() const {
  const flight::Waypoint& start = envelope_->start();
  const flight::Waypoint& goal = envelope_->goal();
  const double dx_m = goal.x_m - start.x_m;
  const double dy_m = goal.y_m - start.y_m;
  const double distance_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
  double major_m = best_cost_m_;
  if (!has_route()) {
    const raster::GridGeometry& geometry = envelope_->geometry();
    // From any point of the map to both foci: no ellipse needs to be larger.
    const double width_m = geometry.east_m() - geometry.west_m;
    const double depth_m = geometry.north_m() - geometry.south_m;
    const double all_m = 2.0 * std::sqrt(width_m * width_m + depth_m * depth_m);
    major_m = std::max(distance_m, 2.0 * options_.check_step_m) * kFirstEllipse;
    for (std::int64_t batch = 0; batch < counts_.batches && major_m < all_m; ++batch) {
      major_m *= kEllipseGrowth;
    }
    major_m = std::min(major_m, all_m);
  }
  Ellipse ellipse{};
  ellipse.centre_x_m = 0.5 * (start.x_m + goal.x_m);
  ellipse.centre_y_m = 0.5 * (start.y_m + goal.y_m);
  ellipse.axis_x = distance_m > 0.0 ? dx_m / distance_m : 1.0;
  ellipse.axis_y = distance_m > 0.0 ? dy_m / distance_m : 0.0;
  ellipse.half_major_m = 0.5 * major_m;
  ellipse.half_minor_m =
      0.5 * std::sqrt(std::max(major_m * major_m - distance_m * distance_m, 0.0));
  return ellipse;
}

bool BitStarSearch::is_inside(const Ellipse& ellipse, const geo::MapPoint& point) {
  const double dx_m = point.x_m - ellipse.centre_x_m;
  const double dy_m = point.y_m - ellipse.centre_y_m;
  const double along = (dx_m * ellipse.axis_x + dy_m * ellipse.axis_y) / ellipse.half_major_m;
  const double across = (dy_m * ellipse.axis_x - dx_m * ellipse.axis_y) / ellipse.half_minor_m;
  return along * along + across * across <= 1.0;
}

bool BitStarSearch::draw_from_ellipse(const Ellipse& ellipse, bool is_smaller, double first,
                                      double second, geo::MapPoint& point) const {
  if (is_smaller) {
    const double radius = std::sqrt(first);
    const double angle_rad = 2.0 * std::numbers::pi * second;
    const double along_m = ellipse.half_major_m * radius * elementary::cos(angle_rad);
    const double across_m = ellipse.half_minor_m * radius * elementary::sin(angle_rad);
    point = {ellipse.centre_x_m + along_m * ellipse.axis_x - across_m * ellipse.axis_y,
             ellipse.centre_y_m + along_m * ellipse.axis_y + across_m * ellipse.axis_x};
    return true;
  }
  const raster::GridGeometry& geometry = envelope_->geometry();
  point = {geometry.west_m + first * (geometry.east_m() - geometry.west_m),
           geometry.south_m + second * (geometry.north_m() - geometry.south_m)};
  return is_inside(ellipse, point);
}

// Cells that a route of less than the best cost could pass; before there is one, of a cost that
// grows from batch to batch. A part of them at a time.
void BitStarSearch::step_region() {
  if (region_next_ == 0) {
    level_m_ = best_cost_m_;
    if (!has_route()) {
      level_m_ = std::max(to_goal_bound_->cost_m(envelope_->start().point()),
                          2.0 * options_.check_step_m) *
                 kFirstLevel;
      const std::int64_t growths = std::min(counts_.batches, kGrowthsMax);
      for (std::int64_t batch = 0; batch < growths; ++batch) {
        level_m_ *= kEllipseGrowth;
      }
    }
    level_cells_.clear();
  }
  const std::size_t end = std::min(region_next_ + kCellStepSize, through_m_.size());
  for (; region_next_ < end; ++region_next_) {
    if (static_cast<double>(through_m_[region_next_]) <= level_m_) {
      level_cells_.push_back(static_cast<std::uint32_t>(region_next_));
    }
  }
  if (region_next_ == through_m_.size()) {
    region_next_ = 0;
    batch_step_ = BatchStep::kDraw;
  }
}

bool BitStarSearch::draw_from_level_set(double first, double second, geo::MapPoint& point) const {
  if (level_cells_.empty()) {
    return false;
  }
  const double chosen = first * static_cast<double>(level_cells_.size());
  const auto k = std::min(static_cast<std::size_t>(chosen), level_cells_.size() - 1);
  const raster::GridGeometry& geometry = envelope_->geometry();
  const auto columns = static_cast<std::uint32_t>(geometry.columns);
  const std::uint32_t cell = level_cells_[k];
  point = {geometry.west_m + geometry.cell_m * (cell % columns + (chosen - static_cast<double>(k))),
           geometry.south_m + geometry.cell_m * (cell / columns + second)};
  // A metre costs at least 1, so no cheaper route leaves the ellipse either.
  const auto least_m = [&](const CostBound& bound, const flight::Waypoint& end) {
    const double dx_m = point.x_m - end.x_m;
    const double dy_m = point.y_m - end.y_m;
    return std::max(bound.cost_m(point), std::sqrt(dx_m * dx_m + dy_m * dy_m));
  };
  return least_m(*to_goal_bound_, envelope_->goal()) +
             least_m(*from_start_bound_, envelope_->start()) <=
         level_m_;
}

// A part of the batch; true once it is complete.
bool BitStarSearch::draw_samples() {
  const bool has_level_set = options_.sampler == SamplingRegion::kLevelSet;
  const Ellipse ellipse = sampling_ellipse();
  const std::int64_t attempts_max = 50 * options_.batch_size;
  const raster::GridGeometry& geometry = envelope_->geometry();
  const double width_m = geometry.east_m() - geometry.west_m;
  const double depth_m = geometry.north_m() - geometry.south_m;
  const double ellipse_m2 = std::numbers::pi * ellipse.half_major_m * ellipse.half_minor_m;
  const bool is_ellipse_smaller = ellipse_m2 < width_m * depth_m;
  for (int step = 0; step < kBatchStepSize && drawn_ < options_.batch_size &&
                     attempts_ < attempts_max && counts_.work_units < budget_;
       ++step) {
    ++attempts_;
    const double first = random_.unit();
    const double second = random_.unit();
    const double height_share = random_.unit();
    geo::MapPoint point;
    const std::int64_t place = drawn_ % kEndSampleInterval;
    if (!has_route() && place < 2) {
      // Ways out of and into a narrow valley need more states than its share of the ellipse.
      const flight::Waypoint& end = place == 0 ? envelope_->start() : envelope_->goal();
      const double radius_m = 2.0 * options_.end_funnel_m * std::sqrt(first);
      const double angle_rad = 2.0 * std::numbers::pi * second;
      point = {end.x_m + radius_m * elementary::cos(angle_rad),
               end.y_m + radius_m * elementary::sin(angle_rad)};
    } else if (has_level_set
                   ? !draw_from_level_set(first, second, point)
                   : !draw_from_ellipse(ellipse, is_ellipse_smaller, first, second, point)) {
      continue;
    }
    const AltitudeBand band = envelope_->band_at(point);
    if (!band.is_flyable()) {
      continue;
    }
    const flight::Waypoint state{point.x_m, point.y_m,
                                 band.low_m + height_share * (band.high_m - band.low_m)};
    append_state(state);
    ++drawn_;
    ++counts_.samples;
    ++counts_.work_units;
  }
  if (drawn_ < options_.batch_size && attempts_ < attempts_max) {
    return false;
  }
  const double region_m2 =
      has_level_set ? static_cast<double>(level_cells_.size()) * geometry.cell_m * geometry.cell_m
      : is_ellipse_smaller ? ellipse_m2
                           : width_m * depth_m;
  sampled_area_m2_ = region_m2 * static_cast<double>(drawn_) /
                     static_cast<double>(std::max<std::int64_t>(attempts_, 1));
  drawn_ = 0;
  attempts_ = 0;
  return true;
}

void BitStarSearch::build_bins() {
  std::vector<std::int32_t> alive;
  double west_m = kInfinity;
  double south_m = kInfinity;
  double east_m = -kInfinity;
  double north_m = -kInfinity;
  for (std::size_t i = 0; i < x_m_.size(); ++i) {
    if (is_pruned_[i] == 0) {
      alive.push_back(static_cast<std::int32_t>(i));
      west_m = std::min(west_m, x_m_[i]);
      east_m = std::max(east_m, x_m_[i]);
      south_m = std::min(south_m, y_m_[i]);
      north_m = std::max(north_m, y_m_[i]);
    }
  }
  const double count = static_cast<double>(alive.size());
  radius_m_ = options_.radius_factor * 2.0 *
              std::sqrt(1.5 * sampled_area_m2_ / std::numbers::pi * elementary::log(count) / count);
  radius_m_ = std::clamp(radius_m_, options_.check_step_m, options_.radius_max_m);
  bin_m_ = 0.5 * radius_m_;
  bins_west_m_ = west_m;
  bins_south_m_ = south_m;
  bin_columns_ = static_cast<int>((east_m - west_m) / bin_m_) + 1;
  bin_rows_ = static_cast<int>((north_m - south_m) / bin_m_) + 1;
  const auto bin_of = [&](std::int32_t i) {
    return static_cast<std::size_t>(static_cast<int>((y_m_[i] - south_m) / bin_m_)) *
               static_cast<std::size_t>(bin_columns_) +
           static_cast<std::size_t>(static_cast<int>((x_m_[i] - west_m) / bin_m_));
  };
  bin_begin_.assign(
      static_cast<std::size_t>(bin_columns_) * static_cast<std::size_t>(bin_rows_) + 1, 0);
  for (const std::int32_t i : alive) {
    ++bin_begin_[bin_of(i) + 1];
  }
  for (std::size_t bin = 1; bin < bin_begin_.size(); ++bin) {
    bin_begin_[bin] += bin_begin_[bin - 1];
  }
  std::vector<std::int32_t> next(bin_begin_.begin(), bin_begin_.end() - 1);
  bin_states_.resize(alive.size());
  for (const std::int32_t i : alive) {
    bin_states_[static_cast<std::size_t>(next[bin_of(i)]++)] = i;
  }
}

template <typename Visit>
void BitStarSearch::for_each_neighbour(int of, const Visit& visit) const {
  const double x_m = x_m_[of];
  const double y_m = y_m_[of];
  const double z_m = z_m_[of];
  const auto bin_at = [&](double offset_m, int bins) {
    return std::clamp(static_cast<int>(std::floor(offset_m / bin_m_)), 0, bins - 1);
  };
  const int west = bin_at(x_m - radius_m_ - bins_west_m_, bin_columns_);
  const int east = bin_at(x_m + radius_m_ - bins_west_m_, bin_columns_);
  const int south = bin_at(y_m - radius_m_ - bins_south_m_, bin_rows_);
  const int north = bin_at(y_m + radius_m_ - bins_south_m_, bin_rows_);
  const double radius_m2 = radius_m_ * radius_m_;
  const double climb_square = climb_tangent_max_ * climb_tangent_max_;
  for (int row = south; row <= north; ++row) {
    const std::size_t first =
        static_cast<std::size_t>(row) * static_cast<std::size_t>(bin_columns_);
    const std::int32_t begin = bin_begin_[first + static_cast<std::size_t>(west)];
    const std::int32_t end = bin_begin_[first + static_cast<std::size_t>(east) + 1];
    for (std::int32_t k = begin; k < end; ++k) {
      const std::int32_t i = bin_states_[static_cast<std::size_t>(k)];
      const double dx_m = x_m_[i] - x_m;
      const double dy_m = y_m_[i] - y_m;
      const double dz_m = z_m_[i] - z_m;
      const double square_m2 = dx_m * dx_m + dy_m * dy_m;
      if (square_m2 <= radius_m2 && square_m2 > 0.0 && dz_m * dz_m <= climb_square * square_m2) {
        visit(i, std::sqrt(square_m2 + dz_m * dz_m));
      }
    }
  }
}

void BitStarSearch::step_batch() {
  switch (batch_step_) {
    case BatchStep::kNone:
      return;
    case BatchStep::kRegion:
      step_region();
      return;
    case BatchStep::kDraw:
      if (draw_samples()) {
        begin_graph();
      }
      return;
    case BatchStep::kConnect:
      if (connect_next_ == connect_end_) {
        first_new_state_ = connect_end_;
        gather_refused();
        batch_step_ = BatchStep::kRetry;
        return;
      }
      if (is_pruned_[connect_next_] == 0) {
        const int state = static_cast<int>(connect_next_);
        for_each_neighbour(state, [&](int neighbour, double) {
          if (come_m_[neighbour] < kInfinity) {
            consider(neighbour, state);
          }
        });
      }
      ++connect_next_;
      return;
    case BatchStep::kRetry:
      retry_refused();
      if (retry_next_ + 1 == again_begin_.size()) {
        batch_step_ = BatchStep::kNone;
        on_event_();
      }
      return;
  }
}

void BitStarSearch::begin_graph() {
  for (std::size_t i = 2; i < x_m_.size(); ++i) {
    if (from_start_m_[i] + to_goal_m_[i] >= best_cost_m_) {
      is_pruned_[i] = 1;
    }
  }
  build_bins();
  queue_.clear();
  ++counts_.batches;
  connect_next_ = first_new_state_;
  connect_end_ = x_m_.size();
  if (options_.turn_rule == TurnRule::kHeadingLabels && !has_route()) {
    first_new_state_ = connect_end_;
    begin_labels();
    batch_step_ = BatchStep::kNone;
    on_event_();
    return;
  }
  if (counts_.batches == 1) {
    consider(kStart, kGoal);
    push(to_goal_m_[kStart], kStart, -1);
  }
  batch_step_ = BatchStep::kConnect;
}

// Sorts refused edges by the state that they leave.
void BitStarSearch::gather_refused() {
  again_begin_.assign(x_m_.size() + 1, 0);
  for (const Entry& entry : refused_) {
    ++again_begin_[static_cast<std::size_t>(entry.from) + 1];
  }
  for (std::size_t i = 1; i < again_begin_.size(); ++i) {
    again_begin_[i] += again_begin_[i - 1];
  }
  std::vector<std::int32_t> next(again_begin_.begin(), again_begin_.end() - 1);
  again_to_.resize(refused_.size());
  for (const Entry& entry : refused_) {
    again_to_[static_cast<std::size_t>(next[static_cast<std::size_t>(entry.from)]++)] = entry.to;
  }
  refused_.clear();
  retry_next_ = 0;
}

// Tries refused edges of some states again, each edge once.
void BitStarSearch::retry_refused() {
  const std::size_t states = again_begin_.size() - 1;
  for (int step = 0; step < kBatchStepSize && retry_next_ < states; ++step, ++retry_next_) {
    const auto begin = again_to_.begin() + again_begin_[retry_next_];
    const auto end = again_to_.begin() + again_begin_[retry_next_ + 1];
    if (begin == end || come_m_[retry_next_] == kInfinity) {
      continue;
    }
    std::sort(begin, end);
    std::for_each(begin, std::unique(begin, end),
                  [&](std::int32_t to) { consider(static_cast<int>(retry_next_), to); });
  }
}

// --- the queue of the tree

bool BitStarSearch::is_later(const Entry& a, const Entry& b) {
  if (a.key_m != b.key_m) {
    return a.key_m > b.key_m;
  }
  return a.from != b.from ? a.from > b.from : a.to > b.to;
}

void BitStarSearch::push(double key_m, int from, int to) {
  queue_.push_back({key_m, from, to});
  std::push_heap(queue_.begin(), queue_.end(), is_later);
}

void BitStarSearch::expand(int from) {
  if (!(come_m_[from] < expanded_at_m_[from])) {
    return;
  }
  expanded_at_m_[from] = come_m_[from];
  for (int child = first_child_[from]; child >= 0;) {
    const int next = next_sibling_[child];  // the goal may be detached meanwhile
    if (const double come_m = come_m_[from] + edge_cost_m_[child]; come_m < come_m_[child]) {
      reach(child, come_m);
      if (come_m_[from] == kInfinity) {
        return;  // the fine check of a route took this state out of the tree
      }
    }
    child = next;
  }
  for_each_neighbour(from, [&](int to, double length_m) {
    if (come_m_[from] + length_m < come_m_[to] && to != parent_[from]) {
      consider(from, to);
    }
  });
}

// Puts an edge into the queue if it may improve the tree and the best route.
void BitStarSearch::consider(int from, int to) {
  if (is_pruned_[to] != 0 || to == kStart) {
    return;
  }
  double cost_m = 0.0;
  if (const Evaluated* evaluated = table_.find(edge_id(from, to)); evaluated != nullptr) {
    cost_m = evaluated->cost_m;
  } else {
    const double dx_m = x_m_[to] - x_m_[from];
    const double dy_m = y_m_[to] - y_m_[from];
    const double dz_m = z_m_[to] - z_m_[from];
    cost_m = std::sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m);
  }
  const double come_m = come_m_[from] + cost_m;
  if (come_m < come_m_[to] && come_m + to_goal_m_[to] < best_cost_m_) {
    push(come_m + to_goal_m_[to], from, to);
  }
}

double BitStarSearch::evaluate(int a, int b) {
  // Always in the same direction, so that both have the same cost to the last bit.
  const auto from = static_cast<std::size_t>(is_directed_ ? a : std::min(a, b));
  const auto to = static_cast<std::size_t>(is_directed_ ? b : std::max(a, b));
  const double cost_m = envelope_->leg_cost_m(state(from), state(to));
  ++counts_.work_units;
  table_.insert(edge_id(a, b), cost_m);
  return cost_m;
}

// Between the edges from a to b and from b to c.
bool BitStarSearch::is_turn_allowed(int a, int b, int c) const {
  return options_.turn_rule == TurnRule::kNone ||
         envelope_->is_turn_allowed(x_m_[b] - x_m_[a], y_m_[b] - y_m_[a], x_m_[c] - x_m_[b],
                                    y_m_[c] - y_m_[b]);
}

// By an edge from the start to a state.
bool BitStarSearch::may_leave_start(int to) const {
  return options_.turn_rule == TurnRule::kNone ||
         envelope_->may_leave_start(x_m_[to] - x_m_[kStart], y_m_[to] - y_m_[kStart]);
}

bool BitStarSearch::is_turn_kept(int from, int to) const {
  if (const int before = parent_[from]; before >= 0 && !is_turn_allowed(before, from, to)) {
    return false;
  }
  if (from == kStart && !may_leave_start(to)) {
    return false;
  }
  for (int child = first_child_[to]; child >= 0; child = next_sibling_[child]) {
    if (!is_turn_allowed(from, to, child)) {
      return false;
    }
  }
  return true;
}

void BitStarSearch::process(const Entry& entry) {
  const int from = entry.from;
  const int to = entry.to;
  if (come_m_[from] == kInfinity) {
    return;
  }
  if (to < 0) {
    expand(from);
    return;
  }
  if (is_pruned_[to] != 0 || parent_[to] == from || !(come_m_[from] < come_m_[to])) {
    return;
  }
  const std::uint64_t edge = edge_id(from, to);
  const Evaluated* evaluated = table_.find(edge);
  if (evaluated != nullptr &&
      !(come_m_[from] + evaluated->cost_m < come_m_[to] &&
        come_m_[from] + evaluated->cost_m + to_goal_m_[to] < best_cost_m_)) {
    return;
  }
  if (!is_turn_kept(from, to)) {
    refused_.push_back(entry);
    return;
  }
  if (evaluated == nullptr) {
    evaluate(from, to);
    consider(from, to);
    return;
  }
  attach(from, to, evaluated->cost_m);
}

void BitStarSearch::unlink_child(int parent, int child) {
  std::int32_t* link = &first_child_[parent];
  while (*link != child) {
    link = &next_sibling_[*link];
  }
  *link = next_sibling_[child];
  next_sibling_[child] = -1;
}

void BitStarSearch::attach(int from, int to, double cost_m) {
  if (parent_[to] >= 0) {
    unlink_child(parent_[to], to);
  }
  parent_[to] = from;
  next_sibling_[to] = first_child_[from];
  first_child_[from] = to;
  edge_cost_m_[to] = cost_m;
  reach(to, come_m_[from] + cost_m);
}

// A state costs less to come to. What lies behind it in the tree learns of that when it is
// expanded, in the order of the queue: until then its costs are upper bounds.
void BitStarSearch::reach(int state, double come_m) {
  come_m_[state] = come_m;
  if (state != kGoal) {
    push(come_m + to_goal_m_[state], state, -1);
  } else if (come_m < best_cost_m_) {
    accept_goal();
  }
}

// Takes a state and everything behind it out of the tree; neighbours may connect it again.
void BitStarSearch::detach(int root) {
  unlink_child(parent_[root], root);
  std::vector<std::int32_t> lost = {root};
  for (std::size_t k = 0; k < lost.size(); ++k) {
    const std::int32_t at = lost[k];
    for (int child = first_child_[at]; child >= 0;) {
      lost.push_back(child);
      const int next = next_sibling_[child];
      next_sibling_[child] = -1;
      child = next;
    }
    first_child_[at] = -1;
    parent_[at] = -1;
    come_m_[at] = kInfinity;
    expanded_at_m_[at] = kInfinity;
  }
  for (const std::int32_t at : lost) {
    for_each_neighbour(at, [&](int neighbour, double) {
      if (come_m_[neighbour] < kInfinity) {
        consider(neighbour, at);
      }
    });
  }
}

// The tree reaches the goal at less cost: takes the route if it passes the fine check. Else the
// edge that fails leaves the graph.
void BitStarSearch::accept_goal() {
  std::vector<std::int32_t> path;
  double cost_m = 0.0;
  for (int at = kGoal; at >= 0; at = parent_[at]) {
    path.push_back(at);
    cost_m += edge_cost_m_[at];
  }
  std::reverse(path.begin(), path.end());
  for (std::size_t k = 1; k < path.size(); ++k) {
    Evaluated* evaluated = table_.find(edge_id(path[k - 1], path[k]));
    HEDGEHOP_ASSERT(evaluated != nullptr);
    if (evaluated->is_fine_checked) {
      continue;
    }
    if (counts_.work_units >= budget_) {
      return;
    }
    ++counts_.work_units;
    if (!envelope_->is_clear(state(static_cast<std::size_t>(path[k - 1])),
                             state(static_cast<std::size_t>(path[k])))) {
      evaluated->cost_m = kInfinity;
      detach(path[k]);
      return;
    }
    evaluated->is_fine_checked = true;
  }
  come_m_[kGoal] = cost_m;
  best_cost_m_ = cost_m;
  best_route_.clear();
  for (const std::int32_t at : path) {
    best_route_.push_back(state(static_cast<std::size_t>(at)));
  }
  on_event_();
}

// --- the first route: labels are directed edges

void BitStarSearch::begin_labels() {
  for (LabelSearch& search : label_searches_) {
    const bool is_forward = &search == &label_searches_[0];
    search.target = is_forward ? kGoal : kStart;
    search.labels.assign(1, Label{is_forward ? kStart : kGoal, -1, 0.0});
    search.queue.clear();
    search.closed.clear();
    open_label(search, 0);
    if (is_forward && counts_.batches == 1) {
      search.queue.push_back({-1.0, 0, kGoal});  // the straight leg, before everything else
    }
  }
  is_labelling_ = true;
  label_turn_ = 0;
}

// Which of the ways into a state an edge is: arrivals of about the same heading, both long enough
// for any turn or both not, are interchangeable enough to keep only the first.
std::uint64_t BitStarSearch::arrival_id(int from, int to) const {
  const double dx_m = x_m_[to] - x_m_[from];
  const double dy_m = y_m_[to] - y_m_[from];
  // Octants by signs and the greater component, halved at 22.5 deg.
  const double ax_m = std::fabs(dx_m);
  const double ay_m = std::fabs(dy_m);
  const bool is_steep = ay_m > ax_m;
  const bool is_outer = std::min(ax_m, ay_m) > 0.41421356 * std::max(ax_m, ay_m);
  const bool is_long = dx_m * dx_m + dy_m * dy_m > long_leg_m_ * long_leg_m_;
  const unsigned heading = (dx_m < 0.0 ? 1U : 0U) | (dy_m < 0.0 ? 2U : 0U) | (is_steep ? 4U : 0U) |
                           (is_outer ? 8U : 0U) | (is_long ? 16U : 0U);
  return (static_cast<std::uint64_t>(to) << 8U) | heading;
}

// The ends of an edge in the order of the flight; in that of the search where both are the same.
std::pair<int, int> BitStarSearch::flown(const LabelSearch& search, int from, int to) const {
  return is_directed_ && search.target == kStart ? std::pair(to, from) : std::pair(from, to);
}

// Queues the edges that may follow a label.
void BitStarSearch::open_label(LabelSearch& search, std::int32_t label) {
  const Label here = search.labels[static_cast<std::size_t>(label)];
  const int before =
      here.before < 0 ? -1 : search.labels[static_cast<std::size_t>(here.before)].state;
  const std::vector<double>& ahead_m = search.target == kGoal ? to_goal_m_ : from_start_m_;
  for_each_neighbour(here.state, [&](int to, double length_m) {
    if (to == before) {
      return;
    }
    const bool is_backward = search.target == kStart;
    if ((before >= 0 &&
         !is_turn_allowed(is_backward ? to : before, here.state, is_backward ? before : to)) ||
        (here.state == kStart && !may_leave_start(to)) ||
        (to == kStart && !may_leave_start(here.state))) {
      return;
    }
    const auto [from, towards] = flown(search, here.state, to);
    const Evaluated* evaluated = table_.find(edge_id(from, towards));
    const double cost_m = evaluated != nullptr ? evaluated->cost_m : length_m;
    if (cost_m < kInfinity) {
      search.queue.push_back({here.come_m + cost_m + first_inflation_ * ahead_m[to], label, to});
      std::push_heap(search.queue.begin(), search.queue.end(), kIsLaterLabel);
    }
  });
}

// One entry of one of the two queues; at most one work unit. Ends with the first route, or when one
// direction has nothing left to try: then this graph holds no route.
void BitStarSearch::step_labels() {
  LabelSearch& search = label_searches_[label_turn_];
  label_turn_ = 1 - label_turn_;
  if (search.queue.empty()) {
    is_labelling_ = false;
    return;
  }
  std::pop_heap(search.queue.begin(), search.queue.end(), kIsLaterLabel);
  const LabelEntry entry = search.queue.back();
  search.queue.pop_back();
  const Label from = search.labels[static_cast<std::size_t>(entry.label)];
  const std::uint64_t arrival = arrival_id(from.state, entry.to);
  if (search.closed.contains(arrival)) {
    return;
  }
  const auto [first, second] = flown(search, from.state, entry.to);
  Evaluated* evaluated = table_.find(edge_id(first, second));
  const auto queue_again = [&](double cost_m) {
    const std::vector<double>& ahead_m = search.target == kGoal ? to_goal_m_ : from_start_m_;
    search.queue.push_back(
        {from.come_m + cost_m + first_inflation_ * ahead_m[entry.to], entry.label, entry.to});
    std::push_heap(search.queue.begin(), search.queue.end(), kIsLaterLabel);
  };
  if (evaluated == nullptr) {
    if (const double cost_m = evaluate(first, second); cost_m < kInfinity) {
      queue_again(cost_m);
    }
    return;
  }
  if (evaluated->cost_m == kInfinity) {
    return;
  }
  if (!evaluated->is_fine_checked) {
    ++counts_.work_units;
    if (envelope_->is_clear(state(static_cast<std::size_t>(first)),
                            state(static_cast<std::size_t>(second)))) {
      evaluated->is_fine_checked = true;
      queue_again(evaluated->cost_m);
    } else {
      evaluated->cost_m = kInfinity;
    }
    return;
  }
  search.closed.insert(arrival);
  search.labels.push_back({entry.to, entry.label, from.come_m + evaluated->cost_m});
  const auto label = static_cast<std::int32_t>(search.labels.size() - 1);
  if (entry.to != search.target) {
    open_label(search, label);
    return;
  }
  std::vector<std::int32_t> path;
  for (std::int32_t at = label; at >= 0; at = search.labels[static_cast<std::size_t>(at)].before) {
    path.push_back(search.labels[static_cast<std::size_t>(at)].state);
  }
  if (search.target == kGoal) {
    std::reverse(path.begin(), path.end());
  }
  is_labelling_ = false;
  install(std::move(path));
}

// Makes a route of clear edges the first branch of the tree. A state that it visits again, to gain
// height in a loop, gets a copy: the tree holds each state once.
void BitStarSearch::install(std::vector<std::int32_t> path) {
  for (std::size_t k = 1; k + 1 < path.size(); ++k) {
    const auto passed = path.begin() + static_cast<std::ptrdiff_t>(k);
    if (std::find(path.begin(), passed, path[k]) == passed) {
      continue;
    }
    const std::int32_t copy = append_state(state(static_cast<std::size_t>(path[k])));
    const Evaluated in = *table_.find(edge_id(path[k - 1], path[k]));
    table_.insert(edge_id(path[k - 1], copy), in.cost_m)->is_fine_checked = true;
    const Evaluated out = *table_.find(edge_id(path[k], path[k + 1]));
    table_.insert(edge_id(copy, path[k + 1]), out.cost_m)->is_fine_checked = true;
    path[k] = copy;
  }
  first_new_state_ = x_m_.size();
  build_bins();
  for (LabelSearch& search : label_searches_) {
    search = LabelSearch{};
  }
  push(to_goal_m_[kStart], kStart, -1);
  for (std::size_t k = 1; k < path.size(); ++k) {
    attach(path[k - 1], path[k], table_.find(edge_id(path[k - 1], path[k]))->cost_m);
  }
}

void BitStarSearch::run(std::int64_t work_budget, const ShouldStop& should_stop,
                        const OnEvent& on_event) {
  budget_ = work_budget;
  on_event_ = on_event;
  int until_asked = 0;
  if (come_m_[kGoal] < best_cost_m_) {
    accept_goal();  // the budget of the run before ended in the middle of the fine check
  }
  while (!is_bounded_) {
    if (should_stop()) {
      return;
    }
    step_bounds();
  }
  while (counts_.work_units < budget_ && !is_optimal()) {
    if (--until_asked < 0) {
      until_asked = kStopInterval;
      if (should_stop()) {
        return;
      }
    }
    if (batch_step_ != BatchStep::kNone) {
      step_batch();
      if (batch_step_ == BatchStep::kNone) {
        // Batches cost time but no work units when no edge can be tried (all ground unknown, say).
        const bool is_idle =
            queue_.empty() && !is_labelling_ && work_before_batch_ == counts_.work_units;
        idle_batches_ = is_idle ? idle_batches_ + 1 : 0;
      }
      continue;
    }
    if (is_labelling_) {
      step_labels();
      continue;
    }
    if (queue_.empty() || queue_.front().key_m >= best_cost_m_) {
      if (idle_batches_ > kIdleBatchesMax) {
        return;
      }
      batch_step_ =
          options_.sampler == SamplingRegion::kLevelSet ? BatchStep::kRegion : BatchStep::kDraw;
      work_before_batch_ = counts_.work_units;
      until_asked = 0;
      continue;
    }
    std::pop_heap(queue_.begin(), queue_.end(), is_later);
    const Entry entry = queue_.back();
    queue_.pop_back();
    process(entry);
  }
}

}  // namespace hedgehop::global_planning
