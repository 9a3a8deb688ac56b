#pragma once

#include <functional>
#include <optional>

#include "geo/map_projection.hpp"
#include "global_planning/cost_field.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/route_line.hpp"

namespace hedgehop::global_planning {

/// Where a better way leaves a route and where it comes back to it, along it [m].
struct Detour {
  double leave_m = 0.0;
  double join_m = 0.0;
  double aside_m = 0.0;  // farthest that the way between them lies beside the box around both
};

/// What is known of a route for which a better way is looked for.
struct DetourQuestion {
  double from_m = 0.0;        // where on the route the flight is
  bool is_on_route = true;    // else it leaves there
  double cost_per_field = 1;  // what flights cost for a metre of the field
  std::function<bool(const geo::MapPoint&)> is_changed;
};

/// Looks along `route` after costs have changed, `field` being the repaired field to its end. The
/// way leaves it before the first changed place, where what the route costs until there and the
/// field from there on are least, and there as late as it can; it joins the route behind the last
/// changed place, as early as it can, where the way down the field comes near and what was flown
/// along it, what lies between and the rest of the route are least, or at its end. None where
/// nothing on the route has changed and no way is better by a fiftieth.
///
/// The rest of the route counts as what it costs, which is why it is kept where it is as good as
/// what the coarse field promises. O(length^2 / (100 m)^2).
std::optional<Detour> find_detour(const FlightEnvelope& envelope, const CostField& field,
                                  const RouteLine& route, const DetourQuestion& question);

}  // namespace hedgehop::global_planning
