#pragma once

#include <filesystem>
#include <gdal_priv.h>
#include <memory>
#include <ogr_spatialref.h>
#include <string>
#include <utility>
#include <vector>

#include "geo/gdal_guards.hpp"

namespace hedgehop::map_sources {

using geo::DatasetPointer;
using geo::GdalErrors;

/// Longitude, latitude in degrees.
OGRSpatialReference wgs84();

/// Never a ballpark one. Throws DataError naming `path`.
std::unique_ptr<OGRCoordinateTransformation> transformation(const OGRSpatialReference& from,
                                                            const OGRSpatialReference& to,
                                                            const std::filesystem::path& path);

/// Points along the outline of a rectangle, sides followed because they are curved elsewhere.
std::vector<std::pair<double, double>> outline(double x0, double y0, double x1, double y1);

/// The files that a dataset consists of, the given one first, the others by name. Throws DataError
/// if one of them is no file of this machine, a web address in a virtual dataset for example.
std::vector<std::filesystem::path> parts_of(GDALDataset& dataset,
                                            const std::filesystem::path& given);

}  // namespace hedgehop::map_sources
