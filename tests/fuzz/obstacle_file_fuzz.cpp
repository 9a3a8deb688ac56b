// FAA DOF in columns and as CSV, and plain CSV: whatever is accepted has a place on the globe and
// heights, radii and errors that can be meant; all else is a DataError.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "map_sources/obstacle_file.hpp"

namespace {

void demand(bool condition) {
  if (!condition) {
    std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace hedgehop;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    for (const map_sources::ObstacleRecord& record : map_sources::parse_obstacles(text, "f")) {
      demand(record.line >= 1);
      demand(std::fabs(record.position.latitude_rad) <= 0.25 * kTwoPi + 1e-9);
      demand(std::fabs(record.position.longitude_rad) <= 0.5 * kTwoPi + 1e-9);
      demand(record.height_m || record.top_m);
      demand(record.height_m.value_or(0.0) >= 0.0 && record.height_m.value_or(0.0) <= 10'000.0);
      demand(std::fabs(record.top_m.value_or(0.0)) <= 10'000.0);
      demand(record.radius_m >= 0.0 && record.radius_m <= 100'000.0);
      demand(record.horizontal_error_m.value_or(0.0) >= 0.0);
      demand(record.vertical_error_m.value_or(0.0) >= 0.0);
      demand(record.name.size() <= 120);
    }
  } catch (const DataError&) {
  }
  return 0;
}
