#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "flight/trajectory.hpp"
#include "flight/verdict.hpp"

namespace hedgehop::verification {

/// Collects what is broken, rule by rule.
class Findings {
 public:
  void add(const std::string& rule, const flight::FlightState& state, double value, double limit) {
    add(rule, state.time_s, state.point(), value, limit);
  }

  void add(const std::string& rule, double time_s, const geo::MapPoint& place, double value,
           double limit) {
    const double excess = std::fabs(value - limit) / std::max(std::fabs(limit), 1e-9);
    const double severity =
        std::isfinite(excess) ? excess : std::numeric_limits<double>::infinity();
    by_rule_[rule].push_back({severity, {rule, time_s, place, value, limit}});
    ++count_;
  }

  [[nodiscard]] std::int64_t count() const { return count_; }

  // Sorted by rule, then worst first. Each rule keeps its worst ones; room is shared evenly.
  [[nodiscard]] std::vector<flight::Violation> worst() {
    std::size_t longest = 0;
    for (auto& [rule, findings] : by_rule_) {
      std::stable_sort(findings.begin(), findings.end(),
                       [](const Finding& a, const Finding& b) { return a.severity > b.severity; });
      longest = std::max(longest, findings.size());
    }
    std::map<std::string, std::size_t> kept;
    std::size_t total = 0;
    for (std::size_t rank = 0; rank < longest && total < kViolationsKept; ++rank) {
      for (const auto& [rule, findings] : by_rule_) {
        if (rank < findings.size() && total < kViolationsKept) {
          ++kept[rule];
          ++total;
        }
      }
    }
    std::vector<flight::Violation> worst;
    for (const auto& [rule, findings] : by_rule_) {
      for (std::size_t i = 0; i < kept[rule]; ++i) {
        worst.push_back(findings[i].violation);
      }
    }
    return worst;
  }

 private:
  static constexpr std::size_t kViolationsKept = 100;

  struct Finding {
    double severity =
        0.0;  // share of the limit by which it is broken; infinite for what is unknown
    flight::Violation violation;
  };

  std::map<std::string, std::vector<Finding>> by_rule_;
  std::int64_t count_ = 0;
};

}  // namespace hedgehop::verification
