#include "evaluation/parameter_search.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <limits>
#include <map>
#include <memory>
#include <nlopt.h>
#include <stdexcept>

#include "base/elementary.hpp"
#include "base/errors.hpp"

namespace hedgehop::evaluation {
namespace {

constexpr double kFinestShare = 1e-3;  // of a range: no step below counts
constexpr int kRepeatsMax = 50;        // steps of the method for each point that may be judged

// All points that were judged, and what ends the search.
class Judge {
 public:
  Judge(const std::vector<ParameterRange>& ranges, const std::vector<double>& start,
        const SearchOptions& options, const Objective& objective, Observer& observer)
      : ranges_(ranges),
        start_(start),
        options_(options),
        objective_(objective),
        observer_(observer) {
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      start_shares_.push_back(ranges[i].share_of(start[i]));
    }
    result_.least = std::numeric_limits<double>::infinity();
  }

  [[nodiscard]] const std::vector<double>& start_shares() const { return start_shares_; }
  [[nodiscard]] bool is_spent() const { return result_.evaluations >= options_.evaluations_max; }

  double judged(const double* shares) {
    std::vector<double> values(ranges_.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = shares[i] == start_shares_[i] ? start_[i] : ranges_[i].value_at(shares[i]);
    }
    if (const auto known = known_.find(values); known != known_.end()) {
      return known->second;
    }
    observer_.check_stop();
    const double value = objective_(values);
    HEDGEHOP_ASSERT(std::isfinite(value));
    known_[values] = value;
    if (++result_.evaluations == 1) {
      result_.at_start = value;
    }
    if (value < result_.least) {
      result_.least = value;
      result_.values = values;
    }
    observer_.progress("sets of parameters", static_cast<double>(result_.evaluations),
                       static_cast<double>(options_.evaluations_max));
    return value;
  }

  // Called by the library, which no exception may cross.
  static double asked(unsigned /*count*/, const double* shares, double* /*gradient*/,
                      void* judge_and_search) {
    auto& [judge, search] = *static_cast<std::pair<Judge*, nlopt_opt>*>(judge_and_search);
    try {
      const double value = judge->judged(shares);
      if (judge->is_spent()) {
        nlopt_force_stop(search);
      }
      return value;
    } catch (...) {
      judge->thrown_ = std::current_exception();
      nlopt_force_stop(search);
      return std::numeric_limits<double>::max();
    }
  }

  SearchResult result() {
    try {
      if (thrown_) {
        std::rethrow_exception(thrown_);
      }
    } catch (const Interrupted&) {
      if (result_.evaluations == 0) {
        throw;
      }
      result_.is_stopped = true;
    }
    return result_;
  }

 private:
  const std::vector<ParameterRange>& ranges_;
  const std::vector<double>& start_;
  const SearchOptions& options_;
  const Objective& objective_;
  Observer& observer_;
  std::vector<double> start_shares_;
  std::map<std::vector<double>, double> known_;
  SearchResult result_;
  std::exception_ptr thrown_;
};

}  // namespace

double ParameterRange::share_of(double value) const {
  const double share = is_logarithmic ? elementary::log(value / low) / elementary::log(high / low)
                                      : (value - low) / (high - low);
  return std::clamp(share, 0.0, 1.0);
}

double ParameterRange::value_at(double share) const {
  const double exact = is_logarithmic ? low * elementary::exp(share * elementary::log(high / low))
                                      : low + share * (high - low);
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", exact);
  return std::clamp(std::strtod(text, nullptr), low, high);
}

SearchResult search_parameters(const std::vector<ParameterRange>& ranges,
                               const std::vector<double>& start, const SearchOptions& options,
                               const Objective& objective, Observer& observer) {
  if (ranges.empty() || start.size() != ranges.size() || options.evaluations_max < 1) {
    throw std::invalid_argument("a search needs ranges, a start in each, and evaluations");
  }
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const ParameterRange& range = ranges[i];
    if (!(range.low < range.high) || (range.is_logarithmic && !(range.low > 0.0)) ||
        !(start[i] >= range.low && start[i] <= range.high)) {
      throw std::invalid_argument("no range with a start in it: " + range.key);
    }
  }
  Judge judge(ranges, start, options, objective, observer);
  const auto count = static_cast<unsigned>(ranges.size());
  const std::unique_ptr<nlopt_opt_s, decltype(&nlopt_destroy)> search(
      nlopt_create(NLOPT_LN_SBPLX, count), &nlopt_destroy);
  std::pair<Judge*, nlopt_opt> judge_and_search{&judge, search.get()};
  const auto evaluations_max =
      static_cast<int>(std::min<std::int64_t>(options.evaluations_max * kRepeatsMax, 1'000'000));
  const bool is_set = nlopt_set_min_objective(search.get(), &Judge::asked, &judge_and_search) > 0 &&
                      nlopt_set_lower_bounds1(search.get(), 0.0) > 0 &&
                      nlopt_set_upper_bounds1(search.get(), 1.0) > 0 &&
                      nlopt_set_initial_step1(search.get(), options.first_step_share) > 0 &&
                      nlopt_set_xtol_abs1(search.get(), kFinestShare) > 0 &&
                      nlopt_set_maxeval(search.get(), evaluations_max) > 0;
  HEDGEHOP_ASSERT(is_set);
  std::vector<double> shares = judge.start_shares();
  double least = 0.0;
  nlopt_optimize(search.get(), shares.data(), &least);
  return judge.result();
}

}  // namespace hedgehop::evaluation
