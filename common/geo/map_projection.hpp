#pragma once

#include <memory>
#include <string>
#include <vector>

namespace hedgehop::geo {

/// A place on the WGS 84 ellipsoid, without height.
struct GeodeticPosition {
  double latitude_rad = 0.0;   // north positive, [-pi/2, pi/2]
  double longitude_rad = 0.0;  // east positive, [-pi, pi]
};

/// A place in the map frame: metric CRS of the map, x east, y north [m].
struct MapPoint {
  double x_m = 0.0;
  double y_m = 0.0;
};

/// Converts between geodetic positions and one projected, metric CRS.
///
/// Results are rounded to 1 mm in the map frame, so that the last bits of the projection library,
/// which may depend on the processor, never reach a decision. Not safe for concurrent use of one
/// object; cheap to make one per thread.
class MapProjection {
 public:
  /// `crs` is WKT, PROJ text or an authority code such as "EPSG:32632".
  /// Throws DataError if it is unknown, not projected or not in metres.
  explicit MapProjection(const std::string& crs);
  ~MapProjection();
  MapProjection(MapProjection&&) noexcept;
  MapProjection& operator=(MapProjection&&) noexcept;

  /// Throws DataError for a position that the projection cannot hold.
  [[nodiscard]] MapPoint to_map(const GeodeticPosition& position) const;
  [[nodiscard]] GeodeticPosition to_geodetic(const MapPoint& point) const;

  /// True azimuth of grid north at a point: positive when grid north lies east of true north [rad].
  /// Many points near each other cost 0.2 us each, see GeodeticTiles; the bits are the same.
  [[nodiscard]] double convergence_rad(const MapPoint& point) const;

  /// WKT2:2019 on one line.
  [[nodiscard]] const std::string& wkt() const;
  /// Authority code such as "EPSG:32632", or empty.
  [[nodiscard]] const std::string& code() const;

 private:
  // The same bits, quicker for many points near each other.
  [[nodiscard]] GeodeticPosition to_geodetic_by_tiles(const MapPoint& point) const;

  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// EPSG code of the UTM zone that holds a position, with the exceptions of Norway and Svalbard.
std::string utm_code(const GeodeticPosition& position);

}  // namespace hedgehop::geo
