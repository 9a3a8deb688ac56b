#pragma once

#include <optional>
#include <string>
#include <vector>

#include "flight/plan.hpp"
#include "geo/map_projection.hpp"
#include "geo/vertical_datum.hpp"
#include "output/exports.hpp"

namespace hedgehop::output {

/// Where the points of a plan lie for others.
class Places {
 public:
  /// Throws DataError if the map has no coordinate system.
  explicit Places(const flight::Plan& plan);

  struct Degrees {
    double latitude_deg = 0.0;  // rounded to 1e-9, 0.1 mm
    double longitude_deg = 0.0;
  };
  [[nodiscard]] Degrees degrees(const geo::MapPoint& point) const;

  /// A height of the map as one above mean sea level (EGM96), or above the WGS 84 ellipsoid,
  /// rounded to 1 mm. Throw DataError if the geoid grid is missing or knows nothing there.
  double amsl_m(const geo::MapPoint& point, double altitude_m);
  double ellipsoid_m(const geo::MapPoint& point, double altitude_m);

 private:
  double shifted_m(std::optional<geo::VerticalShift>& shift, const char* to,
                   const geo::MapPoint& point, double altitude_m);

  geo::MapProjection projection_;
  std::string datum_;
  geo::GeodeticBox area_;
  std::optional<geo::VerticalShift> to_amsl_;
  std::optional<geo::VerticalShift> to_ellipsoid_;
};

/// States at least `step_s` apart, first and last included.
std::vector<flight::FlightState> thinned(const flight::Trajectory& trajectory, double step_s);

/// One item of a waypoint list.
struct MissionItem {
  bool is_speed = false;  // a change of ground speed, else a place to fly to
  double speed_mps = 0.0;
  Places::Degrees place;
  double amsl_m = 0.0;
};
struct WaypointList {
  StraightLegs legs;
  std::vector<MissionItem> items;
  Places::Degrees home;
  double home_amsl_m = 0.0;  // of the ground below the start
  double cruise_speed_mps = 0.0;
};
WaypointList waypoint_list(const flight::Plan& plan, Places& places, const ExportRequest& request,
                           const ExportOptions& options);

/// Sentences that travel with every product: label, attributions, verdict.
std::vector<std::string> product_lines(const flight::Plan& plan);

/// A time of the flight as utc_text(); empty without a start time.
std::string time_text(const std::optional<Time>& start, double time_s);

std::string kml_text(const flight::Plan& plan, Places& places, const ExportRequest& request,
                     const ExportOptions& options);
std::string gpx_text(const flight::Plan& plan, Places& places, const ExportRequest& request,
                     const ExportOptions& options);
std::string csv_text(const flight::Plan& plan, const ExportRequest& request);
std::string wpl_text(const WaypointList& list);
std::string qgc_plan_text(const WaypointList& list);
std::string geojson_text(const flight::Plan& plan, Places& places, const ExportRequest& request,
                         const ExportOptions& options);
std::string czml_text(const flight::Plan& plan, Places& places, const ExportRequest& request,
                      const ExportOptions& options);

/// A recording with the channels /flight/state (every state), /flight/location
/// (foxglove.LocationFix) and /flight/route (foxglove.GeoJSON).
std::string mcap_bytes(const flight::Plan& plan, Places& places, const ExportRequest& request,
                       const ExportOptions& options);

/// A zip archive that holds `text` as doc.kml.
std::string kmz_bytes(const std::string& text);
/// Throws DataError for a layer of the map that cannot be read.
std::string gpkg_bytes(const flight::Plan& plan, const Places& places,
                       const ExportRequest& request);

}  // namespace hedgehop::output
