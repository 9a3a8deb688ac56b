// Formats that GDAL writes: GeoPackage, and the zip archive around KML.
#include <cmath>
#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <gdal_priv.h>
#include <gdal_utils.h>
#include <memory>
#include <ogrsf_frmts.h>
#include <optional>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "geo/gdal_guards.hpp"
#include "output/export_writers.hpp"
#include "output/trajectory_columns.hpp"

namespace hedgehop::output {
namespace {

using geo::DatasetPointer;
using geo::GdalErrors;
using geo::GdalSetting;
using geo::MemoryFile;

constexpr char kGpkg[] = "the GeoPackage";

std::string text_of(const MemoryFile& file) {
  const ByteView bytes = file.bytes();
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

void require_made(bool condition, const GdalErrors& errors, const std::string& what) {
  if (!condition || !errors.first().empty()) {
    throw SystemFailure(what + " cannot be made: " + errors.first());
  }
}

// The map's coordinate system with the datum of its heights, where that has a code.
OGRSpatialReference reference_of(const flight::MapIdentity& map) {
  OGRSpatialReference horizontal;
  const char* wkt = map.crs_wkt.c_str();
  if (horizontal.importFromWkt(&wkt) != OGRERR_NONE) {
    throw DataError("the coordinate system of the plan's map is not valid WKT", "plan again");
  }
  OGRSpatialReference reference = horizontal;
  const geo::VerticalDatum datum = geo::VerticalDatum::parse(map.vertical_datum);
  OGRSpatialReference vertical;
  if (datum.epsg_code != 0 && vertical.importFromEPSG(datum.epsg_code) == OGRERR_NONE) {
    const std::string name = std::string(horizontal.GetName()) + " + " + datum.name + " height";
    OGRSpatialReference compound;
    if (compound.SetCompoundCS(name.c_str(), &horizontal, &vertical) == OGRERR_NONE) {
      reference = compound;
    }
  }
  reference.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return reference;
}

class GpkgWriter {
 public:
  GpkgWriter(GDALDataset& dataset, OGRSpatialReference& reference, const GdalErrors& errors,
             std::string description)
      : dataset_(dataset),
        reference_(reference),
        errors_(errors),
        description_(std::move(description)) {}

  OGRLayer& layer(const char* name, OGRwkbGeometryType type,
                  const std::vector<std::pair<const char*, OGRFieldType>>& fields) {
    CPLStringList options;
    options.SetNameValue("DESCRIPTION", description_.c_str());
    OGRLayer* layer = dataset_.CreateLayer(name, &reference_, type, options.List());
    require_made(layer != nullptr, errors_, kGpkg);
    for (const auto& [field, field_type] : fields) {
      OGRFieldDefn definition(field, field_type);
      require_made(layer->CreateField(&definition) == OGRERR_NONE, errors_, kGpkg);
    }
    return *layer;
  }
  void add(OGRLayer& layer, OGRFeature& feature, const OGRGeometry& geometry) const {
    feature.SetGeometry(&geometry);
    require_made(layer.CreateFeature(&feature) == OGRERR_NONE, errors_, kGpkg);
  }

 private:
  GDALDataset& dataset_;
  OGRSpatialReference& reference_;
  const GdalErrors& errors_;
  std::string description_;
};

void set_time(OGRFeature& feature, const std::optional<Time>& start, double time_s) {
  if (start) {
    feature.SetField("time_utc", time_text(start, time_s).c_str());
  }
}

void write_route(const flight::Plan& plan, GpkgWriter& writer) {
  const auto& waypoints = plan.route_plan.route.waypoints;
  OGRLayer& route =
      writer.layer("route", wkbLineString25D, {{"length_m", OFTReal}, {"cost_m", OFTReal}});
  OGRFeature feature(route.GetLayerDefn());
  feature.SetField("length_m", flight::length_m(waypoints));
  feature.SetField("cost_m", plan.route_plan.route.cost.total_m());
  OGRLineString line;
  for (const flight::Waypoint& waypoint : waypoints) {
    line.addPoint(waypoint.x_m, waypoint.y_m, waypoint.altitude_m);
  }
  writer.add(route, feature, line);

  OGRLayer& points =
      writer.layer("waypoints", wkbPoint25D, {{"number", OFTInteger}, {"altitude_m", OFTReal}});
  for (std::size_t i = 0; i < waypoints.size(); ++i) {
    OGRFeature point(points.GetLayerDefn());
    point.SetField("number", static_cast<int>(i));
    point.SetField("altitude_m", waypoints[i].altitude_m);
    writer.add(points, point,
               OGRPoint(waypoints[i].x_m, waypoints[i].y_m, waypoints[i].altitude_m));
  }
}

void write_flight(const flight::Plan& plan, const Places& places,
                  const std::optional<Time>& start_time, GpkgWriter& writer) {
  const auto& states = plan.trajectory.states;
  OGRLayer& path = writer.layer("flight", wkbLineString25D,
                                {{"length_m", OFTReal},
                                 {"duration_s", OFTReal},
                                 {"clearance_min_m", OFTReal},
                                 {"is_verified", OFTInteger}});
  OGRFeature feature(path.GetLayerDefn());
  feature.SetField("length_m", plan.measures.length_m);
  feature.SetField("duration_s", plan.measures.duration_s);
  feature.SetField("clearance_min_m", plan.verdict.clearance_min_m);
  feature.SetField("is_verified", plan.verdict.is_verified ? 1 : 0);
  OGRLineString line;
  for (const flight::FlightState& state : states) {
    line.addPoint(state.x_m, state.y_m, state.altitude_m);
  }
  writer.add(path, feature, line);

  std::vector<std::pair<const char*, OGRFieldType>> fields;
  for (const TrajectoryColumn& column : kTrajectoryColumns) {
    fields.emplace_back(column.name, OFTReal);
  }
  if (start_time) {
    fields.emplace_back("time_utc", OFTDateTime);
  }
  OGRLayer& trajectory = writer.layer("trajectory", wkbPoint25D, fields);
  for (const flight::FlightState& state : states) {
    OGRFeature row(trajectory.GetLayerDefn());
    const auto set = [&](const char* name, double value) {
      if (!std::isnan(value)) {
        row.SetField(name, value);
      }
    };
    for (const TrajectoryColumn& column : kTrajectoryColumns) {
      if (column.member != nullptr) {
        set(column.name, state.*column.member);
      }
    }
    const Places::Degrees p = places.degrees(state.point());
    set("latitude_deg", p.latitude_deg);
    set("longitude_deg", p.longitude_deg);
    set("height_above_surface_m", state.altitude_m - state.surface_m);
    set("heading_grid_rad",
        grid_from_true_azimuth_rad(state.heading_true_rad, state.convergence_rad));
    set_time(row, start_time, state.time_s);
    writer.add(trajectory, row, OGRPoint(state.x_m, state.y_m, state.altitude_m));
  }
}

DatasetPointer opened(const std::filesystem::path& file, unsigned kind) {
  DatasetPointer dataset(
      GDALDataset::Open(file.c_str(), kind | GDAL_OF_READONLY, nullptr, nullptr, nullptr));
  if (!dataset) {
    throw DataError(file.string() + ": cannot be read", "prepare the map again");
  }
  return dataset;
}

constexpr const char* kRasters[] = {"terrain", "surface", "semantics", "visibility"};

// Raster layers begin the file: the driver adds them by whole copies only, each of one band.
void copy_rasters(const std::filesystem::path& map_folder, const char* path,
                  const GdalErrors& errors) {
  bool is_first = true;
  for (const char* name : kRasters) {
    const DatasetPointer source = opened(map_folder / (std::string(name) + ".tif"), GDAL_OF_RASTER);
    for (int band = 1; band <= source->GetRasterCount(); ++band) {
      // Further bands are those of an exposure volume.
      const std::string table =
          std::string(name) + (band == 1 ? "" : "_band_" + std::to_string(band));
      CPLStringList arguments;
      for (const std::string& argument :
           {std::string("-of"), std::string("GPKG"), std::string("-b"), std::to_string(band),
            std::string("-co"), "RASTER_TABLE=" + table, std::string("-co"),
            std::string("RASTER_DESCRIPTION=") + source->GetRasterBand(band)->GetDescription(),
            std::string("-co"), std::string("APPEND_SUBDATASET=") + (is_first ? "NO" : "YES")}) {
        arguments.AddString(argument.c_str());
      }
      const std::unique_ptr<GDALTranslateOptions, decltype(&GDALTranslateOptionsFree)> options(
          GDALTranslateOptionsNew(arguments.List(), nullptr), &GDALTranslateOptionsFree);
      const DatasetPointer copy(GDALDataset::FromHandle(
          GDALTranslate(path, GDALDataset::ToHandle(source.get()), options.get(), nullptr)));
      require_made(copy != nullptr, errors, kGpkg);
      is_first = false;
    }
  }
}

void copy_features(const std::filesystem::path& map_folder, GDALDataset& dataset,
                   const GdalErrors& errors) {
  const DatasetPointer source = opened(map_folder / "features.gpkg", GDAL_OF_VECTOR);
  for (int i = 0; i < source->GetLayerCount(); ++i) {
    OGRLayer* layer = source->GetLayer(i);
    require_made(dataset.CopyLayer(layer, layer->GetName()) != nullptr, errors, kGpkg);
  }
}

}  // namespace

std::string kmz_bytes(const std::string& text) {
  const MemoryFile memory("flight.kmz");
  {
    const GdalErrors errors;
    void* archive = CPLCreateZip(memory.path(), nullptr);
    require_made(archive != nullptr, errors, "the archive");
    const bool is_written =
        CPLCreateFileInZip(archive, "doc.kml", nullptr) == CE_None &&
        CPLWriteFileInZip(archive, text.data(), static_cast<int>(text.size())) == CE_None &&
        CPLCloseFileInZip(archive) == CE_None;
    const bool is_closed = CPLCloseZip(archive) == CE_None;
    require_made(is_written && is_closed, errors, "the archive");
  }
  return text_of(memory);
}

std::string gpkg_bytes(const flight::Plan& plan, const Places& places,
                       const ExportRequest& request) {
  GDALAllRegister();
  const MemoryFile memory("flight.gpkg");
  {
    const GdalErrors errors;
    const GdalSetting date("OGR_CURRENT_DATE", "2000-01-01T00:00:00.000Z");
    const GdalSetting synchronous("OGR_SQLITE_SYNCHRONOUS", "OFF");
    DatasetPointer dataset;
    if (request.map_folder.empty()) {
      GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GPKG");
      HEDGEHOP_ASSERT(driver != nullptr);
      dataset.reset(driver->Create(memory.path(), 0, 0, 0, GDT_Unknown, nullptr));
    } else {
      copy_rasters(request.map_folder, memory.path(), errors);
      dataset.reset(GDALDataset::Open(memory.path(), GDAL_OF_VECTOR | GDAL_OF_UPDATE, nullptr,
                                      nullptr, nullptr));
    }
    require_made(dataset != nullptr, errors, kGpkg);
    require_made(dataset->StartTransaction() == OGRERR_NONE, errors, kGpkg);
    OGRSpatialReference reference = reference_of(plan.route_plan.map);
    std::string description;
    for (const std::string& line : product_lines(plan)) {
      description += (description.empty() ? "" : "; ") + line;
    }
    GpkgWriter writer(*dataset, reference, errors, description);
    write_flight(plan, places, request.start_time, writer);
    write_route(plan, writer);
    require_made(dataset->CommitTransaction() == OGRERR_NONE, errors, kGpkg);
    if (!request.map_folder.empty()) {
      copy_features(request.map_folder, *dataset, errors);
    }
    dataset->FlushCache(true);
    dataset.reset();
    require_made(true, errors, kGpkg);
  }
  return text_of(memory);
}

}  // namespace hedgehop::output
