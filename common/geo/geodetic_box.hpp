#pragma once

#include "geo/map_projection.hpp"

namespace hedgehop::geo {

/// A region between two parallels and two meridians, not across the antimeridian.
struct GeodeticBox {
  double west_rad = 0.0;
  double south_rad = 0.0;
  double east_rad = 0.0;   // > west_rad
  double north_rad = 0.0;  // > south_rad

  bool operator==(const GeodeticBox&) const = default;

  [[nodiscard]] GeodeticPosition centre() const {
    return {0.5 * (south_rad + north_rad), 0.5 * (west_rad + east_rad)};
  }
};

}  // namespace hedgehop::geo
