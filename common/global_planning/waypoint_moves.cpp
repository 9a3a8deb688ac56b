#include "global_planning/waypoint_moves.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "global_planning/route_finish.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;

constexpr std::array<double, 4> kMoves_m = {20.0, 10.0, 5.0, 2.5};
constexpr double kHeightShare = 0.14;  // of a move: about the slope that may be flown
constexpr int kRounds = 3;             // with each of kMoves_m
constexpr std::size_t kGroupMax = 3;
constexpr double kStep_m = 2.5;
constexpr double kCostStep_m = 1.0;
constexpr double kGainLeast_m = 1e-6;  // smaller ones are rounding
// Turns are looked at as far as this from a move; runs of straight legs seldom have more.
constexpr std::size_t kAround = 12;
// Directions of a move, up and down with it and without.
constexpr std::int64_t kTries = 26;
constexpr std::int64_t kGroupTries = 8;  // not along the way

class Moves {
 public:
  Moves(const FlightEnvelope& envelope, std::vector<Waypoint>& waypoints)
      : envelope_(envelope), waypoints_(waypoints) {
    for (std::size_t i = 1; i < waypoints.size(); ++i) {
      leg_m_.push_back(leg_cost_m(waypoints[i - 1], waypoints[i]));
    }
  }

  /// Every group once, from one end to the other and then back; those alone where something moved
  /// in the round before.
  void round(double move_m, bool is_backward) {
    for (std::size_t group = 1; group <= kGroupMax; ++group) {
      for (std::size_t n = 1; n + group < waypoints_.size(); ++n) {
        const std::size_t first = is_backward ? waypoints_.size() - group - n : n;
        if (is_worth_a_try(first, group)) {
          move(first, group, move_m);
        }
      }
    }
    is_moved_before_.swap(is_moved_);
    std::fill(is_moved_.begin(), is_moved_.end(), false);
  }
  void try_all() {
    is_moved_before_.assign(waypoints_.size(), true);
    is_moved_.assign(waypoints_.size(), false);
  }
  [[nodiscard]] std::int64_t legs() const { return legs_; }

 private:
  [[nodiscard]] bool is_worth_a_try(std::size_t first, std::size_t group) const {
    for (std::size_t i = first - 1; i <= first + group; ++i) {
      if (is_moved_before_[i] || is_moved_[i]) {
        return true;
      }
    }
    return false;
  }

  double leg_cost_m(const Waypoint& a, const Waypoint& b) {
    ++legs_;
    return envelope_.leg_cost_m(a, b, kStep_m);
  }

  [[nodiscard]] bool are_turns_kept(std::size_t first, std::size_t group) {
    const std::size_t begin = first - std::min(first, kAround);
    const std::size_t end = std::min(first + group + kAround, waypoints_.size());
    around_.assign(waypoints_.begin() + static_cast<std::ptrdiff_t>(begin),
                   waypoints_.begin() + static_cast<std::ptrdiff_t>(end));
    return are_turns_allowed(envelope_, around_);
  }

  // The best of all moves of waypoints [first, first + group).
  void move(std::size_t first, std::size_t group, double move_m) {
    const Waypoint& before = waypoints_[first - 1];
    const Waypoint& after = waypoints_[first + group];
    const double dx_m = after.x_m - before.x_m;
    const double dy_m = after.y_m - before.y_m;
    const double length_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    if (!(length_m > 0.0)) {
      return;
    }
    const double along_x_m = move_m * dx_m / length_m;
    const double along_y_m = move_m * dy_m / length_m;
    std::array<Waypoint, kGroupMax> from{};
    std::array<Waypoint, kGroupMax> best{};
    std::array<double, kGroupMax + 1> best_legs_m{};
    std::copy_n(waypoints_.begin() + static_cast<std::ptrdiff_t>(first), group, from.begin());
    double best_m = -kGainLeast_m;
    for (std::size_t i = first - 1; i < first + group; ++i) {
      best_m += leg_m_[i];
    }
    bool has_best = false;
    const int along_max = group == 1 ? 1 : 0;
    for (int along = -along_max; along <= along_max; ++along) {
      for (int across = -1; across <= 1; ++across) {
        for (int up = -1; up <= 1; ++up) {
          if (along == 0 && across == 0 && up == 0) {
            continue;
          }
          for (std::size_t i = 0; i < group; ++i) {
            waypoints_[first + i] = {from[i].x_m + along * along_x_m - across * along_y_m,
                                     from[i].y_m + along * along_y_m + across * along_x_m,
                                     from[i].altitude_m + up * kHeightShare * move_m};
          }
          std::array<double, kGroupMax + 1> legs_m{};
          double sum_m = 0.0;
          for (std::size_t i = 0; i <= group && sum_m < best_m; ++i) {
            legs_m[i] = leg_cost_m(waypoints_[first + i - 1], waypoints_[first + i]);
            sum_m += legs_m[i];
          }
          if (sum_m < best_m && are_turns_kept(first, group) && is_clear(first, group)) {
            best_m = sum_m - kGainLeast_m;
            best_legs_m = legs_m;
            std::copy_n(waypoints_.begin() + static_cast<std::ptrdiff_t>(first), group,
                        best.begin());
            has_best = true;
          }
        }
      }
    }
    std::copy_n(has_best ? best.begin() : from.begin(), group,
                waypoints_.begin() + static_cast<std::ptrdiff_t>(first));
    if (has_best) {
      std::copy_n(best_legs_m.begin(), group + 1,
                  leg_m_.begin() + static_cast<std::ptrdiff_t>(first) - 1);
      std::fill_n(is_moved_.begin() + static_cast<std::ptrdiff_t>(first), group, true);
    }
  }

  [[nodiscard]] bool is_clear(std::size_t first, std::size_t group) const {
    for (std::size_t i = first; i <= first + group; ++i) {
      if (!envelope_.is_clear(waypoints_[i - 1], waypoints_[i])) {
        return false;
      }
    }
    return true;
  }

  const FlightEnvelope& envelope_;
  std::vector<Waypoint>& waypoints_;
  std::vector<double> leg_m_;  // cost, by first waypoint
  std::vector<bool> is_moved_before_;
  std::vector<bool> is_moved_;
  std::vector<Waypoint> around_;
  std::int64_t legs_ = 0;
};

// Legs that a round looks at, at most.
std::int64_t legs_of_round(std::size_t waypoints) {
  std::int64_t legs = kTries * 2;
  for (std::size_t group = 2; group <= kGroupMax; ++group) {
    legs += kGroupTries * static_cast<std::int64_t>(group + 1);
  }
  return legs * static_cast<std::int64_t>(waypoints);
}

}  // namespace

double move_waypoints(const FlightEnvelope& envelope, std::int64_t work_budget,
                      std::int64_t& work_units, std::vector<Waypoint>& waypoints, double cost_m) {
  constexpr std::int64_t kLegsOfUnit = 10;
  std::vector<Waypoint> moved = waypoints;
  Moves moves(envelope, moved);
  const auto work = [&] { return work_units + moves.legs() / kLegsOfUnit; };
  const std::int64_t round_work = legs_of_round(moved.size()) / kLegsOfUnit;
  for (const double move_m : kMoves_m) {
    moves.try_all();
    for (int round = 0; round < kRounds && work() + round_work <= work_budget; ++round) {
      moves.round(move_m, round % 2 == 1);
    }
  }
  work_units = work();
  const double moved_m = envelope.route_cost_m(moved, kCostStep_m);
  if (!(moved_m < cost_m - kGainLeast_m)) {
    return cost_m;
  }
  waypoints = std::move(moved);
  return moved_m;
}

}  // namespace hedgehop::global_planning
