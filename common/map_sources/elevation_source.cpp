#include "map_sources/elevation_source.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <gdal_alg.h>
#include <gdal_priv.h>
#include <gdalwarper.h>
#include <map>
#include <ogr_spatialref.h>
#include <optional>
#include <regex>  // layers: it sees file names only, which are short

#include "base/angles.hpp"
#include "base/errors.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;

constexpr double kLowestGround_m = -1000.0;  // the Dead Sea's shore lies at -430 m
constexpr double kHighestGround_m = 9500.0;  // Mount Everest: 8849 m
constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
constexpr double kSamplesMax = 1e9;
constexpr char kStage[] = "elevation";

struct DatasetCloser {
  void operator()(GDALDataset* dataset) const { GDALClose(dataset); }
};
using DatasetPointer = std::unique_ptr<GDALDataset, DatasetCloser>;

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

// Column, row -> x, y of a raster, as GDAL defines it.
struct Affine {
  std::array<double, 6> c{};

  [[nodiscard]] double x(double column, double row) const {
    return c[0] + c[1] * column + c[2] * row;
  }
  [[nodiscard]] double y(double column, double row) const {
    return c[3] + c[4] * column + c[5] * row;
  }
  [[nodiscard]] double determinant() const { return c[1] * c[5] - c[2] * c[4]; }
  [[nodiscard]] double column(double x_, double y_) const {
    return (c[5] * (x_ - c[0]) - c[2] * (y_ - c[3])) / determinant();
  }
  [[nodiscard]] double row(double x_, double y_) const {
    return (c[1] * (y_ - c[3]) - c[4] * (x_ - c[0])) / determinant();
  }
};

struct OpenFile {
  ElevationFile facts;
  fs::path path;
  DatasetPointer dataset;
  Affine affine;
  OGRSpatialReference crs;
  double scale = 1.0;  // to metres
  double offset_m = 0.0;
  std::optional<double> no_data;
};

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

// GDAL compares a member's checksum only when it is read from end to end, which a driver need not
// do.
void check_member(const fs::path& path, const std::string& archive, const std::string& member) {
  const std::string name = archive + "/" + member;
  GdalErrors errors;
  VSIStatBufL status{};
  VSILFILE* file = VSIStatL(name.c_str(), &status) == 0 ? VSIFOpenL(name.c_str(), "rb") : nullptr;
  std::uint64_t size = 0;
  if (file != nullptr) {
    std::vector<char> block(std::size_t{1} << 20);
    for (std::size_t got = block.size(); got == block.size(); size += got) {
      got = VSIFReadL(block.data(), 1, block.size(), file);
    }
    VSIFCloseL(file);
  }
  if (file == nullptr || size != static_cast<std::uint64_t>(status.st_size) ||
      !errors.first().empty()) {
    throw DataError(path.string() + ": its content '" + member + "' is damaged" +
                        (errors.first().empty() ? "" : ": " + errors.first()),
                    "it may have been cut off while it was fetched; fetch it again");
  }
}

// The one raster inside a .zip.
std::string member_of_archive(const fs::path& path) {
  const GdalErrors silent;
  const std::string archive = "/vsizip/{" + path.string() + "}";
  const CPLStringList members(VSIReadDirRecursive(archive.c_str()));
  if (members.empty()) {
    throw DataError(path.string() + ": is no readable zip archive, or an empty one",
                    "it may have been cut off while it was fetched; fetch it again");
  }
  std::vector<std::string> rasters;
  for (int i = 0; i < members.size(); ++i) {
    const std::string member = members[i];
    const std::string name = lower(member);
    for (const char* suffix : {".hgt", ".tif", ".tiff", ".dt0", ".dt1", ".dt2", ".asc", ".img"}) {
      if (ends_with(name, suffix)) {
        rasters.push_back(member);
      }
    }
  }
  if (rasters.size() != 1) {
    throw DataError(path.string() + ": holds " + std::to_string(rasters.size()) +
                        " elevation rasters, one is needed",
                    "unpack it and name the files that you want");
  }
  check_member(path, archive, rasters.front());
  return archive + "/" + rasters.front();
}

// "n49e011", "s01w078": a hemisphere, two digits, a hemisphere, three digits.
bool names_a_tile(const std::string& name) {
  const auto is_digit = [&](std::size_t i) {
    return std::isdigit(static_cast<unsigned char>(name[i])) != 0;
  };
  return name.size() >= 7 && (name[0] == 'n' || name[0] == 's') && is_digit(1) && is_digit(2) &&
         (name[3] == 'e' || name[3] == 'w') && is_digit(4) && is_digit(5) && is_digit(6);
}

void check_tile_name(const fs::path& path, const std::string& opened) {
  const std::string name = fs::path(opened).filename().string();
  if (ends_with(lower(name), ".hgt") && !names_a_tile(lower(name))) {
    throw DataError(path.string() + ": '" + name +
                        "' does not say where the tile lies; an SRTM tile is named after its "
                        "south-western corner",
                    "rename it to NxxEyyy.hgt, for example N49E011.hgt for 49..50 N, 11..12 E");
  }
}

double unit_in_metres(const std::string& unit, const fs::path& path) {
  const std::string name = lower(unit);
  if (name.empty() || name == "m" || name == "metre" || name == "meter" || name == "metres" ||
      name == "meters") {
    return 1.0;
  }
  if (name == "ft" || name == "foot" || name == "feet" || name == "international foot") {
    return 0.3048;
  }
  if (name == "us survey foot" || name == "us-ft" || name == "ftus" || name == "foot_us") {
    return 1200.0 / 3937.0;
  }
  if (name == "cm" || name == "centimetre") {
    return 0.01;
  }
  throw DataError(path.string() + ": its heights are in '" + unit + "', which is not known",
                  "convert it to metres first, for example with gdal_translate -scale");
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
        "reproject it first, for example with gdalwarp -t_srs EPSG:4326");
  }
  return result;
}

OGRSpatialReference wgs84() {
  OGRSpatialReference crs;
  crs.importFromEPSG(4326);
  crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return crs;
}

// Points along the outline of a rectangle, sides followed because they are curved elsewhere.
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

OpenFile open_file(const fs::path& given) {
  const fs::path path = fs::absolute(given);
  std::error_code error;
  if (!fs::exists(path, error)) {
    throw DataError(given.string() + ": no such file", "check the path given with --dem");
  }
  if (!fs::is_regular_file(path, error)) {
    throw DataError(given.string() + ": is not a file", "give elevation files one by one");
  }
  OpenFile file;
  file.path = given;
  file.facts.name = path.filename().string();
  const std::string name =
      ends_with(lower(file.facts.name), ".zip") ? member_of_archive(path) : path.string();
  check_tile_name(given, name);
  GdalErrors errors;
  file.dataset.reset(static_cast<GDALDataset*>(
      GDALOpenEx(name.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, nullptr, nullptr, nullptr)));
  if (!file.dataset) {
    throw DataError(given.string() + ": is not a raster that can be read" +
                        (errors.first().empty() ? "" : ": " + errors.first()),
                    "--dem takes SRTM tiles (.hgt, .hgt.zip), GeoTIFF and other GDAL rasters");
  }
  GDALDataset& dataset = *file.dataset;
  if (dataset.GetRasterCount() < 1) {
    throw DataError(given.string() + ": holds no raster band");
  }
  if (dataset.GetGeoTransform(file.affine.c.data()) != CE_None ||
      !(std::fabs(file.affine.determinant()) > 0.0)) {
    throw DataError(given.string() + ": does not say where it lies (no geo-transform)",
                    "add it, for example with gdal_translate -a_ullr");
  }
  const OGRSpatialReference* crs = dataset.GetSpatialRef();
  if (crs == nullptr || (!crs->IsProjected() && !crs->IsGeographic())) {
    throw DataError(given.string() + ": has no coordinate system",
                    "add it, for example with gdal_translate -a_srs EPSG:4326");
  }
  file.crs = *crs;
  if (file.crs.IsCompound()) {
    const char* vertical = file.crs.GetAttrValue("VERT_CS");
    file.facts.vertical = vertical == nullptr ? "" : vertical;
    file.crs.StripVertical();
  }
  file.crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  GDALRasterBand* band = dataset.GetRasterBand(1);
  if (GDALDataTypeIsComplex(band->GetRasterDataType())) {
    throw DataError(given.string() + ": holds complex numbers, not heights");
  }
  const double unit_m = unit_in_metres(band->GetUnitType(), given);
  file.scale = band->GetScale() * unit_m;
  file.offset_m = band->GetOffset() * unit_m;
  int has_no_data = FALSE;
  const double no_data = band->GetNoDataValue(&has_no_data);
  if (has_no_data != FALSE) {
    file.no_data = no_data;
  }
  file.facts.format = dataset.GetDriver()->GetDescription();
  const char* authority = file.crs.GetAuthorityName(nullptr);
  const char* code = file.crs.GetAuthorityCode(nullptr);
  file.facts.crs = authority != nullptr && code != nullptr ? std::string(authority) + ":" + code
                                                           : std::string(file.crs.GetName());
  const char* copyright = dataset.GetMetadataItem("TIFFTAG_COPYRIGHT");
  file.facts.copyright = copyright == nullptr ? "" : copyright;
  file.facts.columns = dataset.GetRasterXSize();
  file.facts.rows = dataset.GetRasterYSize();

  const auto to_geodetic = transformation(file.crs, wgs84(), given);
  geo::GeodeticBox& box = file.facts.extent;
  box = {1e9, 1e9, -1e9, -1e9};
  for (const auto& [column, row] : outline(0.0, 0.0, file.facts.columns, file.facts.rows)) {
    double longitude_deg = file.affine.x(column, row);
    double latitude_deg = file.affine.y(column, row);
    if (!to_geodetic->Transform(1, &longitude_deg, &latitude_deg) ||
        !(std::fabs(latitude_deg) <= 90.1) || !(std::fabs(longitude_deg) <= 180.1)) {
      throw DataError(given.string() + ": lies outside the globe",
                      "check its geo-transform and coordinate system with gdalinfo");
    }
    box.west_rad = std::min(box.west_rad, radians_from_degrees(longitude_deg));
    box.east_rad = std::max(box.east_rad, radians_from_degrees(longitude_deg));
    box.south_rad = std::min(box.south_rad, radians_from_degrees(latitude_deg));
    box.north_rad = std::max(box.north_rad, radians_from_degrees(latitude_deg));
  }
  const double metres_per_unit =
      file.crs.IsGeographic() ? file.crs.GetSemiMajor() * kDegree_rad : file.crs.GetLinearUnits();
  const double shrink =
      file.crs.IsGeographic() ? std::cos(0.5 * (box.south_rad + box.north_rad)) : 1.0;
  const double across_m = std::hypot(file.affine.c[1] * shrink, file.affine.c[4]) * metres_per_unit;
  const double down_m = std::hypot(file.affine.c[2] * shrink, file.affine.c[5]) * metres_per_unit;
  file.facts.sample_spacing_m = std::round(100.0 * std::min(across_m, down_m)) / 100.0;
  return file;
}

// Files whose samples lie on one lattice can be joined without interpolation.
bool share_lattice(const OpenFile& a, const OpenFile& b) {
  if (!a.crs.IsSame(&b.crs)) {
    return false;
  }
  const double tolerance = 1e-6;
  for (const int i : {1, 2, 4, 5}) {
    const double span = std::fabs(a.affine.c[1]) + std::fabs(a.affine.c[5]);
    if (std::fabs(a.affine.c[static_cast<std::size_t>(i)] -
                  b.affine.c[static_cast<std::size_t>(i)]) > tolerance * 1e-3 * span) {
      return false;
    }
  }
  const double column = a.affine.column(b.affine.c[0], b.affine.c[3]);
  const double row = a.affine.row(b.affine.c[0], b.affine.c[3]);
  return std::fabs(column - std::round(column)) < 1e-3 && std::fabs(row - std::round(row)) < 1e-3;
}

// A rectangle of samples of one lattice, north-up order as in the files.
struct Samples {
  Affine affine;
  int columns = 0;
  int rows = 0;
  std::vector<float> values_m;
};

struct ProgressLink {
  Observer* observer;
  double done;
  double share;
};

int CPL_STDCALL on_progress(double complete, const char*, void* link_pointer) {
  const auto* link = static_cast<const ProgressLink*>(link_pointer);
  link->observer->progress(kStage, link->done + link->share * complete, 1.0);
  return link->observer->stop_requested() ? FALSE : TRUE;
}

void copy_samples(const OpenFile& file, Samples& samples, Observer& observer) {
  // Where this file's first sample lies in the window.
  const int left =
      static_cast<int>(std::lround(samples.affine.column(file.affine.c[0], file.affine.c[3])));
  const int top =
      static_cast<int>(std::lround(samples.affine.row(file.affine.c[0], file.affine.c[3])));
  const int first_column = std::max(0, -left);
  const int last_column = std::min(file.facts.columns, samples.columns - left);
  const int first_row = std::max(0, -top);
  const int last_row = std::min(file.facts.rows, samples.rows - top);
  if (first_column >= last_column || first_row >= last_row) {
    return;
  }
  const int count = last_column - first_column;
  std::vector<double> line(static_cast<std::size_t>(count));
  GdalErrors errors;
  for (int row = first_row; row < last_row; ++row) {
    if (row % 16 == 0) {
      observer.check_stop();
    }
    if (file.dataset->GetRasterBand(1)->RasterIO(GF_Read, first_column, row, count, 1, line.data(),
                                                 count, 1, GDT_Float64, 0, 0, nullptr) != CE_None) {
      throw DataError(file.path.string() + ": cannot be read: " + errors.first(),
                      "the file may be damaged or cut off; fetch it again");
    }
    float* target =
        samples.values_m.data() +
        static_cast<std::size_t>(top + row) * static_cast<std::size_t>(samples.columns) +
        static_cast<std::size_t>(left + first_column);
    for (int i = 0; i < count; ++i) {
      const double raw = line[static_cast<std::size_t>(i)];
      const double height_m = raw * file.scale + file.offset_m;
      const bool is_void = (file.no_data && raw == *file.no_data) || raw == -32768.0 ||
                           !(height_m >= kLowestGround_m && height_m <= kHighestGround_m);
      if (!is_void && std::isnan(target[i])) {
        target[i] = static_cast<float>(height_m);
      }
    }
  }
}

float rounded_up(double value_m) { return static_cast<float>(std::ceil(value_m * 64.0) / 64.0); }

}  // namespace

struct ElevationSource::Impl {
  std::vector<OpenFile> files;
  std::vector<ElevationFile> facts;
  std::vector<std::vector<std::size_t>> lattices;  // files that belong together, in order

  std::optional<Samples> read_window(const std::vector<std::size_t>& lattice,
                                     const raster::GridGeometry& geometry,
                                     const OGRSpatialReference& map_crs, Observer& observer) const;
  void warp(const Samples& samples, const OpenFile& origin, const std::string& crs_wkt, int threads,
            const ProgressLink& link, int lattice_number, raster::Grid<float>& terrain_m,
            raster::Grid<std::int32_t>& owner) const;
  void raise_to_samples(const Samples& samples, const OpenFile& origin,
                        const OGRSpatialReference& map_crs, bool over_bilinear, int lattice_number,
                        const raster::Grid<std::int32_t>& owner, const raster::Grid<float>& base_m,
                        raster::Grid<float>& upper_m, Observer& observer) const;
};

std::optional<Samples> ElevationSource::Impl::read_window(const std::vector<std::size_t>& lattice,
                                                          const raster::GridGeometry& geometry,
                                                          const OGRSpatialReference& map_crs,
                                                          Observer& observer) const {
  const OpenFile& origin = files[lattice.front()];
  const auto to_source = transformation(map_crs, origin.crs, origin.path);
  double low_column = 1e18, high_column = -1e18, low_row = 1e18, high_row = -1e18;
  for (const auto& [x_m, y_m] :
       outline(geometry.west_m, geometry.south_m, geometry.east_m(), geometry.north_m())) {
    double x = x_m;
    double y = y_m;
    if (!to_source->Transform(1, &x, &y)) {
      throw DataError(origin.path.string() + ": the map region cannot be shown in its coordinates");
    }
    low_column = std::min(low_column, origin.affine.column(x, y));
    high_column = std::max(high_column, origin.affine.column(x, y));
    low_row = std::min(low_row, origin.affine.row(x, y));
    high_row = std::max(high_row, origin.affine.row(x, y));
  }
  // A wide margin: the warper's kernel grows with the ratio of cell to sample.
  const double margin = 4.0 + 4.0 * geometry.cell_m / std::max(origin.facts.sample_spacing_m, 1e-3);
  double left = 1e18, right = -1e18, top = 1e18, bottom = -1e18;
  for (const std::size_t index : lattice) {
    const OpenFile& file = files[index];
    const double column = std::round(origin.affine.column(file.affine.c[0], file.affine.c[3]));
    const double row = std::round(origin.affine.row(file.affine.c[0], file.affine.c[3]));
    left = std::min(left, column);
    right = std::max(right, column + file.facts.columns);
    top = std::min(top, row);
    bottom = std::max(bottom, row + file.facts.rows);
  }
  left = std::max(left, std::floor(low_column - margin));
  right = std::min(right, std::ceil(high_column + margin));
  top = std::max(top, std::floor(low_row - margin));
  bottom = std::min(bottom, std::ceil(high_row + margin));
  if (!(left < right) || !(top < bottom)) {
    return std::nullopt;
  }
  if ((right - left) * (bottom - top) > kSamplesMax) {
    throw DataError(origin.path.string() + ": has more than 1e9 samples in the region",
                    "make it coarser first, for example with gdalwarp -r max -tr, or choose a "
                    "smaller region");
  }
  Samples samples;
  samples.columns = static_cast<int>(right - left);
  samples.rows = static_cast<int>(bottom - top);
  samples.affine = origin.affine;
  samples.affine.c[0] = origin.affine.x(left, top);
  samples.affine.c[3] = origin.affine.y(left, top);
  samples.values_m.assign(
      static_cast<std::size_t>(samples.columns) * static_cast<std::size_t>(samples.rows), kUnknown);
  for (const std::size_t index : lattice) {
    copy_samples(files[index], samples, observer);
  }
  return samples;
}

void ElevationSource::Impl::warp(const Samples& samples, const OpenFile& origin,
                                 const std::string& crs_wkt, int threads, const ProgressLink& link,
                                 int lattice_number, raster::Grid<float>& terrain_m,
                                 raster::Grid<std::int32_t>& owner) const {
  const raster::GridGeometry& geometry = terrain_m.geometry();
  GdalErrors errors;
  const auto check = [&](bool condition) {
    if (link.observer->stop_requested()) {
      throw Interrupted();
    }
    if (!condition) {
      throw DataError(origin.path.string() + ": cannot be warped to the map: " + errors.first());
    }
  };
  GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  HEDGEHOP_ASSERT(memory != nullptr);
  const DatasetPointer source(
      memory->Create("", samples.columns, samples.rows, 0, GDT_Float32, nullptr));
  const auto add_band = [](GDALDataset& dataset, float* values) {
    std::array<char, 64> pointer{};
    pointer[static_cast<std::size_t>(CPLPrintPointer(pointer.data(), values, 63))] = '\0';
    CPLStringList options;
    options.SetNameValue("DATAPOINTER", pointer.data());
    return dataset.AddBand(GDT_Float32, options.List()) == CE_None;
  };
  check(source && add_band(*source, const_cast<float*>(samples.values_m.data())));
  std::array<double, 6> transform = samples.affine.c;
  source->SetGeoTransform(transform.data());
  source->SetSpatialRef(&origin.crs);
  source->GetRasterBand(1)->SetNoDataValue(kUnknown);

  std::vector<float> north_up(geometry.cell_count(), kUnknown);
  const DatasetPointer target(
      memory->Create("", geometry.columns, geometry.rows, 0, GDT_Float32, nullptr));
  check(target && add_band(*target, north_up.data()));
  transform = {geometry.west_m, geometry.cell_m, 0.0, geometry.north_m(), 0.0, -geometry.cell_m};
  target->SetGeoTransform(transform.data());
  OGRSpatialReference map_crs;
  map_crs.importFromWkt(crs_wkt.c_str());
  map_crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  target->SetSpatialRef(&map_crs);
  target->GetRasterBand(1)->SetNoDataValue(kUnknown);

  CPLStringList transformer_options;
  transformer_options.SetNameValue("ALLOW_BALLPARK", "NO");
  void* transformer = GDALCreateGenImgProjTransformer2(GDALDataset::ToHandle(source.get()),
                                                       GDALDataset::ToHandle(target.get()),
                                                       transformer_options.List());
  check(transformer != nullptr);
  const std::unique_ptr<void, void (*)(void*)> transformer_owner(transformer,
                                                                 &GDALDestroyGenImgProjTransformer);

  // Cells per sample, the same for every block, so that the kernel does not depend on blocks.
  const double ratio = origin.facts.sample_spacing_m / geometry.cell_m;
  std::unique_ptr<GDALWarpOptions, void (*)(GDALWarpOptions*)> options(GDALCreateWarpOptions(),
                                                                       &GDALDestroyWarpOptions);
  options->hSrcDS = GDALDataset::ToHandle(source.get());
  options->hDstDS = GDALDataset::ToHandle(target.get());
  options->nBandCount = 1;
  options->panSrcBands = static_cast<int*>(CPLMalloc(sizeof(int)));
  options->panDstBands = static_cast<int*>(CPLMalloc(sizeof(int)));
  options->panSrcBands[0] = 1;
  options->panDstBands[0] = 1;
  GDALWarpInitSrcNoDataReal(options.get(), kUnknown);
  GDALWarpInitDstNoDataReal(options.get(), kUnknown);
  options->eResampleAlg = GRA_Bilinear;
  options->eWorkingDataType = GDT_Float32;
  options->dfWarpMemoryLimit = 32.0 * 1024 * 1024;
  options->pTransformerArg = transformer;
  options->pfnTransformer = GDALGenImgProjTransform;
  options->pfnProgress = &on_progress;
  ProgressLink progress = link;
  options->pProgressArg = &progress;
  CPLStringList warp_options;
  warp_options.SetNameValue("INIT_DEST", "NO_DATA");
  warp_options.SetNameValue("NUM_THREADS",
                            threads > 0 ? std::to_string(threads).c_str() : "ALL_CPUS");
  const std::string scale = CPLSPrintf("%.17g", std::min(1.0, ratio));
  warp_options.SetNameValue("XSCALE", scale.c_str());
  warp_options.SetNameValue("YSCALE", scale.c_str());
  options->papszWarpOptions = warp_options.StealList();

  GDALWarpOperation operation;
  check(operation.Initialize(options.get()) == CE_None);
  check(operation.ChunkAndWarpImage(0, 0, geometry.columns, geometry.rows) == CE_None);
  target->FlushCache(false);
  for (int row = 0; row < geometry.rows; ++row) {
    const float* line = north_up.data() + static_cast<std::size_t>(geometry.rows - 1 - row) *
                                              static_cast<std::size_t>(geometry.columns);
    for (int column = 0; column < geometry.columns; ++column) {
      float& cell_m = terrain_m.at(column, row);
      if (std::isnan(cell_m) && !std::isnan(line[column])) {
        cell_m = static_cast<float>(std::round(static_cast<double>(line[column]) * 64.0) / 64.0);
        owner.at(column, row) = lattice_number;
      }
    }
  }
}

// First pass: no cell below a sample in it. Second pass (over_bilinear): where the bilinear surface
// through the cells' centres still passes below a sample, its four cells are raised by what is
// missing.
void ElevationSource::Impl::raise_to_samples(
    const Samples& samples, const OpenFile& origin, const OGRSpatialReference& map_crs,
    bool over_bilinear, int lattice_number, const raster::Grid<std::int32_t>& owner,
    const raster::Grid<float>& base_m, raster::Grid<float>& upper_m, Observer& observer) const {
  const auto to_map = transformation(origin.crs, map_crs, origin.path);
  const raster::GridGeometry& g = upper_m.geometry();
  const auto width = static_cast<std::size_t>(samples.columns);
  std::vector<double> x(width);
  std::vector<double> y(width);
  std::vector<int> is_good(width);
  for (int row = 0; row < samples.rows; ++row) {
    if (row % 8 == 0) {
      observer.check_stop();
    }
    for (int column = 0; column < samples.columns; ++column) {
      const auto i = static_cast<std::size_t>(column);
      x[i] = samples.affine.x(column + 0.5, row + 0.5);
      y[i] = samples.affine.y(column + 0.5, row + 0.5);
    }
    to_map->Transform(samples.columns, x.data(), y.data(), nullptr, is_good.data());
    for (std::size_t i = 0; i < width; ++i) {
      const float sample_m = samples.values_m[static_cast<std::size_t>(row) * width + i];
      if (std::isnan(sample_m) || is_good[i] == 0 || !g.contains(geo::MapPoint{x[i], y[i]})) {
        continue;
      }
      const raster::CellIndex cell = g.cell_at({x[i], y[i]});
      if (!g.contains(cell) || owner.at(cell) != lattice_number) {
        continue;
      }
      if (!over_bilinear) {
        upper_m.at(cell) = std::max(upper_m.at(cell), rounded_up(static_cast<double>(sample_m)));
        continue;
      }
      const double u = (x[i] - g.west_m) / g.cell_m - 0.5;
      const double v = (y[i] - g.south_m) / g.cell_m - 0.5;
      const int low_column = std::clamp(static_cast<int>(std::floor(u)), 0, g.columns - 1);
      const int low_row = std::clamp(static_cast<int>(std::floor(v)), 0, g.rows - 1);
      const int high_column = std::clamp(static_cast<int>(std::floor(u)) + 1, 0, g.columns - 1);
      const int high_row = std::clamp(static_cast<int>(std::floor(v)) + 1, 0, g.rows - 1);
      const double surface_m = raster::sample_bilinear(base_m, {x[i], y[i]});
      const double missing_m = static_cast<double>(sample_m) - surface_m;
      if (!(missing_m > 0.0)) {
        continue;
      }
      std::array<raster::CellIndex, 4> corners = {
          raster::CellIndex{low_column, low_row}, raster::CellIndex{high_column, low_row},
          raster::CellIndex{low_column, high_row}, raster::CellIndex{high_column, high_row}};
      for (const raster::CellIndex corner : corners) {
        upper_m.at(corner) = std::max(
            upper_m.at(corner), rounded_up(static_cast<double>(base_m.at(corner)) + missing_m));
      }
    }
  }
}

ElevationSource::ElevationSource(const std::vector<fs::path>& paths)
    : impl_(std::make_unique<Impl>()) {
  GDALAllRegister();
  if (paths.empty()) {
    throw UsageError("no elevation file is given", "add at least one with --dem");
  }
  for (const fs::path& path : paths) {
    impl_->files.push_back(open_file(path));
    impl_->facts.push_back(impl_->files.back().facts);
  }
  for (std::size_t i = 0; i < impl_->files.size(); ++i) {
    bool is_placed = false;
    for (auto& lattice : impl_->lattices) {
      if (share_lattice(impl_->files[lattice.front()], impl_->files[i])) {
        lattice.push_back(i);
        is_placed = true;
        break;
      }
    }
    if (!is_placed) {
      impl_->lattices.push_back({i});
    }
  }
}

ElevationSource::~ElevationSource() = default;

const std::vector<ElevationFile>& ElevationSource::files() const { return impl_->facts; }

geo::GeodeticBox ElevationSource::extent() const {
  geo::GeodeticBox box = impl_->facts.front().extent;
  for (const ElevationFile& file : impl_->facts) {
    box.west_rad = std::min(box.west_rad, file.extent.west_rad);
    box.south_rad = std::min(box.south_rad, file.extent.south_rad);
    box.east_rad = std::max(box.east_rad, file.extent.east_rad);
    box.north_rad = std::max(box.north_rad, file.extent.north_rad);
  }
  return box;
}

ElevationLayers ElevationSource::on_grid(const raster::GridGeometry& geometry,
                                         const std::string& crs_wkt, int threads,
                                         Observer& observer) const {
  const GdalErrors silent;
  OGRSpatialReference map_crs;
  if (map_crs.importFromWkt(crs_wkt.c_str()) != OGRERR_NONE) {
    throw std::invalid_argument("on_grid: not a coordinate system: " + crs_wkt);
  }
  map_crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  ElevationLayers layers;
  layers.terrain_m = raster::Grid<float>(geometry, kUnknown);
  raster::Grid<std::int32_t> owner(geometry, -1);  // lattice that each cell's height comes from
  const double share = 1.0 / static_cast<double>(impl_->lattices.size());
  std::vector<std::optional<Samples>> windows;
  observer.progress(kStage, 0.0, 1.0);
  for (std::size_t i = 0; i < impl_->lattices.size(); ++i) {
    observer.check_stop();
    const OpenFile& origin = impl_->files[impl_->lattices[i].front()];
    windows.push_back(impl_->read_window(impl_->lattices[i], geometry, map_crs, observer));
    if (windows.back()) {
      impl_->warp(*windows.back(), origin, crs_wkt, threads,
                  {&observer, share * static_cast<double>(i), 0.6 * share}, static_cast<int>(i),
                  layers.terrain_m, owner);
    }
  }
  layers.upper_terrain_m = layers.terrain_m;
  for (const bool over_bilinear : {false, true}) {
    const raster::Grid<float> base_m = layers.upper_terrain_m;
    for (std::size_t i = 0; i < impl_->lattices.size(); ++i) {
      if (windows[i]) {
        impl_->raise_to_samples(*windows[i], impl_->files[impl_->lattices[i].front()], map_crs,
                                over_bilinear, static_cast<int>(i), owner, base_m,
                                layers.upper_terrain_m, observer);
      }
    }
  }
  observer.progress(kStage, 1.0, 1.0);
  return layers;
}

}  // namespace hedgehop::map_sources
