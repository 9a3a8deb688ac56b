// OpenAir: whatever is accepted has corners on the globe and limits in order; all else is a
// DataError.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "map_sources/open_air.hpp"

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
  (void)map_sources::altitude_limit_in(text, 0.3048);
  if (const auto limit = map_sources::altitude_limit_in(text, 0.0)) {
    demand(!std::isnan(limit->value_m));
  }
  try {
    for (const map_sources::OpenAirArea& area : map_sources::parse_open_air(text, "f")) {
      demand(area.outline.size() >= 3);
      demand(area.line >= 1);
      demand(area.floor.is_above_ground != area.ceiling.is_above_ground ||
             area.floor.value_m <= area.ceiling.value_m);
      for (const geo::GeodeticPosition& corner : area.outline) {
        demand(std::fabs(corner.latitude_rad) <= 0.25 * kTwoPi + 1e-9);
        demand(std::fabs(corner.longitude_rad) <= 0.5 * kTwoPi + 1e-9);
      }
    }
  } catch (const DataError&) {
  }
  return 0;
}
