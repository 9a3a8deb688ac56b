#include "map_sources/area_source.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <numbers>
#include <ogrsf_frmts.h>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "map_sources/gdal_access.hpp"
#include "map_sources/text_in_files.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;

constexpr char kStage[] = "areas";
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kStep_deg = 0.01;
constexpr double kMargin_deg = 0.1;
constexpr char kHint[] =
    "--areas takes OpenAir (.txt), GeoJSON, KML, KMZ, GeoPackage, Shapefile and FlatGeobuf";

using GeometryPointer = std::unique_ptr<OGRGeometry>;

// Polygons in degrees, cut to the region and put on the map.
class Placer {
 public:
  Placer(const geo::MapProjection& projection, const geo::GeodeticBox& region)
      : projection_(projection) {
    auto ring = std::make_unique<OGRLinearRing>();
    const double west = degrees_from_radians(region.west_rad) - kMargin_deg;
    const double south = degrees_from_radians(region.south_rad) - kMargin_deg;
    const double east = degrees_from_radians(region.east_rad) + kMargin_deg;
    const double north = degrees_from_radians(region.north_rad) + kMargin_deg;
    ring->addPoint(west, south);
    ring->addPoint(east, south);
    ring->addPoint(east, north);
    ring->addPoint(west, north);
    ring->closeRings();
    window_.addRingDirectly(ring.release());
  }

  [[nodiscard]] const OGRPolygon& window() const { return window_; }

  // Empty if nothing of it lies in the region. Null if GEOS cannot work on it.
  [[nodiscard]] std::optional<std::vector<MapPolygon>> placed(const OGRGeometry& given) const {
    GeometryPointer valid(given.IsValid() ? given.clone() : given.MakeValid());
    if (!valid) {
      return std::nullopt;
    }
    const GeometryPointer inside(valid->Intersection(&window_));
    if (!inside) {
      return std::nullopt;
    }
    std::vector<MapPolygon> polygons;
    collect(*inside, polygons);
    return polygons;
  }

 private:
  // What MakeValid and Intersection leave besides polygons are lines and points without area.
  void collect(const OGRGeometry& geometry, std::vector<MapPolygon>& polygons) const {
    const auto type = wkbFlatten(geometry.getGeometryType());
    if (type == wkbPolygon) {
      MapPolygon polygon;
      bool is_outer = true;
      for (const OGRLinearRing* ring : *geometry.toPolygon()) {
        MapLine line = line_of(*ring);
        if (is_outer) {
          if (line.size() < 4) {
            return;
          }
          polygon.outer = std::move(line);
        } else if (line.size() >= 4) {
          polygon.holes.push_back(std::move(line));
        }
        is_outer = false;
      }
      if (!polygon.outer.empty()) {
        polygons.push_back(std::move(polygon));
      }
    } else if (type == wkbMultiPolygon || type == wkbGeometryCollection) {
      for (const OGRGeometry* part : *geometry.toGeometryCollection()) {
        collect(*part, polygons);
      }
    }
  }

  [[nodiscard]] MapLine line_of(const OGRLinearRing& ring) const {
    MapLine line;
    const int count = ring.getNumPoints();
    const auto add = [&](double longitude_deg, double latitude_deg) {
      const geo::MapPoint point = projection_.to_map(
          {radians_from_degrees(latitude_deg), radians_from_degrees(longitude_deg)});
      if (line.empty() || point.x_m != line.back().x_m || point.y_m != line.back().y_m) {
        line.push_back(point);
      }
    };
    for (int i = 0; i + 1 < count; ++i) {
      const double dx = ring.getX(i + 1) - ring.getX(i);
      const double dy = ring.getY(i + 1) - ring.getY(i);
      const int steps =
          std::max(1, static_cast<int>(std::ceil(std::sqrt(dx * dx + dy * dy) / kStep_deg)));
      for (int k = 0; k < steps; ++k) {
        add(ring.getX(i) + dx * k / steps, ring.getY(i) + dy * k / steps);
      }
    }
    if (line.size() >= 3) {
      if (line.front().x_m != line.back().x_m || line.front().y_m != line.back().y_m) {
        line.push_back(line.front());
      }
    }
    return line;
  }

  const geo::MapProjection& projection_;
  OGRPolygon window_;
};

// ---- OpenAir

void read_open_air(const fs::path& path, const Placer& placer, AirspaceList& list) {
  for (OpenAirArea& area : parse_open_air(read_file(path), path.string())) {
    ++list.record_count;
    OGRPolygon polygon;
    auto ring = std::make_unique<OGRLinearRing>();
    for (const geo::GeodeticPosition& corner : area.outline) {
      ring->addPoint(degrees_from_radians(corner.longitude_rad),
                     degrees_from_radians(corner.latitude_rad));
    }
    ring->closeRings();
    polygon.addRingDirectly(ring.release());
    auto polygons = placer.placed(polygon);
    if (!polygons) {
      throw DataError(path.string() + ":" + std::to_string(area.line) + ": the outline of area '" +
                          area.name + "' cannot be made valid",
                      "correct it");
    }
    if (!polygons->empty()) {
      list.areas.push_back({std::move(area.name), std::move(area.kind), std::nullopt, area.floor,
                            area.ceiling, std::move(*polygons)});
    }
  }
}

// ---- OGR

// The attributes of one feature.
class Attributes {
 public:
  Attributes(const OGRFeature& feature, std::string where)
      : feature_(feature), where_(std::move(where)) {}

  [[noreturn]] void refuse(const std::string& why, const std::string& hint) const {
    throw DataError(where_ + ": " + why, hint);
  }

  using Names = std::vector<std::string>;  // the first that is set counts

  [[nodiscard]] std::string text(const Names& names) const {
    const int field = find(names);
    return field < 0 ? "" : clean_name(feature_.GetFieldAsString(field));
  }

  [[nodiscard]] std::optional<bool> truth(const Names& names) const {
    const int field = find(names);
    if (field < 0) {
      return std::nullopt;
    }
    const std::string value = lower_case(clean_name(feature_.GetFieldAsString(field)));
    for (const std::string_view word : {"1", "true", "yes", "hard", "no_fly"}) {
      if (value == word) {
        return true;
      }
    }
    for (const std::string_view word : {"0", "false", "no", "soft", "avoid"}) {
      if (value == word) {
        return false;
      }
    }
    refuse("'" + value + "' is no truth value", "write true or false");
  }

  // `end` is "floor" or "ceiling", `texts` are other names of a text with unit.
  [[nodiscard]] std::optional<AltitudeLimit> limit(const std::string& end,
                                                   const Names& texts) const {
    for (const auto& [suffix, unit_m] :
         {std::pair<const char*, double>{"_m", 1.0}, {"_ft", kFoot_m}, {"_fl", 100.0 * kFoot_m}}) {
      const int field = find({end + suffix});
      if (field < 0) {
        continue;
      }
      const auto number = number_in(feature_.GetFieldAsString(field));
      if (!number || !(std::fabs(*number * unit_m) <= 100'000.0)) {
        refuse(end + suffix + " is '" + clean_name(feature_.GetFieldAsString(field)) +
                   "', which is no altitude",
               "write a number");
      }
      const std::string reference =
          upper_case(text({end + "_reference", end + "_ref", end + "_datum"}));
      if (reference != "" && reference != "AMSL" && reference != "MSL" && reference != "AGL" &&
          reference != "SFC" && reference != "GND") {
        refuse(end + "_reference is '" + reference + "'", "write AMSL or AGL");
      }
      return AltitudeLimit{*number * unit_m,
                           reference == "AGL" || reference == "SFC" || reference == "GND"};
    }
    const int field = find(texts);
    if (field < 0) {
      return std::nullopt;
    }
    const std::string value = clean_name(feature_.GetFieldAsString(field));
    if (value.empty()) {
      return std::nullopt;
    }
    const auto parsed = altitude_limit_in(value, 0.0);
    if (!parsed) {
      refuse("the " + end + " '" + value + "' cannot be read",
             "write it with its unit, \"1500 ft AGL\" or \"FL 95\" for example, or as a number in "
             "an attribute " +
                 end + "_m or " + end + "_ft");
    }
    return parsed;
  }

 private:
  // Number of the first of the fields that is set; -1 if none is.
  [[nodiscard]] int find(const Names& names) const {
    for (const std::string& name : names) {
      for (int i = 0; i < feature_.GetFieldCount(); ++i) {
        if (lower_case(feature_.GetFieldDefnRef(i)->GetNameRef()) == name &&
            feature_.IsFieldSetAndNotNull(i)) {
          return i;
        }
      }
    }
    return -1;
  }

  const OGRFeature& feature_;
  std::string where_;
};

void read_layer(const AreaFile& file, OGRLayer& layer, const Placer& placer, Observer& observer,
                AirspaceList& list) {
  const fs::path& path = file.path;
  if (layer.GetLayerDefn()->GetGeomFieldCount() == 0) {
    return;
  }
  if (layer.GetSpatialRef() == nullptr) {
    throw DataError(
        path.string() + ": layer '" + clean_name(layer.GetName()) + "' states no coordinate system",
        "set it with ogr2ogr -a_srs");
  }
  OGRSpatialReference source(*layer.GetSpatialRef());
  source.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const auto to_wgs84 = transformation(source, wgs84(), path);
  for (const auto& feature : layer) {
    observer.check_stop();
    if (const OGRGeometry* shape = feature->GetGeometryRef();
        file.others_are_skipped && (shape == nullptr || shape->getDimension() != 2)) {
      continue;
    }
    ++list.record_count;
    const std::string where = path.string() + ": layer '" + clean_name(layer.GetName()) +
                              "', feature " + std::to_string(feature->GetFID());
    const Attributes attributes(*feature, where);
    GeometryPointer geometry(feature->StealGeometry());
    if (!geometry || geometry->IsEmpty()) {
      attributes.refuse("has no geometry", "remove it");
    }
    if (geometry->hasCurveGeometry()) {
      geometry.reset(geometry->getLinearGeometry(0.5));
    }
    geometry->flattenTo2D();
    if (geometry->getDimension() != 2) {
      attributes.refuse("is a " + std::string(geometry->getGeometryName()) + ", no polygon",
                        "an area needs polygons; draw a circle or corridor as one");
    }
    if (geometry->transform(to_wgs84.get()) != OGRERR_NONE) {
      attributes.refuse("cannot be converted to WGS 84", "check its coordinates");
    }
    OGREnvelope box;
    geometry->getEnvelope(&box);
    if (!(box.MinX >= -180.0 - 1e-9 && box.MaxX <= 180.0 + 1e-9 && box.MinY >= -90.0 - 1e-9 &&
          box.MaxY <= 90.0 + 1e-9)) {
      attributes.refuse("has corners that are not on the globe", "check its coordinates");
    }
    AirspaceArea area;
    area.name = attributes.text({"name", "designator", "id"});
    area.kind = attributes.text({"kind", "class", "type", "category"});
    area.is_hard = attributes.truth({"hard", "is_hard", "no_fly"});
    area.floor = attributes.limit("floor", {"floor", "lower", "lower_limit", "base"})
                     .value_or(AltitudeLimit{-kInfinity, true});
    area.ceiling = attributes.limit("ceiling", {"ceiling", "upper", "upper_limit", "top"})
                       .value_or(AltitudeLimit{kInfinity, false});
    if ((area.floor.is_above_ground == area.ceiling.is_above_ground &&
         area.floor.value_m > area.ceiling.value_m) ||
        area.ceiling.value_m == -kInfinity || area.floor.value_m == kInfinity) {
      attributes.refuse("area '" + area.name + "' ends below its beginning",
                        "exchange floor and ceiling");
    }
    auto polygons = placer.placed(*geometry);
    if (!polygons) {
      attributes.refuse("has polygons that cannot be made valid", "correct them");
    }
    if (!polygons->empty()) {
      area.polygons = std::move(*polygons);
      list.areas.push_back(std::move(area));
    }
  }
}

void read_vectors(const AreaFile& file, const Placer& placer, Observer& observer,
                  AirspaceList& list) {
  const fs::path& path = file.path;
  GDALAllRegister();
  GdalErrors errors;
  static const char* const kDrivers[] = {"GeoJSON",        "LIBKML",     "KML",  "GPKG",
                                         "ESRI Shapefile", "FlatGeobuf", nullptr};
  // Absolute, because GDAL takes some names for something else than files.
  const DatasetPointer dataset(static_cast<GDALDataset*>(GDALOpenEx(
      fs::absolute(path).c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY, kDrivers, nullptr, nullptr)));
  if (!dataset) {
    throw DataError(path.string() + ": cannot be read as areas" +
                        (errors.first().empty() ? "" : ": " + errors.first()),
                    kHint);
  }
  for (OGRLayer* layer : dataset->GetLayers()) {
    read_layer(file, *layer, placer, observer, list);
  }
  if (!errors.first().empty()) {
    throw DataError(path.string() + ": " + errors.first(), kHint);
  }
}

}  // namespace

geo::MapProjection around(const geo::GeodeticPosition& place) {
  char crs[200];
  std::snprintf(crs, sizeof crs, "+proj=aeqd +lat_0=%.12f +lon_0=%.12f +datum=WGS84 +units=m",
                degrees_from_radians(place.latitude_rad),
                degrees_from_radians(place.longitude_rad));
  return geo::MapProjection(crs);
}

Fence circle_fence(const geo::GeodeticPosition& centre, double radius_m, bool is_inclusion,
                   std::string place) {
  constexpr int kCorners = 64;
  constexpr double kSpare = 1e-4;  // what edges in degrees may stray from those of the ellipsoid
  const geo::MapProjection projection = around(centre);
  const double half_step_rad = std::numbers::pi / kCorners;
  const double reach_m = is_inclusion ? radius_m * (1.0 - kSpare)
                                      : radius_m / elementary::cos(half_step_rad) * (1.0 + kSpare);
  Fence fence{is_inclusion, {}, std::move(place)};
  for (int i = 0; i < kCorners; ++i) {
    const double angle_rad = 2.0 * half_step_rad * i;
    fence.outline.push_back(projection.to_geodetic(
        {reach_m * elementary::cos(angle_rad), reach_m * elementary::sin(angle_rad)}));
  }
  return fence;
}

std::vector<AirspaceArea> areas_of_fences(const std::vector<Fence>& fences,
                                          const geo::MapProjection& projection,
                                          const geo::GeodeticBox& region) {
  const GdalErrors quiet;
  const Placer placer(projection, region);
  std::vector<AirspaceArea> areas;
  for (const Fence& fence : fences) {
    const auto refuse = [&fence]() {
      throw DataError(fence.place + ": its outline cannot be made a polygon", "correct it");
    };
    auto ring = std::make_unique<OGRLinearRing>();
    for (const geo::GeodeticPosition& corner : fence.outline) {
      ring->addPoint(degrees_from_radians(corner.longitude_rad),
                     degrees_from_radians(corner.latitude_rad));
    }
    ring->closeRings();
    if (ring->getNumPoints() < 4) {
      refuse();
    }
    OGRPolygon polygon;
    polygon.addRingDirectly(ring.release());
    const GeometryPointer valid(polygon.IsValid() ? polygon.clone() : polygon.MakeValid());
    GeometryPointer forbidden(!valid               ? nullptr
                              : fence.is_inclusion ? placer.window().Difference(valid.get())
                                                   : valid->clone());
    auto polygons = forbidden ? placer.placed(*forbidden) : std::nullopt;
    if (!polygons) {
      refuse();
    }
    if (!polygons->empty()) {
      areas.push_back({fence.is_inclusion ? "outside of the geofence" : "geofence", "no_fly", true,
                       AltitudeLimit{-kInfinity, true}, AltitudeLimit{kInfinity, false},
                       std::move(*polygons)});
    }
  }
  return areas;
}

AirspaceList read_areas(const AreaFiles& files, const geo::MapProjection& projection,
                        const geo::GeodeticBox& region, Observer& observer) {
  AirspaceList list;
  const GdalErrors quiet;  // GEOS says what is not valid, which is mended
  const Placer placer(projection, region);
  for (std::size_t i = 0; i < files.size(); ++i) {
    observer.check_stop();
    observer.progress(kStage, static_cast<double>(i), static_cast<double>(files.size()));
    std::error_code error;
    const fs::path& path = files[i].path;
    if (!fs::is_regular_file(path, error)) {
      throw DataError(path.string() + ": no such file",
                      "check the path given with --areas, or under areas in the mission");
    }
    const std::string extension = lower_case(path.extension().string());
    if (extension == ".txt" || extension == ".air" || extension == ".openair") {
      read_open_air(path, placer, list);
    } else {
      read_vectors(files[i], placer, observer, list);
    }
  }
  if (!files.empty()) {
    observer.progress(kStage, static_cast<double>(files.size()), static_cast<double>(files.size()));
  }
  return list;
}

}  // namespace hedgehop::map_sources
