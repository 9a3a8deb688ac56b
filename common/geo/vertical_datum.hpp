#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "geo/geodetic_box.hpp"
#include "geo/map_projection.hpp"

namespace hedgehop::geo {

/// What heights are counted from.
struct VerticalDatum {
  std::string name;   // "EGM96", "EGM2008", "EGM84", "ellipsoid", else "EPSG:5703" for example
  int epsg_code = 0;  // of the vertical coordinate system; 0: the WGS 84 ellipsoid

  /// One of the names above, in any case. Throws UsageError for others, and for codes of what is no
  /// vertical coordinate system.
  static VerticalDatum parse(std::string_view text);

  bool operator==(const VerticalDatum& other) const { return epsg_code == other.epsg_code; }
};

/// Turns heights of one vertical datum into those of another with the geoid grids of PROJ.
///
/// Ballpark transformations, which leave heights as they are, are never used; the network neither.
/// Not safe for concurrent use of one object.
class VerticalShift {
 public:
  /// The best operation for the area whose grids are installed. Throws DataError if there is none;
  /// it names the missing grid and where to put it.
  VerticalShift(const VerticalDatum& from, const VerticalDatum& to, const GeodeticBox& area);
  ~VerticalShift();
  VerticalShift(VerticalShift&&) noexcept;
  VerticalShift& operator=(VerticalShift&&) noexcept;

  /// What must be added to a height in `from` [m], rounded to 1/1024 m; NaN where the grid knows
  /// nothing.
  [[nodiscard]] double at_m(const GeodeticPosition& position) const;

  /// PROJ's name of the operation.
  [[nodiscard]] const std::string& operation() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hedgehop::geo
