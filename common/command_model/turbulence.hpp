#pragma once

#include <cstdint>
#include <random>

#include "base/config_reader.hpp"

namespace hedgehop::command_model {

/// Turbulence of an atmosphere near the ground; section `turbulence` of config/command_model.yaml.
struct TurbulenceOptions {
  double wind_6m_mps = 0.0;  // mean wind 6 m (20 ft) above the ground; 0: none
  std::uint64_t seed = 1;
};
TurbulenceOptions read_turbulence_options(ConfigReader& reader);

/// Gust velocities of the air [m/s], besides the mean wind.
struct Gust {
  double along_mps = 0.0;  // towards the heading
  double left_mps = 0.0;   // across it
  double up_mps = 0.0;
};

/// Intensities and scales of the Dryden model near the ground, h in feet:
///
///     sigma_w = 0.1 W_20,   sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4
///     L_w = h,              L_u = L_v = h / (0.177 + 0.000823 h)^1.2
///
/// Heights are held between 10 and 1000 ft, where the formulas are made for.
struct DrydenParameters {
  double sigma_along_mps = 0.0;  // and across
  double sigma_up_mps = 0.0;
  double scale_along_m = 0.0;  // and across
  double scale_up_m = 0.0;
};
DrydenParameters dryden_parameters(double wind_6m_mps, double height_m);

/// Random gusts with the spectra of the Dryden model,
///
///     Phi_u = sigma_u^2 2 L_u / pi / (1 + (L_u W)^2)
///     Phi_v = sigma_v^2 L_v / pi (1 + 3 (L_v W)^2) / (1 + (L_v W)^2)^2,   Phi_w likewise
///
/// in the spatial frequency W along the flight: white noise through H_u = 1 / (1 + s) and
/// H_v = (1 + sqrt(3) s) / (1 + s)^2 over the distance in scales. The correlations at the distance
/// x are exp(-x / L_u) and (1 - x / (2 L)) exp(-x / L). Each step is the exact solution of the
/// filters for white noise, so that the statistics do not depend on its length. Intensities and
/// scales are those of the height; the filters themselves have unit variance. The field is frozen:
/// time counts only by the distance flown through the air.
///
/// The same seed gives the same gusts, to the last bit.
///
/// Source: MIL-F-8785C, Flying qualities of piloted airplanes, 1980, 3.7.2 and 3.7.3.4 (low
/// altitude).
class Turbulence {
 public:
  explicit Turbulence(const TurbulenceOptions& options);

  /// After so much more way through the air.
  Gust next(double way_m, double height_m);

 private:
  // Of v and w: two first-order lags one after the other.
  struct SecondOrder {
    double late = 0.0;
    double early = 0.0;
  };
  double normal();
  void advance(SecondOrder& filter, double scales);

  double wind_6m_mps_;
  std::mt19937_64 random_;
  bool has_spare_ = false;
  double spare_ = 0.0;
  double along_ = 0.0;
  SecondOrder left_;
  SecondOrder up_;
};

}  // namespace hedgehop::command_model
