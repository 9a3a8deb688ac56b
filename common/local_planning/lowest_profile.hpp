#pragma once

#include <optional>
#include <vector>

namespace hedgehop::local_planning {

/// What a climb profile may do; magnitudes.
struct ProfileLimits {
  double climb_rate_mps = 0.0;
  double descent_rate_mps = 0.0;
  double acceleration_mps2 = 0.0;
  /// The climb rate plus this many seconds of the acceleration stays within the rates as well: what
  /// a controller with that lag must command.
  double command_lead_s = 0.0;
  /// Of each interval between knots, instead of climb_rate_mps and descent_rate_mps; empty: those.
  std::vector<double> climb_rates_mps = {};
  std::vector<double> descent_rates_mps = {};
};

/// The lowest climb profile above a floor: the altitudes x_1 ... x_n, `knot_s` apart, with
///
///     min  sum w_k x_k
///     x_k                                      >= floor_k
///     (x_k+1 - x_k) / T                        in [-descent, climb]
///     (x_k+1 - 2 x_k + x_k-1) / T^2            in [-a, a], half of it at the start
///     rate + command_lead acceleration         in [-descent, climb]
///
/// from the altitude x_0 and the climb rate v_0 at the start. A linear programme whose normal
/// matrix has two side diagonals, solved by Mehrotra's predictor-corrector interior-point method to
/// a mean gap of a millimetre. Where the start is too low for the floor, the floor is what the
/// steepest climb from the start reaches.
///
/// @param floor_m   of x_0 ... x_n, finite; the first one does not count
/// @param weights   of x_0 ... x_n, > 0; the first one does not count
/// @return  x_0 ... x_n; nothing if the method did not converge.
/// @throws std::invalid_argument  for fewer than 2 knots, sizes that differ, limits that are not
///          above 0.
/// @note  O(n) for each of about 20 iterations; arithmetic and square roots only, so the same bits
///        everywhere.
///
/// Source: S. Mehrotra, "On the implementation of a primal-dual interior point method", SIAM J.
/// Optimization 2(4), 1992, doi:10.1137/0802028.
std::optional<std::vector<double>> lowest_profile(const std::vector<double>& floor_m,
                                                  const std::vector<double>& weights,
                                                  double start_altitude_m, double start_rate_mps,
                                                  double knot_s, const ProfileLimits& limits);

}  // namespace hedgehop::local_planning
