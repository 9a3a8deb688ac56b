#include "map/source_layer.hpp"

#include <array>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <gdal_priv.h>
#include <memory>
#include <ogr_spatialref.h>
#include <string>
#include <system_error>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "geo/gdal_guards.hpp"

namespace hedgehop::map {
namespace {

namespace fs = std::filesystem;

using geo::DatasetPointer;

}  // namespace

std::string_view words_of(HeightOrigin origin) {
  switch (origin) {
    case HeightOrigin::kElevation:
      return "elevation file";
    case HeightOrigin::kStated:
      return "height that the source states";
    case HeightOrigin::kStoreys:
      return "storeys that the source states";
    case HeightOrigin::kClassDefault:
      return "default of the object's class";
    case HeightOrigin::kThin:
      return "wire or thin obstacle";
  }
  return "unknown";
}

std::uint16_t packed(const CellSource& source) {
  return static_cast<std::uint16_t>(source.elevation + 4096 * static_cast<int>(source.origin));
}

CellSource unpacked_source(std::uint16_t value) {
  return {value % 4096, static_cast<HeightOrigin>(value / 4096)};
}

void write_source_layer(const Map& map, const raster::Grid<std::uint16_t>& sources,
                        const fs::path& folder) {
  GDALAllRegister();
  const geo::GdalErrors errors;
  const fs::path file = folder / kSourceLayerFile;
  const std::string name =
      "/vsimem/hedgehop_sources_" + std::to_string(reinterpret_cast<std::uintptr_t>(&sources));
  const auto require = [&](bool condition) {
    if (!condition) {
      VSIUnlink(name.c_str());
      throw SystemFailure(file.string() + ": cannot be written: " + errors.first());
    }
  };
  CPLStringList options;
  options.SetNameValue("COMPRESS", "DEFLATE");
  options.SetNameValue("PREDICTOR", "2");
  options.SetNameValue("TILED", "YES");
  DatasetPointer dataset(GetGDALDriverManager()->GetDriverByName("GTiff")->Create(
      name.c_str(), sources.columns(), sources.rows(), 1, GDT_UInt16, options.List()));
  require(dataset != nullptr);
  const raster::GridGeometry& g = map.geometry;
  std::array<double, 6> transform = {g.west_m, g.cell_m, 0.0, g.north_m(), 0.0, -g.cell_m};
  require(dataset->SetGeoTransform(transform.data()) == CE_None);
  OGRSpatialReference crs;
  if (!map.crs_wkt.empty() && crs.importFromWkt(map.crs_wkt.c_str()) == OGRERR_NONE) {
    crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    require(dataset->SetSpatialRef(&crs) == CE_None);
  }
  GDALRasterBand* band = dataset->GetRasterBand(1);
  band->SetDescription("number of the elevation file + 4096 x origin of the height");
  for (int row = 0; row < sources.rows(); ++row) {
    require(band->RasterIO(GF_Write, 0, sources.rows() - 1 - row, sources.columns(), 1,
                           const_cast<std::uint16_t*>(sources.row(row)), sources.columns(), 1,
                           GDT_UInt16, 0, 0, nullptr) == CE_None);
  }
  dataset->FlushCache(true);
  dataset.reset();
  vsi_l_offset size = 0;
  const GByte* data = VSIGetMemFileBuffer(name.c_str(), &size, FALSE);
  require(data != nullptr);
  const Bytes bytes(reinterpret_cast<const std::byte*>(data),
                    reinterpret_cast<const std::byte*>(data) + size);
  VSIUnlink(name.c_str());
  write_file_atomically(file, ByteView(bytes));
}

std::optional<CellSource> read_cell_source(const Map& map, const fs::path& folder,
                                           raster::CellIndex cell) {
  const fs::path file = folder / kSourceLayerFile;
  std::error_code error;
  if (!fs::exists(file, error)) {
    return std::nullopt;
  }
  GDALAllRegister();
  const geo::GdalErrors errors;
  const std::array<const char*, 2> drivers = {"GTiff", nullptr};
  const DatasetPointer dataset(static_cast<GDALDataset*>(
      GDALOpenEx(fs::absolute(file).c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, drivers.data(),
                 nullptr, nullptr)));
  std::uint16_t value = 0;
  if (!dataset || dataset->GetRasterCount() != 1 ||
      dataset->GetRasterXSize() != map.geometry.columns ||
      dataset->GetRasterYSize() != map.geometry.rows ||
      dataset->GetRasterBand(1)->GetRasterDataType() != GDT_UInt16 ||
      dataset->GetRasterBand(1)->RasterIO(GF_Read, cell.column, map.geometry.rows - 1 - cell.row, 1,
                                          1, &value, 1, 1, GDT_UInt16, 0, 0, nullptr) != CE_None ||
      value / 4096 > static_cast<int>(HeightOrigin::kThin)) {
    throw DataError(file.string() + ": is damaged, or does not belong to this map",
                    "prepare the map again");
  }
  return unpacked_source(value);
}

}  // namespace hedgehop::map
