#pragma once

#include <cpl_string.h>
#include <filesystem>
#include <functional>
#include <gdal_priv.h>
#include <ogr_spatialref.h>
#include <stdexcept>
#include <string>
#include <vector>

namespace hedgehop::test {

struct RasterFile {
  std::string crs = "EPSG:4326";
  double west = 11.0;  // outer edge, units of the CRS
  double north = 50.0;
  double step = 0.001;
  int columns = 100;
  int rows = 100;
  double no_data = -9999.0;
  std::string unit;
};

/// Writes a GeoTIFF whose samples are height(x, y) at their centres, in the file's own coordinates.
inline void write_raster(const std::filesystem::path& path, const RasterFile& file,
                         const std::function<double(double x, double y)>& height) {
  GDALAllRegister();
  GDALDataset* dataset = GetGDALDriverManager()->GetDriverByName("GTiff")->Create(
      path.c_str(), file.columns, file.rows, 1, GDT_Float32, nullptr);
  if (dataset == nullptr) {
    throw std::runtime_error("cannot write " + path.string());
  }
  double transform[6] = {file.west, file.step, 0.0, file.north, 0.0, -file.step};
  dataset->SetGeoTransform(transform);
  if (!file.crs.empty()) {
    OGRSpatialReference crs;
    crs.SetFromUserInput(file.crs.c_str());
    dataset->SetSpatialRef(&crs);
  }
  dataset->GetRasterBand(1)->SetNoDataValue(file.no_data);
  if (!file.unit.empty()) {
    dataset->GetRasterBand(1)->SetUnitType(file.unit.c_str());
  }
  std::vector<float> line(static_cast<std::size_t>(file.columns));
  for (int row = 0; row < file.rows; ++row) {
    for (int column = 0; column < file.columns; ++column) {
      line[static_cast<std::size_t>(column)] = static_cast<float>(
          height(file.west + (column + 0.5) * file.step, file.north - (row + 0.5) * file.step));
    }
    if (dataset->GetRasterBand(1)->RasterIO(GF_Write, 0, row, file.columns, 1, line.data(),
                                            file.columns, 1, GDT_Float32, 0, 0,
                                            nullptr) != CE_None) {
      throw std::runtime_error("cannot write " + path.string());
    }
  }
  GDALClose(dataset);
}

}  // namespace hedgehop::test
