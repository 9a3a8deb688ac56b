#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/observer.hpp"
#include "geo/geodetic_box.hpp"
#include "geo/map_projection.hpp"
#include "map_sources/land_use_source.hpp"
#include "map_sources/open_air.hpp"

namespace hedgehop::map_sources {

/// A volume of airspace that flights avoid, in the map frame.
struct AirspaceArea {
  std::string name;             // may be empty
  std::string kind;             // class or type as its source states it; may be empty
  std::optional<bool> is_hard;  // as its source states it
  AltitudeLimit floor;
  AltitudeLimit ceiling;
  std::vector<MapPolygon> polygons;  // inside the region, at least 1
};

struct AirspaceList {
  std::vector<AirspaceArea> areas;  // those that touch the region, in the order of the files
  std::int64_t record_count = 0;    // of the files, wherever they lie
};

struct AreaFile {
  std::filesystem::path path;
  bool others_are_skipped = false;  // what is no polygon; else it is refused
};
using AreaFiles = std::vector<AreaFile>;

/// Where a flight must stay, or must not go, at every altitude. The outline is open or closed;
/// edges are straight in longitude and latitude.
struct Fence {
  bool is_inclusion = false;  // stay inside
  std::vector<geo::GeodeticPosition> outline;
  std::string place;  // "flight.plan: fence 0", for errors
};

/// A projection whose azimuths and distances from a place are true: x east, y north of it.
geo::MapProjection around(const geo::GeodeticPosition& place);

/// A circle as a fence with straight edges that permits nothing which the circle does not: around
/// it if it must not be entered, inside it if it must not be left.
Fence circle_fence(const geo::GeodeticPosition& centre, double radius_m, bool is_inclusion,
                   std::string place);

/// Reads areas from files.
///
/// OpenAir (.txt, .air, .openair): see parse_open_air(). Anything else goes through OGR: GeoJSON,
/// KML, KMZ, GeoPackage, Shapefile, FlatGeobuf; every layer, polygons only. Attributes, in any
/// case; the first that is there counts:
/// - name: name, designator, id;
/// - kind: kind, class, type, category;
/// - hard: hard, is_hard, no_fly, as a truth value (1, true, yes);
/// - floor: floor_m, floor_ft, floor_fl with floor_reference (AMSL or AGL; else AMSL), or floor,
///   lower, lower_limit, base as a text with its unit ("1500 ft AGL", "FL 95", "GND");
/// - ceiling: the same with ceiling_m ..., or ceiling, upper, upper_limit, top.
/// Without a floor an area begins on the ground, without a ceiling it has no end.
///
/// Polygons that cross themselves are made valid (GEOS). They are cut to the region with a margin,
/// which changes nothing inside, and their edges, straight in longitude and latitude (or in the
/// file's own projection), are followed on the map with corners at most 0.01 degrees apart.
///
/// @throws DataError  a file is missing, damaged, without a coordinate system, holds an area that
/// is
///                    no polygon or an altitude that cannot be read; says which and where.
/// @throws Interrupted
AirspaceList read_areas(const AreaFiles& files, const geo::MapProjection& projection,
                        const geo::GeodeticBox& region, Observer& observer);

/// Fences as hard areas at every altitude. All inclusions together must be kept: outside of each of
/// them is an area.
///
/// @throws DataError  an outline cannot be made a polygon.
std::vector<AirspaceArea> areas_of_fences(const std::vector<Fence>& fences,
                                          const geo::MapProjection& projection,
                                          const geo::GeodeticBox& region);

}  // namespace hedgehop::map_sources
