#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "geo/map_projection.hpp"

namespace hedgehop::map_sources {

/// Lower or upper end of an area of airspace, in metres.
struct AltitudeLimit {
  double value_m = 0.0;  // -infinity: from the ground on; +infinity: without end
  bool is_above_ground = false;

  bool operator==(const AltitudeLimit&) const = default;
};

/// An altitude as aeronautical publications write it: "FL 95", "2500 ft MSL", "1500FT AGL", "300 m
/// AGL", "4500" (feet above the sea), "GND", "SFC", "UNL".
///
/// A flight level is hundreds of feet of pressure altitude, taken as altitude above the sea: right
/// in the ICAO standard atmosphere, off by about 8 m for each hPa that the pressure at sea level
/// differs from 1013.25 hPa.
///
/// Nothing for anything else. `bare_unit_m` is the length of the unit that a number without one is
/// in; 0: such a number is nothing, unless it is 0.
std::optional<AltitudeLimit> altitude_limit_in(std::string_view text, double bare_unit_m);

struct OpenAirArea {
  std::int64_t line = 0;  // of its AC
  std::string kind;       // its class as written, "R" or "CTR" for example
  std::string name;
  AltitudeLimit floor;
  AltitudeLimit ceiling;
  std::vector<geo::GeodeticPosition> outline;  // at least 3 corners, not closed
};

/// Areas of an OpenAir file.
///
/// Read: AC, AN, AL, AH, V X=, V D=, DP, DA, DB, DC; circles and arcs run along corners that lie on
/// them and leave them by at most 1 m. Labels, frequencies, pens and terrain (AT, AY, AF, AG, AI,
/// AX, AA, TP, SP, SB, TO, TC, V Z, V W) are passed over, airways (DY) refused. An area without
/// AL begins on the ground, one without AH has no end.
///
/// @param name  what errors call the file.
/// @throws DataError  what() begins with name:line; nothing is left out in silence.
std::vector<OpenAirArea> parse_open_air(std::string_view text, const std::string& name);

}  // namespace hedgehop::map_sources
