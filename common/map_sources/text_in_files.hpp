#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace hedgehop::map_sources {

inline constexpr double kFoot_m = 0.3048;
inline constexpr double kNauticalMile_m = 1852.0;

/// Without blanks at both ends.
std::string_view without_blanks(std::string_view text);

/// The first line of `rest`, without its end (LF or CR LF), which is taken off `rest`.
std::string_view take_line(std::string_view& rest);

/// Without a byte order mark.
std::string_view without_mark(std::string_view text);

std::string lower_case(std::string_view text);
std::string upper_case(std::string_view text);

/// The whole text as a finite number with a decimal point, or nothing.
std::optional<double> number_in(std::string_view text);

/// Text of a file, fit for names: control characters become blanks, bytes that are no UTF-8
/// question marks; no blanks at the ends; cut to at most `bytes_max` between characters.
std::string clean_name(std::string_view text, std::size_t bytes_max = 120);

}  // namespace hedgehop::map_sources
