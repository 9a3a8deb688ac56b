#include "geo/map_projection.hpp"

#include <cmath>
#include <cpl_conv.h>
#include <cpl_string.h>
#include <ogr_spatialref.h>
#include <optional>
#include <sstream>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "geo/gdal_guards.hpp"
#include "geo/geodetic_box.hpp"
#include "geo/geodetic_tiles.hpp"

namespace hedgehop::geo {
namespace {

constexpr double kSemiMajorAxis_m = 6378137.0;       // WGS 84
constexpr double kFlattening = 1.0 / 298.257223563;  // WGS 84
constexpr double kEccentricitySquared = kFlattening * (2.0 - kFlattening);

double rounded_to_millimetre(double value_m) { return std::round(value_m * 1e3) / 1e3; }

// 1e-11 rad is 0.06 mm on the ground.
double rounded_angle_rad(double angle_rad) { return std::round(angle_rad * 1e11) / 1e11; }

// Whether an angle that is off by up to five times GeodeticTiles::kError_rad is rounded as the
// right one would be. Of all angles 1 % are too near to a tie to say.
bool is_surely_rounded(double angle_rad) {
  const double steps = angle_rad * 1e11;
  return std::fabs(steps - std::floor(steps) - 0.5) > 5.0 * GeodeticTiles::kError_rad * 1e11;
}

std::string shortened(const std::string& text) {
  return text.size() <= 60 ? text : text.substr(0, 57) + "...";
}

std::string text_of(const GeodeticPosition& position) {
  std::ostringstream text;
  text.precision(9);
  text << degrees_from_radians(position.latitude_rad) << ","
       << degrees_from_radians(position.longitude_rad);
  return text.str();
}

bool is_on_the_globe(const GeodeticPosition& position) {
  return std::isfinite(position.latitude_rad) && std::isfinite(position.longitude_rad) &&
         std::fabs(position.latitude_rad) <= 0.5 * std::numbers::pi + 1e-12 &&
         std::fabs(position.longitude_rad) <= std::numbers::pi + 1e-12;
}

}  // namespace

struct MapProjection::Impl {
  std::string wkt;
  std::string code;
  std::unique_ptr<OGRCoordinateTransformation> to_map;
  std::unique_ptr<OGRCoordinateTransformation> to_geodetic;
  GeodeticTiles tiles;

  // Not rounded; nothing outside the projection.
  [[nodiscard]] std::optional<GeodeticTiles::Angles> angles_at(double x_m, double y_m) const {
    double x = x_m;
    double y = y_m;
    if (!std::isfinite(x) || !std::isfinite(y) || !to_geodetic->Transform(1, &x, &y) ||
        !std::isfinite(x) || !std::isfinite(y)) {
      return std::nullopt;
    }
    return GeodeticTiles::Angles{radians_from_degrees(y), radians_from_degrees(x)};
  }
};

MapProjection::MapProjection(const std::string& crs) : impl_(std::make_unique<Impl>()) {
  const GdalErrors errors;
  const char* hint =
      "give a projected coordinate system in metres, for example EPSG:32632 (UTM zone 32 north)";
  OGRSpatialReference map_crs;
  static const char* const kNoOutsideAccess[] = {"ALLOW_NETWORK_ACCESS=NO", "ALLOW_FILE_ACCESS=NO",
                                                 nullptr};
  if (crs.empty() || map_crs.SetFromUserInput(crs.c_str(), kNoOutsideAccess) != OGRERR_NONE) {
    throw DataError("coordinate system '" + shortened(crs) + "' is not known", hint);
  }
  if (!map_crs.IsProjected()) {
    throw DataError("coordinate system '" + shortened(crs) + "' is not a map projection", hint);
  }
  if (map_crs.GetLinearUnits() != 1.0) {
    throw DataError("coordinate system '" + shortened(crs) + "' is not in metres", hint);
  }
  map_crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  OGRSpatialReference geodetic_crs;
  geodetic_crs.importFromEPSG(4326);
  geodetic_crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);

  static const char* const kWktFormat[] = {"FORMAT=WKT2_2019", "MULTILINE=NO", nullptr};
  char* wkt = nullptr;
  if (map_crs.exportToWkt(&wkt, kWktFormat) == OGRERR_NONE && wkt != nullptr) {
    impl_->wkt = wkt;
  }
  CPLFree(wkt);
  if (impl_->wkt.empty()) {
    throw DataError("coordinate system '" + shortened(crs) + "' cannot be written as WKT", hint);
  }
  const char* authority = map_crs.GetAuthorityName(nullptr);
  const char* number = map_crs.GetAuthorityCode(nullptr);
  if (authority != nullptr && number != nullptr) {
    impl_->code = std::string(authority) + ":" + number;
  }

  // A ballpark transformation would move the map by up to hundreds of metres without a word.
  OGRCoordinateTransformationOptions options;
  options.SetBallparkAllowed(false);
  impl_->to_map.reset(OGRCreateCoordinateTransformation(&geodetic_crs, &map_crs, options));
  impl_->to_geodetic.reset(OGRCreateCoordinateTransformation(&map_crs, &geodetic_crs, options));
  if (!impl_->to_map || !impl_->to_geodetic) {
    throw DataError(
        "coordinate system '" + shortened(crs) + "' cannot be related to WGS 84: " + errors.first(),
        hint);
  }
}

MapProjection::~MapProjection() = default;
MapProjection::MapProjection(MapProjection&&) noexcept = default;
MapProjection& MapProjection::operator=(MapProjection&&) noexcept = default;

MapPoint MapProjection::to_map(const GeodeticPosition& position) const {
  const GdalErrors errors;
  double x = degrees_from_radians(position.longitude_rad);
  double y = degrees_from_radians(position.latitude_rad);
  if (!is_on_the_globe(position) || !impl_->to_map->Transform(1, &x, &y) || !std::isfinite(x) ||
      !std::isfinite(y)) {
    throw DataError("position " + text_of(position) + " cannot be shown in the map's projection");
  }
  // Far outside its domain a projection may fold: two places on one point.
  double longitude_deg = x;
  double latitude_deg = y;
  if (!impl_->to_geodetic->Transform(1, &longitude_deg, &latitude_deg) ||
      !(std::fabs(latitude_deg - degrees_from_radians(position.latitude_rad)) < 1e-7) ||
      !(std::fabs(wrap_to_pi(radians_from_degrees(longitude_deg) - position.longitude_rad)) *
            elementary::cos(position.latitude_rad) <
        1e-8)) {
    throw DataError("position " + text_of(position) + " cannot be shown in the map's projection");
  }
  return {rounded_to_millimetre(x), rounded_to_millimetre(y)};
}

GeodeticPosition MapProjection::to_geodetic(const MapPoint& point) const {
  const GdalErrors errors;
  const auto angles = impl_->angles_at(point.x_m, point.y_m);
  if (!angles) {
    std::ostringstream text;
    text << "map point (" << point.x_m << ", " << point.y_m
         << ") m lies outside the map's projection";
    throw DataError(text.str());
  }
  return {rounded_angle_rad(angles->latitude_rad), rounded_angle_rad(angles->longitude_rad)};
}

GeodeticPosition MapProjection::to_geodetic_by_tiles(const MapPoint& point) const {
  const auto angles = impl_->tiles.at(point.x_m, point.y_m, [this](double x_m, double y_m) {
    const GdalErrors errors;
    return impl_->angles_at(x_m, y_m);
  });
  if (angles && is_surely_rounded(angles->latitude_rad) &&
      is_surely_rounded(angles->longitude_rad)) {
    return {rounded_angle_rad(angles->latitude_rad), rounded_angle_rad(angles->longitude_rad)};
  }
  return to_geodetic(point);
}

double MapProjection::convergence_rad(const MapPoint& point) const {
  constexpr double kHalfStep_m = 500.0;
  const GeodeticPosition south = to_geodetic_by_tiles({point.x_m, point.y_m - kHalfStep_m});
  const GeodeticPosition north = to_geodetic_by_tiles({point.x_m, point.y_m + kHalfStep_m});
  const double latitude_rad = 0.5 * (south.latitude_rad + north.latitude_rad);
  const double sine = elementary::sin(latitude_rad);
  const double w_squared = 1.0 - kEccentricitySquared * sine * sine;
  const double prime_vertical_radius_m = kSemiMajorAxis_m / std::sqrt(w_squared);
  const double meridian_radius_m =
      prime_vertical_radius_m * (1.0 - kEccentricitySquared) / w_squared;
  const double north_m = meridian_radius_m * (north.latitude_rad - south.latitude_rad);
  const double east_m = prime_vertical_radius_m * elementary::cos(latitude_rad) *
                        wrap_to_pi(north.longitude_rad - south.longitude_rad);
  return std::round(elementary::atan2(east_m, north_m) * 1e9) / 1e9;
}

const std::string& MapProjection::wkt() const { return impl_->wkt; }
const std::string& MapProjection::code() const { return impl_->code; }

std::string utm_code(const GeodeticPosition& position) {
  const double latitude_deg = degrees_from_radians(position.latitude_rad);
  const double longitude_deg = degrees_from_radians(position.longitude_rad);
  if (!is_on_the_globe(position) || latitude_deg < -80.0 || latitude_deg >= 84.0) {
    throw DataError(
        "position " + text_of(position) + " lies outside UTM, which ends at 80 S and 84 N",
        "choose a polar projection in metres with --crs");
  }
  // Half a nanodegree, so that 12 degrees given in radians stay on their side of the border.
  int zone = static_cast<int>(std::floor((longitude_deg + 180.0 + 5e-10) / 6.0)) + 1;
  if (zone > 60) {
    zone = 1;  // 180 degrees east is 180 degrees west
  }
  if (latitude_deg >= 56.0 && latitude_deg < 64.0 && longitude_deg >= 3.0 && longitude_deg < 12.0) {
    zone = 32;  // south-western Norway
  } else if (latitude_deg >= 72.0 && longitude_deg >= 0.0 && longitude_deg < 42.0) {
    zone = longitude_deg < 9.0 ? 31 : longitude_deg < 21.0 ? 33 : longitude_deg < 33.0 ? 35 : 37;
  }
  return "EPSG:" + std::to_string((latitude_deg >= 0.0 ? 32600 : 32700) + zone);
}

}  // namespace hedgehop::geo
