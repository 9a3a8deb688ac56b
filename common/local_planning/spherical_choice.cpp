#include "local_planning/spherical_choice.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::local_planning {

namespace {

constexpr double kRounding = 1e-9;  // of costs, radians times weights

double half_sine_square(double difference_rad) {
  const double sine = elementary::sin(0.5 * difference_rad);
  return sine * sine;
}

// Haversine: exact for directions that are near to each other.
double apart_rad(double half_azimuth_square, double half_elevation_square, double cosines) {
  const double square = half_elevation_square + cosines * half_azimuth_square;
  return 2.0 * elementary::asin(std::sqrt(std::clamp(square, 0.0, 1.0)));
}

// Not more than apart_rad() of the same, and quick: a chord is shorter than its arc.
double chord_rad(double half_azimuth_square, double half_elevation_square, double cosines) {
  const double square = half_elevation_square + cosines * half_azimuth_square;
  return 2.0 * std::sqrt(std::clamp(square, 0.0, 1.0));
}

// A climb angle that can be chosen, and what its distance from three directions is made of.
struct Climb {
  double elevation_rad = 0.0;
  double tangent = 0.0;
  double least = 0.0;  // cost of its distances, at least, in any azimuth
  std::array<double, 3> half_squares{};
  std::array<double, 3> cosines{};
};

// A sector that may be flown into.
struct Azimuth {
  int sector = 0;
  double azimuth_rad = 0.0;
  double needed = 0.0;  // tangent of the climb
  double extra = 0.0;   // cost of its risk
  double least = 0.0;   // no candidate costs less
  std::array<double, 3> half_squares{};
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
  std::array<double, 3> reference_cosines{};
  for (std::size_t i = 0; i < references.size(); ++i) {
    reference_cosines[i] = elementary::cos(references[i].elevation_rad);
  }
  std::vector<Climb> climbs(static_cast<std::size_t>(steps) + 1);
  for (std::size_t e = 0; e < climbs.size(); ++e) {
    Climb& climb = climbs[e];
    climb.elevation_rad =
        std::min(lowest_rad + static_cast<double>(e) * options.elevation_step_rad, highest_rad);
    // The highest one stands for tangent_max itself, however its tangent is rounded.
    climb.tangent =
        e + 1 < climbs.size() ? elementary::tan(climb.elevation_rad) : question.tangent_max;
    const double cosine = elementary::cos(climb.elevation_rad);
    for (std::size_t i = 0; i < references.size(); ++i) {
      climb.half_squares[i] = half_sine_square(climb.elevation_rad - references[i].elevation_rad);
      climb.cosines[i] = cosine * reference_cosines[i];
      climb.least += weights[i] * chord_rad(0.0, climb.half_squares[i], climb.cosines[i]);
    }
  }

  std::array<double, 3> least_cosines{1.0, 1.0, 1.0};
  for (const Climb& climb : climbs) {
    for (std::size_t i = 0; i < references.size(); ++i) {
      least_cosines[i] = std::min(least_cosines[i], climb.cosines[i]);
    }
  }

  // Climbs and sectors by the least that any candidate with them can cost; most need no closer
  // look.
  std::sort(climbs.begin(), climbs.end(), [](const Climb& a, const Climb& b) {
    return a.least != b.least ? a.least < b.least : a.elevation_rad < b.elevation_rad;
  });
  std::vector<Azimuth> azimuths;
  azimuths.reserve(static_cast<std::size_t>(sectors.count()));
  for (int k = 0; k < sectors.count(); ++k) {
    const auto at = static_cast<std::size_t>(k);
    Azimuth azimuth;
    azimuth.sector = k;
    azimuth.needed = static_cast<double>(histogram.tan_masked[at]);
    if (azimuth.needed > question.tangent_max) {
      continue;
    }
    azimuth.azimuth_rad = wrap_to_pi(sectors.centre_rad(k));
    if (question.polar_share > 0.0 && histogram.risk_weight[at] > 0.0F) {
      const double off_rad = std::fabs(wrap_to_pi(azimuth.azimuth_rad - question.heading_math_rad));
      azimuth.extra = question.polar_share * (static_cast<double>(histogram.risk[at]) - mean_risk) /
                      (off_rad * off_rad * off_rad + polar_offset_rad3);
    }
    azimuth.least = azimuth.extra - kRounding;
    for (std::size_t i = 0; i < references.size(); ++i) {
      azimuth.half_squares[i] =
          half_sine_square(azimuth.azimuth_rad - references[i].azimuth_math_rad);
      azimuth.least += weights[i] * chord_rad(azimuth.half_squares[i], 0.0, least_cosines[i]);
    }
    azimuths.push_back(azimuth);
  }
  const auto is_dearer = [](const Azimuth& a, const Azimuth& b) {
    return a.least != b.least ? a.least > b.least : a.sector > b.sector;
  };
  std::make_heap(azimuths.begin(), azimuths.end(), is_dearer);

  std::optional<SphericalDirection> chosen;
  double best = std::numeric_limits<double>::infinity();
  int best_sector = sectors.count();
  for (auto end = azimuths.end(); end != azimuths.begin(); --end) {
    std::pop_heap(azimuths.begin(), end, is_dearer);
    const Azimuth& azimuth = *(end - 1);
    if (azimuth.least > best) {
      break;
    }
    for (const Climb& climb : climbs) {
      if (azimuth.extra - kRounding + climb.least > best) {
        break;
      }
      if (climb.tangent < azimuth.needed) {
        continue;
      }
      double least = azimuth.extra - kRounding;
      for (std::size_t i = 0; i < references.size(); ++i) {
        least += weights[i] *
                 chord_rad(azimuth.half_squares[i], climb.half_squares[i], climb.cosines[i]);
      }
      if (least > best) {
        continue;
      }
      double cost = azimuth.extra;
      for (std::size_t i = 0; i < references.size(); ++i) {
        cost += weights[i] *
                apart_rad(azimuth.half_squares[i], climb.half_squares[i], climb.cosines[i]);
      }
      const bool is_lower_of_equals =
          cost == best &&
          (azimuth.sector != best_sector ? azimuth.sector < best_sector
                                         : climb.elevation_rad < chosen->elevation_rad);
      if (cost < best || is_lower_of_equals) {
        best = cost;
        best_sector = azimuth.sector;
        chosen = SphericalDirection{azimuth.azimuth_rad, climb.elevation_rad};
      }
    }
  }
  return chosen;
}

}  // namespace hedgehop::local_planning
