#pragma once

#include <cstdint>
#include <vector>

namespace hedgehop::evaluation {

/// NaN for no values; the mean of the middle two of an even number.
double median_of(std::vector<double> values);
/// The least value that at least `share` of all do not exceed (nearest rank); NaN for no values.
///
/// @param share  above 0, at most 1
double quantile_of(std::vector<double> values, double share);

/// How a quantity changed between pairs of runs. Changes are relative: -0.05 is a twentieth less.
struct PairedChange {
  std::int64_t pairs = 0;
  double sum = 0.0;           // of the changed runs
  double baseline_sum = 0.0;  // of the runs they are compared with
  double change = 0.0;        // of the sums; NaN if the baseline's is not above 0
  double low = 0.0;           // bounds of the 95 % bootstrap interval of `change`
  double high = 0.0;
  std::int64_t ratio_pairs = 0;   // pairs whose baseline is above 0: of these are
  double mean_change = 0.0;       // the mean of each pair's own change and
  double change_deviation = 0.0;  // its sample standard deviation
};

/// @param values           of the changed runs
/// @param baseline         of the same length
/// @param bootstrap_draws  resamplings of the pairs for the percentile interval
/// @throws std::invalid_argument  for different lengths, no pairs or no draws.
/// @note  A function of its arguments alone.
///
/// Source of the interval: B. Efron and R. J. Tibshirani, "An Introduction to the Bootstrap", 1993,
/// section 13.3.
PairedChange paired_change(const std::vector<double>& values, const std::vector<double>& baseline,
                           std::int64_t bootstrap_draws, std::uint64_t seed);

}  // namespace hedgehop::evaluation
