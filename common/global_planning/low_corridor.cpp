#include "global_planning/low_corridor.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "global_planning/route_line.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kAside = 2;
constexpr int kColumns = 2 * kAside + 1;
// The profile looks more densely, and between its samples nothing.
constexpr double kStep_m = 15.0;
constexpr double kMargin_m = 1.0;
constexpr double kClimbShare = 0.98;
constexpr double kEndTolerance_m = 1.5;
constexpr double kSame_m = 1e-6;

// The cheapest arrival at a place from a place of the station before.
struct Arrival {
  double cost_m = kInfinity;
  AltitudeBand altitudes;
  double owed_m = 0.0;
  std::int8_t column_before = -1;  // of the station before that
};

using Arrivals = std::array<std::array<Arrival, kColumns>, kColumns>;  // column before, column
using Station = std::array<geo::MapPoint, kColumns>;

std::vector<Station> stations_of(const std::vector<flight::Waypoint>& base, double station_m,
                                 double aside_m) {
  const RouteLine line(base);
  const int parts = std::max(2, static_cast<int>(std::floor(line.length_m() / station_m + 0.5)));
  std::vector<geo::MapPoint> middle;
  for (int k = 0; k <= parts; ++k) {
    middle.push_back(line.at(line.length_m() * k / parts).point());
  }
  middle.front() = base.front().point();
  middle.back() = base.back().point();
  std::vector<Station> stations(middle.size());
  for (std::size_t i = 0; i < middle.size(); ++i) {
    const bool is_end = i == 0 || i + 1 == middle.size();
    const geo::MapPoint& a = middle[i > 0 ? i - 1 : 0];
    const geo::MapPoint& b = middle[std::min(i + 1, middle.size() - 1)];
    const double length_m = plan_distance_m(a, b);
    const double ux = is_end || !(length_m > 0.0) ? 0.0 : -(b.y_m - a.y_m) / length_m;
    const double uy = is_end || !(length_m > 0.0) ? 0.0 : (b.x_m - a.x_m) / length_m;
    for (int c = 0; c < kColumns; ++c) {
      const double offset_m = (c - kAside) * aside_m;
      stations[i][static_cast<std::size_t>(c)] = {middle[i].x_m + offset_m * ux,
                                                  middle[i].y_m + offset_m * uy};
    }
  }
  return stations;
}

class LowCorridor {
 public:
  LowCorridor(const FlightEnvelope& envelope, std::vector<Station> stations,
              const std::optional<flight::Waypoint>& before,
              const std::optional<flight::Waypoint>& after)
      : envelope_(envelope), stations_(std::move(stations)), before_(before), after_(after) {}

  std::vector<geo::MapPoint> cheapest(double start_m, double goal_m) {
    const std::size_t last = stations_.size() - 1;
    arrivals_.assign(stations_.size(), {});
    Arrival start;
    start.cost_m = 0.0;
    start.altitudes = {start_m, start_m};
    for (int c = 0; c < kColumns; ++c) {
      if (is_end_column(1, c) && (!before_ || may_turn(before_->point(), 0, kAside, c))) {
        advance(0, start, kAside, c, -1);
      }
    }
    for (std::size_t i = 1; i < last; ++i) {
      for (int c1 = 0; c1 < kColumns; ++c1) {
        const std::vector<From> cheapest_first = arrivals_at(i, c1);
        for (int c2 = 0; c2 < kColumns; ++c2) {
          if (is_end_column(i + 1, c2)) {
            advance_all(i, cheapest_first, c1, c2);
          }
        }
      }
    }
    double best_m = kInfinity;
    int best = -1;
    for (int c = 0; c < kColumns; ++c) {
      const Arrival& end = arrival(last, c, kAside);
      if (end.cost_m < best_m && end.altitudes.low_m <= goal_m + kEndTolerance_m &&
          end.altitudes.high_m >= goal_m - kEndTolerance_m &&
          (!after_ || is_turn_allowed(place(last - 1, c), place(last, kAside), after_->point()))) {
        best_m = end.cost_m;
        best = c;
      }
    }
    return best < 0 ? std::vector<geo::MapPoint>{} : track_to_end(best);
  }

 private:
  [[nodiscard]] const geo::MapPoint& place(std::size_t station, int column) const {
    return stations_[station][static_cast<std::size_t>(column)];
  }
  [[nodiscard]] Arrival& arrival(std::size_t station, int before, int column) {
    return arrivals_[station][static_cast<std::size_t>(before)][static_cast<std::size_t>(column)];
  }
  // The places of an end are one.
  [[nodiscard]] bool is_end_column(std::size_t station, int column) const {
    return station + 1 < stations_.size() || column == kAside;
  }
  [[nodiscard]] bool is_turn_allowed(const geo::MapPoint& a, const geo::MapPoint& b,
                                     const geo::MapPoint& c) const {
    return envelope_.is_turn_allowed(b.x_m - a.x_m, b.y_m - a.y_m, c.x_m - b.x_m, c.y_m - b.y_m);
  }
  [[nodiscard]] bool may_turn(const geo::MapPoint& from, std::size_t station, int column,
                              int next) const {
    return is_turn_allowed(from, place(station, column), place(station + 1, next));
  }

  // An arrival, and the column that it came from.
  struct From {
    Arrival arrival;
    int column;
  };

  [[nodiscard]] std::vector<From> arrivals_at(std::size_t station, int column) {
    std::vector<From> found;
    for (int before = 0; before < kColumns; ++before) {
      if (const Arrival& here = arrival(station, before, column); here.cost_m < kInfinity) {
        found.push_back({here, before});
      }
    }
    std::stable_sort(found.begin(), found.end(), [](const From& a, const From& b) {
      return a.arrival.cost_m < b.arrival.cost_m;
    });
    return found;
  }

  // Mostly the ground decides how low the flight may be, wherever it comes from, and the cheapest
  // arrival goes on the most cheaply.
  void advance_all(std::size_t station, const std::vector<From>& cheapest_first, int column,
                   int next) {
    const bool is_by_lowest = envelope_.slopes().is_symmetric();
    std::array<const Arrival*, kColumns> gone_on{};
    std::size_t count = 0;
    for (const From& from : cheapest_first) {
      const bool is_dearer =
          is_by_lowest &&
          std::any_of(gone_on.begin(), gone_on.begin() + count, [&](const Arrival* other) {
            return std::fabs(other->altitudes.low_m - from.arrival.altitudes.low_m) <= kSame_m &&
                   std::fabs(other->owed_m - from.arrival.owed_m) <= kSame_m;
          });
      if (!is_dearer && may_turn(place(station - 1, from.column), station, column, next) &&
          advance(station, from.arrival, column, next, from.column)) {
        gone_on[count++] = &from.arrival;
      }
    }
  }

  // Whether the leg can be flown.
  bool advance(std::size_t station, const Arrival& here, int column, int next, int before) {
    Arrival& there = arrival(station + 1, column, next);
    if (!(here.cost_m < there.cost_m)) {
      return false;
    }
    const FlightEnvelope::Arrival found =
        envelope_.follow(place(station, column), place(station + 1, next), here.altitudes,
                         {kStep_m, kMargin_m, kClimbShare, false, false, true}, here.owed_m);
    if (found.altitudes.is_flyable() && here.cost_m + found.cost_m < there.cost_m) {
      there = {here.cost_m + found.cost_m, found.altitudes, found.owed_m,
               static_cast<std::int8_t>(before)};
    }
    return found.altitudes.is_flyable();
  }

  std::vector<geo::MapPoint> track_to_end(int before_last) {
    std::vector<geo::MapPoint> track;
    int column = kAside;
    int before = before_last;
    for (std::size_t i = stations_.size() - 1; i > 0; --i) {
      track.push_back(place(i, column));
      const int before_that = arrival(i, before, column).column_before;
      column = before;
      before = before_that;
    }
    track.push_back(place(0, kAside));
    std::reverse(track.begin(), track.end());
    return track;
  }

  const FlightEnvelope& envelope_;
  std::vector<Station> stations_;
  std::optional<flight::Waypoint> before_;
  std::optional<flight::Waypoint> after_;
  std::vector<Arrivals> arrivals_;
};

}  // namespace

std::vector<geo::MapPoint> low_corridor_track(const FlightEnvelope& envelope,
                                              const std::vector<flight::Waypoint>& base,
                                              const LowCorridorGrid& grid,
                                              const std::optional<flight::Waypoint>& before,
                                              const std::optional<flight::Waypoint>& after) {
  return LowCorridor(envelope, stations_of(base, grid.station_m, grid.aside_m), before, after)
      .cheapest(base.front().altitude_m, base.back().altitude_m);
}

}  // namespace hedgehop::global_planning
