#include "map/map_bundle.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <gdal_priv.h>
#include <memory>
#include <nlohmann/json.hpp>
#include <ogrsf_frmts.h>
#include <optional>
#include <sstream>
#include <system_error>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "geo/gdal_guards.hpp"

namespace hedgehop::map {
namespace {

namespace fs = std::filesystem;
using geo::DatasetPointer;
using geo::GdalErrors;
using geo::GdalSetting;
using geo::MemoryFile;
using Json = nlohmann::ordered_json;

constexpr char kSchemaName[] = "hedgehop map";
constexpr std::int64_t kSideCellsMax = 200'000;
constexpr std::int64_t kCellsMax = 400'000'000;
constexpr std::uintmax_t kManifestBytesMax = 64U << 20U;
constexpr std::int64_t kFeaturesMax = 20'000'000;  // of one layer
constexpr char kPrepareAgain[] = "prepare the map again";
constexpr int kHeightBandsMax = 1000;
// Deflate cannot shrink by more than 1032; a file that claims more cells than that is damaged.
constexpr double kDeflateRatioMax = 1100.0;

template <typename T>
constexpr GDALDataType gdal_type() {
  return std::is_same_v<T, float> ? GDT_Float32 : GDT_UInt16;
}

void require_written(bool condition, const GdalErrors& errors, const fs::path& file) {
  if (!condition || !errors.first().empty()) {
    throw SystemFailure(file.string() + ": cannot be written: " + errors.first());
  }
}

std::optional<OGRSpatialReference> spatial_reference(const std::string& wkt) {
  if (wkt.empty()) {
    return std::nullopt;
  }
  OGRSpatialReference reference;
  const char* text = wkt.c_str();
  if (reference.importFromWkt(&text) != OGRERR_NONE) {
    throw DataError("map: its coordinate system is not valid WKT", kPrepareAgain);
  }
  reference.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return reference;
}

struct LayerStyle {
  const char* unit;
  double no_data;
  double scale;
};

template <typename T>
struct LayerBand {
  const raster::Grid<T>* grid = nullptr;
  std::string description;
  std::vector<std::pair<std::string, std::string>> metadata;
};

template <typename T>
void write_bands(const Map& map, const std::vector<LayerBand<T>>& bands, const LayerStyle& style,
                 const Observer* observer, const fs::path& file) {
  const int columns = map.geometry.columns;
  const int rows = map.geometry.rows;
  const MemoryFile memory(file.filename().string());
  {
    GdalErrors errors;
    GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
    HEDGEHOP_ASSERT(driver != nullptr);
    CPLStringList options;
    options.SetNameValue("COMPRESS", "DEFLATE");
    options.SetNameValue("ZLEVEL", "6");
    options.SetNameValue("PREDICTOR", std::is_same_v<T, float> ? "3" : "2");
    options.SetNameValue("TILED", "YES");
    options.SetNameValue("BIGTIFF", "IF_SAFER");
    if (bands.size() > 1) {
      options.SetNameValue("INTERLEAVE", "BAND");
    }
    DatasetPointer dataset(driver->Create(memory.path(), columns, rows,
                                          static_cast<int>(bands.size()), gdal_type<T>(),
                                          options.List()));
    require_written(dataset != nullptr, errors, file);
    std::array<double, 6> transform = {
        map.geometry.west_m, map.geometry.cell_m, 0.0, map.geometry.north_m(), 0.0,
        -map.geometry.cell_m};
    require_written(dataset->SetGeoTransform(transform.data()) == CE_None, errors, file);
    const auto reference = spatial_reference(map.crs_wkt);
    if (reference) {
      require_written(dataset->SetSpatialRef(&*reference) == CE_None, errors, file);
    }
    for (std::size_t i = 0; i < bands.size(); ++i) {
      const raster::Grid<T>& grid = *bands[i].grid;
      GDALRasterBand* band = dataset->GetRasterBand(static_cast<int>(i) + 1);
      band->SetDescription(bands[i].description.c_str());
      if (*style.unit != '\0') {
        band->SetUnitType(style.unit);
      }
      if (style.scale != 1.0) {
        band->SetScale(style.scale);
      }
      if (!std::is_same_v<T, std::uint16_t> || style.no_data != 0.0) {
        band->SetNoDataValue(style.no_data);
      }
      for (const auto& [key, value] : bands[i].metadata) {
        band->SetMetadataItem(key.c_str(), value.c_str());
      }
      for (int row = 0; row < rows; ++row) {
        if (observer != nullptr) {
          observer->check_stop();
        }
        const int file_row = rows - 1 - row;
        const CPLErr result =
            band->RasterIO(GF_Write, 0, file_row, columns, 1, const_cast<T*>(grid.row(row)),
                           columns, 1, gdal_type<T>(), 0, 0, nullptr);
        require_written(result == CE_None, errors, file);
      }
    }
    dataset->FlushCache(true);
    dataset.reset();
    require_written(true, errors, file);
  }
  write_file_atomically(file, memory.bytes());
}

template <typename T>
void write_layer(const Map& map, const raster::Grid<T>& grid, const char* description,
                 const LayerStyle& style,
                 const std::vector<std::pair<std::string, std::string>>& metadata,
                 const Observer* observer, const fs::path& file) {
  write_bands<T>(map, {{&grid, description, metadata}}, style, observer, file);
}

// "15.24"
std::string text_of_height(double height_m) {
  std::ostringstream text;
  text << height_m;
  return text.str();
}

// Fills the layers of features.gpkg; every refusal of GDAL is a SystemFailure.
class FeatureWriter {
 public:
  FeatureWriter(GDALDataset& dataset, OGRSpatialReference* reference, const GdalErrors& errors,
                const fs::path& file)
      : dataset_(dataset), reference_(reference), errors_(errors), file_(file) {}

  // Layers are made before anything is written into one of them.
  OGRLayer& layer(const char* name, OGRwkbGeometryType type,
                  std::initializer_list<std::pair<const char*, OGRFieldType>> fields) {
    OGRLayer* layer = dataset_.CreateLayer(name, reference_, type, nullptr);
    require_written(layer != nullptr, errors_, file_);
    for (const auto& [field, field_type] : fields) {
      OGRFieldDefn definition(field, field_type);
      require_written(layer->CreateField(&definition) == OGRERR_NONE, errors_, file_);
    }
    require_written(dataset_.StartTransaction() == OGRERR_NONE, errors_, file_);
    return *layer;
  }
  void add(OGRLayer& layer, OGRFeature& feature, OGRGeometry& geometry) {
    feature.SetGeometry(&geometry);
    require_written(layer.CreateFeature(&feature) == OGRERR_NONE, errors_, file_);
  }
  void commit() { require_written(dataset_.CommitTransaction() == OGRERR_NONE, errors_, file_); }

 private:
  GDALDataset& dataset_;
  OGRSpatialReference* reference_;
  const GdalErrors& errors_;
  const fs::path& file_;
};

void write_overhead_lines(const Map& map, FeatureWriter& writer) {
  OGRLayer& lines = writer.layer(
      "overhead_lines", wkbLineString,
      {{"line_number", OFTInteger64}, {"source_id", OFTInteger64}, {"kind", OFTString}});
  for (std::size_t l = 0; l < map.overhead_lines.size(); ++l) {
    const OverheadLine& line = map.overhead_lines[l];
    OGRFeature feature(lines.GetLayerDefn());
    feature.SetField("line_number", static_cast<GIntBig>(l));
    feature.SetField("source_id", static_cast<GIntBig>(line.source_id));
    feature.SetField("kind", name_of(line.kind));
    OGRLineString geometry;
    for (const OverheadLine::Support& support : line.supports) {
      geometry.addPoint(support.point.x_m, support.point.y_m);
    }
    writer.add(lines, feature, geometry);
  }
  writer.commit();
  OGRLayer& supports = writer.layer("line_supports", wkbPoint,
                                    {{"line_number", OFTInteger64},
                                     {"support_number", OFTInteger64},
                                     {"source_id", OFTInteger64},
                                     {"kind", OFTString},
                                     {"height_m", OFTReal},
                                     {"is_pole", OFTInteger}});
  for (std::size_t l = 0; l < map.overhead_lines.size(); ++l) {
    const OverheadLine& line = map.overhead_lines[l];
    for (std::size_t i = 0; i < line.supports.size(); ++i) {
      const OverheadLine::Support& support = line.supports[i];
      OGRFeature feature(supports.GetLayerDefn());
      feature.SetField("line_number", static_cast<GIntBig>(l));
      feature.SetField("support_number", static_cast<GIntBig>(i));
      feature.SetField("source_id", static_cast<GIntBig>(line.source_id));
      feature.SetField("kind", name_of(line.kind));
      feature.SetField("height_m", support.height_m);
      feature.SetField("is_pole", support.is_pole ? 1 : 0);
      OGRPoint point(support.point.x_m, support.point.y_m);
      writer.add(supports, feature, point);
    }
  }
  writer.commit();
}

void write_obstacles(const Map& map, FeatureWriter& writer) {
  OGRLayer& layer = writer.layer("obstacles", wkbPoint,
                                 {{"source_id", OFTInteger64},
                                  {"kind", OFTString},
                                  {"name", OFTString},
                                  {"radius_m", OFTReal},
                                  {"height_m", OFTReal},
                                  {"top_m", OFTReal}});
  for (const Obstacle& obstacle : map.obstacles) {
    OGRFeature feature(layer.GetLayerDefn());
    feature.SetField("source_id", static_cast<GIntBig>(obstacle.source_id));
    feature.SetField("kind", name_of(obstacle.kind));
    feature.SetField("name", obstacle.name.c_str());
    feature.SetField("radius_m", obstacle.radius_m);
    feature.SetField("height_m", obstacle.height_m);
    if (!std::isnan(obstacle.top_m)) {
      feature.SetField("top_m", obstacle.top_m);
    }
    OGRPoint point(obstacle.point.x_m, obstacle.point.y_m);
    writer.add(layer, feature, point);
  }
  writer.commit();
}

constexpr char kAmsl[] = "amsl";
constexpr char kAboveGround[] = "above_ground";

void write_areas(const Map& map, FeatureWriter& writer) {
  OGRLayer& layer = writer.layer("areas", wkbMultiPolygon,
                                 {{"name", OFTString},
                                  {"kind", OFTString},
                                  {"is_hard", OFTInteger},
                                  {"floor_m", OFTReal},
                                  {"floor_reference", OFTString},
                                  {"ceiling_m", OFTReal},
                                  {"ceiling_reference", OFTString}});
  const auto ring_of = [](const std::vector<geo::MapPoint>& points) {
    auto ring = std::make_unique<OGRLinearRing>();
    for (const geo::MapPoint& point : points) {
      ring->addPoint(point.x_m, point.y_m);
    }
    return ring.release();
  };
  for (const Area& area : map.areas) {
    OGRFeature feature(layer.GetLayerDefn());
    feature.SetField("name", area.name.c_str());
    feature.SetField("kind", area.kind.c_str());
    feature.SetField("is_hard", area.is_hard ? 1 : 0);
    const auto set_limit = [&](const char* value_field, const char* reference_field,
                               const AreaLimit& limit) {
      if (std::isfinite(limit.value_m)) {
        feature.SetField(value_field, limit.value_m);
      }
      feature.SetField(reference_field,
                       limit.reference == AreaLimit::Reference::kAmsl ? kAmsl : kAboveGround);
    };
    set_limit("floor_m", "floor_reference", area.floor);
    set_limit("ceiling_m", "ceiling_reference", area.ceiling);
    OGRMultiPolygon geometry;
    for (const Area::Polygon& polygon : area.polygons) {
      auto part = std::make_unique<OGRPolygon>();
      part->addRingDirectly(ring_of(polygon.outer));
      for (const auto& hole : polygon.holes) {
        part->addRingDirectly(ring_of(hole));
      }
      geometry.addGeometryDirectly(part.release());
    }
    writer.add(layer, feature, geometry);
  }
  writer.commit();
}

void write_features(const Map& map, const fs::path& file) {
  const MemoryFile memory(file.filename().string());
  {
    GdalErrors errors;
    const GdalSetting date("OGR_CURRENT_DATE", "2000-01-01T00:00:00.000Z");
    const GdalSetting synchronous("OGR_SQLITE_SYNCHRONOUS", "OFF");
    GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GPKG");
    HEDGEHOP_ASSERT(driver != nullptr);
    DatasetPointer dataset(driver->Create(memory.path(), 0, 0, 0, GDT_Unknown, nullptr));
    require_written(dataset != nullptr, errors, file);
    auto reference = spatial_reference(map.crs_wkt);
    OGRSpatialReference* srs = reference ? &*reference : nullptr;

    FeatureWriter writer(*dataset, srs, errors, file);
    write_overhead_lines(map, writer);
    write_obstacles(map, writer);
    write_areas(map, writer);
    dataset->FlushCache(true);
    dataset.reset();
    require_written(true, errors, file);
  }
  write_file_atomically(file, memory.bytes());
}

template <typename T>
std::int64_t count_of(const raster::Grid<T>& grid, bool (*matches)(T)) {
  return std::count_if(grid.values().begin(), grid.values().end(), matches);
}

Json geodetic_extent(const Map& map) {
  if (map.crs_wkt.empty()) {
    return nullptr;
  }
  // The outline is curved in degrees, so its sides are followed, not only its corners.
  const geo::MapProjection projection(map.crs_wkt);
  double west = 1e9, south = 1e9, east = -1e9, north = -1e9;
  constexpr int kSteps = 32;
  for (int i = 0; i <= kSteps; ++i) {
    const double x_m =
        map.geometry.west_m + (map.geometry.east_m() - map.geometry.west_m) * i / kSteps;
    const double y_m =
        map.geometry.south_m + (map.geometry.north_m() - map.geometry.south_m) * i / kSteps;
    for (const geo::MapPoint& point :
         {geo::MapPoint{x_m, map.geometry.south_m}, geo::MapPoint{x_m, map.geometry.north_m()},
          geo::MapPoint{map.geometry.west_m, y_m}, geo::MapPoint{map.geometry.east_m(), y_m}}) {
      const geo::GeodeticPosition position = projection.to_geodetic(point);
      west = std::min(west, position.longitude_rad);
      east = std::max(east, position.longitude_rad);
      south = std::min(south, position.latitude_rad);
      north = std::max(north, position.latitude_rad);
    }
  }
  const auto degrees = [](double angle_rad) {
    return std::round(degrees_from_radians(angle_rad) * 1e7) / 1e7;
  };
  return Json{{"west", degrees(west)},
              {"south", degrees(south)},
              {"east", degrees(east)},
              {"north", degrees(north)}};
}

Json manifest_of(const Map& map, const std::string& provenance_json) {
  const raster::GridGeometry& g = map.geometry;
  Json manifest;
  manifest["schema"] = kSchemaName;
  manifest["schema_version"] = kMapSchemaVersion;
  manifest["map_hash"] = map.hash.hex();
  manifest["label"] = map.label;
  manifest["crs_code"] = map.crs_wkt.empty() ? "" : geo::MapProjection(map.crs_wkt).code();
  manifest["crs_wkt"] = map.crs_wkt;
  manifest["vertical_datum"] = map.vertical_datum;
  manifest["cell_m"] = g.cell_m;
  manifest["columns"] = g.columns;
  manifest["rows"] = g.rows;
  manifest["extent_m"] =
      Json{{"west", g.west_m}, {"south", g.south_m}, {"east", g.east_m()}, {"north", g.north_m()}};
  manifest["extent_deg"] = geodetic_extent(map);
  manifest["reference_height_m"] = map.reference_height_m;
  manifest["visibility_radius_m"] = map.visibility_radius_m;
  if (!map.further_visibility.empty()) {
    manifest["further_visibility_heights_m"] = Json::array();
    for (const VisibilityBand& band : map.further_visibility) {
      manifest["further_visibility_heights_m"].push_back(band.height_m);
    }
  }
  manifest["layers"] = Json{
      {"terrain", "terrain.tif: ground elevation [m], float32 in steps of 1/64 m, NaN unknown"},
      {"surface",
       "surface.tif: terrain and what stands on it [m], float32 in steps of 1/64 m, NaN unknown"},
      {"semantics", "semantics.tif: uint16, bits may overlap"},
      {"visibility",
       "visibility.tif: uint16, share of the surroundings that sees a point at reference height x "
       "65534, 65535 unknown; further bands for the further heights"},
      {"features", "features.gpkg: overhead_lines, line_supports, obstacles, areas"}};
  Json bits = Json::object();
  for (const SemanticName& name : semantic_names()) {
    bits[std::string(name.name)] = static_cast<std::uint16_t>(name.bit);
  }
  manifest["semantic_bits"] = std::move(bits);
  manifest["void_count"] = count_of<float>(map.terrain_m, [](float v) { return std::isnan(v); });
  manifest["unknown_visibility_count"] = count_of<std::uint16_t>(
      map.visibility, [](std::uint16_t v) { return v == kVisibilityUnknown; });
  manifest["unmapped_count"] = count_of<std::uint16_t>(map.semantics, [](std::uint16_t v) {
    return (v & static_cast<std::uint16_t>(SemanticClass::kUnmapped)) != 0;
  });
  manifest["overhead_line_count"] = map.overhead_lines.size();
  manifest["obstacle_count"] = map.obstacles.size();
  manifest["area_count"] = map.areas.size();
  manifest["attributions"] = map.attributions;

  const Json provenance = Json::parse(provenance_json, nullptr, false);
  if (!provenance.is_object()) {
    throw std::invalid_argument("write_map_bundle: provenance is not a JSON object");
  }
  for (const auto& [key, value] : provenance.items()) {
    if (manifest.contains(key)) {
      throw std::invalid_argument("write_map_bundle: provenance key '" + key +
                                  "' belongs to the bundle itself");
    }
    manifest[key] = value;
  }
  return manifest;
}

std::string text_of_manifest(const fs::path& folder) {
  const fs::path file = folder / kMapManifestFile;
  std::error_code error;
  if (!fs::exists(folder, error)) {
    throw DataError(folder.string() + ": no such folder",
                    "give the folder that 'hedgehop prepare --out' wrote");
  }
  if (!fs::is_regular_file(file, error)) {
    throw DataError(folder.string() + ": is no map bundle, it holds no " + kMapManifestFile,
                    "give the folder that 'hedgehop prepare --out' wrote");
  }
  if (fs::file_size(file, error) > kManifestBytesMax || error) {
    throw DataError(file.string() + ": is too large to be a manifest", kPrepareAgain);
  }
  return read_file(file);
}

// One typed value of the manifest.
template <typename T>
T value_of(const Json& manifest, const char* key, const fs::path& file) {
  const auto refuse = [&](const char* why) {
    throw DataError(file.string() + ": '" + key + "' " + why, kPrepareAgain);
  };
  const auto entry = manifest.find(key);
  if (entry == manifest.end()) {
    refuse("is missing");
  }
  if constexpr (std::is_same_v<T, std::string>) {
    if (!entry->is_string()) {
      refuse("is not a text");
    }
  } else if constexpr (std::is_same_v<T, double>) {
    if (!entry->is_number()) {
      refuse("is not a number");
    }
  } else {
    if (!entry->is_number_integer()) {
      refuse("is not a whole number");
    }
  }
  return entry->template get<T>();
}

Json parsed_manifest(const std::string& text, const fs::path& file) {
  Json manifest = Json::parse(text, nullptr, false);
  if (manifest.is_discarded() || !manifest.is_object()) {
    throw DataError(file.string() + ": is not a JSON object", kPrepareAgain);
  }
  const auto schema = manifest.find("schema");
  if (schema == manifest.end() || !schema->is_string() || *schema != kSchemaName) {
    throw DataError(file.string() + ": is not the manifest of a hedgehop map",
                    "give the folder that 'hedgehop prepare --out' wrote");
  }
  const auto version = value_of<std::int64_t>(manifest, "schema_version", file);
  if (version != kMapSchemaVersion) {
    throw DataError(file.string() + ": has schema version " + std::to_string(version) +
                        ", this program reads " + std::to_string(kMapSchemaVersion),
                    "prepare the map again with this version");
  }
  return manifest;
}

constexpr std::size_t kFurtherHeightsMax = 64;

// Heights of the bands of visibility.tif beyond the first; older maps have none.
std::vector<double> further_heights_in(const Json& manifest, const fs::path& file) {
  const auto entry = manifest.find("further_visibility_heights_m");
  if (entry == manifest.end()) {
    return {};
  }
  std::vector<double> heights_m;
  if (entry->is_array() && entry->size() <= kFurtherHeightsMax) {
    for (const Json& height : *entry) {
      if (height.is_number()) {
        heights_m.push_back(height.get<double>());
      }
    }
  }
  if (heights_m.empty() || heights_m.size() != entry->size()) {
    throw DataError(file.string() + ": 'further_visibility_heights_m' is no list of heights",
                    kPrepareAgain);
  }
  return heights_m;
}

template <typename T>
std::vector<raster::Grid<T>> read_bands(const raster::GridGeometry& geometry, std::size_t count,
                                        const fs::path& file) {
  const auto refuse = [&](const std::string& why) {
    throw DataError(file.string() + ": " + why, kPrepareAgain);
  };
  std::error_code error;
  if (!fs::is_regular_file(file, error)) {
    refuse("is missing");
  }
  const std::uintmax_t bytes = fs::file_size(file, error);
  const double bytes_unpacked =
      static_cast<double>(count) * static_cast<double>(geometry.cell_count()) * sizeof(T);
  if (error || static_cast<double>(bytes) * kDeflateRatioMax < bytes_unpacked) {
    refuse("is too short for its number of cells");
  }
  GdalErrors errors;
  static const char* const kDrivers[] = {"GTiff", nullptr};
  static const char* const kNoSiblings[] = {nullptr};
  const DatasetPointer dataset(static_cast<GDALDataset*>(
      GDALOpenEx(file.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_INTERNAL, kDrivers,
                 nullptr, kNoSiblings)));
  if (!dataset) {
    refuse("is not a GeoTIFF: " + errors.first());
  }
  if (dataset->GetRasterXSize() != geometry.columns || dataset->GetRasterYSize() != geometry.rows) {
    refuse("has " + std::to_string(dataset->GetRasterXSize()) + " x " +
           std::to_string(dataset->GetRasterYSize()) + " cells, the manifest says " +
           std::to_string(geometry.columns) + " x " + std::to_string(geometry.rows));
  }
  if (dataset->GetRasterCount() != static_cast<int>(count)) {
    refuse("has another number or type of bands than this layer");
  }
  std::array<double, 6> transform{};
  const double tolerance_m = 1e-6 * geometry.cell_m;
  if (dataset->GetGeoTransform(transform.data()) != CE_None ||
      !(std::fabs(transform[0] - geometry.west_m) < tolerance_m) ||
      !(std::fabs(transform[3] - geometry.north_m()) < tolerance_m) ||
      !(std::fabs(transform[1] - geometry.cell_m) < 1e-9 * geometry.cell_m) ||
      !(std::fabs(transform[5] + geometry.cell_m) < 1e-9 * geometry.cell_m) ||
      transform[2] != 0.0 || transform[4] != 0.0) {
    refuse("lies elsewhere than the manifest says");
  }
  std::vector<raster::Grid<T>> grids;
  for (std::size_t i = 0; i < count; ++i) {
    GDALRasterBand* band = dataset->GetRasterBand(static_cast<int>(i) + 1);
    if (band->GetRasterDataType() != gdal_type<T>()) {
      refuse("has another number or type of bands than this layer");
    }
    int block_columns = 0;
    int block_rows = 0;
    band->GetBlockSize(&block_columns, &block_rows);
    if (static_cast<std::int64_t>(block_columns) * block_rows >
        std::max<std::int64_t>(1 << 22, static_cast<std::int64_t>(geometry.cell_count()))) {
      refuse("has blocks larger than itself");
    }
    raster::Grid<T>& grid = grids.emplace_back(geometry, T{});
    for (int row = 0; row < geometry.rows; ++row) {
      if (band->RasterIO(GF_Read, 0, geometry.rows - 1 - row, geometry.columns, 1, grid.row(row),
                         geometry.columns, 1, gdal_type<T>(), 0, 0, nullptr) != CE_None) {
        refuse("cannot be read: " + errors.first());
      }
    }
  }
  return grids;
}

template <typename T>
raster::Grid<T> read_layer(const raster::GridGeometry& geometry, const fs::path& file) {
  return std::move(read_bands<T>(geometry, 1, file).front());
}

// One layer of features.gpkg, whose content is hostile until checked.
class FeatureReader {
 public:
  FeatureReader(GDALDataset& dataset, const char* name, const fs::path& file)
      : name_(name), file_(file), layer_(dataset.GetLayerByName(name)) {
    if (layer_ == nullptr) {
      throw DataError(file.string() + ": has no layer " + name, kPrepareAgain);
    }
  }
  [[noreturn]] void refuse(const std::string& why) const {
    throw DataError(file_.string() + ": layer " + name_ + " " + why, kPrepareAgain);
  }
  [[nodiscard]] OGRLayer& layer() const { return *layer_; }
  [[nodiscard]] int field(const char* name) const {
    const int index = layer_->GetLayerDefn()->GetFieldIndex(name);
    if (index < 0) {
      refuse("lacks the column " + std::string(name));
    }
    return index;
  }
  [[nodiscard]] geo::MapPoint point_of(const OGRFeature& feature) const {
    const OGRGeometry* geometry = feature.GetGeometryRef();
    if (geometry == nullptr || wkbFlatten(geometry->getGeometryType()) != wkbPoint) {
      refuse("holds something that is no point");
    }
    return {geometry->toPoint()->getX(), geometry->toPoint()->getY()};
  }
  template <typename Kind>
  [[nodiscard]] Kind kind_of(const OGRFeature& feature, int field,
                             std::initializer_list<Kind> kinds) const {
    const std::string_view text = feature.GetFieldAsString(field);
    for (const Kind kind : kinds) {
      if (text == name_of(kind)) {
        return kind;
      }
    }
    refuse("holds the unknown kind '" + std::string(text) + "'");
  }
  void count() {
    if (++count_ > kFeaturesMax) {
      refuse("holds too much");
    }
  }

 private:
  const char* name_;
  const fs::path& file_;
  OGRLayer* layer_;
  std::int64_t count_ = 0;
};

std::vector<OverheadLine> read_overhead_lines(GDALDataset& dataset, const fs::path& file) {
  FeatureReader reader(dataset, "line_supports", file);
  const int line_field = reader.field("line_number");
  const int support_field = reader.field("support_number");
  const int source_field = reader.field("source_id");
  const int kind_field = reader.field("kind");
  const int height_field = reader.field("height_m");
  const int pole_field = reader.field("is_pole");
  std::vector<OverheadLine> lines;
  for (const auto& feature : reader.layer()) {
    reader.count();
    const std::int64_t line = feature->GetFieldAsInteger64(line_field);
    const std::int64_t support = feature->GetFieldAsInteger64(support_field);
    if (support == 0 && line == static_cast<std::int64_t>(lines.size())) {
      lines.push_back({feature->GetFieldAsInteger64(source_field),
                       {},
                       reader.kind_of(*feature, kind_field,
                                      {LineKind::kPowerLine, LineKind::kMinorPowerLine,
                                       LineKind::kAerialway})});
    }
    if (lines.empty() || line != static_cast<std::int64_t>(lines.size()) - 1 ||
        support != static_cast<std::int64_t>(lines.back().supports.size())) {
      reader.refuse("is not in the order of its numbers");
    }
    lines.back().supports.push_back({reader.point_of(*feature),
                                     feature->GetFieldAsDouble(height_field),
                                     feature->GetFieldAsInteger(pole_field) != 0});
  }
  return lines;
}

std::vector<Obstacle> read_obstacles(GDALDataset& dataset, const fs::path& file) {
  FeatureReader reader(dataset, "obstacles", file);
  const int source_field = reader.field("source_id");
  const int kind_field = reader.field("kind");
  const int name_field = reader.field("name");
  const int radius_field = reader.field("radius_m");
  const int height_field = reader.field("height_m");
  const int top_field = reader.field("top_m");
  std::vector<Obstacle> obstacles;
  for (const auto& feature : reader.layer()) {
    reader.count();
    Obstacle obstacle;
    obstacle.source_id = feature->GetFieldAsInteger64(source_field);
    obstacle.kind = reader.kind_of(
        *feature, kind_field,
        {ObstacleKind::kMast, ObstacleKind::kTower, ObstacleKind::kChimney,
         ObstacleKind::kWindTurbine, ObstacleKind::kStructure, ObstacleKind::kOther});
    obstacle.name = feature->GetFieldAsString(name_field);
    obstacle.point = reader.point_of(*feature);
    obstacle.radius_m = feature->GetFieldAsDouble(radius_field);
    obstacle.height_m = feature->GetFieldAsDouble(height_field);
    obstacle.top_m = feature->IsFieldSetAndNotNull(top_field)
                         ? feature->GetFieldAsDouble(top_field)
                         : std::numeric_limits<double>::quiet_NaN();
    obstacles.push_back(std::move(obstacle));
  }
  return obstacles;
}

std::vector<Area> read_areas(GDALDataset& dataset, const fs::path& file) {
  FeatureReader reader(dataset, "areas", file);
  const int name_field = reader.field("name");
  const int kind_field = reader.field("kind");
  const int hard_field = reader.field("is_hard");
  const auto limit_of = [&](const OGRFeature& feature, const std::string& name, double none_m) {
    const int value_field = reader.field((name + "_m").c_str());
    const std::string_view reference =
        feature.GetFieldAsString(reader.field((name + "_reference").c_str()));
    if (reference != kAmsl && reference != kAboveGround) {
      reader.refuse("holds the unknown reference '" + std::string(reference) + "'");
    }
    return AreaLimit{
        feature.IsFieldSetAndNotNull(value_field) ? feature.GetFieldAsDouble(value_field) : none_m,
        reference == kAmsl ? AreaLimit::Reference::kAmsl : AreaLimit::Reference::kAboveGround};
  };
  const auto ring_of = [](const OGRLinearRing& ring) {
    std::vector<geo::MapPoint> points;
    for (int i = 0; i < ring.getNumPoints(); ++i) {
      points.push_back({ring.getX(i), ring.getY(i)});
    }
    return points;
  };
  constexpr double kWithoutEnd_m = std::numeric_limits<double>::infinity();
  std::vector<Area> areas;
  for (const auto& feature : reader.layer()) {
    reader.count();
    Area area;
    area.name = feature->GetFieldAsString(name_field);
    area.kind = feature->GetFieldAsString(kind_field);
    area.is_hard = feature->GetFieldAsInteger(hard_field) != 0;
    area.floor = limit_of(*feature, "floor", -kWithoutEnd_m);
    area.ceiling = limit_of(*feature, "ceiling", kWithoutEnd_m);
    const OGRGeometry* geometry = feature->GetGeometryRef();
    if (geometry == nullptr || wkbFlatten(geometry->getGeometryType()) != wkbMultiPolygon) {
      reader.refuse("holds something that is no set of polygons");
    }
    for (const OGRPolygon* part : *geometry->toMultiPolygon()) {
      Area::Polygon polygon;
      bool is_outer = true;
      for (const OGRLinearRing* ring : *part) {
        if (is_outer) {
          polygon.outer = ring_of(*ring);
        } else {
          polygon.holes.push_back(ring_of(*ring));
        }
        is_outer = false;
      }
      area.polygons.push_back(std::move(polygon));
    }
    areas.push_back(std::move(area));
  }
  return areas;
}

void read_features(const fs::path& file, Map& map) {
  const auto refuse = [&](const std::string& why) {
    throw DataError(file.string() + ": " + why, kPrepareAgain);
  };
  std::error_code error;
  if (!fs::is_regular_file(file, error)) {
    refuse("is missing");
  }
  GdalErrors errors;
  static const char* const kDrivers[] = {"GPKG", nullptr};
  static const char* const kNoSiblings[] = {nullptr};
  const DatasetPointer dataset(static_cast<GDALDataset*>(
      GDALOpenEx(file.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY, kDrivers, nullptr, kNoSiblings)));
  if (!dataset) {
    refuse("is not a GeoPackage: " + errors.first());
  }
  map.overhead_lines = read_overhead_lines(*dataset, file);
  map.obstacles = read_obstacles(*dataset, file);
  map.areas = read_areas(*dataset, file);
  if (!errors.first().empty()) {
    refuse("cannot be read: " + errors.first());
  }
}

// Drivers are registered once for each process, whoever comes first; GDAL guards it.
void register_drivers() { GDALAllRegister(); }

}  // namespace

void write_map_bundle(const Map& map, const std::string& provenance_json, const fs::path& folder,
                      const Observer* observer) {
  register_drivers();
  const std::string manifest = manifest_of(map, provenance_json).dump(2) + "\n";
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::pair<std::string, std::string>> datum = {
      {"VERTICAL_DATUM", map.vertical_datum}};
  write_layer(map, map.terrain_m, "terrain elevation", {"m", nan, 1.0}, datum, observer,
              folder / "terrain.tif");
  write_layer(map, map.surface_m, "surface elevation", {"m", nan, 1.0}, datum, observer,
              folder / "surface.tif");
  std::vector<std::pair<std::string, std::string>> bits;
  for (const SemanticName& name : semantic_names()) {
    bits.emplace_back("BIT_" + std::to_string(static_cast<std::uint16_t>(name.bit)),
                      std::string(name.name));
  }
  write_layer(map, map.semantics, "semantic classes, a bit each", {"", 0.0, 1.0}, bits, observer,
              folder / "semantics.tif");
  const LayerStyle share{"", static_cast<double>(kVisibilityUnknown), 1.0 / kVisibilityScale};
  std::vector<LayerBand<std::uint16_t>> heights = {
      {&map.visibility, "share of the surroundings that sees a point at reference height", {}}};
  for (const VisibilityBand& band : map.further_visibility) {
    const std::string height = text_of_height(band.height_m);
    heights.push_back(
        {&band.share,
         "share of the surroundings that sees a point " + height + " m above the surface",
         {{"HEIGHT_M", height}}});
  }
  write_bands(map, heights, share, observer, folder / "visibility.tif");
  write_features(map, folder / "features.gpkg");
  write_file_atomically(folder / kMapManifestFile, manifest);
}

void write_height_bands(const Map& map, const std::vector<NamedBand>& bands, const fs::path& file,
                        const Observer* observer) {
  register_drivers();
  std::vector<LayerBand<float>> layers;
  for (const NamedBand& band : bands) {
    if (band.height_m->geometry() != map.geometry) {
      throw std::invalid_argument("write_height_bands: a band has another geometry than the map");
    }
    layers.push_back({band.height_m, band.name, {}});
  }
  write_bands(map, layers, {"m", std::numeric_limits<double>::quiet_NaN(), 1.0}, observer, file);
}

std::vector<HeightLayer> read_height_bands(const Map& map, const fs::path& file) {
  register_drivers();
  std::vector<std::string> names;
  {
    const GdalErrors errors;
    static const char* const kDrivers[] = {"GTiff", nullptr};
    static const char* const kNoSiblings[] = {nullptr};
    const DatasetPointer dataset(static_cast<GDALDataset*>(
        GDALOpenEx(file.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_INTERNAL, kDrivers,
                   nullptr, kNoSiblings)));
    if (!dataset) {
      throw DataError(file.string() + ": is not a GeoTIFF: " + errors.first(), kPrepareAgain);
    }
    if (dataset->GetRasterCount() < 1 || dataset->GetRasterCount() > kHeightBandsMax) {
      throw DataError(file.string() + ": has " + std::to_string(dataset->GetRasterCount()) +
                          " bands, 1 to " + std::to_string(kHeightBandsMax) + " are possible",
                      kPrepareAgain);
    }
    for (int i = 1; i <= dataset->GetRasterCount(); ++i) {
      names.emplace_back(dataset->GetRasterBand(i)->GetDescription());
    }
  }
  std::vector<raster::Grid<float>> grids = read_bands<float>(map.geometry, names.size(), file);
  std::vector<HeightLayer> layers;
  for (std::size_t i = 0; i < names.size(); ++i) {
    layers.push_back({names[i], std::move(grids[i])});
  }
  return layers;
}

Map read_map_bundle(const fs::path& folder) {
  register_drivers();
  const fs::path file = folder / kMapManifestFile;
  const Json manifest = parsed_manifest(text_of_manifest(folder), file);

  Map map;
  const auto columns = value_of<std::int64_t>(manifest, "columns", file);
  const auto rows = value_of<std::int64_t>(manifest, "rows", file);
  if (columns < 1 || rows < 1 || columns > kSideCellsMax || rows > kSideCellsMax ||
      columns * rows > kCellsMax) {
    throw DataError(file.string() + ": " + std::to_string(columns) + " x " + std::to_string(rows) +
                        " cells are not possible",
                    kPrepareAgain);
  }
  const auto extent = manifest.find("extent_m");
  if (extent == manifest.end() || !extent->is_object()) {
    throw DataError(file.string() + ": 'extent_m' is missing", kPrepareAgain);
  }
  map.geometry = {value_of<double>(*extent, "west", file), value_of<double>(*extent, "south", file),
                  value_of<double>(manifest, "cell_m", file), static_cast<int>(columns),
                  static_cast<int>(rows)};
  if (!(map.geometry.cell_m > 0.0) || !(map.geometry.cell_m < 1e6) ||
      !(std::fabs(map.geometry.west_m) < 1e9) || !(std::fabs(map.geometry.south_m) < 1e9)) {
    throw DataError(file.string() + ": extent or cell size is out of range", kPrepareAgain);
  }
  map.crs_wkt = value_of<std::string>(manifest, "crs_wkt", file);
  if (!map.crs_wkt.empty()) {
    const geo::MapProjection checked(map.crs_wkt);
  }
  map.vertical_datum = value_of<std::string>(manifest, "vertical_datum", file);
  map.reference_height_m = value_of<double>(manifest, "reference_height_m", file);
  map.visibility_radius_m = value_of<double>(manifest, "visibility_radius_m", file);
  map.label = value_of<std::string>(manifest, "label", file);
  const auto attributions = manifest.find("attributions");
  if (attributions == manifest.end() || !attributions->is_array()) {
    throw DataError(file.string() + ": 'attributions' is missing", kPrepareAgain);
  }
  for (const Json& line : *attributions) {
    if (!line.is_string()) {
      throw DataError(file.string() + ": 'attributions' holds something that is no text",
                      kPrepareAgain);
    }
    map.attributions.push_back(line.get<std::string>());
  }
  try {
    map.hash = hash128_from_hex(value_of<std::string>(manifest, "map_hash", file));
  } catch (const std::invalid_argument& error) {
    throw DataError(file.string() + ": 'map_hash': " + error.what(), kPrepareAgain);
  }
  map.terrain_m = read_layer<float>(map.geometry, folder / "terrain.tif");
  map.surface_m = read_layer<float>(map.geometry, folder / "surface.tif");
  map.semantics = read_layer<std::uint16_t>(map.geometry, folder / "semantics.tif");
  const std::vector<double> heights_m = further_heights_in(manifest, file);
  std::vector<raster::Grid<std::uint16_t>> shares =
      read_bands<std::uint16_t>(map.geometry, heights_m.size() + 1, folder / "visibility.tif");
  map.visibility = std::move(shares.front());
  for (std::size_t i = 0; i < heights_m.size(); ++i) {
    map.further_visibility.push_back({heights_m[i], std::move(shares[i + 1])});
  }
  read_features(folder / "features.gpkg", map);
  try {
    validate(map);
  } catch (const DataError& error) {
    throw DataError(folder.string() + ": " + error.what(), error.hint());
  }
  return map;
}

std::string read_map_manifest(const fs::path& folder) {
  const fs::path file = folder / kMapManifestFile;
  std::string text = text_of_manifest(folder);
  (void)parsed_manifest(text, file);
  return text;
}

}  // namespace hedgehop::map
