#include "briefing/cost_profile.hpp"

#include <algorithm>
#include <cmath>

#include "briefing/flight_legs.hpp"
#include "raster/grid.hpp"

namespace hedgehop::briefing {
namespace {

using flight::add;

// A straight piece of a path, seen from above.
struct Piece {
  geo::MapPoint middle;
  double east_m = 0.0, north_m = 0.0;  // from its beginning to its end

  [[nodiscard]] double length_m() const { return std::sqrt(east_m * east_m + north_m * north_m); }
  [[nodiscard]] geo::MapPoint at(double share) const {
    return {middle.x_m + share * east_m, middle.y_m + share * north_m};
  }
};

// Of a metre of the piece: what depends on the place is taken in its middle.
flight::RouteCost density_on(const risk::CostModel& model, const Piece& piece, double height_m) {
  const geo::MapPoint& place = piece.middle;
  const risk::CostWeights& weights = model.weights();
  const double seen = model.seen(place, height_m);
  const double altitude_m = raster::sample_bilinear(model.map().surface_m, place) + height_m;
  flight::RouteCost cost;
  cost.length_m = 1.0;
  cost.visibility_m = weights.visibility * seen * seen;
  cost.semantics_m = weights.semantics * model.semantics(place, altitude_m);
  cost.height_m = weights.height_1pm * std::fabs(height_m - model.reference_height_m());
  cost.soft_ceiling_m = model.density_rule().above_soft_ceiling(height_m);
  const raster::GridGeometry& geometry = model.map().geometry;
  const double length_m = piece.length_m();
  if (geometry.contains(place)) {
    const raster::CellIndex at = geometry.cell_at(place);
    const std::size_t cell =
        static_cast<std::size_t>(at.row) * static_cast<std::size_t>(geometry.columns) +
        static_cast<std::size_t>(at.column);
    if (model.has_threats()) {
      cost.threats_m = model.threat_density(cell, height_m);
    }
    if (model.has_slope() && length_m > 0.0) {
      cost.slope_m = model.slope_density(cell, piece.east_m / length_m, piece.north_m / length_m);
    }
  }
  if (model.has_wires() && length_m > 0.0) {
    cost.wire_crossings_m = model.wire_cost_m(piece.at(-0.5), piece.at(0.5)) / length_m;
  }
  return cost;
}

}  // namespace

CostOptions read_cost_options(ConfigReader& reader) {
  CostOptions options;
  options.step_m = reader.required_double("step_m");
  reader.require(options.step_m > 0.0, "step_m", "must be above 0");
  options.beside_m = reader.required_double("beside_m");
  reader.require(options.beside_m > 0.0, "beside_m", "must be above 0");
  reader.finish();
  return options;
}

flight::RouteCost CostProfile::total() const {
  flight::RouteCost sum;
  for (const CostPlace& place : places) {
    add(sum, place.here, step_m);
  }
  return sum;
}

flight::RouteCost mean_cost(const CostProfile& profile, double from_m, double to_m,
                            flight::RouteCost CostPlace::*side) {
  flight::RouteCost sum;
  int count = 0;
  for (const CostPlace& place : profile.places) {
    const flight::RouteCost& cost = place.*side;
    if (place.along_m >= from_m && place.along_m < to_m && std::isfinite(cost.total_m())) {
      add(sum, cost, 1.0);
      ++count;
    }
  }
  flight::RouteCost mean;
  add(mean, sum, count > 0 ? 1.0 / count : std::numeric_limits<double>::quiet_NaN());
  return mean;
}

CostProfile cost_profile(const risk::CostModel& model, const flight::Trajectory& trajectory,
                         const CostOptions& options) {
  CostProfile profile;
  const auto& states = trajectory.states;
  const std::vector<double> along_m = distances_m(trajectory);
  if (states.size() < 2 || !(along_m.back() > 0.0)) {
    return profile;
  }
  const auto count = static_cast<std::size_t>(std::ceil(along_m.back() / options.step_m));
  profile.step_m = along_m.back() / static_cast<double>(count);
  const map::Map& map = model.map();
  std::size_t i = 1;
  for (std::size_t k = 0; k < count; ++k) {
    CostPlace place;
    place.along_m = (static_cast<double>(k) + 0.5) * profile.step_m;
    while (i + 1 < states.size() && along_m[i] < place.along_m) {
      ++i;
    }
    const flight::FlightState& a = states[i - 1];
    const flight::FlightState& b = states[i];
    const double piece_m = along_m[i] - along_m[i - 1];
    const double t = piece_m > 0.0 ? (place.along_m - along_m[i - 1]) / piece_m : 0.0;
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    place.time_s = a.time_s + t * (b.time_s - a.time_s);
    place.place = {a.x_m + t * dx_m, a.y_m + t * dy_m};
    place.height_m = a.altitude_m + t * (b.altitude_m - a.altitude_m) -
                     raster::sample_bilinear(map.surface_m, place.place);
    place.seen = model.seen(place.place, place.height_m);
    if (map.geometry.contains(place.place)) {
      place.classes = map.semantics.at(map.geometry.cell_at(place.place));
    }
    const double ux = piece_m > 0.0 ? dx_m / piece_m : 0.0;
    const double uy = piece_m > 0.0 ? dy_m / piece_m : 0.0;
    const auto beside = [&](double offset_m) {  // to the left
      return density_on(model,
                        {{place.place.x_m - offset_m * uy, place.place.y_m + offset_m * ux},
                         profile.step_m * ux,
                         profile.step_m * uy},
                        place.height_m);
    };
    place.here = beside(0.0);
    place.left = beside(options.beside_m);
    place.right = beside(-options.beside_m);
    profile.places.push_back(place);
  }
  return profile;
}

flight::RouteCost straight_cost(const risk::CostModel& model,
                                const std::vector<geo::MapPoint>& places, double height_m,
                                double step_m) {
  flight::RouteCost sum;
  for (std::size_t i = 1; i < places.size(); ++i) {
    const double dx_m = places[i].x_m - places[i - 1].x_m;
    const double dy_m = places[i].y_m - places[i - 1].y_m;
    const double length_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    const auto count = std::max(1L, std::lround(std::ceil(length_m / step_m)));
    for (long k = 0; k < count; ++k) {
      const double t = (static_cast<double>(k) + 0.5) / static_cast<double>(count);
      const double share = 1.0 / static_cast<double>(count);
      add(sum,
          density_on(model,
                     {{places[i - 1].x_m + t * dx_m, places[i - 1].y_m + t * dy_m},
                      share * dx_m,
                      share * dy_m},
                     height_m),
          length_m * share);
    }
  }
  return sum;
}

}  // namespace hedgehop::briefing
