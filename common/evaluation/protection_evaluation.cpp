#include "evaluation/protection_evaluation.hpp"

#include <algorithm>
#include <cmath>
#include <cpl_error.h>
#include <gdal_alg.h>
#include <gdal_priv.h>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>

#include "base/errors.hpp"
#include "evaluation/paired_statistics.hpp"
#include "geo/gdal_guards.hpp"

namespace hedgehop::evaluation {
namespace {

using preparation::VisibilityExecution;
using preparation::VisibilityGround;
using preparation::VisibilityLayers;
using preparation::VisibilityOptions;

constexpr int kSideMin = 100;
constexpr int kExposureErrorShare = 5;

ErrorStatistics statistics_of(const std::vector<double>& errors) {
  ErrorStatistics statistics;
  statistics.cells = static_cast<std::int64_t>(errors.size());
  if (errors.empty()) {
    return statistics;
  }
  std::vector<double> sizes;
  const auto count = static_cast<double>(errors.size());
  statistics.bias = 0.0;
  statistics.mean_abs = 0.0;
  for (const double error : errors) {
    statistics.bias += error / count;
    statistics.mean_abs += std::fabs(error) / count;
    sizes.push_back(std::fabs(error));
  }
  statistics.p95_abs = quantile_of(sizes, 0.95);
  statistics.max_abs = quantile_of(sizes, 1.0);
  return statistics;
}

using geo::DatasetPointer;

// The surface around a cell, for GDAL.
DatasetPointer window_around(const raster::Grid<float>& surface_m, raster::CellIndex cell,
                             int reach) {
  const raster::GridGeometry& g = surface_m.geometry();
  const int column = std::max(cell.column - reach, 0);
  const int row = std::max(cell.row - reach, 0);
  const int columns = std::min(cell.column + reach + 1, g.columns) - column;
  const int rows = std::min(cell.row + reach + 1, g.rows) - row;
  DatasetPointer dataset(GetGDALDriverManager()->GetDriverByName("MEM")->Create(
      "", columns, rows, 1, GDT_Float32, nullptr));
  HEDGEHOP_ASSERT(dataset != nullptr);
  std::array<double, 6> transform = {g.west_m + column * g.cell_m,        g.cell_m, 0.0,
                                     g.south_m + (row + rows) * g.cell_m, 0.0,      -g.cell_m};
  dataset->SetGeoTransform(transform.data());
  std::vector<float> line(static_cast<std::size_t>(columns));
  for (int r = 0; r < rows; ++r) {
    std::copy_n(surface_m.row(row + r) + column, columns, line.begin());
    // GDAL knows no unknown ground here: deep holes hide nothing.
    std::replace_if(
        line.begin(), line.end(), [](float z) { return std::isnan(z); }, -20000.0F);
    const CPLErr written = dataset->GetRasterBand(1)->RasterIO(
        GF_Write, 0, rows - 1 - r, columns, 1, line.data(), columns, 1, GDT_Float32, 0, 0, nullptr);
    HEDGEHOP_ASSERT(written == CE_None);
  }
  return dataset;
}

// Share of the cells within the radius that GDAL calls visible.
double gdal_share(GDALDataset& window, const geo::MapPoint& eye, const VisibilityOptions& options) {
  const double curvature = options.is_earth_curved ? 1.0 - options.refraction : 0.0;
  constexpr double kSeen = 255.0;
  constexpr double kHidden = 0.0;
  constexpr double kOutside = 100.0;
  const DatasetPointer viewshed(GDALDataset::FromHandle(GDALViewshedGenerate(
      GDALRasterBand::ToHandle(window.GetRasterBand(1)), "MEM", "", nullptr, eye.x_m, eye.y_m,
      options.reference_height_m, 0.0, kSeen, kHidden, kOutside, -1.0, curvature, GVM_Edge,
      options.radius_m, nullptr, nullptr, GVOT_NORMAL, nullptr)));
  if (!viewshed) {
    throw SystemFailure(std::string("GDAL's viewshed failed: ") + CPLGetLastErrorMsg());
  }
  GDALRasterBand* band = viewshed->GetRasterBand(1);
  std::vector<GByte> cells(static_cast<std::size_t>(band->GetXSize()) *
                           static_cast<std::size_t>(band->GetYSize()));
  const CPLErr read =
      band->RasterIO(GF_Read, 0, 0, band->GetXSize(), band->GetYSize(), cells.data(),
                     band->GetXSize(), band->GetYSize(), GDT_Byte, 0, 0, nullptr);
  HEDGEHOP_ASSERT(read == CE_None);
  const auto seen = std::count(cells.begin(), cells.end(), static_cast<GByte>(kSeen));
  const auto hidden = std::count(cells.begin(), cells.end(), static_cast<GByte>(kHidden));
  return static_cast<double>(seen) / static_cast<double>(std::max<std::int64_t>(seen + hidden, 1));
}

struct Block {
  raster::CellIndex corner;
  int columns = 0;
  int rows = 0;
};

class Evaluation {
 public:
  Evaluation(const map::Map& map, const VisibilityOptions& visibility,
             const ProtectionOptions& options, const VisibilityExecution& execution,
             const ProcessMeters& meters, Observer& observer)
      : map_(&map),
        visibility_(visibility),
        options_(&options),
        execution_(execution),
        meters_(&meters),
        observer_(&observer) {
    visibility_.further_heights_m.clear();
    const raster::GridGeometry& g = map.geometry;
    const int reach = static_cast<int>(std::ceil(visibility.radius_m / g.cell_m)) + 2;
    block_ = {{0, 0}, g.columns, g.rows};
    if (std::min(g.columns, g.rows) - 2 * reach >= kSideMin) {
      block_ = {{reach, reach}, g.columns - 2 * reach, g.rows - 2 * reach};
      result_.is_surroundings_complete = true;
    }
    result_.timed_cells = std::int64_t{block_.columns} * block_.rows;
  }

  ProtectionResult run(std::uint64_t seed) {
    result_.seed = seed;
    result_.simd = preparation::name_of_simd(execution_.simd);
    result_.threads = execution_.threads;
    result_.azimuths = visibility_.azimuths;
    const double bytes_before = meters_->peak_bytes();
    const VisibilityLayers layers = timed(visibility_, execution_, result_.cpu_s_per_million_cells);
    result_.memory_bytes_per_cell =
        (meters_->peak_bytes() - bytes_before) / static_cast<double>(result_.timed_cells);
    try {
      timed(visibility_, {1, execution_.simd}, result_.one_thread_cpu_s_per_million_cells);
      compare(layers, seed);
      observer_->check_stop();
      update();
      exposure(seed);
    } catch (const Interrupted&) {
      result_.is_stopped = true;
    }
    return result_;
  }

 private:
  [[nodiscard]] VisibilityGround ground() const { return {map_->surface_m, map_->surface_m}; }

  VisibilityLayers timed(const VisibilityOptions& visibility, const VisibilityExecution& execution,
                         double& cpu_s_per_million_cells) {
    const double before_s = meters_->cpu_s();
    VisibilityLayers layers = preparation::visibility_of_block(
        ground(), block_.corner, block_.columns, block_.rows, visibility, execution, *observer_);
    cpu_s_per_million_cells =
        (meters_->cpu_s() - before_s) / (1e-6 * static_cast<double>(result_.timed_cells));
    return layers;
  }

  // Known cells of the block, drawn evenly; the same seed gives the same cells.
  std::vector<raster::CellIndex> drawn(std::uint64_t seed, std::int64_t count) const {
    std::vector<raster::CellIndex> known;
    for (int row = 0; row < block_.rows; ++row) {
      for (int column = 0; column < block_.columns; ++column) {
        const raster::CellIndex cell{block_.corner.column + column, block_.corner.row + row};
        if (!std::isnan(map_->surface_m.at(cell))) {
          known.push_back(cell);
        }
      }
    }
    if (known.empty()) {
      throw DataError("the map knows no elevation where visibility would be evaluated",
                      "evaluate another map");
    }
    std::mt19937_64 random(seed);
    std::vector<raster::CellIndex> cells;
    for (std::int64_t i = 0; i < count; ++i) {
      cells.push_back(known[random() % known.size()]);
    }
    return cells;
  }

  [[nodiscard]] double share_at(const raster::Grid<std::uint16_t>& shares,
                                raster::CellIndex cell) const {
    return map::visibility_share(
        shares.at(cell.column - block_.corner.column, cell.row - block_.corner.row));
  }

  void compare(const VisibilityLayers& layers, std::uint64_t seed) {
    const std::vector<raster::CellIndex> cells = drawn(seed, options_->error_cells);
    const int reach = static_cast<int>(std::ceil(visibility_.radius_m / map_->geometry.cell_m)) + 1;
    GDALAllRegister();
    std::vector<double> errors;
    double gdal_cpu_s = 0.0;
    double gdal_sum = 0.0;
    for (const raster::CellIndex& cell : cells) {
      if (observer_->stop_requested()) {
        break;
      }
      observer_->progress("brute force", static_cast<double>(errors.size()),
                          static_cast<double>(cells.size()));
      const double exact = preparation::reference_visibility_share(
          ground(), cell, visibility_.reference_height_m, visibility_);
      const double share = share_at(layers.shares[0], cell);
      if (std::isnan(exact) || std::isnan(share)) {
        continue;  // nothing around it is known
      }
      errors.push_back(share - exact);
      if (result_.gdal_cells < options_->gdal_cells) {
        const DatasetPointer window = window_around(map_->surface_m, cell, reach);
        const double before_s = meters_->cpu_s();
        const double gdal = gdal_share(*window, map_->geometry.centre(cell), visibility_);
        gdal_cpu_s += meters_->cpu_s() - before_s;
        gdal_sum += std::fabs(gdal - exact);
        ++result_.gdal_cells;
      }
    }
    if (!observer_->stop_requested()) {
      observer_->progress("brute force", 1.0, 1.0);
    }
    result_.error = statistics_of(errors);
    if (result_.gdal_cells > 0) {
      const auto count = static_cast<double>(result_.gdal_cells);
      result_.gdal_cpu_s_per_million_cells = 1e6 * gdal_cpu_s / count;
      result_.gdal_mean_abs_error = gdal_sum / count;
    }
  }

  // A patch in the middle rises by 20 m.
  void update() {
    const int side = static_cast<int>(std::min<std::int64_t>(
        options_->patch_cells, std::min(map_->geometry.columns, map_->geometry.rows)));
    const preparation::CellRectangle patch{(map_->geometry.columns - side) / 2,
                                           (map_->geometry.rows - side) / 2, side, side};
    raster::Grid<float> surface_m = map_->surface_m;
    for (int row = patch.row; row < patch.row + side; ++row) {
      for (int column = patch.column; column < patch.column + side; ++column) {
        surface_m.at(column, row) += 20.0F;
      }
    }
    const VisibilityGround changed{surface_m, surface_m};
    // The layers of before once more, as sums are not kept in passing.
    preparation::VisibilitySums sums;
    VisibilityLayers layers =
        preparation::visibility_of_block(ground(), block_.corner, block_.columns, block_.rows,
                                         visibility_, execution_, *observer_, nullptr, &sums);
    const double before_s = meters_->cpu_s();
    preparation::update_visibility_of_block(ground(), changed, block_.corner, patch, visibility_,
                                            execution_, *observer_, layers, sums);
    result_.update_cpu_s = meters_->cpu_s() - before_s;
    const VisibilityLayers full = preparation::visibility_of_block(
        changed, block_.corner, block_.columns, block_.rows, visibility_, execution_, *observer_);
    result_.is_update_exact = full.shares[0].values() == layers.shares[0].values() &&
                              full.is_partial.values() == layers.is_partial.values();
  }

  void exposure(std::uint64_t seed) {
    if (options_->further_heights_m.empty()) {
      return;
    }
    VisibilityOptions volume = visibility_;
    volume.further_heights_m = options_->further_heights_m;
    const VisibilityLayers layers =
        timed(volume, execution_, result_.exposure_cpu_s_per_million_cells);
    result_.exposure_ratio =
        result_.exposure_cpu_s_per_million_cells / result_.cpu_s_per_million_cells;
    result_.exposure_heights_m = volume.further_heights_m;
    const std::vector<raster::CellIndex> cells =
        drawn(seed, options_->error_cells / kExposureErrorShare);
    for (std::size_t i = 0; i < volume.further_heights_m.size(); ++i) {
      std::vector<double> errors;
      for (const raster::CellIndex& cell : cells) {
        observer_->check_stop();
        const double exact = preparation::reference_visibility_share(
            ground(), cell, volume.further_heights_m[i], volume);
        const double share = share_at(layers.shares[i + 1], cell);
        if (!std::isnan(exact) && !std::isnan(share)) {
          errors.push_back(share - exact);
        }
      }
      result_.exposure_errors.push_back(statistics_of(errors));
    }
  }

  const map::Map* map_;
  VisibilityOptions visibility_;
  const ProtectionOptions* options_;
  VisibilityExecution execution_;
  const ProcessMeters* meters_;
  Observer* observer_;
  Block block_;
  ProtectionResult result_;
};

nlohmann::ordered_json json_of(const ErrorStatistics& error) {
  return {{"cells", error.cells},
          {"mean_abs", error.mean_abs},
          {"p95_abs", error.p95_abs},
          {"max_abs", error.max_abs},
          {"bias", error.bias}};
}

}  // namespace

ProtectionOptions read_protection_options(ConfigReader& reader) {
  ProtectionOptions options;
  const auto within = [&](const char* key, std::int64_t low, std::int64_t high) {
    const std::int64_t value = reader.required_integer(key);
    reader.require(value >= low && value <= high, key,
                   "must lie in " + std::to_string(low) + " to " + std::to_string(high));
    return value;
  };
  options.error_cells = within("error_cells", 1, 1'000'000);
  options.gdal_cells = within("gdal_cells", 0, 1'000'000);
  options.patch_cells = within("patch_cells", 1, 10'000);
  options.further_heights_m = reader.required_doubles("further_heights_m");
  for (const double height_m : options.further_heights_m) {
    reader.require(height_m >= 0.0 && height_m <= 10000.0, "further_heights_m",
                   "must lie in 0 to 10000");
  }
  reader.finish();
  return options;
}

ProtectionResult evaluate_protection(const map::Map& map, const VisibilityOptions& visibility,
                                     const ProtectionOptions& options,
                                     const VisibilityExecution& execution, std::uint64_t seed,
                                     const ProcessMeters& meters, Observer& observer) {
  if (!preparation::is_available(execution.simd)) {
    throw UsageError("this processor lacks the instructions that --simd asks for",
                     "leave --simd out; the widest set there is will be used");
  }
  return Evaluation(map, visibility, options, execution, meters, observer).run(seed);
}

std::string protection_result_json(const ProtectionResult& result) {
  nlohmann::ordered_json json;
  json["schema"] = "hedgehop evaluate protection";
  json["schema_version"] = 1;
  json["seed"] = result.seed;
  json["is_stopped"] = result.is_stopped;
  json["azimuths"] = result.azimuths;
  json["simd"] = result.simd;
  json["threads"] = result.threads;
  json["timed_cells"] = result.timed_cells;
  json["surroundings_complete"] = result.is_surroundings_complete;
  json["cpu_s_per_million_cells"] = result.cpu_s_per_million_cells;
  json["one_thread_cpu_s_per_million_cells"] = result.one_thread_cpu_s_per_million_cells;
  json["memory_bytes_per_cell"] = result.memory_bytes_per_cell;
  json["error"] = json_of(result.error);
  json["gdal"] = {{"cells", result.gdal_cells},
                  {"cpu_s_per_million_cells", result.gdal_cpu_s_per_million_cells},
                  {"mean_abs_error", result.gdal_mean_abs_error}};
  json["update"] = {
      {"cpu_s", result.update_cpu_s},
      {"same_bytes", result.is_update_exact ? nlohmann::ordered_json(*result.is_update_exact)
                                            : nlohmann::ordered_json(nullptr)}};
  nlohmann::ordered_json exposure;
  exposure["cpu_s_per_million_cells"] = result.exposure_cpu_s_per_million_cells;
  exposure["ratio_to_one_height"] = result.exposure_ratio;
  exposure["heights"] = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < result.exposure_errors.size(); ++i) {
    exposure["heights"].push_back({{"height_m", result.exposure_heights_m[i]},
                                   {"error", json_of(result.exposure_errors[i])}});
  }
  json["exposure"] = std::move(exposure);
  return json.dump(2) + "\n";
}

}  // namespace hedgehop::evaluation
