#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "geo/map_projection.hpp"
#include "global_planning/cost_field.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"

namespace hedgehop::global_planning {

/// What a track keeps to spare, so that a profile that is looked at more densely fits as well.
struct LatticeSpare {
  double margin_m;     // to the band, at points 15 m apart
  double climb_share;  // of the climb limit
};

/// What the search for a ground track spent and found.
struct LatticeResult {
  std::vector<geo::MapPoint> track;  // corners, start and goal included; empty if none was found
  double cost_m = 0.0;               // as low as the track allows, infinity without a track
  std::int64_t work_units = 0;       // legs followed
  bool is_exhausted = false;         // nothing is left to try: the lattice holds no track
};

/// Heading-aware A* over ground tracks, altitudes as intervals.
///
/// Corners lie on a square lattice around the start, headings are the sixteen directions to the
/// neighbours one or two nodes away. A track goes on straight by one node or turns into the next
/// direction; nodes are so far apart that FlightEnvelope::is_turn_allowed holds for both legs. The
/// first and the last leg are free: any direction, up to 600 m. Altitude is not a
/// dimension of the search: along a fixed track, the altitudes that climb limit and band leave are
/// one interval, which FlightEnvelope::follow carries along exactly. Each arrival is a label (cost,
/// interval); one that costs more than another of the same node and direction and can do nothing
/// that the other cannot is dropped, and so is a seventh.
///
/// The cost of a track is that of its lowest altitudes as seen from behind, and what it costs to be
/// higher before a climb (FlightEnvelope::FollowRules::counts_climbs), so it is about that of its
/// lowest profile. A CostField, counted more than once and still more
/// when the search takes long, leads it to the goal: the first track found ends it. When the search
/// from the start takes long, one from the goal joins it, in turns, with climbs and descents
/// exchanged; its lattice lies around the goal. The spacing is at least two cells. Deterministic.
///
/// @param to_goal  the field that leads the search from the start, if there is one already.
LatticeResult search_lattice(const FlightEnvelope& envelope, const GlobalOptions& options,
                             const LatticeSpare& spare, std::int64_t work_budget,
                             const std::function<bool()>& should_stop,
                             const CostField* to_goal = nullptr);

/// A part of a route: from one of its places to a later one.
struct LatticePart {
  flight::Waypoint from;
  flight::Waypoint to;
  std::optional<LeadIn> lead_in;   // the leg of the route that ends at `from`
  std::optional<LeadIn> lead_out;  // and the one that begins at `to`
  double higher_m = 0.0;           // than at `from` the flight may be there
  double aside_m = 0.0;            // of the box around both ends that is searched
  bool is_backward = false;        // searched from `to`
};

/// The same for a part of a route that is flown as low as it may be, so that what follows can be
/// flown from any height above it too. The turns into and out of the part are kept. Altitudes at
/// its ends are open upwards, except at start and goal of the envelope, where all is as above. The
/// search goes from one end alone. What `ahead` says of a place, less what it says of the end that
/// is looked for, leads it, or the straight line where that is more; it counts more than above,
/// since what is found gets moved.
LatticeResult search_lattice(const FlightEnvelope& envelope, const GlobalOptions& options,
                             const LatticeSpare& spare, const LatticePart& part,
                             std::int64_t work_budget, const std::function<bool()>& should_stop,
                             const CostField& ahead);

}  // namespace hedgehop::global_planning
