#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "flight/trajectory.hpp"
#include "map/map.hpp"

namespace hedgehop::briefing {

struct ManoeuvreOptions {
  double announce_ahead_s = 0.0;     // >= 0
  double bank_min_rad = 0.0;         // > 0
  double turn_min_rad = 0.0;         // >= 0
  double climb_angle_min_rad = 0.0;  // > 0
  double climb_min_m = 0.0;          // >= 0
  double gap_s = 0.0;                // >= 0
  double obstacle_distance_m = 0.0;  // >= 0
  double obstacle_height_m = 0.0;    // >= 0
};
/// Section `manoeuvres` of config/report.yaml.
ManoeuvreOptions read_manoeuvre_options(ConfigReader& reader);

enum class ManoeuvreKind : std::uint8_t { kTurn, kClimb, kDescent, kWireCrossing, kObstacle, kVia };
/// "turn" and so on, as used in files.
const char* name_of(ManoeuvreKind kind);

/// Something that a pilot is told about before it comes. Members that do not belong to the kind are
/// NaN or empty.
struct Manoeuvre {
  ManoeuvreKind kind = ManoeuvreKind::kTurn;
  double time_s = 0.0;   // when it begins, since the start of the flight
  double along_m = 0.0;  // distance flown until then
  double duration_s = 0.0;
  geo::MapPoint place;                // where it begins
  double announced_time_s = 0.0;      // announce_ahead_s before, but not before the start
  double announced_distance_m = 0.0;  // still to fly from there

  double heading_change_rad = 0.0;  // turn: right positive
  double heading_to_rad = 0.0;      // turn: from true north, when it ends
  double bank_max_rad = 0.0;        // turn: magnitude
  double altitude_from_m = 0.0;     // climb, descent: AMSL
  double altitude_to_m = 0.0;
  double rate_max_mps = 0.0;  // climb, descent: magnitude

  std::string name;    // wire, obstacle: kind and, if it has one, name or number in its source
  double top_m = 0.0;  // wire: altitude of the conductor below the crossing; obstacle: its top
  double above_m =
      0.0;  // altitude of the flight less that; negative for an obstacle that is higher
  double support_m = 0.0;    // wire: distance along it to the nearest support
  double bearing_rad = 0.0;  // obstacle: from the heading, right positive, at the nearest place
  double distance_m = 0.0;   // obstacle: horizontal, to its side; via: to the point
  std::size_t number = 0;    // via: 1 for the first
};

/// All manoeuvres of a flight, by the time at which they begin.
///
/// A turn lasts while the bank to one side is at least `bank_min_rad`, a climb or descent while the
/// climb angle is at least `climb_angle_min_rad`; interruptions up to `gap_s` do not end it unless
/// the other side comes first. What changes less than `turn_min_rad` or `climb_min_m` is left out.
///
/// A wire is crossed where a step of the flight and a span between two supports meet, seen from
/// above; the conductor is taken as straight between their tops. An obstacle counts once, where it
/// is nearest, if the side of its cylinder comes within `obstacle_distance_m` and its top lies no
/// more than `obstacle_height_m` below the flight there.
///
/// @param via  states at which the flight passes via points, in their order.
/// @param via_distance_m  how far off, one for each.
/// O(states x (spans + obstacles) in the worst case; those far from the whole flight cost nothing).
std::vector<Manoeuvre> manoeuvres(const map::Map& map, const flight::Trajectory& trajectory,
                                  const std::vector<std::size_t>& via,
                                  const std::vector<double>& via_distance_m,
                                  const ManoeuvreOptions& options);

}  // namespace hedgehop::briefing
