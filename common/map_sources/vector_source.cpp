#include "map_sources/vector_source.hpp"

#include <algorithm>
#include <cmath>
#include <ogrsf_frmts.h>
#include <set>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "map_sources/gdal_access.hpp"
#include "map_sources/height_text.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;

constexpr char kStage[] = "land use";

// What the parts of one geometry become on the map.
struct Shapes {
  std::vector<MapPolygon> polygons;
  std::vector<MapLine> lines;
  std::vector<geo::MapPoint> points;
  bool is_usable = true;
};

struct Box {
  double west_m = 1e18, south_m = 1e18, east_m = -1e18, north_m = -1e18;

  void add(const geo::MapPoint& point) {
    west_m = std::min(west_m, point.x_m);
    east_m = std::max(east_m, point.x_m);
    south_m = std::min(south_m, point.y_m);
    north_m = std::max(north_m, point.y_m);
  }
  [[nodiscard]] bool touches(const Box& other) const {
    return west_m <= other.east_m && other.west_m <= east_m && south_m <= other.north_m &&
           other.south_m <= north_m;
  }
};

// A rule with the numbers of its attributes in the layer; -1: not used.
struct BoundRule {
  const MappingRule* rule;
  std::size_t number;
  int attribute = -1;
  int height_attribute = -1;
  int levels_attribute = -1;
};

std::string names_of_layers(GDALDataset& dataset) {
  std::string names;
  for (int i = 0; i < dataset.GetLayerCount(); ++i) {
    names += (i == 0 ? "" : ", ") + std::string(dataset.GetLayer(i)->GetName());
  }
  return names.empty() ? "no layer at all" : names;
}

std::string names_of_attributes(OGRFeatureDefn& definition) {
  std::string names;
  for (int i = 0; i < definition.GetFieldCount(); ++i) {
    names += (i == 0 ? "" : ", ") + std::string(definition.GetFieldDefn(i)->GetNameRef());
  }
  return names.empty() ? "no attribute at all" : names;
}

class Reader {
 public:
  Reader(const VectorInput& input, const geo::MapProjection& projection,
         const geo::GeodeticBox& region, LandUse& land_use, Observer& observer)
      : input_(input),
        region_(region),
        land_use_(land_use),
        observer_(observer),
        name_(input.file.string()) {
    findings_.objects_of_rule.assign(input.mapping.rules.size(), 0);
    map_crs_.importFromWkt(projection.wkt().c_str());
    map_crs_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    for (const auto& [longitude_rad, latitude_rad] :
         outline(region.west_rad, region.south_rad, region.east_rad, region.north_rad)) {
      map_box_.add(projection.to_map({latitude_rad, longitude_rad}));
    }
    open();
  }

  VectorFindings read() {
    add_coverage();
    std::vector<std::string> layers;
    for (const MappingRule& rule : input_.mapping.rules) {
      (void)layer(rule.layer, rule.place);
      if (std::find(layers.begin(), layers.end(), rule.layer) == layers.end()) {
        layers.push_back(rule.layer);
      }
    }
    // All are bound before the first is read, so that a mistake shows at once.
    std::vector<std::vector<BoundRule>> bound;
    for (const std::string& name : layers) {
      bound.push_back(bound_rules(name));
    }
    for (std::size_t i = 0; i < layers.size(); ++i) {
      observer_.progress(kStage, static_cast<double>(i), static_cast<double>(layers.size()));
      read_layer(*dataset_->GetLayerByName(layers[i].c_str()), bound[i]);
    }
    observer_.progress(kStage, 1.0, 1.0);
    return std::move(findings_);
  }

 private:
  void open() {
    std::error_code error;
    if (!fs::exists(input_.file, error)) {
      throw DataError(name_ + ": no such file", "check the path given with --vectors");
    }
    GdalErrors errors;
    // Absolute, because a name may look like the address of a data base.
    dataset_.reset(static_cast<GDALDataset*>(GDALOpenEx(fs::absolute(input_.file).c_str(),
                                                        GDAL_OF_VECTOR | GDAL_OF_READONLY, nullptr,
                                                        nullptr, nullptr)));
    if (!dataset_) {
      throw DataError(name_ + ": is not a vector file that can be read" +
                          (errors.first().empty() ? "" : ": " + errors.first()),
                      "--vectors takes GeoPackage, Shapefile, GeoJSON, KML and whatever else OGR "
                      "reads; a file that was cut off must be fetched again");
    }
    findings_.format = dataset_->GetDriver()->GetDescription();
    if (findings_.format == "OSM") {
      throw DataError(name_ + ": is OpenStreetMap data", "give it with --osm, without a mapping");
    }
    findings_.parts = parts_of(*dataset_, input_.file);
  }

  OGRLayer& layer(const std::string& name, const std::string& place) {
    OGRLayer* found = dataset_->GetLayerByName(name.c_str());
    if (found == nullptr) {
      throw ConfigError(place + ": " + name_ + " has no layer '" + name + "'",
                        "it has " + names_of_layers(*dataset_));
    }
    return *found;
  }

  std::vector<BoundRule> bound_rules(const std::string& name) {
    std::vector<BoundRule> bound;
    for (std::size_t i = 0; i < input_.mapping.rules.size(); ++i) {
      const MappingRule& rule = input_.mapping.rules[i];
      if (rule.layer != name) {
        continue;
      }
      OGRFeatureDefn& definition = *layer(name, rule.place).GetLayerDefn();
      const auto index = [&](const std::string& attribute) {
        const int found = attribute.empty() ? -1 : definition.GetFieldIndex(attribute.c_str());
        if (!attribute.empty() && found < 0) {
          throw ConfigError(rule.place + ": layer '" + name + "' of " + name_ +
                                " has no attribute '" + attribute + "'",
                            "it has " + names_of_attributes(definition));
        }
        return found;
      };
      bound.push_back({&rule, i, index(rule.attribute), index(rule.height_attribute),
                       index(rule.levels_attribute)});
    }
    return bound;
  }

  OGRSpatialReference crs_of(OGRLayer& layer) const {
    if (layer.GetSpatialRef() != nullptr) {
      OGRSpatialReference crs = *layer.GetSpatialRef();
      if (crs.IsCompound()) {
        crs.StripVertical();
      }
      return crs;
    }
    if (input_.mapping.crs.empty()) {
      throw DataError(name_ + ": layer '" + layer.GetName() + "' has no coordinate system",
                      "say it with the key crs of the mapping, for example crs: EPSG:4326");
    }
    OGRSpatialReference crs;
    const GdalErrors silent;
    if (crs.SetFromUserInput(input_.mapping.crs.c_str(),
                             OGRSpatialReference::SET_FROM_USER_INPUT_LIMITATIONS_get()) !=
        OGRERR_NONE) {
      throw ConfigError(input_.mapping.name + ": crs '" + input_.mapping.crs + "' is not known",
                        "give a code such as EPSG:4326");
    }
    crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    return crs;
  }

  void add_coverage() {
    geo::GeodeticBox box{1e9, 1e9, -1e9, -1e9};
    for (const std::string& name : input_.mapping.coverage_layers) {
      OGRLayer& covering = layer(name, input_.mapping.name);
      const GdalErrors silent;
      OGREnvelope extent;
      if (covering.GetExtent(&extent, TRUE) != OGRERR_NONE) {
        continue;  // an empty layer covers nothing
      }
      const auto to_geodetic = transformation(crs_of(covering), wgs84(), input_.file);
      for (const auto& [x, y] : outline(extent.MinX, extent.MinY, extent.MaxX, extent.MaxY)) {
        double longitude_deg = x;
        double latitude_deg = y;
        if (!to_geodetic->Transform(1, &longitude_deg, &latitude_deg) ||
            !(std::fabs(latitude_deg) <= 90.0) || !(std::fabs(longitude_deg) <= 180.0)) {
          throw DataError(name_ + ": layer '" + name + "' lies outside the globe",
                          "check its coordinate system with ogrinfo -so");
        }
        box.west_rad = std::min(box.west_rad, radians_from_degrees(longitude_deg));
        box.east_rad = std::max(box.east_rad, radians_from_degrees(longitude_deg));
        box.south_rad = std::min(box.south_rad, radians_from_degrees(latitude_deg));
        box.north_rad = std::max(box.north_rad, radians_from_degrees(latitude_deg));
      }
    }
    if (box.west_rad > box.east_rad) {
      throw DataError(name_ + ": the layers that tell what it covers are empty",
                      "name others as coverage_layers in " + input_.mapping.name);
    }
    land_use_.mapped.push_back(box);
  }

  // The region's box in the layer's coordinates; nothing is skipped where it cannot be told.
  void set_filter(OGRLayer& layer, const OGRSpatialReference& crs) {
    const GdalErrors silent;
    OGRCoordinateTransformationOptions options;
    const OGRSpatialReference geodetic = wgs84();
    const std::unique_ptr<OGRCoordinateTransformation> from_geodetic(
        OGRCreateCoordinateTransformation(&geodetic, &crs, options));
    OGREnvelope box;
    for (const auto& [longitude_rad, latitude_rad] :
         outline(region_.west_rad, region_.south_rad, region_.east_rad, region_.north_rad)) {
      double x = degrees_from_radians(longitude_rad);
      double y = degrees_from_radians(latitude_rad);
      if (!from_geodetic || !from_geodetic->Transform(1, &x, &y) || !std::isfinite(x) ||
          !std::isfinite(y)) {
        return;
      }
      box.Merge(x, y);
    }
    const double margin = 0.01 * (box.MaxX - box.MinX + box.MaxY - box.MinY);
    layer.SetSpatialFilterRect(box.MinX - margin, box.MinY - margin, box.MaxX + margin,
                               box.MaxY + margin);
  }

  void read_layer(OGRLayer& layer, const std::vector<BoundRule>& rules) {
    const OGRSpatialReference crs = crs_of(layer);
    to_map_ = transformation(crs, map_crs_, input_.file);
    set_filter(layer, crs);
    GdalErrors errors;
    layer.ResetReading();
    std::int64_t count = 0;
    while (const OGRFeatureUniquePtr feature{layer.GetNextFeature()}) {
      if (++count % 64 == 0) {
        observer_.check_stop();
      }
      const auto rule = std::find_if(rules.begin(), rules.end(), [&](const BoundRule& candidate) {
        return candidate.attribute < 0 ||
               (feature->IsFieldSetAndNotNull(candidate.attribute) &&
                std::find(candidate.rule->values.begin(), candidate.rule->values.end(),
                          feature->GetFieldAsString(candidate.attribute)) !=
                    candidate.rule->values.end());
      });
      if (rule == rules.end()) {
        ++findings_.unmapped_feature_count;
      } else {
        add(*feature, *rule);
      }
    }
    if (!errors.first().empty()) {
      throw DataError(name_ + ": layer '" + layer.GetName() + "' cannot be read: " + errors.first(),
                      "the file may be damaged or cut off; fetch it again");
    }
  }

  void add(OGRFeature& feature, const BoundRule& bound) {
    const OGRGeometry* geometry = feature.GetGeometryRef();
    Shapes shapes;
    if (geometry != nullptr && !geometry->IsEmpty()) {
      const std::unique_ptr<OGRGeometry> linear(
          geometry->hasCurveGeometry(TRUE) != FALSE ? geometry->getLinearGeometry() : nullptr);
      collect(linear ? *linear : *geometry, shapes, 0);
    }
    const MappedKind& kind = bound.rule->kind;
    if (!kind.object_class) {
      shapes.is_usable = shapes.is_usable && !shapes.lines.empty();
    }
    if (!shapes.is_usable ||
        (shapes.polygons.empty() && shapes.lines.empty() && shapes.points.empty())) {
      ++findings_.unusable_feature_count;
      return;
    }
    const auto height_m = height_of(feature, bound);
    const auto id = static_cast<std::int64_t>(feature.GetFID());
    bool is_kept = false;
    if (!kind.object_class) {
      for (MapLine& line : shapes.lines) {
        line.erase(std::unique(line.begin(), line.end(),
                               [](const geo::MapPoint& a, const geo::MapPoint& b) {
                                 return a.x_m == b.x_m && a.y_m == b.y_m;
                               }),
                   line.end());
        if (line.size() < 2 || !is_near(line)) {
          continue;
        }
        PowerLineObject object;
        object.source_id = id;
        object.is_minor = kind.is_minor_line;
        object.default_height_m = bound.rule->default_height_m;
        for (const geo::MapPoint& point : line) {
          object.supports.push_back({point, height_m});
        }
        land_use_.power_lines.push_back(std::move(object));
        is_kept = true;
      }
      findings_.objects_of_rule[bound.number] += is_kept ? 1 : 0;
      return;
    }
    std::erase_if(shapes.polygons,
                  [&](const MapPolygon& polygon) { return !is_near(polygon.outer); });
    if (!shapes.polygons.empty()) {
      AreaObject object;
      object.object_class = *kind.object_class;
      object.source_id = id;
      object.height_m = height_m;
      if (bound.levels_attribute >= 0 && feature.IsFieldSetAndNotNull(bound.levels_attribute)) {
        object.levels = levels_in_text(feature.GetFieldAsString(bound.levels_attribute));
        land_use_.unreadable_height_count += object.levels ? 0 : 1;
      }
      object.polygons = std::move(shapes.polygons);
      object.default_height_m = bound.rule->default_height_m;
      land_use_.areas.push_back(std::move(object));
      is_kept = true;
    }
    for (const geo::MapPoint& point : shapes.points) {
      shapes.lines.push_back({point});
    }
    for (MapLine& line : shapes.lines) {
      if (is_near(line)) {
        land_use_.lines.push_back(
            {*kind.object_class, id, height_m, std::move(line), bound.rule->default_height_m});
        is_kept = true;
      }
    }
    findings_.objects_of_rule[bound.number] += is_kept ? 1 : 0;
  }

  [[nodiscard]] bool is_near(const MapLine& line) const {
    Box box;
    for (const geo::MapPoint& point : line) {
      box.add(point);
    }
    return box.touches(map_box_);
  }

  std::optional<double> height_of(OGRFeature& feature, const BoundRule& bound) {
    if (bound.height_attribute < 0 || !feature.IsFieldSetAndNotNull(bound.height_attribute)) {
      return std::nullopt;
    }
    std::optional<double> height_m;
    const OGRFieldType type = feature.GetFieldDefnRef(bound.height_attribute)->GetType();
    if (type == OFTReal || type == OFTInteger || type == OFTInteger64) {
      const double value_m =
          feature.GetFieldAsDouble(bound.height_attribute) * bound.rule->height_unit_m;
      if (value_m > 0.0 && value_m <= 1000.0) {
        height_m = value_m;
      }
    } else {
      const std::string_view text = feature.GetFieldAsString(bound.height_attribute);
      if (text.empty()) {
        return std::nullopt;
      }
      height_m = height_in_text_m(text, bound.rule->height_unit_m);
    }
    land_use_.unreadable_height_count += height_m ? 0 : 1;
    return height_m;
  }

  MapLine to_map(const OGRSimpleCurve& curve, Shapes& shapes) {
    const int count = curve.getNumPoints();
    std::vector<double> x(static_cast<std::size_t>(count));
    std::vector<double> y(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i) {
      x[static_cast<std::size_t>(i)] = curve.getX(i);
      y[static_cast<std::size_t>(i)] = curve.getY(i);
    }
    return to_map(std::move(x), std::move(y), shapes);
  }

  MapLine to_map(std::vector<double> x, std::vector<double> y, Shapes& shapes) {
    const GdalErrors silent;  // a point that cannot be shown makes the feature unusable, no more
    std::vector<int> is_good(x.size());
    to_map_->Transform(static_cast<int>(x.size()), x.data(), y.data(), nullptr, is_good.data());
    MapLine line;
    line.reserve(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (is_good[i] == 0 || !(std::fabs(x[i]) < 1e9) || !(std::fabs(y[i]) < 1e9)) {
        shapes.is_usable = false;
        return {};
      }
      line.push_back({std::round(x[i] * 1000.0) / 1000.0, std::round(y[i] * 1000.0) / 1000.0});
    }
    return line;
  }

  void collect(const OGRGeometry& geometry, Shapes& shapes, int depth) {
    constexpr int kDepthMax = 16;
    const OGRwkbGeometryType type = wkbFlatten(geometry.getGeometryType());
    if (geometry.IsEmpty()) {
      return;
    }
    if (type == wkbPolygon || type == wkbTriangle) {
      const OGRPolygon& polygon = *geometry.toPolygon();
      MapPolygon result{to_map(*polygon.getExteriorRing(), shapes), {}};
      for (int i = 0; i < polygon.getNumInteriorRings(); ++i) {
        result.holes.push_back(to_map(*polygon.getInteriorRing(i), shapes));
      }
      if (result.outer.size() < 3) {
        shapes.is_usable = false;
        return;
      }
      shapes.polygons.push_back(std::move(result));
    } else if (type == wkbLineString || type == wkbLinearRing) {
      shapes.lines.push_back(to_map(*geometry.toSimpleCurve(), shapes));
    } else if (type == wkbPoint) {
      const OGRPoint& point = *geometry.toPoint();
      const MapLine line = to_map({point.getX()}, {point.getY()}, shapes);
      shapes.points.insert(shapes.points.end(), line.begin(), line.end());
    } else if (OGR_GT_IsSubClassOf(type, wkbGeometryCollection) != FALSE && depth < kDepthMax) {
      for (const OGRGeometry* part : *geometry.toGeometryCollection()) {
        collect(*part, shapes, depth + 1);
      }
    } else {
      shapes.is_usable = false;
    }
  }

  const VectorInput& input_;
  const geo::GeodeticBox region_;
  LandUse& land_use_;
  Observer& observer_;
  std::string name_;
  OGRSpatialReference map_crs_;
  Box map_box_;
  DatasetPointer dataset_;
  std::unique_ptr<OGRCoordinateTransformation> to_map_;
  VectorFindings findings_;
};

}  // namespace

VectorFindings read_vectors(const VectorInput& input, const geo::MapProjection& projection,
                            const geo::GeodeticBox& region, LandUse& land_use, Observer& observer) {
  GDALAllRegister();
  return Reader(input, projection, region, land_use, observer).read();
}

}  // namespace hedgehop::map_sources
