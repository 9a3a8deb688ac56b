#include "evaluation/paired_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "global_planning/random_source.hpp"

namespace hedgehop::evaluation {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

double relative_change(double value, double baseline) {
  return baseline > 0.0 ? value / baseline - 1.0 : kNan;
}

}  // namespace

double median_of(std::vector<double> values) {
  if (values.empty()) {
    return kNan;
  }
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 == 1 ? values[middle] : 0.5 * (values[middle - 1] + values[middle]);
}

double quantile_of(std::vector<double> values, double share) {
  if (values.empty()) {
    return kNan;
  }
  std::sort(values.begin(), values.end());
  const double rank = std::ceil(share * static_cast<double>(values.size()));
  return values[std::max<std::size_t>(1, static_cast<std::size_t>(rank)) - 1];
}

PairedChange paired_change(const std::vector<double>& values, const std::vector<double>& baseline,
                           std::int64_t bootstrap_draws, std::uint64_t seed) {
  if (values.empty() || values.size() != baseline.size() || bootstrap_draws < 1) {
    throw std::invalid_argument("a paired change needs pairs and draws");
  }
  PairedChange result;
  result.pairs = static_cast<std::int64_t>(values.size());
  std::vector<double> ratios;
  for (std::size_t i = 0; i < values.size(); ++i) {
    result.sum += values[i];
    result.baseline_sum += baseline[i];
    if (baseline[i] > 0.0) {
      ratios.push_back(values[i] / baseline[i] - 1.0);
    }
  }
  result.change = relative_change(result.sum, result.baseline_sum);
  result.ratio_pairs = static_cast<std::int64_t>(ratios.size());
  const auto count = static_cast<double>(ratios.size());
  for (const double ratio : ratios) {
    result.mean_change += ratio / count;
  }
  double squares = 0.0;
  for (const double ratio : ratios) {
    squares += (ratio - result.mean_change) * (ratio - result.mean_change);
  }
  result.mean_change = ratios.empty() ? kNan : result.mean_change;
  result.change_deviation = ratios.size() < 2 ? kNan : std::sqrt(squares / (count - 1.0));

  global_planning::RandomSource random(seed);
  std::vector<double> drawn;
  for (std::int64_t draw = 0; draw < bootstrap_draws; ++draw) {
    double sum = 0.0;
    double baseline_sum = 0.0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const auto at = static_cast<std::size_t>(random.unit() * static_cast<double>(values.size()));
      sum += values[at];
      baseline_sum += baseline[at];
    }
    if (baseline_sum > 0.0) {
      drawn.push_back(sum / baseline_sum - 1.0);
    }
  }
  if (drawn.empty()) {
    result.low = result.high = kNan;
    return result;
  }
  std::sort(drawn.begin(), drawn.end());
  const auto quantile = [&](double share) {
    return drawn[std::min(drawn.size() - 1,
                          static_cast<std::size_t>(share * static_cast<double>(drawn.size())))];
  };
  result.low = quantile(0.025);
  result.high = quantile(0.975);
  return result;
}

}  // namespace hedgehop::evaluation
