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

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "map_sources/gdal_access.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;

constexpr double kLowestGround_m = -1000.0;  // the Dead Sea's shore lies at -430 m
constexpr double kHighestGround_m = 9500.0;  // Mount Everest: 8849 m
constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
constexpr double kSamplesMax = 1e9;
constexpr char kStage[] = "elevation";

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
  std::shared_ptr<const geo::VerticalShift> shift;  // none: heights are the map's already
  std::shared_ptr<OGRCoordinateTransformation> to_geodetic;
};

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

// What is known of a product by its file name.
struct Product {
  const char* mark;  // in small letters
  ElevationKind kind;
  const char* datum;
};
constexpr std::array<Product, 9> kProducts = {
    {{"copernicus_dsm", ElevationKind::kSurface, "EGM2008"},
     {"fabdem", ElevationKind::kTerrain, "EGM2008"},
     {"alpsmlc30", ElevationKind::kSurface, "EGM96"},
     {"aw3d30", ElevationKind::kSurface, "EGM96"},
     {"astgtm", ElevationKind::kSurface, "EGM96"},
     {"aster_gdem", ElevationKind::kSurface, "EGM96"},
     {"tdm1_dem", ElevationKind::kSurface, "ellipsoid"},
     {"nasadem", ElevationKind::kTerrain, "EGM96"},
     {"srtm", ElevationKind::kTerrain, "EGM96"}}};

const Product* product_of(const std::string& name, const std::string& format) {
  static constexpr Product kSrtm{"", ElevationKind::kTerrain, "EGM96"};
  for (const Product& product : kProducts) {
    if (lower(name).find(product.mark) != std::string::npos) {
      return &product;
    }
  }
  // DTED heights are above mean sea level by its specification.
  return format == "SRTMHGT" || format == "DTED" ? &kSrtm : nullptr;
}

// "dsm" as a word of its own: "town_dsm_2019.tif".
bool says_surface(const std::string& name) {
  const std::string text = lower(name);
  const auto is_letter = [&](std::size_t i) {
    return i < text.size() && std::isalpha(static_cast<unsigned char>(text[i])) != 0;
  };
  for (std::size_t i = text.find("dsm"); i != std::string::npos; i = text.find("dsm", i + 1)) {
    if (!(i > 0 && is_letter(i - 1)) && !is_letter(i + 3)) {
      return true;
    }
  }
  return false;
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

// Takes the vertical part off the file's coordinate system.
void set_datum(OpenFile& file, const ElevationInput& input, const Product* product,
               const geo::VerticalDatum& map_datum) {
  ElevationFile& facts = file.facts;
  std::optional<geo::VerticalDatum> stated;
  std::string stated_name;
  if (file.crs.IsCompound()) {
    const char* name = file.crs.GetAttrValue("VERT_CS");
    const char* code = file.crs.GetAuthorityCode("VERT_CS");
    stated_name = name == nullptr ? "?" : name;
    try {
      stated = geo::VerticalDatum::parse("EPSG:" + std::string(code == nullptr ? "" : code));
    } catch (const UsageError&) {
      for (const char* known : {"EGM2008", "EGM96", "EGM84"}) {
        std::string plain = stated_name;
        std::erase_if(plain, [](char c) { return c == ' ' || c == '_'; });
        if (lower(plain).find(lower(known)) != std::string::npos) {
          stated = geo::VerticalDatum::parse(known);
          break;
        }
      }
    }
    file.crs.StripVertical();
  } else if (file.crs.GetAxesCount() == 3) {
    stated = geo::VerticalDatum::parse("ellipsoid");
    file.crs.DemoteTo2D(nullptr);
  }
  if (input.datum) {
    facts.datum = *input.datum;
    facts.datum_from = "command line";
  } else if (stated) {
    facts.datum = *stated;
    facts.datum_from = "file";
  } else if (!stated_name.empty()) {
    throw DataError(
        input.file.string() + ": its heights refer to '" + stated_name + "', which is not known",
        "say what they refer to, for example " + input.file.filename().string() +
            ":datum=EGM96 or :datum=EPSG:5703");
  } else if (product != nullptr) {
    facts.datum = geo::VerticalDatum::parse(product->datum);
    facts.datum_from = "product";
  } else {
    facts.datum = map_datum;
    facts.datum_from = "assumed";
  }
}

OpenFile open_file(const ElevationInput& input, const geo::VerticalDatum& map_datum) {
  const fs::path& given = input.file;
  const fs::path path = fs::absolute(given);
  std::error_code error;
  if (!fs::exists(path, error)) {
    throw DataError(given.string() + ": no such file",
                    "check the path given with --dem; behind it may stand :terrain, :surface, "
                    ":datum=NAME and :crs=EPSG:CODE");
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
  file.facts.parts = parts_of(dataset, given);
  if (!input.crs.empty()) {
    if (file.crs.SetFromUserInput(input.crs.c_str(),
                                  OGRSpatialReference::SET_FROM_USER_INPUT_LIMITATIONS_get()) !=
        OGRERR_NONE) {
      throw UsageError(given.string() + ": coordinate system '" + input.crs + "' is not known",
                       "give a code, for example :crs=EPSG:4326");
    }
  } else if (dataset.GetSpatialRef() != nullptr) {
    file.crs = *dataset.GetSpatialRef();
  }
  if (!file.crs.IsProjected() && !file.crs.IsGeographic()) {
    throw DataError(given.string() + ": has no coordinate system",
                    "say it, for example " + given.filename().string() + ":crs=EPSG:4326");
  }
  file.facts.format = dataset.GetDriver()->GetDescription();
  const Product* product = product_of(fs::path(name).filename().string(), file.facts.format);
  set_datum(file, input, product, map_datum);
  if (input.kind) {
    file.facts.kind = *input.kind;
    file.facts.kind_from = "command line";
  } else if (product != nullptr) {
    file.facts.kind = product->kind;
    file.facts.kind_from = "product";
  } else if (says_surface(file.facts.name)) {
    file.facts.kind = ElevationKind::kSurface;
    file.facts.kind_from = "name";
  } else {
    file.facts.kind_from = "default";
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
  const char* authority = file.crs.GetAuthorityName(nullptr);
  const char* code = file.crs.GetAuthorityCode(nullptr);
  file.facts.crs = authority != nullptr && code != nullptr ? std::string(authority) + ":" + code
                                                           : std::string(file.crs.GetName());
  const char* copyright = dataset.GetMetadataItem("TIFFTAG_COPYRIGHT");
  file.facts.copyright = copyright == nullptr ? "" : copyright;
  file.facts.columns = dataset.GetRasterXSize();
  file.facts.rows = dataset.GetRasterYSize();

  file.to_geodetic = transformation(file.crs, wgs84(), given);
  geo::GeodeticBox& box = file.facts.extent;
  box = {1e9, 1e9, -1e9, -1e9};
  for (const auto& [column, row] : outline(0.0, 0.0, file.facts.columns, file.facts.rows)) {
    double longitude_deg = file.affine.x(column, row);
    double latitude_deg = file.affine.y(column, row);
    if (!file.to_geodetic->Transform(1, &longitude_deg, &latitude_deg) ||
        !(std::fabs(latitude_deg) <= 90.1) || !(std::fabs(longitude_deg) <= 180.1)) {
      throw DataError(given.string() + ": lies outside the globe",
                      "check its geo-transform and coordinate system with gdalinfo");
    }
    box.west_rad = std::min(box.west_rad, radians_from_degrees(longitude_deg));
    box.east_rad = std::max(box.east_rad, radians_from_degrees(longitude_deg));
    box.south_rad = std::min(box.south_rad, radians_from_degrees(latitude_deg));
    box.north_rad = std::max(box.north_rad, radians_from_degrees(latitude_deg));
  }
  if (!(file.facts.datum == map_datum)) {
    try {
      file.shift = std::make_shared<geo::VerticalShift>(file.facts.datum, map_datum, box);
    } catch (const DataError& caught) {
      throw DataError(given.string() + ": " + caught.what(), caught.hint());
    }
    file.facts.datum_conversion = file.shift->operation();
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
  if (a.facts.kind != b.facts.kind || !a.crs.IsSame(&b.crs)) {
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
  std::vector<std::uint16_t> files;  // that each value is of; empty where there is one only
  std::uint16_t first_file = 0;
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

void copy_samples(const OpenFile& file, std::size_t number, Samples& samples, Observer& observer) {
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
  // GDAL finds a line of a text grid by those before it, and tries them over and over, in time that
  // doubles with each, when one is damaged: so they are read from the first on.
  const bool is_text = file.facts.format == "AAIGrid" || file.facts.format == "GRASSASCIIGrid" ||
                       file.facts.format == "ISG";
  for (int row = is_text ? 0 : first_row; row < last_row; ++row) {
    if (row % 16 == 0) {
      observer.check_stop();
    }
    if (file.dataset->GetRasterBand(1)->RasterIO(GF_Read, first_column, row, count, 1, line.data(),
                                                 count, 1, GDT_Float64, 0, 0, nullptr) != CE_None) {
      throw DataError(file.path.string() + ": cannot be read: " + errors.first(),
                      "the file may be damaged or cut off; fetch it again");
    }
    if (row < first_row) {
      continue;
    }
    const std::size_t begin =
        static_cast<std::size_t>(top + row) * static_cast<std::size_t>(samples.columns) +
        static_cast<std::size_t>(left + first_column);
    float* target = samples.values_m.data() + begin;
    for (int i = 0; i < count; ++i) {
      const double raw = line[static_cast<std::size_t>(i)];
      double height_m = raw * file.scale + file.offset_m;
      const bool is_void = (file.no_data && raw == *file.no_data) || raw == -32768.0 ||
                           !(height_m >= kLowestGround_m && height_m <= kHighestGround_m);
      if (is_void || !std::isnan(target[i])) {
        continue;
      }
      if (file.shift) {
        double x = file.affine.x(first_column + i + 0.5, row + 0.5);
        double y = file.affine.y(first_column + i + 0.5, row + 0.5);
        height_m =
            file.to_geodetic->Transform(1, &x, &y)
                ? height_m + file.shift->at_m({radians_from_degrees(y), radians_from_degrees(x)})
                : static_cast<double>(kUnknown);
      }
      target[i] = static_cast<float>(height_m);
      if (!samples.files.empty()) {
        samples.files[begin + static_cast<std::size_t>(i)] = static_cast<std::uint16_t>(number);
      }
    }
  }
}

float rounded_up(double value_m) { return static_cast<float>(std::ceil(value_m * 64.0) / 64.0); }

}  // namespace

struct ElevationSource::Impl {
  double void_fill_radius_m = 0.0;
  std::vector<OpenFile> files;
  std::vector<ElevationFile> facts;
  std::vector<std::vector<std::size_t>> lattices;  // files that belong together, in order

  std::optional<Samples> read_window(const std::vector<std::size_t>& lattice,
                                     const raster::GridGeometry& geometry,
                                     const OGRSpatialReference& map_crs, Observer& observer) const;
  raster::Grid<float> warp(const Samples& samples, const OpenFile& origin,
                           const raster::GridGeometry& geometry, const std::string& crs_wkt,
                           int threads, const ProgressLink& link) const;
  raster::Grid<std::uint16_t> files_of_cells(const Samples& samples, const OpenFile& origin,
                                             const OGRSpatialReference& map_crs,
                                             const raster::GridGeometry& geometry,
                                             Observer& observer) const;
  ElevationLayers merged(const raster::GridGeometry& geometry, const std::string& crs_wkt,
                         int threads, Observer& observer) const;
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
  samples.first_file = static_cast<std::uint16_t>(lattice.front());
  if (lattice.size() > 1) {
    samples.files.assign(samples.values_m.size(), samples.first_file);
  }
  for (const std::size_t index : lattice) {
    copy_samples(files[index], index, samples, observer);
  }
  return samples;
}

raster::Grid<float> ElevationSource::Impl::warp(const Samples& samples, const OpenFile& origin,
                                                const raster::GridGeometry& geometry,
                                                const std::string& crs_wkt, int threads,
                                                const ProgressLink& link) const {
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
  raster::Grid<float> result(geometry, kUnknown);
  for (int row = 0; row < geometry.rows; ++row) {
    const float* line = north_up.data() + static_cast<std::size_t>(geometry.rows - 1 - row) *
                                              static_cast<std::size_t>(geometry.columns);
    for (int column = 0; column < geometry.columns; ++column) {
      result.at(column, row) =
          static_cast<float>(std::round(static_cast<double>(line[column]) * 64.0) / 64.0);
    }
  }
  return result;
}

// The file of the sample nearest to each cell's centre.
raster::Grid<std::uint16_t> ElevationSource::Impl::files_of_cells(
    const Samples& samples, const OpenFile& origin, const OGRSpatialReference& map_crs,
    const raster::GridGeometry& geometry, Observer& observer) const {
  raster::Grid<std::uint16_t> result(geometry, samples.first_file);
  if (samples.files.empty()) {
    return result;
  }
  const auto to_source = transformation(map_crs, origin.crs, origin.path);
  const auto width = static_cast<std::size_t>(geometry.columns);
  std::vector<double> x(width);
  std::vector<double> y(width);
  std::vector<int> is_good(width);
  for (int row = 0; row < geometry.rows; ++row) {
    if (row % 8 == 0) {
      observer.check_stop();
    }
    for (int column = 0; column < geometry.columns; ++column) {
      const geo::MapPoint centre = geometry.centre({column, row});
      x[static_cast<std::size_t>(column)] = centre.x_m;
      y[static_cast<std::size_t>(column)] = centre.y_m;
    }
    to_source->Transform(geometry.columns, x.data(), y.data(), nullptr, is_good.data());
    for (int column = 0; column < geometry.columns; ++column) {
      const auto i = static_cast<std::size_t>(column);
      if (is_good[i] == 0) {
        continue;
      }
      const double sample_column = std::floor(samples.affine.column(x[i], y[i]));
      const double sample_row = std::floor(samples.affine.row(x[i], y[i]));
      const auto c =
          static_cast<std::size_t>(std::clamp(sample_column, 0.0, samples.columns - 1.0));
      const auto r = static_cast<std::size_t>(std::clamp(sample_row, 0.0, samples.rows - 1.0));
      result.at(column, row) = samples.files[r * static_cast<std::size_t>(samples.columns) + c];
    }
  }
  return result;
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

std::string_view word_of(ElevationKind kind) {
  return kind == ElevationKind::kTerrain ? "terrain" : "surface";
}

ElevationInput ElevationInput::parse(const std::string& text) {
  std::string rest = text;
  std::optional<ElevationKind> kind;
  std::optional<geo::VerticalDatum> datum;
  std::string crs;
  std::error_code error;
  while (!fs::exists(rest, error)) {
    const std::size_t key = std::max(rest.rfind(":datum=") + 1, rest.rfind(":crs=") + 1);
    if (ends_with(rest, ":terrain") || ends_with(rest, ":surface")) {
      kind = ends_with(rest, ":terrain") ? ElevationKind::kTerrain : ElevationKind::kSurface;
      rest.resize(rest.size() - 8);
    } else if (key > 1 && rest.find('/', key) == std::string::npos) {
      const std::string value = rest.substr(rest.find('=', key) + 1);
      if (rest[key] == 'd') {
        datum = geo::VerticalDatum::parse(value);
      } else {
        crs = value;
      }
      rest.resize(key - 1);
    } else {
      break;
    }
  }
  ElevationInput input{fs::path(rest)};
  input.kind = kind;
  input.datum = datum;
  input.crs = crs;
  return input;
}

ElevationSource::ElevationSource(const std::vector<ElevationInput>& inputs,
                                 const geo::VerticalDatum& map_datum, double void_fill_radius_m)
    : impl_(std::make_unique<Impl>()) {
  GDALAllRegister();
  if (inputs.empty()) {
    throw UsageError("no elevation file is given", "add at least one with --dem");
  }
  constexpr std::size_t kFilesMax = 60000;
  if (inputs.size() > kFilesMax) {
    throw UsageError("more than 60000 elevation files are given",
                     "join them to a virtual mosaic with gdalbuildvrt");
  }
  impl_->void_fill_radius_m = void_fill_radius_m;
  for (const ElevationInput& input : inputs) {
    impl_->files.push_back(open_file(input, map_datum));
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

namespace {

// Fills holes; see the header. What is filled in here is no known cell for its neighbours.
void fill_holes(ElevationLayers& layers, double radius_m, Observer& observer) {
  const raster::GridGeometry& g = layers.terrain_m.geometry();
  struct Direction {
    int columns, rows;
    double step_m;
  };
  const std::array<Direction, 4> directions = {{{1, 0, g.cell_m},
                                                {0, 1, g.cell_m},
                                                {1, 1, g.cell_m * std::sqrt(2.0)},
                                                {1, -1, g.cell_m * std::sqrt(2.0)}}};
  struct Filling {
    std::size_t index;
    float terrain_m;
    float upper_m;
  };
  std::vector<Filling> fillings;
  for (int row = 0; row < g.rows; ++row) {
    if (row % 8 == 0) {
      observer.check_stop();
    }
    for (int column = 0; column < g.columns; ++column) {
      if (!std::isnan(layers.terrain_m.at(column, row))) {
        continue;
      }
      int pairs = 0;
      double sum = 0.0;
      double weights = 0.0;
      float highest_m = -std::numeric_limits<float>::infinity();
      for (const Direction& direction : directions) {
        std::array<std::optional<raster::CellIndex>, 2> ends;
        std::array<double, 2> distances_m{};
        for (const int sign : {-1, 1}) {
          const auto end = static_cast<std::size_t>(sign > 0 ? 1 : 0);
          for (int step = 1; step * direction.step_m <= radius_m; ++step) {
            const raster::CellIndex cell{column + sign * step * direction.columns,
                                         row + sign * step * direction.rows};
            if (!g.contains(cell)) {
              break;
            }
            if (!std::isnan(layers.terrain_m.at(cell))) {
              ends[end] = cell;
              distances_m[end] = step * direction.step_m;
              break;
            }
          }
        }
        if (!ends[0] || !ends[1]) {
          continue;
        }
        ++pairs;
        const double weight = 1.0 / (distances_m[0] + distances_m[1]);
        sum += weight * weight *
               (static_cast<double>(layers.terrain_m.at(*ends[0])) * distances_m[1] +
                static_cast<double>(layers.terrain_m.at(*ends[1])) * distances_m[0]);
        weights += weight;
        for (const auto& end : ends) {
          highest_m = std::max(highest_m, layers.upper_terrain_m.at(*end));
        }
      }
      if (pairs >= 2) {
        const double terrain_m = std::round(sum / weights * 64.0) / 64.0;
        fillings.push_back({static_cast<std::size_t>(row) * static_cast<std::size_t>(g.columns) +
                                static_cast<std::size_t>(column),
                            static_cast<float>(terrain_m), highest_m});
      }
    }
  }
  for (const Filling& filling : fillings) {
    layers.terrain_m.values()[filling.index] = filling.terrain_m;
    layers.upper_terrain_m.values()[filling.index] = std::max(filling.upper_m, filling.terrain_m);
    layers.source.values()[filling.index] = ElevationLayers::kFilled;
  }
}

}  // namespace

ElevationLayers ElevationSource::Impl::merged(const raster::GridGeometry& geometry,
                                              const std::string& crs_wkt, int threads,
                                              Observer& observer) const {
  OGRSpatialReference map_crs;
  if (map_crs.importFromWkt(crs_wkt.c_str()) != OGRERR_NONE) {
    throw std::invalid_argument("on_grid: not a coordinate system: " + crs_wkt);
  }
  map_crs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  constexpr std::uint16_t kNone = 65535;
  ElevationLayers layers;
  layers.terrain_m = raster::Grid<float>(geometry, kUnknown);
  layers.is_surface = raster::Grid<std::uint8_t>(geometry, 0);
  layers.source = raster::Grid<std::uint16_t>(geometry, 0);
  raster::Grid<std::int32_t> owner(geometry, -1);      // lattice that each cell's height comes from
  raster::Grid<std::uint16_t> first(geometry, kNone);  // file that each cell's height comes from
  const auto is_surface = [&](std::size_t lattice) {
    return files[lattices[lattice].front()].facts.kind == ElevationKind::kSurface;
  };
  bool has_surface = false;
  bool has_terrain = false;
  for (std::size_t i = 0; i < lattices.size(); ++i) {
    (is_surface(i) ? has_surface : has_terrain) = true;
  }
  // The ground below surfaces, of terrain files alone.
  raster::Grid<float> ground_m;
  raster::Grid<std::uint16_t> first_ground;
  if (has_surface && has_terrain) {
    ground_m = raster::Grid<float>(geometry, kUnknown);
    first_ground = raster::Grid<std::uint16_t>(geometry, kNone);
  }
  const double share = 1.0 / static_cast<double>(lattices.size());
  std::vector<std::optional<Samples>> windows;
  observer.progress(kStage, 0.0, 1.0);
  for (std::size_t i = 0; i < lattices.size(); ++i) {
    observer.check_stop();
    const OpenFile& origin = files[lattices[i].front()];
    windows.push_back(read_window(lattices[i], geometry, map_crs, observer));
    if (!windows.back()) {
      continue;
    }
    const raster::Grid<float> heights_m =
        warp(*windows.back(), origin, geometry, crs_wkt, threads,
             {&observer, share * static_cast<double>(i), 0.6 * share});
    const raster::Grid<std::uint16_t> numbers =
        files_of_cells(*windows.back(), origin, map_crs, geometry, observer);
    for (std::size_t cell = 0; cell < geometry.cell_count(); ++cell) {
      const float height_m = heights_m.values()[cell];
      const std::uint16_t number = numbers.values()[cell];
      if (std::isnan(height_m)) {
        continue;
      }
      if (number < first.values()[cell]) {
        first.values()[cell] = number;
        layers.terrain_m.values()[cell] = height_m;
        owner.values()[cell] = static_cast<std::int32_t>(i);
        layers.is_surface.values()[cell] = is_surface(i) ? 1 : 0;
        layers.source.values()[cell] = static_cast<std::uint16_t>(number + 1);
      }
      if (!ground_m.is_empty() && !is_surface(i) && number < first_ground.values()[cell]) {
        first_ground.values()[cell] = number;
        ground_m.values()[cell] = height_m;
      }
    }
  }
  layers.upper_terrain_m = layers.terrain_m;
  for (const bool over_bilinear : {false, true}) {
    const raster::Grid<float> base_m = layers.upper_terrain_m;
    for (std::size_t i = 0; i < lattices.size(); ++i) {
      if (windows[i]) {
        raise_to_samples(*windows[i], files[lattices[i].front()], map_crs, over_bilinear,
                         static_cast<int>(i), owner, base_m, layers.upper_terrain_m, observer);
      }
    }
  }
  for (std::size_t cell = 0; cell < (ground_m.is_empty() ? 0 : geometry.cell_count()); ++cell) {
    if (layers.is_surface.values()[cell] != 0 && !std::isnan(ground_m.values()[cell])) {
      layers.terrain_m.values()[cell] =
          std::min(layers.terrain_m.values()[cell], ground_m.values()[cell]);
    }
  }
  fill_holes(layers, void_fill_radius_m, observer);
  observer.progress(kStage, 1.0, 1.0);
  return layers;
}

namespace {

template <typename T>
raster::Grid<T> inner_part(const raster::Grid<T>& grid, const raster::GridGeometry& geometry,
                           int margin) {
  raster::Grid<T> result(geometry, T{});
  for (int row = 0; row < geometry.rows; ++row) {
    std::copy_n(grid.row(row + margin) + margin, geometry.columns, result.row(row));
  }
  return result;
}

}  // namespace

ElevationLayers ElevationSource::on_grid(const raster::GridGeometry& geometry,
                                         const std::string& crs_wkt, int threads,
                                         Observer& observer) const {
  const GdalErrors silent;
  // What a cell needs of its neighbours: filling looks as far as its radius, raising one cell.
  const int margin = 2 + static_cast<int>(std::ceil(impl_->void_fill_radius_m / geometry.cell_m));
  const raster::GridGeometry wide{geometry.west_m - margin * geometry.cell_m,
                                  geometry.south_m - margin * geometry.cell_m, geometry.cell_m,
                                  geometry.columns + 2 * margin, geometry.rows + 2 * margin};
  const ElevationLayers layers = impl_->merged(wide, crs_wkt, threads, observer);
  ElevationLayers result;
  result.terrain_m = inner_part(layers.terrain_m, geometry, margin);
  result.upper_terrain_m = inner_part(layers.upper_terrain_m, geometry, margin);
  result.is_surface = inner_part(layers.is_surface, geometry, margin);
  result.source = inner_part(layers.source, geometry, margin);
  return result;
}

}  // namespace hedgehop::map_sources
