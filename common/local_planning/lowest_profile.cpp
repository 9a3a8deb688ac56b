#include "local_planning/lowest_profile.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <stdexcept>

namespace hedgehop::local_planning {
namespace {

constexpr int kIterationsMax = 80;
constexpr double kGap_m = 1e-3;
constexpr double kResidual = 1e-5;
constexpr double kDualResidual = 1e-3;
constexpr double kBackOff = 0.99;    // share of the way to the boundary that a step may go
constexpr double kSlackMin_m = 1.0;  // of the first iterate

// A demand on three neighbouring altitudes: low <= a x_k-1 + b x_k + c x_k+1 <= high, the same
// a, b, c for every k.
struct Family {
  std::array<double, 3> row{};
  double low = 0.0;
  double high = 0.0;
};

// One bound of the demands of a family, or the floor: values by k.
struct Side {
  std::array<double, 3> row{};  // of row . x <= bound
  std::vector<double> bound;
  std::vector<double> slack;
  std::vector<double> price;
  std::vector<double> slack_step;
  std::vector<double> price_step;
  std::vector<double> residual;
};

// Symmetric with two side diagonals; unknowns x_1 ... x_n stand at 0 ... n-1.
class Banded {
 public:
  explicit Banded(std::size_t size) : main_(size), first_(size), second_(size) {}

  void clear() {
    std::fill(main_.begin(), main_.end(), 0.0);
    std::fill(first_.begin(), first_.end(), 0.0);
    std::fill(second_.begin(), second_.end(), 0.0);
  }
  // Adds weight row row^T for a row around unknown i; entries outside are known and left out.
  void add(std::ptrdiff_t i, const std::array<double, 3>& row, double weight) {
    const auto size = static_cast<std::ptrdiff_t>(main_.size());
    const auto entry = [&](std::ptrdiff_t at) {
      return at >= 0 && at < size ? row[static_cast<std::size_t>(at - i + 1)] : 0.0;
    };
    const double before = entry(i - 1);
    const double here = entry(i);
    const double after = entry(i + 1);
    if (i >= 1) {
      main_[static_cast<std::size_t>(i - 1)] += weight * before * before;
      if (i < size) {
        first_[static_cast<std::size_t>(i - 1)] += weight * before * here;
      }
      if (i + 1 < size) {
        second_[static_cast<std::size_t>(i - 1)] += weight * before * after;
      }
    }
    if (i >= 0 && i < size) {
      main_[static_cast<std::size_t>(i)] += weight * here * here;
      if (i + 1 < size) {
        first_[static_cast<std::size_t>(i)] += weight * here * after;
      }
    }
    if (i + 1 >= 0 && i + 1 < size) {
      main_[static_cast<std::size_t>(i + 1)] += weight * after * after;
    }
  }
  // L D L^T in place; false if it is not positive definite.
  bool factor() {
    const std::size_t size = main_.size();
    for (std::size_t i = 0; i < size; ++i) {
      if (!(main_[i] > 0.0)) {
        return false;
      }
      const double first = first_[i] / main_[i];
      const double second = second_[i] / main_[i];
      if (i + 1 < size) {
        main_[i + 1] -= first * first_[i];
        first_[i + 1] -= first * second_[i];
      }
      if (i + 2 < size) {
        main_[i + 2] -= second * second_[i];
      }
      first_[i] = first;
      second_[i] = second;
    }
    return true;
  }
  void solve(std::vector<double>& x) const {
    const std::size_t size = main_.size();
    for (std::size_t i = 0; i < size; ++i) {
      if (i + 1 < size) {
        x[i + 1] -= first_[i] * x[i];
      }
      if (i + 2 < size) {
        x[i + 2] -= second_[i] * x[i];
      }
    }
    for (std::size_t i = size; i-- > 0;) {
      double value = x[i] / main_[i];
      if (i + 1 < size) {
        value -= first_[i] * x[i + 1];
      }
      if (i + 2 < size) {
        value -= second_[i] * x[i + 2];
      }
      x[i] = value;
    }
  }

 private:
  std::vector<double> main_;
  std::vector<double> first_;
  std::vector<double> second_;
};

// The steepest climb from the start, x_0 ... x_n, counted from the start's altitude.
std::vector<double> steepest_climb(std::size_t knots, double rate_mps, double knot_s,
                                   const ProfileLimits& limits) {
  std::vector<double> altitudes_m{0.0};
  double rate_before_mps = rate_mps;
  double acceleration_mps2 = 0.5 * limits.acceleration_mps2;
  for (std::size_t k = 1; k < knots; ++k) {
    const double climb_mps =
        limits.climb_rates_mps.empty() ? limits.climb_rate_mps : limits.climb_rates_mps[k - 1];
    // rate + lead (rate - before) / T <= climb
    const double led_mps = (climb_mps * knot_s + limits.command_lead_s * rate_before_mps) /
                           (knot_s + limits.command_lead_s);
    const double next_mps =
        std::min({rate_before_mps + acceleration_mps2 * knot_s, led_mps, climb_mps});
    altitudes_m.push_back(altitudes_m.back() + knot_s * next_mps);
    rate_before_mps = next_mps;
    acceleration_mps2 = limits.acceleration_mps2;
  }
  return altitudes_m;
}

class Programme {
 public:
  Programme(const std::vector<double>& floor_m, const std::vector<double>& weights,
            double start_altitude_m, double start_rate_mps, double knot_s,
            const ProfileLimits& limits)
      : unknowns_(floor_m.size() - 1), normal_(unknowns_), x_(unknowns_), step_(unknowns_) {
    // Altitudes are counted from the start's.
    const double before_m = -knot_s * start_rate_mps;
    cost_.assign(weights.begin() + 1, weights.end());
    Side floor;
    floor.row = {0.0, -1.0, 0.0};
    reach_m_ = steepest_climb(floor_m.size(), start_rate_mps, knot_s, limits);
    for (std::size_t i = 0; i < unknowns_; ++i) {
      floor.bound.push_back(
          -std::min(floor_m[i + 1] - start_altitude_m, reach_m_[i + 1] - kBelowReach_m));
    }
    sides_.push_back(std::move(floor));

    // In m/s^2 and m/s: slacks and prices of all demands are then of like size.
    const double per_s = 1.0 / knot_s;
    const double per_s2 = per_s * per_s;
    const double lead = limits.command_lead_s * per_s;
    const std::array<Family, 3> families{
        {{{per_s2, -2.0 * per_s2, per_s2}, -limits.acceleration_mps2, limits.acceleration_mps2},
         {{0.0, -per_s, per_s}, -limits.descent_rate_mps, limits.climb_rate_mps},
         {{lead * per_s, -(1.0 + 2.0 * lead) * per_s, (1.0 + lead) * per_s},
          -limits.descent_rate_mps,
          limits.climb_rate_mps}}};
    for (std::size_t f = 0; f < families.size(); ++f) {
      for (const double sign : {1.0, -1.0}) {
        const Family& family = families[f];
        Side side;
        side.row = {sign * family.row[0], sign * family.row[1], sign * family.row[2]};
        // The row around x_k belongs to unknown k - 1; that around x_0 stands first.
        for (std::size_t k = 0; k < unknowns_; ++k) {
          double bound = sign > 0.0 ? family.high : -family.low;
          const std::vector<double>& rates =
              sign > 0.0 ? limits.climb_rates_mps : limits.descent_rates_mps;
          if (f > 0 && !rates.empty()) {
            bound = rates[k];
          }
          if (k == 0) {
            bound *= f == 0 ? 0.5 : 1.0;
            bound -= side.row[0] * before_m;
          }
          side.bound.push_back(bound);
        }
        sides_.push_back(std::move(side));
      }
    }
    for (Side& side : sides_) {
      side.slack.assign(unknowns_, 0.0);
      side.price.assign(unknowns_, 1.0);
      side.slack_step = side.price_step = side.residual = side.slack;
    }
  }

  bool solve() {
    // Level flight over everything, after the climb to there: almost allowed.
    const double top_m =
        std::max(0.0, -*std::min_element(sides_[0].bound.begin(), sides_[0].bound.end()));
    for (std::size_t i = 0; i < unknowns_; ++i) {
      x_[i] = std::min(reach_m_[i + 1], top_m + kSlackMin_m);
    }
    for (std::size_t s = 0; s < sides_.size(); ++s) {
      Side& side = sides_[s];
      for (std::size_t i = 0; i < unknowns_; ++i) {
        side.slack[i] = std::max(side.bound[i] - product(s, i, x_), kSlackMin_m);
      }
    }
    for (int iteration = 0; iteration < kIterationsMax; ++iteration) {
      const double gap_m = measure();
      if (gap_m <= kGap_m && worst_residual_ <= kResidual &&
          worst_dual_residual_ <= kDualResidual) {
        return true;
      }
      if (!std::isfinite(gap_m) || !factor_normal()) {
        return false;
      }
      direction(0.0, false);
      const double affine_gap_m = gap_after(largest_step(false), largest_step(true));
      const double ratio = affine_gap_m / gap_m;
      direction(ratio * ratio * ratio * gap_m, true);
      advance(std::min(1.0, kBackOff * largest_step(false)),
              std::min(1.0, kBackOff * largest_step(true)));
    }
    return false;
  }

  [[nodiscard]] const std::vector<double>& altitudes_m() const { return x_; }

 private:
  static constexpr double kBelowReach_m = 0.05;  // so that an interior exists

  // Unknown in the middle of row i of side s: the floor's rows stand around x_1, the others' around
  // x_0.
  [[nodiscard]] static std::ptrdiff_t centre(std::size_t s, std::size_t i) {
    return static_cast<std::ptrdiff_t>(i) - (s == 0 ? 0 : 1);
  }

  [[nodiscard]] double product(std::size_t s, std::size_t i, const std::vector<double>& x) const {
    const std::array<double, 3>& row = sides_[s].row;
    const std::ptrdiff_t middle = centre(s, i);
    double sum = 0.0;
    for (std::ptrdiff_t at = middle - 1; at <= middle + 1; ++at) {
      if (at >= 0 && at < static_cast<std::ptrdiff_t>(unknowns_)) {
        sum += row[static_cast<std::size_t>(at - middle + 1)] * x[static_cast<std::size_t>(at)];
      }
    }
    return sum;
  }

  void add_transposed(std::size_t s, std::size_t i, double value, std::vector<double>& to) const {
    const std::array<double, 3>& row = sides_[s].row;
    const std::ptrdiff_t middle = centre(s, i);
    for (std::ptrdiff_t at = middle - 1; at <= middle + 1; ++at) {
      if (at >= 0 && at < static_cast<std::ptrdiff_t>(unknowns_)) {
        to[static_cast<std::size_t>(at)] += row[static_cast<std::size_t>(at - middle + 1)] * value;
      }
    }
  }

  // Residuals of the iterate; mean of slack times price.
  double measure() {
    dual_residual_ = cost_;
    worst_residual_ = 0.0;
    double sum = 0.0;
    for (std::size_t s = 0; s < sides_.size(); ++s) {
      Side& side = sides_[s];
      for (std::size_t i = 0; i < unknowns_; ++i) {
        side.residual[i] = product(s, i, x_) + side.slack[i] - side.bound[i];
        worst_residual_ = std::max(worst_residual_, std::fabs(side.residual[i]));
        add_transposed(s, i, side.price[i], dual_residual_);
        sum += side.slack[i] * side.price[i];
      }
    }
    worst_dual_residual_ = 0.0;
    for (const double value : dual_residual_) {
      worst_dual_residual_ = std::max(worst_dual_residual_, std::fabs(value));
    }
    return sum / static_cast<double>(sides_.size() * unknowns_);
  }

  bool factor_normal() {
    normal_.clear();
    for (std::size_t s = 0; s < sides_.size(); ++s) {
      const Side& side = sides_[s];
      for (std::size_t i = 0; i < unknowns_; ++i) {
        normal_.add(centre(s, i), side.row, side.price[i] / side.slack[i]);
      }
    }
    return normal_.factor();
  }

  // Newton's step towards slack times price = target; with the products of the step before as the
  // second-order term if `is_corrected`.
  void direction(double target, bool is_corrected) {
    for (std::size_t i = 0; i < unknowns_; ++i) {
      step_[i] = -dual_residual_[i];
    }
    for (std::size_t s = 0; s < sides_.size(); ++s) {
      Side& side = sides_[s];
      for (std::size_t i = 0; i < unknowns_; ++i) {
        const double second = is_corrected ? side.slack_step[i] * side.price_step[i] : 0.0;
        // Kept in slack_step until the step of x is known.
        side.slack_step[i] = side.price[i] * side.slack[i] + second - target;
        add_transposed(
            s, i, (side.slack_step[i] - side.price[i] * side.residual[i]) / side.slack[i], step_);
      }
    }
    normal_.solve(step_);
    for (std::size_t s = 0; s < sides_.size(); ++s) {
      Side& side = sides_[s];
      for (std::size_t i = 0; i < unknowns_; ++i) {
        const double complementarity = side.slack_step[i];
        side.slack_step[i] = -side.residual[i] - product(s, i, step_);
        side.price_step[i] =
            -(complementarity + side.price[i] * side.slack_step[i]) / side.slack[i];
      }
    }
  }

  // Longest step that keeps slacks, or prices, from becoming negative; at most 1 / kBackOff.
  [[nodiscard]] double largest_step(bool of_prices) const {
    double step = 1.0 / kBackOff;
    for (const Side& side : sides_) {
      const std::vector<double>& value = of_prices ? side.price : side.slack;
      const std::vector<double>& change = of_prices ? side.price_step : side.slack_step;
      for (std::size_t i = 0; i < unknowns_; ++i) {
        if (change[i] < 0.0) {
          step = std::min(step, -value[i] / change[i]);
        }
      }
    }
    return step;
  }

  [[nodiscard]] double gap_after(double slack_share, double price_share) const {
    slack_share = std::min(1.0, slack_share);
    price_share = std::min(1.0, price_share);
    double sum = 0.0;
    for (const Side& side : sides_) {
      for (std::size_t i = 0; i < unknowns_; ++i) {
        sum += (side.slack[i] + slack_share * side.slack_step[i]) *
               (side.price[i] + price_share * side.price_step[i]);
      }
    }
    return sum / static_cast<double>(sides_.size() * unknowns_);
  }

  void advance(double slack_share, double price_share) {
    for (std::size_t i = 0; i < unknowns_; ++i) {
      x_[i] += slack_share * step_[i];
    }
    for (Side& side : sides_) {
      for (std::size_t i = 0; i < unknowns_; ++i) {
        side.slack[i] += slack_share * side.slack_step[i];
        side.price[i] += price_share * side.price_step[i];
      }
    }
  }

  std::size_t unknowns_;
  Banded normal_;
  std::vector<double> reach_m_;
  std::vector<double> cost_;
  std::vector<double> x_;
  std::vector<double> step_;
  std::vector<double> dual_residual_;
  std::vector<Side> sides_;
  double worst_residual_ = 0.0;
  double worst_dual_residual_ = 0.0;
};

}  // namespace

std::optional<std::vector<double>> lowest_profile(const std::vector<double>& floor_m,
                                                  const std::vector<double>& weights,
                                                  double start_altitude_m, double start_rate_mps,
                                                  double knot_s, const ProfileLimits& limits) {
  if (floor_m.size() < 2 || weights.size() != floor_m.size()) {
    throw std::invalid_argument("a profile needs two knots, each with a floor and a weight");
  }
  if (!(knot_s > 0.0 && limits.climb_rate_mps > 0.0 && limits.descent_rate_mps > 0.0 &&
        limits.acceleration_mps2 > 0.0 && limits.command_lead_s >= 0.0)) {
    throw std::invalid_argument("the limits of a profile must be above 0");
  }
  for (const std::vector<double>& rates : {limits.climb_rates_mps, limits.descent_rates_mps}) {
    if (!rates.empty() && rates.size() + 1 != floor_m.size()) {
      throw std::invalid_argument("a profile needs a rate for each interval between knots");
    }
    for (const double rate_mps : rates) {
      if (!(rate_mps > 0.0)) {
        throw std::invalid_argument("the rates of a profile must be above 0");
      }
    }
  }
  Programme programme(floor_m, weights, start_altitude_m, start_rate_mps, knot_s, limits);
  if (!programme.solve()) {
    return std::nullopt;
  }
  std::vector<double> altitudes_m{start_altitude_m};
  for (const double altitude_m : programme.altitudes_m()) {
    altitudes_m.push_back(start_altitude_m + altitude_m);
  }
  return altitudes_m;
}

}  // namespace hedgehop::local_planning
