#include "local_planning/spherical_choice.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::local_planning {

namespace {

double half_sine_square(double difference_rad) {
  const double sine = elementary::sin(0.5 * difference_rad);
  return sine * sine;
}

// Haversine: exact for directions that are near to each other.
double apart_rad(double half_azimuth_square, double half_elevation_square, double cosines) {
  const double square = half_elevation_square + cosines * half_azimuth_square;
  return 2.0 * elementary::asin(std::sqrt(std::clamp(square, 0.0, 1.0)));
}

// A climb angle that can be chosen, and what its distance from three directions is made of.
struct Climb {
  double elevation_rad = 0.0;
  double tangent = 0.0;
  std::array<double, 3> half_squares{};
  std::array<double, 3> cosines{};
};

}  // namespace

double apart_rad(const SphericalDirection& a, const SphericalDirection& b) {
  return apart_rad(half_sine_square(a.azimuth_math_rad - b.azimuth_math_rad),
                   half_sine_square(a.elevation_rad - b.elevation_rad),
                   elementary::cos(a.elevation_rad) * elementary::cos(b.elevation_rad));
}

std::optional<SphericalDirection> cheapest_spherical(
    const PolarHistogram& histogram, const Sectors& sectors, const SphericalOptions& options,
    double polar_offset_rad3, const DirectionQuestion& question, const SphericalDirection& now,
    const SphericalDirection& before) {
  double risk_sum = 0.0;
  int known = 0;
  for (int k = 0; k < sectors.count(); ++k) {
    if (histogram.risk_weight[static_cast<std::size_t>(k)] > 0.0F) {
      risk_sum += static_cast<double>(histogram.risk[static_cast<std::size_t>(k)]);
      ++known;
    }
  }
  const double mean_risk = known > 0 ? risk_sum / known : 0.0;
  const SphericalDirection goal{question.goal_math_rad, elementary::atan(question.goal_tangent)};
  const double lowest_rad = elementary::atan(question.tangent_min);
  const double highest_rad = elementary::atan(question.tangent_max);
  const int steps =
      static_cast<int>(std::ceil((highest_rad - lowest_rad) / options.elevation_step_rad - 1e-9));

  const std::array<SphericalDirection, 3> references{goal, now, before};
  const std::array<double, 3> weights{options.goal, options.heading, options.before};
  std::vector<Climb> climbs(static_cast<std::size_t>(steps) + 1);
  for (std::size_t e = 0; e < climbs.size(); ++e) {
    Climb& climb = climbs[e];
    climb.elevation_rad =
        std::min(lowest_rad + static_cast<double>(e) * options.elevation_step_rad, highest_rad);
    // The highest one stands for tangent_max itself, however its tangent is rounded.
    climb.tangent =
        e + 1 < climbs.size() ? elementary::tan(climb.elevation_rad) : question.tangent_max;
    for (std::size_t i = 0; i < references.size(); ++i) {
      climb.half_squares[i] = half_sine_square(climb.elevation_rad - references[i].elevation_rad);
      climb.cosines[i] =
          elementary::cos(climb.elevation_rad) * elementary::cos(references[i].elevation_rad);
    }
  }

  std::optional<SphericalDirection> chosen;
  double best = std::numeric_limits<double>::infinity();
  for (int k = 0; k < sectors.count(); ++k) {
    const auto at = static_cast<std::size_t>(k);
    const double needed = static_cast<double>(histogram.tan_masked[at]);
    if (needed > question.tangent_max) {
      continue;
    }
    const double azimuth_rad = wrap_to_pi(sectors.centre_rad(k));
    double extra = 0.0;
    if (question.polar_share > 0.0 && histogram.risk_weight[at] > 0.0F) {
      const double off_rad = std::fabs(wrap_to_pi(azimuth_rad - question.heading_math_rad));
      extra = question.polar_share * (static_cast<double>(histogram.risk[at]) - mean_risk) /
              (off_rad * off_rad * off_rad + polar_offset_rad3);
    }
    std::array<double, 3> half_squares{};
    for (std::size_t i = 0; i < references.size(); ++i) {
      half_squares[i] = half_sine_square(azimuth_rad - references[i].azimuth_math_rad);
    }
    for (const Climb& climb : climbs) {
      if (climb.tangent < needed) {
        continue;
      }
      double cost = extra;
      for (std::size_t i = 0; i < references.size(); ++i) {
        cost += weights[i] * apart_rad(half_squares[i], climb.half_squares[i], climb.cosines[i]);
      }
      if (cost < best) {
        best = cost;
        chosen = SphericalDirection{azimuth_rad, climb.elevation_rad};
      }
    }
  }
  return chosen;
}

}  // namespace hedgehop::local_planning
