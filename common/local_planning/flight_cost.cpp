#include "local_planning/flight_cost.hpp"

#include <cmath>

namespace hedgehop::local_planning {

double flight_cost_m(const risk::CostModel& costs, const Flight& flight, double bank_weight_1prad) {
  const auto integrand = [&](const command_model::ModelState& state) {
    const geo::MapPoint point{state.x_m, state.y_m};
    const double height_m =
        state.altitude_m - raster::sample_bilinear(costs.map().surface_m, point);
    return costs.density(point, height_m) + bank_weight_1prad * std::fabs(state.bank_left_rad);
  };
  const bool is_directed = costs.has_wires() || costs.has_slope();
  double cost_m = 0.0;
  double before = flight.steps.empty() ? 0.0 : integrand(flight.steps.front().state);
  for (std::size_t i = 1; i < flight.steps.size(); ++i) {
    const command_model::ModelState& a = flight.steps[i - 1].state;
    const command_model::ModelState& b = flight.steps[i].state;
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    const double after = integrand(b);
    cost_m += 0.5 * (before + after) * std::sqrt(dx_m * dx_m + dy_m * dy_m);
    if (is_directed) {
      cost_m += costs.directed_cost_m({a.x_m, a.y_m}, {b.x_m, b.y_m});
    }
    before = after;
  }
  return cost_m;
}

LocalOptions following_options(LocalOptions options) {
  options.semantics_weight = 0.0;
  options.visibility_weight = 0.0;
  options.weights.climb = 0.0;
  options.weights.climb_relative = 0.0;
  return options;
}

}  // namespace hedgehop::local_planning
