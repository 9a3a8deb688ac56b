#include "global_planning/roadmap.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>
#include <type_traits>
#include <utility>

#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "global_planning/track_profile.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr float kInfinityFloat = std::numeric_limits<float>::infinity();
constexpr double kTurnMax_rad = 0.46364760900080609;  // between (1, 0) and (2, 1)
constexpr FlightEnvelope::FollowRules kRules{15.0, 2.0, 0.97};
constexpr FlightEnvelope::FollowRules kBackRules{
    .step_m = 15.0, .margin_m = 2.0, .climb_share = 0.97, .is_backward = true};
constexpr double kFieldBlock_m = 180.0;
constexpr double kFar_m = 1e7;  // from the map: start and goal of no problem
constexpr double kProfileStep_m = 10.0;

constexpr double kEndLegMax_m = 600.0;
constexpr double kEndStep_m = 2.5;
constexpr double kIntervalTolerance_m = 3.0;
constexpr int kLabelsMax = 3;  // of one node and direction
constexpr double kInflation = 1.5;
constexpr std::int64_t kStopInterval = 256;

constexpr std::array<char, 8> kMagic = {'H', 'H', 'R', 'O', 'A', 'D', '0', '2'};

struct Header {
  std::array<char, 8> magic;
  std::uint32_t order = 0x01020304U;  // of bytes
  std::int32_t columns = 0, rows = 0;
  std::int32_t map_columns = 0, map_rows = 0;
  std::uint32_t field_numbers = 0;
  std::array<double, 6> places{};  // cell, west and south of the map; spacing, west, south
  std::array<std::uint64_t, 2> key{};
  std::array<std::uint64_t, 2> content{};  // hash of the whole file with zeros here
};
static_assert(std::is_trivially_copyable_v<Header> && sizeof(Header) == 112);
static_assert(std::is_trivially_copyable_v<Roadmap::Edge> && sizeof(Roadmap::Edge) == 24);

constexpr Roadmap::Edge kNoEdge{1.0F, 0.0F, 1.0F, 0.0F, kInfinityFloat, kInfinityFloat};

struct Label {
  double cost_m;
  float low_m, high_m;
  std::int32_t column, row;
  std::int32_t before;     // label, -1: start
  std::int32_t next;       // label of the same node and direction
  std::int32_t direction;  // -1: free, from the start
};
struct Entry {
  double key_m;
  std::int32_t label;
};
constexpr auto kIsLater = [](const Entry& a, const Entry& b) {
  return a.key_m != b.key_m ? a.key_m > b.key_m : a.label > b.label;
};
constexpr std::int32_t kGoalMark = 100;

class Query {
 public:
  Query(const FlightEnvelope& envelope, const Roadmap& roadmap)
      : envelope_(envelope),
        roadmap_(roadmap),
        field_(roadmap.field(), envelope.goal().point(), envelope.start().point()) {
    const double share = Roadmap::rules().climb_share;
    for (int d = 0; d < kLatticeDirections; ++d) {
      const auto& step = kLatticeStep[static_cast<std::size_t>(d)];
      const double length_m = roadmap.spacing_m() *
                              std::sqrt(static_cast<double>(step[0] * step[0] + step[1] * step[1]));
      rise_m_[static_cast<std::size_t>(d)] = share * envelope.slopes().greatest().up * length_m;
      fall_m_[static_cast<std::size_t>(d)] = share * envelope.slopes().greatest().down * length_m;
    }
    first_label_.assign(roadmap.edge_count(), -1);
  }

  std::vector<geo::MapPoint> track(std::int64_t work_budget, std::int64_t& work_units,
                                   const std::function<bool()>& should_stop) {
    begin();
    std::int64_t until_asked = 0;
    std::int32_t goal = -1;
    while (!queue_.empty() && work_units + work_ < work_budget) {
      if (--until_asked < 0) {
        until_asked = kStopInterval;
        if (should_stop()) {
          break;
        }
      }
      std::pop_heap(queue_.begin(), queue_.end(), kIsLater);
      const std::int32_t at = queue_.back().label;
      queue_.pop_back();
      if (labels_[static_cast<std::size_t>(at)].direction == kGoalMark) {
        goal = at;
        break;
      }
      expand(at);
    }
    work_units += work_;
    if (goal < 0) {
      return {};
    }
    std::vector<geo::MapPoint> track = {envelope_.goal().point()};
    for (std::int32_t at = labels_[static_cast<std::size_t>(goal)].before; at > 0;) {
      const Label& label = labels_[static_cast<std::size_t>(at)];
      track.push_back(roadmap_.place(label.column, label.row));
      // Nodes on a straight run are no corners.
      std::int32_t before = label.before;
      while (before > 0 && label.direction >= 0 &&
             labels_[static_cast<std::size_t>(before)].direction == label.direction) {
        before = labels_[static_cast<std::size_t>(before)].before;
      }
      at = before;
    }
    track.push_back(envelope_.start().point());
    std::reverse(track.begin(), track.end());
    return track;
  }

 private:
  [[nodiscard]] geo::MapPoint place(const Label& label) const {
    return label.before < 0 ? envelope_.start().point() : roadmap_.place(label.column, label.row);
  }

  // Ground track of the leg that leads to a label, as far as it is straight.
  [[nodiscard]] std::array<double, 2> run_to(const Label& label) const {
    std::int32_t from = label.before;
    while (from > 0 && label.direction >= 0 &&
           labels_[static_cast<std::size_t>(from)].direction == label.direction) {
      from = labels_[static_cast<std::size_t>(from)].before;
    }
    const geo::MapPoint a = place(labels_[static_cast<std::size_t>(from)]);
    const geo::MapPoint b = place(label);
    return {b.x_m - a.x_m, b.y_m - a.y_m};
  }

  void push(const Label& label, double key_m) {
    labels_.push_back(label);
    queue_.push_back({key_m, static_cast<std::int32_t>(labels_.size() - 1)});
    std::push_heap(queue_.begin(), queue_.end(), kIsLater);
  }

  FlightEnvelope::Arrival follow(const geo::MapPoint& a, const geo::MapPoint& b,
                                 const Label& from) {
    ++work_;
    FlightEnvelope::FollowRules rules = Roadmap::rules();
    rules.step_m = kEndStep_m;
    rules.at_crossings = true;
    return envelope_.follow(
        a, b, {static_cast<double>(from.low_m), static_cast<double>(from.high_m)}, rules);
  }

  void begin() {
    const flight::Waypoint& start = envelope_.start();
    const auto z_m = static_cast<float>(start.altitude_m);
    labels_.push_back({0.0, z_m, z_m, 0, 0, -1, -1, -1});
    const geo::MapPoint origin = roadmap_.place(0, 0);
    const double spacing_m = roadmap_.spacing_m();
    const auto range = [&](double centre_m, double origin_m, int count) {
      const int first =
          static_cast<int>(std::ceil((centre_m - kEndLegMax_m - origin_m) / spacing_m));
      const int last =
          static_cast<int>(std::floor((centre_m + kEndLegMax_m - origin_m) / spacing_m));
      return std::array<int, 2>{std::max(first, 0), std::min(last, count - 1)};
    };
    const auto columns = range(start.x_m, origin.x_m, roadmap_.columns());
    const auto rows = range(start.y_m, origin.y_m, roadmap_.rows());
    for (int row = rows[0]; row <= rows[1]; ++row) {
      for (int column = columns[0]; column <= columns[1]; ++column) {
        const geo::MapPoint to = roadmap_.place(column, row);
        const double dx_m = to.x_m - start.x_m;
        const double dy_m = to.y_m - start.y_m;
        const double ahead_m = field_.cost_m(to);
        if (dx_m * dx_m + dy_m * dy_m > kEndLegMax_m * kEndLegMax_m ||
            (dx_m == 0.0 && dy_m == 0.0) || !(ahead_m < kInfinity) ||
            !envelope_.may_leave_start(dx_m, dy_m)) {
          continue;
        }
        const FlightEnvelope::Arrival arrival = follow(start.point(), to, labels_.front());
        if (arrival.altitudes.is_flyable()) {
          push({arrival.cost_m, static_cast<float>(arrival.altitudes.low_m),
                static_cast<float>(arrival.altitudes.high_m), column, row, 0, -1, -1},
               arrival.cost_m + kInflation * ahead_m);
        }
      }
    }
    try_goal(0);
  }

  void expand(std::int32_t index) {
    const std::int32_t direction = labels_[static_cast<std::size_t>(index)].direction;
    if (direction < 0) {
      for (int d = 0; d < kLatticeDirections; ++d) {
        step(index, d);
      }
    } else {
      for (int d = direction - 1; d <= direction + 1; ++d) {
        step(index, (d + kLatticeDirections) % kLatticeDirections);
      }
    }
    try_goal(index);
  }

  void step(std::int32_t index, int direction) {
    const Label from = labels_[static_cast<std::size_t>(index)];
    const auto& offset = kLatticeStep[static_cast<std::size_t>(direction)];
    const int column = from.column + offset[0];
    const int row = from.row + offset[1];
    if (column < 0 || column >= roadmap_.columns() || row < 0 || row >= roadmap_.rows()) {
      return;
    }
    ++work_;
    const Roadmap::Edge& edge = roadmap_.edge(from.column, from.row, direction);
    const float low_m = std::max(from.low_m, edge.from_low_m);
    const float high_m = std::min(from.high_m, edge.from_high_m);
    if (!(low_m <= high_m)) {
      return;
    }
    const double rise_m = rise_m_[static_cast<std::size_t>(direction)];
    const double fall_m = fall_m_[static_cast<std::size_t>(direction)];
    const auto to_low_m = static_cast<float>(
        std::max(static_cast<double>(edge.to_low_m), static_cast<double>(low_m) - fall_m));
    const auto to_high_m = static_cast<float>(
        std::min(static_cast<double>(edge.to_high_m), static_cast<double>(high_m) + rise_m));
    if (!(to_low_m <= to_high_m)) {
      return;
    }
    if (from.direction < 0) {
      const std::array<double, 2> run = run_to(from);
      if (!envelope_.is_turn_allowed(run[0], run[1], offset[0] * roadmap_.spacing_m(),
                                     offset[1] * roadmap_.spacing_m())) {
        return;
      }
    }
    const double ahead_m = field_.cost_m(roadmap_.place(column, row));
    if (!(ahead_m < kInfinity)) {
      return;
    }
    const double raised = static_cast<double>(low_m - edge.from_low_m) * (1.0 / Roadmap::kRaised_m);
    const double cost_m =
        from.cost_m + static_cast<double>(edge.low_cost_m) +
        raised * static_cast<double>(std::max(edge.raised_cost_m - edge.low_cost_m, 0.0F));
    std::int32_t& chain =
        first_label_[(static_cast<std::size_t>(row) * static_cast<std::size_t>(roadmap_.columns()) +
                      static_cast<std::size_t>(column)) *
                         kLatticeDirections +
                     static_cast<std::size_t>(direction)];
    int count = 0;
    for (std::int32_t at = chain; at >= 0; at = labels_[static_cast<std::size_t>(at)].next) {
      const Label& other = labels_[static_cast<std::size_t>(at)];
      if (other.cost_m <= cost_m &&
          static_cast<double>(other.low_m) <=
              static_cast<double>(to_low_m) + kIntervalTolerance_m &&
          static_cast<double>(other.high_m) >=
              static_cast<double>(to_high_m) - kIntervalTolerance_m) {
        return;
      }
      ++count;
    }
    if (count >= kLabelsMax) {
      return;
    }
    const Label label{cost_m, to_low_m, to_high_m, column, row, index, chain, direction};
    chain = static_cast<std::int32_t>(labels_.size());
    push(label, cost_m + kInflation * ahead_m);
  }

  void try_goal(std::int32_t index) {
    const Label from = labels_[static_cast<std::size_t>(index)];
    const geo::MapPoint a = place(from);
    const flight::Waypoint& goal = envelope_.goal();
    const double dx_m = goal.x_m - a.x_m;
    const double dy_m = goal.y_m - a.y_m;
    if (dx_m * dx_m + dy_m * dy_m > kEndLegMax_m * kEndLegMax_m || (dx_m == 0.0 && dy_m == 0.0)) {
      return;
    }
    if (index > 0) {
      const std::array<double, 2> run = run_to(from);
      if (!envelope_.is_turn_allowed(run[0], run[1], dx_m, dy_m)) {
        return;
      }
    } else if (!envelope_.may_leave_start(dx_m, dy_m)) {
      return;
    }
    const FlightEnvelope::Arrival arrival = follow(a, goal.point(), from);
    if (arrival.altitudes.low_m <= goal.altitude_m && goal.altitude_m <= arrival.altitudes.high_m) {
      Label label = from;
      label.before = index;
      label.direction = kGoalMark;
      label.cost_m = from.cost_m + arrival.cost_m;
      push(label, label.cost_m);
    }
  }

  const FlightEnvelope& envelope_;
  const Roadmap& roadmap_;
  CostField field_;
  // The most that an edge may climb and sink, whatever the altitude.
  std::array<double, kLatticeDirections> rise_m_{}, fall_m_{};
  std::vector<std::int32_t> first_label_;  // per node and direction
  std::vector<Label> labels_;
  std::vector<Entry> queue_;
  std::int64_t work_ = 0;
};

}  // namespace

FlightEnvelope::FollowRules Roadmap::rules() { return kRules; }

Roadmap::Roadmap(const risk::CostModel& costs, const GlobalOptions& options, Observer& observer) {
  const raster::GridGeometry& geometry = costs.map().geometry;
  // Start and goal sink the floor around them: here they do so nowhere.
  const FlightEnvelope ground(costs, options, {geometry.west_m - kFar_m, geometry.south_m, 0.0},
                              {geometry.west_m - kFar_m, geometry.south_m - kFar_m, 0.0});
  field_.emplace(ground, kFieldBlock_m);
  cells_ = geometry;
  // Edges as long as the tangents of both corners.
  spacing_m_ = std::max(2.0 * options.turn_radius_m * elementary::tan(0.5 * kTurnMax_rad) * 1.001,
                        4.0 * geometry.cell_m);
  columns_ = std::max(1, static_cast<int>((geometry.east_m() - geometry.west_m) / spacing_m_));
  rows_ = std::max(1, static_cast<int>((geometry.north_m() - geometry.south_m) / spacing_m_));
  west_m_ =
      geometry.west_m + 0.5 * (geometry.east_m() - geometry.west_m - (columns_ - 1) * spacing_m_);
  south_m_ =
      geometry.south_m + 0.5 * (geometry.north_m() - geometry.south_m - (rows_ - 1) * spacing_m_);
  edges_.assign(
      static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) * kLatticeDirections,
      kNoEdge);
  for (int row = 0; row < rows_; ++row) {
    observer.check_stop();
    observer.progress("roadmap", static_cast<double>(row), static_cast<double>(rows_));
    for (int column = 0; column < columns_; ++column) {
      const geo::MapPoint a = place(column, row);
      const AltitudeBand band = ground.band_at(a);
      if (!band.is_flyable()) {
        continue;
      }
      for (int d = 0; d < kLatticeDirections; ++d) {
        const auto& step = kLatticeStep[static_cast<std::size_t>(d)];
        const int to_column = column + step[0];
        const int to_row = row + step[1];
        if (to_column < 0 || to_column >= columns_ || to_row < 0 || to_row >= rows_) {
          continue;
        }
        const geo::MapPoint b = place(to_column, to_row);
        const AltitudeBand to_band = ground.band_at(b);
        const FlightEnvelope::Arrival there = ground.follow(a, b, band, kRules);
        // What `b` can be reached from.
        const FlightEnvelope::Arrival back = to_band.is_flyable()
                                                 ? ground.follow(b, a, to_band, kBackRules)
                                                 : FlightEnvelope::Arrival{};
        if (!to_band.is_flyable() || !there.altitudes.is_flyable() ||
            !back.altitudes.is_flyable()) {
          continue;
        }
        const FlightEnvelope::Arrival raised =
            ground.follow(a, b,
                          {std::min(back.altitudes.low_m + kRaised_m, back.altitudes.high_m),
                           back.altitudes.high_m},
                          kRules);
        edges_[(static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
                static_cast<std::size_t>(column)) *
                   kLatticeDirections +
               static_cast<std::size_t>(d)] = {
            static_cast<float>(back.altitudes.low_m),  static_cast<float>(back.altitudes.high_m),
            static_cast<float>(there.altitudes.low_m), static_cast<float>(there.altitudes.high_m),
            static_cast<float>(there.cost_m),          static_cast<float>(raised.cost_m)};
      }
    }
  }
}

Bytes Roadmap::written(const Hash128& key) const {
  const std::vector<float> numbers = field_->numbers();
  Header header;
  header.magic = kMagic;
  header.columns = columns_;
  header.rows = rows_;
  header.map_columns = cells_.columns;
  header.map_rows = cells_.rows;
  header.field_numbers = static_cast<std::uint32_t>(numbers.size());
  header.places = {cells_.cell_m, cells_.west_m, cells_.south_m, spacing_m_, west_m_, south_m_};
  header.key = {key.high, key.low};
  const ByteView edges = std::as_bytes(std::span(edges_));
  const ByteView field = std::as_bytes(std::span(numbers));
  const ByteView head = std::as_bytes(std::span(&header, 1));
  Bytes bytes(head.begin(), head.end());
  bytes.insert(bytes.end(), edges.begin(), edges.end());
  bytes.insert(bytes.end(), field.begin(), field.end());
  const Hash128 content = hash128(bytes);  // with zeros in its own place
  header.content = {content.high, content.low};
  std::memcpy(bytes.data(), &header, sizeof header);
  return bytes;
}

std::optional<Roadmap> Roadmap::read(ByteView bytes, const Hash128& key,
                                     const raster::GridGeometry& geometry, std::string& why) {
  const auto refused = [&](const char* reason) {
    why = reason;
    return std::nullopt;
  };
  Header header;
  if (bytes.size() < sizeof header) {
    return refused("it is too short");
  }
  std::memcpy(&header, bytes.data(), sizeof header);
  if (header.magic != kMagic || header.order != Header{}.order) {
    return refused("it is no roadmap of this version");
  }
  if (header.key != std::array<std::uint64_t, 2>{key.high, key.low}) {
    return refused("it was made of another map or with other settings");
  }
  if (header.map_columns != geometry.columns || header.map_rows != geometry.rows ||
      header.places[0] != geometry.cell_m || header.places[1] != geometry.west_m ||
      header.places[2] != geometry.south_m) {
    return refused("it belongs to a map of other extent");
  }
  Roadmap roadmap;
  roadmap.cells_ = geometry;
  roadmap.columns_ = header.columns;
  roadmap.rows_ = header.rows;
  roadmap.spacing_m_ = header.places[3];
  roadmap.west_m_ = header.places[4];
  roadmap.south_m_ = header.places[5];
  // No more nodes than cells; checked before anything is reserved.
  const bool is_lattice = header.columns >= 1 && header.rows >= 1 &&
                          header.columns <= geometry.columns && header.rows <= geometry.rows &&
                          roadmap.spacing_m_ >= geometry.cell_m && roadmap.spacing_m_ <= kFar_m &&
                          geometry.contains(roadmap.place(0, 0)) &&
                          geometry.contains(roadmap.place(header.columns - 1, header.rows - 1));
  if (!is_lattice) {
    return refused("its lattice does not fit the map");
  }
  const std::size_t edges = static_cast<std::size_t>(header.columns) *
                            static_cast<std::size_t>(header.rows) * kLatticeDirections;
  const std::size_t edge_bytes = edges * sizeof(Edge);
  if (bytes.size() != sizeof header + edge_bytes + header.field_numbers * sizeof(float)) {
    return refused("it is cut off or too long");
  }
  const ByteView content = bytes.subspan(sizeof header);
  Header unsigned_header = header;
  unsigned_header.content = {};
  Hasher128 hasher;
  hasher.update(std::as_bytes(std::span(&unsigned_header, 1)));
  hasher.update(content);
  const Hash128 hash = hasher.digest();
  if (header.content != std::array<std::uint64_t, 2>{hash.high, hash.low}) {
    return refused("it is damaged");
  }
  roadmap.edges_.resize(edges);
  std::memcpy(roadmap.edges_.data(), content.data(), edge_bytes);
  for (const Edge& edge : roadmap.edges_) {
    const bool is_absent = edge.from_low_m > edge.from_high_m;
    const bool is_sound = std::isfinite(edge.from_low_m) && std::isfinite(edge.from_high_m) &&
                          std::isfinite(edge.to_low_m) && std::isfinite(edge.to_high_m) &&
                          edge.low_cost_m >= 0.0F && std::isfinite(edge.low_cost_m) &&
                          edge.raised_cost_m >= 0.0F;
    if (!is_absent && !is_sound) {
      return refused("it holds an edge that cannot be");
    }
  }
  std::vector<float> numbers(header.field_numbers);
  std::memcpy(numbers.data(), content.data() + edge_bytes, numbers.size() * sizeof(float));
  roadmap.field_ = CostField::with_numbers(geometry, kFieldBlock_m, std::move(numbers));
  if (!roadmap.field_) {
    return refused("its blocks do not fit the map");
  }
  return roadmap;
}

std::vector<flight::Waypoint> roadmap_route(const FlightEnvelope& envelope, const Roadmap& roadmap,
                                            std::int64_t work_budget, std::int64_t& work_units,
                                            const std::function<bool()>& should_stop) {
  const std::vector<geo::MapPoint> track =
      Query(envelope, roadmap).track(work_budget, work_units, should_stop);
  return track.empty() ? std::vector<flight::Waypoint>{}
                       : lowest_profile(envelope, track, kProfileStep_m);
}

}  // namespace hedgehop::global_planning
