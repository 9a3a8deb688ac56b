#pragma once

#include <string_view>

namespace hedgehop::output {

/// Text of a file in common/output/report as it was at build time: "report.css", "report.js".
std::string_view report_part(std::string_view name);

}  // namespace hedgehop::output
