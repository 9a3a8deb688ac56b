#include "map_sources/gdal_access.hpp"

#include <algorithm>
#include <cpl_string.h>

#include "base/errors.hpp"

namespace hedgehop::map_sources {

namespace fs = std::filesystem;

OGRSpatialReference wgs84() {
  OGRSpatialReference crs;
  crs.importFromEPSG(4326);
  crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return crs;
}

std::unique_ptr<OGRCoordinateTransformation> transformation(const OGRSpatialReference& from,
                                                            const OGRSpatialReference& to,
                                                            const fs::path& path) {
  OGRCoordinateTransformationOptions options;
  options.SetBallparkAllowed(false);
  GdalErrors errors;
  std::unique_ptr<OGRCoordinateTransformation> result(
      OGRCreateCoordinateTransformation(&from, &to, options));
  if (!result) {
    throw DataError(
        path.string() + ": its coordinate system cannot be related to the map's: " + errors.first(),
        "reproject it first, for example with gdalwarp or ogr2ogr -t_srs EPSG:4326");
  }
  return result;
}

std::vector<std::pair<double, double>> outline(double x0, double y0, double x1, double y1) {
  constexpr int kSteps = 40;
  std::vector<std::pair<double, double>> points;
  for (int i = 0; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    const double x = x0 + t * (x1 - x0);
    const double y = y0 + t * (y1 - y0);
    points.emplace_back(x, y0);
    points.emplace_back(x, y1);
    points.emplace_back(x0, y);
    points.emplace_back(x1, y);
  }
  return points;
}

std::vector<fs::path> parts_of(GDALDataset& dataset, const fs::path& given) {
  const GdalErrors silent;
  const CPLStringList names(dataset.GetFileList());
  std::vector<fs::path> parts;
  for (int i = 0; i < names.size(); ++i) {
    std::string name = names[i];
    std::error_code error;
    if (name.starts_with("/vsizip/{")) {
      name = name.substr(9, name.find('}') - 9);
    } else if (name.starts_with("/vsizip/") || name.starts_with("/vsigzip/")) {
      fs::path archive(name.substr(name.find('/', 1) + 1));
      while (archive.has_relative_path() && !fs::is_regular_file(archive, error)) {
        archive = archive.parent_path();
      }
      name = archive.string();
    }
    const fs::path path(name);
    if (!fs::exists(path, error)) {
      throw DataError(given.string() + ": refers to '" + name + "', which is no file here",
                      "fetch what it refers to first; files are read from this machine only");
    }
    if (fs::is_regular_file(path, error) && !fs::equivalent(path, given, error)) {
      parts.push_back(path);
    }
  }
  std::sort(parts.begin(), parts.end());
  parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
  std::error_code error;
  if (fs::is_regular_file(given, error)) {
    parts.insert(parts.begin(), given);
  }
  return parts;
}

}  // namespace hedgehop::map_sources
