#include "command_model/turbulence.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/elementary.hpp"

namespace hedgehop::command_model {
namespace {

constexpr double kFoot_m = 0.3048;
constexpr double kRoot3 = std::numbers::sqrt3;

double power(double base, double exponent) {
  return elementary::exp(exponent * elementary::log(base));
}

}  // namespace

TurbulenceOptions read_turbulence_options(ConfigReader& reader) {
  TurbulenceOptions options;
  options.wind_6m_mps = reader.required_double("wind_6m_mps");
  reader.require(options.wind_6m_mps >= 0.0 && options.wind_6m_mps <= 40.0, "wind_6m_mps",
                 "must lie between 0 and 40");
  const std::int64_t seed = reader.required_integer("seed");
  reader.require(seed >= 0, "seed", "must not be negative");
  options.seed = static_cast<std::uint64_t>(seed);
  reader.finish();
  return options;
}

DrydenParameters dryden_parameters(double wind_6m_mps, double height_m) {
  const double height_ft = std::clamp(height_m / kFoot_m, 10.0, 1000.0);
  const double shape = 0.177 + 0.000823 * height_ft;
  DrydenParameters result;
  result.sigma_up_mps = 0.1 * wind_6m_mps;
  result.sigma_along_mps = result.sigma_up_mps / power(shape, 0.4);
  result.scale_up_m = height_ft * kFoot_m;
  result.scale_along_m = result.scale_up_m / power(shape, 1.2);
  return result;
}

Turbulence::Turbulence(const TurbulenceOptions& options)
    : wind_6m_mps_(options.wind_6m_mps), random_(options.seed) {
  // Drawn from the stationary distribution: variances 1/4 and 1/2, covariance 1/4.
  along_ = normal();
  for (SecondOrder* filter : {&left_, &up_}) {
    filter->early = std::sqrt(0.5) * normal();
    filter->late = 0.5 * filter->early + std::sqrt(0.125) * normal();
  }
}

// Box and Muller's, with functions whose bits are the same everywhere.
double Turbulence::normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const auto uniform = [this] {  // in (0, 1]
    return (static_cast<double>(random_() >> 11U) + 1.0) / 9007199254740992.0;
  };
  const double radius = std::sqrt(-2.0 * elementary::log(uniform()));
  const elementary::SineCosine angle = elementary::sine_cosine(2.0 * std::numbers::pi * uniform());
  has_spare_ = true;
  spare_ = radius * angle.sine;
  return radius * angle.cosine;
}

// late' = -late + early, early' = -early + noise. The noise of a step has the covariance
//   integral of e^(-2s) (s^2, s; s, 1) over the step.
void Turbulence::advance(SecondOrder& filter, double scales) {
  const double decay = elementary::exp(-scales);
  const double rest = decay * decay;
  const double early_variance = 0.5 * (1.0 - rest);
  const double covariance = 0.25 * (1.0 - rest * (1.0 + 2.0 * scales));
  const double late_variance = 0.25 * (1.0 - rest * (1.0 + 2.0 * scales * (1.0 + scales)));
  const double early_noise = std::sqrt(early_variance);
  const double shared = early_noise > 0.0 ? covariance / early_noise : 0.0;
  const double own = std::sqrt(std::max(late_variance - shared * shared, 0.0));
  const double first = normal();
  const double second = normal();
  filter.late = decay * (filter.late + scales * filter.early) + shared * first + own * second;
  filter.early = decay * filter.early + early_noise * first;
}

Gust Turbulence::next(double way_m, double height_m) {
  const DrydenParameters here = dryden_parameters(wind_6m_mps_, height_m);
  const double decay = elementary::exp(-way_m / here.scale_along_m);
  along_ = decay * along_ + std::sqrt(1.0 - decay * decay) * normal();
  advance(left_, way_m / here.scale_along_m);
  advance(up_, way_m / here.scale_up_m);
  // (1 + sqrt(3) s) / (1 + s)^2 = sqrt(3) / (1 + s) + (1 - sqrt(3)) / (1 + s)^2
  const auto value = [](const SecondOrder& filter) {
    return kRoot3 * filter.early + (1.0 - kRoot3) * filter.late;
  };
  return {here.sigma_along_mps * along_, here.sigma_along_mps * value(left_),
          here.sigma_up_mps * value(up_)};
}

}  // namespace hedgehop::command_model
