#include "global_planning/corridor_refinement.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <tbb/parallel_for.h>

#include "global_planning/route_finish.hpp"
#include "global_planning/track_profile.hpp"
#include "global_planning/waypoint_moves.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// One of the sweeps of refine(); the first ones look at few heights and get the lowest profile.
struct Sweep {
  CorridorGrid grid;
  bool is_lowered;
};
// From coarse to fine; each is repeated while it pays.
constexpr std::array<Sweep, 6> kSweeps = {{{{250.0, 120.0, 30.0, true}, true},
                                           {{200.0, 60.0, 15.0, true}, true},
                                           {{200.0, 30.0, 8.0, true}, true},
                                           {{150.0, 40.0, 8.0}, false},
                                           {{150.0, 15.0, 4.0}, false},
                                           {{120.0, 10.0, 3.0}, true}}};
constexpr double kProfileStep_m = 10.0;
constexpr int kRepeatsMax = 4;
constexpr double kGainMin = 0.001;  // of the cost, else the next sweep begins

// Costs are compared at this step: what optimises exploits a coarser one.
constexpr double kCostStep_m = 1.0;
// Smaller gains are rounding.
constexpr double kGainLeast = 1e-6;

constexpr int kAside = 3;  // places to either side
constexpr int kColumns = 2 * kAside + 1;
constexpr int kManyHeights = 5;
constexpr int kFewHeights = 2;
// Ten legs of a grid count as one work unit: neighbours share most of their cost.
constexpr std::int64_t work_per_gap(int heights) {
  const std::int64_t places = static_cast<std::int64_t>(kColumns) * heights;
  return places * places / 10;
}
constexpr double kFloorSpare_m = 0.3;
constexpr int kClearTries = 8;
constexpr std::size_t kPieceStations = 16;
constexpr double kPieceOverlap = 0.5;

std::vector<Waypoint> resample(const std::vector<Waypoint>& route, double spacing_m) {
  std::vector<double> along_m = {0.0};
  for (std::size_t i = 1; i < route.size(); ++i) {
    const double dx_m = route[i].x_m - route[i - 1].x_m;
    const double dy_m = route[i].y_m - route[i - 1].y_m;
    along_m.push_back(along_m.back() + std::sqrt(dx_m * dx_m + dy_m * dy_m));
  }
  const double all_m = along_m.back();
  const int parts = std::max(2, static_cast<int>(std::floor(all_m / spacing_m + 0.5)));
  std::vector<Waypoint> points = {route.front()};
  std::size_t leg = 1;
  for (int part = 1; part < parts; ++part) {
    const double at_m = all_m * part / parts;
    while (leg + 1 < route.size() && at_m > along_m[leg]) {
      ++leg;
    }
    const double leg_m = along_m[leg] - along_m[leg - 1];
    const double t = leg_m > 0.0 ? (at_m - along_m[leg - 1]) / leg_m : 0.0;
    const Waypoint& a = route[leg - 1];
    const Waypoint& b = route[leg];
    points.push_back({a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
                      a.altitude_m + t * (b.altitude_m - a.altitude_m)});
  }
  points.push_back(route.back());
  return points;
}

// A corridor with so many heights at each column of a station.
template <int kHeights>
struct Corridors {
  static constexpr int kPlaces = kColumns * kHeights;

  struct Station {
    std::array<Waypoint, kPlaces> places;  // by column, then height
    std::array<bool, kPlaces> is_used;
  };

  using Legs = std::array<float, kPlaces * kPlaces>;  // from, to

  // The grid of places around one point of the route; `fixed`: this point alone.
  static Station station_of(const FlightEnvelope& envelope, const Waypoint& before,
                            const Waypoint& base, const Waypoint& after, const CorridorGrid& grid,
                            bool is_fixed) {
    Station station{};
    const double dx_m = after.x_m - before.x_m;
    const double dy_m = after.y_m - before.y_m;
    const double length_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    const double ux = length_m > 0.0 ? -dy_m / length_m : 0.0;
    const double uy = length_m > 0.0 ? dx_m / length_m : 0.0;
    const AltitudeBand own = envelope.band_at(base.point());
    for (int column = 0; column < kColumns; ++column) {
      const int aside = column - kAside;
      const auto first = static_cast<std::size_t>(column * kHeights);
      const geo::MapPoint point{base.x_m + aside * grid.aside_m * ux,
                                base.y_m + aside * grid.aside_m * uy};
      const AltitudeBand band = envelope.band_at(point);
      for (int k = 0; k < kHeights; ++k) {
        const std::size_t at = first + static_cast<std::size_t>(k);
        Waypoint& place = station.places[at];
        if (aside == 0 && k == 0) {
          place = base;
          station.is_used[at] = true;
          continue;
        }
        if (is_fixed || !band.is_flyable()) {
          continue;
        }
        // Keeps the height above the floor; the last one of many is the floor itself.
        constexpr std::array<int, kManyHeights> kUp = {0, 1, -1, -2, 0};
        double altitude_m = band.low_m + kFloorSpare_m;
        if (k + 1 < kManyHeights) {
          altitude_m = std::max(altitude_m, band.low_m + (base.altitude_m - own.low_m) +
                                                kUp[static_cast<std::size_t>(k)] * grid.height_m);
        }
        place = {point.x_m, point.y_m, altitude_m};
        station.is_used[at] = altitude_m <= band.high_m;
        for (std::size_t other = first; station.is_used[at] && other < at; ++other) {
          if (station.is_used[other] &&
              std::fabs(station.places[other].altitude_m - altitude_m) < 0.05) {
            station.is_used[at] = false;
          }
        }
      }
    }
    return station;
  }

  class Corridor {
   public:
    /// `before` and `after`: legs that join the route at its ends, for their turns; may be missing.
    Corridor(const FlightEnvelope& envelope, std::vector<Station> stations,
             std::optional<Waypoint> before, std::optional<Waypoint> after)
        : envelope_(envelope),
          stations_(std::move(stations)),
          before_(before),
          after_(after),
          legs_(stations_.size() - 1) {
      tbb::parallel_for(std::size_t{0}, legs_.size(), [&](std::size_t gap) { cost_legs(gap); });
    }

    /// The cheapest polyline all of whose legs are clear; empty if none was found.
    std::vector<Waypoint> best() {
      for (int attempt = 0; attempt < kClearTries; ++attempt) {
        const std::vector<int> chosen = cheapest();
        if (chosen.empty()) {
          return {};
        }
        bool is_clear = true;
        for (std::size_t gap = 0; gap < legs_.size(); ++gap) {
          const auto a = static_cast<std::size_t>(chosen[gap]);
          const auto b = static_cast<std::size_t>(chosen[gap + 1]);
          if (!envelope_.is_clear(stations_[gap].places[a], stations_[gap + 1].places[b])) {
            legs_[gap][a * kPlaces + b] = std::numeric_limits<float>::infinity();
            is_clear = false;
          }
        }
        if (is_clear) {
          std::vector<Waypoint> route;
          for (std::size_t i = 0; i < stations_.size(); ++i) {
            route.push_back(stations_[i].places[static_cast<std::size_t>(chosen[i])]);
          }
          return route;
        }
      }
      return {};
    }

   private:
    // Of all legs over one gap: those between the same two columns have the same ground below.
    void cost_legs(std::size_t gap) {
      legs_[gap].fill(std::numeric_limits<float>::infinity());
      std::vector<std::size_t> first;
      std::vector<std::size_t> second;
      std::vector<double> from_m;
      std::vector<double> to_m;
      std::vector<double> costs_m;
      const auto take_column = [](const Station& station, int column,
                                  std::vector<std::size_t>& places,
                                  std::vector<double>& altitudes_m) {
        places.clear();
        altitudes_m.clear();
        for (int k = 0; k < kHeights; ++k) {
          const auto at = static_cast<std::size_t>(column * kHeights + k);
          if (station.is_used[at]) {
            places.push_back(at);
            altitudes_m.push_back(station.places[at].altitude_m);
          }
        }
      };
      for (int a = 0; a < kColumns; ++a) {
        take_column(stations_[gap], a, first, from_m);
        for (int b = 0; b < kColumns && !first.empty(); ++b) {
          take_column(stations_[gap + 1], b, second, to_m);
          if (second.empty()) {
            continue;
          }
          envelope_.leg_costs_m(stations_[gap].places[first.front()].point(), from_m,
                                stations_[gap + 1].places[second.front()].point(), to_m, costs_m);
          for (std::size_t i = 0; i < first.size(); ++i) {
            for (std::size_t j = 0; j < second.size(); ++j) {
              legs_[gap][first[i] * kPlaces + second[j]] =
                  static_cast<float>(costs_m[i * second.size() + j]);
            }
          }
        }
      }
    }

    // Plan position of a column; its places share it.
    [[nodiscard]] const Waypoint* column_point(std::size_t station, int column) const {
      for (int k = 0; k < kHeights; ++k) {
        const auto at = static_cast<std::size_t>(column * kHeights + k);
        if (stations_[station].is_used[at]) {
          return &stations_[station].places[at];
        }
      }
      return nullptr;
    }

    // Per station the index of the place; empty if nothing joins.
    std::vector<int> cheapest() const {
      const std::size_t count = stations_.size();
      // value[column before][place]
      using Values = std::array<std::array<double, kPlaces>, kColumns>;
      struct Choice {
        std::array<std::array<std::int8_t, kPlaces>, kColumns> place;   // of the station before
        std::array<std::array<std::int8_t, kPlaces>, kColumns> column;  // of the one before that
      };
      std::vector<Choice> choices(count);
      Values value{};
      for (auto& row : value) {
        row.fill(kInfinity);
      }
      // Station 1 from station 0, whose column before does not exist.
      for (int c0 = 0; c0 < kColumns; ++c0) {
        const Waypoint* from = column_point(0, c0);
        if (from == nullptr) {
          continue;
        }
        for (int p1 = 0; p1 < kPlaces; ++p1) {
          const auto to = static_cast<std::size_t>(p1);
          if (!stations_[1].is_used[to] ||
              (before_ && !is_turn_allowed(*before_, *from, stations_[1].places[to]))) {
            continue;
          }
          for (int k = 0; k < kHeights; ++k) {
            const int p0 = c0 * kHeights + k;
            const double cost_m =
                static_cast<double>(legs_[0][static_cast<std::size_t>(p0) * kPlaces + to]);
            if (cost_m < value[static_cast<std::size_t>(c0)][to]) {
              value[static_cast<std::size_t>(c0)][to] = cost_m;
              choices[1].place[static_cast<std::size_t>(c0)][to] = static_cast<std::int8_t>(p0);
            }
          }
        }
      }
      for (std::size_t i = 2; i < count; ++i) {
        Values next{};
        for (auto& row : next) {
          row.fill(kInfinity);
        }
        for (int c1 = 0; c1 < kColumns; ++c1) {
          const Waypoint* corner = column_point(i - 1, c1);
          if (corner == nullptr) {
            continue;
          }
          for (int c2 = 0; c2 < kColumns; ++c2) {
            const Waypoint* to = column_point(i, c2);
            if (to == nullptr) {
              continue;
            }
            // The cheapest way to each height of the corner that may turn into this column.
            std::array<double, kHeights> come{};
            come.fill(kInfinity);
            std::array<std::int8_t, kHeights> come_column{};
            for (int c0 = 0; c0 < kColumns; ++c0) {
              const Waypoint* from = column_point(i - 2, c0);
              if (from == nullptr || !is_turn_allowed(*from, *corner, *to)) {
                continue;
              }
              for (int k = 0; k < kHeights; ++k) {
                const double cost_m = value[static_cast<std::size_t>(c0)]
                                           [static_cast<std::size_t>(c1 * kHeights + k)];
                if (cost_m < come[static_cast<std::size_t>(k)]) {
                  come[static_cast<std::size_t>(k)] = cost_m;
                  come_column[static_cast<std::size_t>(k)] = static_cast<std::int8_t>(c0);
                }
              }
            }
            for (int k1 = 0; k1 < kHeights; ++k1) {
              const double come_m = come[static_cast<std::size_t>(k1)];
              if (come_m == kInfinity) {
                continue;
              }
              const int p1 = c1 * kHeights + k1;
              for (int k2 = 0; k2 < kHeights; ++k2) {
                const auto p2 = static_cast<std::size_t>(c2 * kHeights + k2);
                const double cost_m =
                    come_m +
                    static_cast<double>(legs_[i - 1][static_cast<std::size_t>(p1) * kPlaces + p2]);
                if (cost_m < next[static_cast<std::size_t>(c1)][p2]) {
                  next[static_cast<std::size_t>(c1)][p2] = cost_m;
                  choices[i].place[static_cast<std::size_t>(c1)][p2] = static_cast<std::int8_t>(p1);
                  choices[i].column[static_cast<std::size_t>(c1)][p2] =
                      come_column[static_cast<std::size_t>(k1)];
                }
              }
            }
          }
        }
        value = next;
      }
      double best_m = kInfinity;
      int best_column = -1;
      int best_place = -1;
      for (int c = 0; c < kColumns; ++c) {
        const Waypoint* from = column_point(count - 2, c);
        for (int p = 0; from != nullptr && p < kPlaces; ++p) {
          const auto at = static_cast<std::size_t>(p);
          if (value[static_cast<std::size_t>(c)][at] < best_m &&
              (!after_ || is_turn_allowed(*from, stations_.back().places[at], *after_))) {
            best_m = value[static_cast<std::size_t>(c)][at];
            best_column = c;
            best_place = p;
          }
        }
      }
      if (best_place < 0) {
        return {};
      }
      std::vector<int> chosen(count);
      for (std::size_t i = count - 1; i > 0; --i) {
        chosen[i] = best_place;
        const auto c = static_cast<std::size_t>(best_column);
        const auto p = static_cast<std::size_t>(best_place);
        best_place = choices[i].place[c][p];
        best_column = choices[i].column[c][p];
      }
      chosen[0] = best_place;
      return chosen;
    }

    [[nodiscard]] bool is_turn_allowed(const Waypoint& a, const Waypoint& b,
                                       const Waypoint& c) const {
      return envelope_.is_turn_allowed(b.x_m - a.x_m, b.y_m - a.y_m, c.x_m - b.x_m, c.y_m - b.y_m);
    }

    const FlightEnvelope& envelope_;
    std::vector<Station> stations_;
    std::optional<Waypoint> before_;
    std::optional<Waypoint> after_;
    std::vector<Legs> legs_;
  };
};

template <int kHeights>
std::vector<Waypoint> best_in_corridor(const FlightEnvelope& envelope,
                                       const std::vector<Waypoint>& base, const CorridorGrid& grid,
                                       const std::optional<Waypoint>& before,
                                       const std::optional<Waypoint>& after,
                                       std::int64_t& work_units) {
  using Shape = Corridors<kHeights>;
  const std::vector<Waypoint> line = resample(base, grid.station_m);
  std::vector<typename Shape::Station> stations;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const bool is_end = i == 0 || i + 1 == line.size();
    stations.push_back(Shape::station_of(envelope, line[i > 0 ? i - 1 : 0], line[i],
                                         line[std::min(i + 1, line.size() - 1)], grid, is_end));
  }
  work_units += work_per_gap(kHeights) * static_cast<std::int64_t>(line.size() - 1);
  return typename Shape::Corridor(envelope, std::move(stations), before, after).best();
}

// Ten legs of a grid count as one work unit.
std::int64_t work_of(double length_m, const CorridorGrid& grid) {
  return work_per_gap(grid.has_few_heights ? kFewHeights : kManyHeights) *
         (static_cast<std::int64_t>(length_m / grid.station_m) + 2);
}

}  // namespace

std::vector<Waypoint> corridor_route(const FlightEnvelope& envelope,
                                     const std::vector<Waypoint>& base, const CorridorGrid& grid,
                                     const std::optional<Waypoint>& before,
                                     const std::optional<Waypoint>& after,
                                     std::int64_t& work_units) {
  return grid.has_few_heights
             ? best_in_corridor<kFewHeights>(envelope, base, grid, before, after, work_units)
             : best_in_corridor<kManyHeights>(envelope, base, grid, before, after, work_units);
}

double sweep_corridor(const FlightEnvelope& envelope, const CorridorGrid& grid,
                      std::int64_t work_budget, std::int64_t& work_units,
                      std::vector<Waypoint>& waypoints, double cost_m) {
  const auto cost_of = [&](const std::vector<Waypoint>& route) {
    return envelope.route_cost_m(route, kCostStep_m);
  };
  // A station may move beyond its neighbours where the route bends; such legs fail by their turns.
  const auto sweep_over = [&](const std::vector<Waypoint>& piece,
                              const std::optional<Waypoint>& before,
                              const std::optional<Waypoint>& after) {
    return corridor_route(envelope, piece, grid, before, after, work_units);
  };
  const auto spliced = [&](std::size_t first, std::size_t last,
                           const std::vector<Waypoint>& piece) {
    std::vector<Waypoint> route(waypoints.begin(),
                                waypoints.begin() + static_cast<std::ptrdiff_t>(first));
    route.insert(route.end(), piece.begin(), piece.end());
    route.insert(route.end(), waypoints.begin() + static_cast<std::ptrdiff_t>(last) + 1,
                 waypoints.end());
    return route;
  };
  // Pieces of the route between two of its waypoints, each replaced where that is cheaper.
  const auto sweep_pieces = [&] {
    const double piece_m = grid.station_m * static_cast<double>(kPieceStations);
    std::size_t first = 0;
    while (first + 1 < waypoints.size()) {
      std::size_t last = first + 1;
      double length_m = flight::length_m({waypoints[first], waypoints[last]});
      std::size_t next = last;
      while (last + 1 < waypoints.size() && length_m < piece_m) {
        if (length_m < kPieceOverlap * piece_m) {
          next = last;
        }
        length_m += flight::length_m({waypoints[last], waypoints[last + 1]});
        ++last;
      }
      if (length_m >= 2.0 * grid.station_m) {
        if (work_units + work_of(length_m, grid) > work_budget) {
          return;
        }
        const std::vector<Waypoint> piece(
            waypoints.begin() + static_cast<std::ptrdiff_t>(first),
            waypoints.begin() + static_cast<std::ptrdiff_t>(last) + 1);
        const std::vector<Waypoint> better = sweep_over(
            piece, first > 0 ? std::optional(waypoints[first - 1]) : envelope.before_start(),
            last + 1 < waypoints.size() ? std::optional(waypoints[last + 1]) : std::nullopt);
        if (!better.empty() && cost_of(better) < cost_of(piece) * (1.0 - kGainLeast) &&
            are_turns_allowed(envelope, spliced(first, last, better))) {
          const double half_m = kPieceOverlap * flight::length_m(better);
          double along_m = 0.0;
          next = first;
          for (std::size_t i = 1; i < better.size() && along_m < half_m; ++i) {
            along_m += flight::length_m({better[i - 1], better[i]});
            ++next;
          }
          waypoints = spliced(first, last, better);
        }
      }
      if (last + 1 >= waypoints.size() && next <= first) {
        break;
      }
      first = std::max(next, first + 1);
    }
  };
  std::vector<Waypoint> better = sweep_over(waypoints, envelope.before_start(), std::nullopt);
  if (better.empty()) {
    sweep_pieces();
    return cost_of(waypoints);
  }
  const double better_m = cost_of(better);
  if (better_m < cost_m * (1.0 - kGainLeast)) {
    waypoints = std::move(better);
    return better_m;
  }
  return cost_m;
}

void refine(const FlightEnvelope& envelope, std::int64_t work_budget, std::int64_t& work_units,
            std::vector<Waypoint>& waypoints, const OnRefined& on_refined) {
  double best_m = envelope.route_cost_m(waypoints, kCostStep_m);
  for (const Sweep& sweep : kSweeps) {
    for (int repeat = 0; repeat < kRepeatsMax; ++repeat) {
      if (work_units + work_of(flight::length_m(waypoints), sweep.grid) > work_budget) {
        return;
      }
      const double before_m = best_m;
      best_m = sweep_corridor(envelope, sweep.grid, work_budget, work_units, waypoints, best_m);
      if (on_refined(best_m, work_units)) {
        return;
      }
      if (!(before_m - best_m > kGainMin * before_m)) {
        break;
      }
    }
    if (!sweep.is_lowered) {
      continue;
    }
    // Altitudes of a sweep lie on a grid; along its track they can be lower still.
    if (auto lowest = cheaper_profile(envelope, waypoints, kProfileStep_m, kCostStep_m);
        !lowest.empty()) {
      waypoints = std::move(lowest);
      best_m = envelope.route_cost_m(waypoints, kCostStep_m);
      if (on_refined(best_m, work_units)) {
        return;
      }
    }
  }
  best_m = move_waypoints(envelope, work_budget, work_units, waypoints, best_m);
  on_refined(best_m, work_units);
}

}  // namespace hedgehop::global_planning
