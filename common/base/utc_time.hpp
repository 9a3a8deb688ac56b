#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "base/time.hpp"

namespace hedgehop {

/// An instant as ISO 8601 writes it: "2026-05-01T06:30Z", "2026-05-01T08:30:15.5+02:00".
///
/// Years 1970 to 2200. Seconds may be missing; the zone may not: without it nobody knows what is
/// meant. Nothing for any other text, days and hours that do not exist included.
std::optional<Time> parse_utc(std::string_view text);

/// "2026-05-01T06:30:00.050Z", rounded down to milliseconds.
std::string utc_text(Time time);

}  // namespace hedgehop
