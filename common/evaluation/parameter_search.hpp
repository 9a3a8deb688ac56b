#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/observer.hpp"

namespace hedgehop::evaluation {

/// Where a parameter may lie. Searched in ratios if it is logarithmic, then `low` is above 0.
struct ParameterRange {
  std::string key;  // of the planning config
  double low = 0.0;
  double high = 0.0;
  bool is_logarithmic = false;

  /// Share of the range, in [0, 1]; of ratios if it is logarithmic.
  [[nodiscard]] double share_of(double value) const;
  /// Its value with four significant digits.
  [[nodiscard]] double value_at(double share) const;
};

struct SearchOptions {
  std::int64_t evaluations_max = 0;  // of different points
  double first_step_share = 0.0;     // of each range
};

struct SearchResult {
  std::vector<double> values;  // the best, in the order of the ranges
  double least = 0.0;          // objective there
  double at_start = 0.0;
  std::int64_t evaluations = 0;
  bool is_stopped = false;  // by the observer
};

/// Value of a point, to be made small; finite. May be discontinuous.
using Objective = std::function<double(const std::vector<double>& values)>;

/// Searches for parameters without derivatives: subplex within bounds (a Nelder-Mead simplex in one
/// small subspace after another, which bears kinks and steps), from `start` on.
///
/// Points are rounded to four significant digits before they are judged, so that what is written
/// down is what was judged; a point that comes again is not judged again. Nothing is drawn: the
/// same objective gives the same result.
///
/// Source: T. H. Rowan, "Functional stability analysis of numerical algorithms", PhD thesis,
/// University of Texas at Austin, 1990, as implemented by NLopt.
///
/// @param start  within the ranges; judged first, exactly
/// @return  the best of all points that were judged; the first of equal ones
/// @throws Interrupted  if the observer says so before the start was judged.
/// @throws std::invalid_argument  for no ranges, an empty range, a start outside of it.
SearchResult search_parameters(const std::vector<ParameterRange>& ranges,
                               const std::vector<double>& start, const SearchOptions& options,
                               const Objective& objective, Observer& observer);

}  // namespace hedgehop::evaluation
