#pragma once

#include <optional>
#include <vector>

#include "flight/route.hpp"
#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"

namespace hedgehop::global_planning {

/// Stations along a line and places beside each of them.
struct LowCorridorGrid {
  double station_m;  // between stations
  double aside_m;    // between neighbouring places, of which there are two to either side
};

/// The ground track through one place of each station around `base` that is cheapest to fly as low
/// as it may be: heights are no choice here, FlightEnvelope::follow() carries along each track what
/// altitudes can be had and what the lowest of them cost, climbs counted. Dynamic programming over
/// the places of two stations at a time, so turns are exact (FlightEnvelope::is_turn_allowed); of
/// the arrivals at such a pair the cheapest is kept. Ends are fixed, with their altitudes.
///
/// Empty if none was found. lowest_profile() makes a flight of it, or finds that there is none.
///
/// @param before, after  where legs that join it come from and go to; may be missing.
std::vector<geo::MapPoint> low_corridor_track(const FlightEnvelope& envelope,
                                              const std::vector<flight::Waypoint>& base,
                                              const LowCorridorGrid& grid,
                                              const std::optional<flight::Waypoint>& before,
                                              const std::optional<flight::Waypoint>& after);

}  // namespace hedgehop::global_planning
