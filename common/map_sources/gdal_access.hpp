#pragma once

#include <cpl_error.h>
#include <filesystem>
#include <gdal_priv.h>
#include <memory>
#include <ogr_spatialref.h>
#include <string>
#include <utility>
#include <vector>

namespace hedgehop::map_sources {

struct DatasetCloser {
  void operator()(GDALDataset* dataset) const { GDALClose(dataset); }
};
using DatasetPointer = std::unique_ptr<GDALDataset, DatasetCloser>;

/// Collects GDAL's errors of this thread instead of printing them.
class GdalErrors {
 public:
  GdalErrors() { CPLPushErrorHandlerEx(&GdalErrors::on_error, this); }
  ~GdalErrors() { CPLPopErrorHandler(); }
  GdalErrors(const GdalErrors&) = delete;
  GdalErrors& operator=(const GdalErrors&) = delete;
  [[nodiscard]] const std::string& first() const { return first_; }

 private:
  static void CPL_STDCALL on_error(CPLErr severity, CPLErrorNum, const char* text) {
    auto* self = static_cast<GdalErrors*>(CPLGetErrorHandlerUserData());
    if (severity >= CE_Failure && self->first_.empty()) {
      self->first_ = text;
    }
  }
  std::string first_;
};

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
