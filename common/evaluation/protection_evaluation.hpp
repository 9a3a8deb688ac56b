#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "map/map.hpp"
#include "preparation/visibility.hpp"

namespace hedgehop::evaluation {

/// Section `protection` of the evaluation config.
struct ProtectionOptions {
  std::int64_t error_cells = 0;           // compared with brute force
  std::int64_t gdal_cells = 0;            // of these also done by GDAL's viewshed
  std::int64_t patch_cells = 0;           // side of the patch whose update is timed
  std::vector<double> further_heights_m;  // of the exposure volume that is timed
};
ProtectionOptions read_protection_options(ConfigReader& reader);

/// Readings of the process, from the caller, since rooms own no clock.
struct ProcessMeters {
  std::function<double()> cpu_s;       // of all threads
  std::function<double()> peak_bytes;  // greatest memory so far
};

/// NaN without a cell.
struct ErrorStatistics {
  std::int64_t cells = 0;
  double mean_abs = std::numeric_limits<double>::quiet_NaN();
  double p95_abs = std::numeric_limits<double>::quiet_NaN();
  double max_abs = std::numeric_limits<double>::quiet_NaN();
  double bias = std::numeric_limits<double>::quiet_NaN();  // mean of share - brute force
};

/// What was not measured is NaN.
struct ProtectionResult {
  std::uint64_t seed = 0;
  bool is_stopped = false;  // early: the later measurements are missing, or cover fewer cells
  std::string simd;
  int threads = 0;
  int azimuths = 0;
  std::int64_t timed_cells = 0;
  bool is_surroundings_complete = false;  // of the timed and compared cells
  double cpu_s_per_million_cells = 0.0;
  double one_thread_cpu_s_per_million_cells = std::numeric_limits<double>::quiet_NaN();
  double memory_bytes_per_cell = 0.0;  // peak above what the map needs
  // All heights together, and over that of one height
  double exposure_cpu_s_per_million_cells = std::numeric_limits<double>::quiet_NaN();
  double exposure_ratio = std::numeric_limits<double>::quiet_NaN();
  std::vector<double> exposure_heights_m;
  std::vector<ErrorStatistics> exposure_errors;  // a fifth of the cells, by height
  double update_cpu_s = std::numeric_limits<double>::quiet_NaN();  // of a patch in the middle
  std::optional<bool> is_update_exact;                             // same bytes as a full run
  ErrorStatistics error;
  std::int64_t gdal_cells = 0;
  double gdal_cpu_s_per_million_cells = std::numeric_limits<double>::quiet_NaN();
  double gdal_mean_abs_error = std::numeric_limits<double>::quiet_NaN();
};

/// Times the visibility layer over the map's surface and compares it with brute force and with
/// GDAL's viewshed, all in this process.
///
/// Cells whose surroundings lie inside the map altogether are timed and compared, as long as there
/// are at least 100 x 100 of them; in a smaller map all cells.
///
/// @param execution  threads 0: one for each processor.
/// @throws DataError    the map has no known cell
/// @throws UsageError   this processor lacks the instructions that `simd` asks for
/// @throws Interrupted
ProtectionResult evaluate_protection(const map::Map& map,
                                     const preparation::VisibilityOptions& visibility,
                                     const ProtectionOptions& options,
                                     const preparation::VisibilityExecution& execution,
                                     std::uint64_t seed, const ProcessMeters& meters,
                                     Observer& observer);

std::string protection_result_json(const ProtectionResult& result);

}  // namespace hedgehop::evaluation
