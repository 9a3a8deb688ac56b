#pragma once

#include <string>
#include <string_view>

namespace hedgehop::output {

/// A number with so many decimals, "unknown" if it is not finite; no minus before zero.
std::string fixed_text(double value, int decimals);

/// "03:07" of 187 s; hours go on as minutes. "unknown" if it is not finite.
std::string clock_text(double seconds);

/// `<i style=...></i>name` of a legend: a filled box, or a line.
std::string key_box(const std::string& color, std::string_view name);
std::string key_line(const std::string& color, std::string_view name, bool is_dashed = false);

}  // namespace hedgehop::output
