#pragma once

#include <optional>
#include <string_view>

namespace hedgehop::map_sources {

/// Height written by people [m]: "12", "12.5 m", "12,5", "40'", "5'6\"", "40 ft", "6 ft 2 in",
/// "1,250.5 ft" (a comma before exactly three digits parts thousands); of a range or list ("3 m - 5
/// m", "8;10", "8/10") the greatest, a bare number in it taking the unit of the last. Prime marks
/// of Unicode count as ' and ".
///
/// A bare number is multiplied by `bare_unit_m`. Nothing for anything else, for 0 and below, and
/// above 1000 m. Never throws.
std::optional<double> height_in_text_m(std::string_view text, double bare_unit_m = 1.0);

/// Number of storeys: "4", "2.5", "2,5"; of a range or list the greatest. Nothing for anything
/// else, for 0 and below, and above 200.
std::optional<double> levels_in_text(std::string_view text);

}  // namespace hedgehop::map_sources
