#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "local_planning/polar_geometry.hpp"

/// The inner loops of a step of the local planner: SIMD, chosen at run time.
namespace hedgehop::local_planning {

/// What computes a step. All give the same bits; kBest is the widest instructions there are, kPlain
/// the straightforward form that the others are measured against.
enum class Kernel : std::uint8_t { kBest, kPlain, kAvx2, kAvx512 };

/// "avx512", "avx2", "plain" or the name of a lesser set of instructions.
const char* name_of_kernel(Kernel kernel);
/// Whether processor and build offer it.
bool is_available(Kernel kernel);

/// A run of cells in one row of the window.
struct PolarRow {
  std::int32_t first = 0;    // cell of the raster, from the one that holds the viewpoint
  std::int32_t vectors = 0;  // of kLanes cells
};

/// What one cell beyond the disc adds to, packed: its number in the order of the rows, its first
/// sector, the one after its last sector (1..K), its window of sectors.
struct PolarEntry {
  static std::uint64_t packed(std::uint64_t cell, std::uint64_t low, std::uint64_t end,
                              std::uint64_t slot) {
    return cell | low << 16U | end << 32U | slot << 48U;
  }
  static std::uint64_t cell(std::uint64_t entry) { return entry & 0xffffU; }
  static std::uint64_t low(std::uint64_t entry) { return entry >> 16U & 0xffffU; }
  static std::uint64_t end(std::uint64_t entry) { return entry >> 32U & 0xffffU; }
  static std::uint64_t slot(std::uint64_t entry) { return entry >> 48U; }
};
struct PolarSlot {
  std::uint16_t cell = 0;
  std::uint16_t slot = 0;
};

/// The window as seen from one sub-cell.
struct PolarTable {
  std::vector<PolarRow> rows;
  std::vector<float> distance_m;  // by row, kFarAway_m beside the window
  std::vector<float> azimuth_rad;
  std::vector<std::uint64_t> entries;  // PolarEntry
  std::vector<PolarSlot> further;      // second windows
  std::vector<std::uint16_t> wrapped;  // cells whose sectors go on at 0
  std::vector<std::uint16_t> near;     // cells within the disc
};
inline constexpr float kFarAway_m = 1e9F;

/// Memory of a histogram, aligned by its users.
struct HistogramScratch {
  std::vector<float> tangents;        // by cell of the rows
  std::vector<std::uint64_t> shares;  // likewise: weighted risk * 2^32 + weight
  std::vector<float> windows;         // greatest tangents, by slot
  std::vector<float> wide;            // two turns of one width
  std::vector<std::uint64_t> differences;
  std::vector<PolarRow> ahead;
  std::vector<std::int32_t> mask_sectors;
  std::vector<float> mask_tangents;
};

struct HistogramTask {
  const PolarConstants* constants = nullptr;
  const PolarQuestion* question = nullptr;
  const PolarTable* table = nullptr;
  const float* surface_m = nullptr;  // at the cell that holds the viewpoint
  const float* risk = nullptr;       // likewise
  const int* widths = nullptr;
  int width_count = 0;
  int sectors = 0;
  int heading_sector = 0;
  float* tan_climb = nullptr;  // out, as in PolarHistogram
  float* tan_masked = nullptr;
  float* tan_mask = nullptr;
  float* risk_of_sectors = nullptr;
  float* risk_weight = nullptr;
  float tan_climb_near = 0.0F;
};

/// Cost of each direction and the cheapest one, see cheapest_direction_rad().
struct DirectionTask {
  const float* tan_masked = nullptr;
  const float* risk = nullptr;
  const float* risk_weight = nullptr;
  const float* centre_rad = nullptr;  // of the sectors, in [0, 2 pi)
  float* polar = nullptr;             // scratch
  int sectors = 0;
  int goal_sector = 0;
  bool is_quadratic = false;
  float goal_weight = 0.0F;
  float climb_weight = 0.0F;
  float climb_relative_weight = 0.0F;
  float polar_offset = 0.0F;
  float heading_rad = 0.0F;  // in [0, 2 pi)
  float goal_rad = 0.0F;     // in [0, 2 pi)
  float goal_tangent = 0.0F;
  float tangent_min = 0.0F;
  float tangent_max = 0.0F;
  float polar_share = 0.0F;
};
/// What cheapest() answers instead of a sector.
inline constexpr int kGoalDirection = -1;
inline constexpr int kNoDirection = -2;

/// The flight of the next seconds and the climb rate that it needs, see ClimbForecast.
struct ForecastTask {
  int samples = 0;
  const float* bearing_rad = nullptr;  // of the guide's target, by place along the guide
  const float* altitude_m = nullptr;   // of the guide, likewise
  int table_count = 0;
  float from_in_table = 0.0F;
  float step_in_table = 0.0F;
  float end_in_table = 0.0F;  // places beyond do not count
  float wanted_rad = 0.0F;    // commanded heading less the present one
  float bearing_now_rad = 0.0F;
  float beside_rad = 0.0F;  // direction to the target less the bearing of the guide
  float fading = 0.0F;      // of the latter in one sample
  float sample_s = 0.0F;
  float gain = 0.0F;
  float turn_max_radps = 0.0F;
  float turn_radps = 0.0F;
  float roll_share = 0.0F;
  int column = 0;  // cell that holds the place
  int row = 0;
  float part_of_column = 0.0F;
  float part_of_row = 0.0F;
  float east_cells = 0.0F;  // one sample straight on
  float north_cells = 0.0F;
  int columns = 0;
  int rows = 0;
  const float* dilated_m = nullptr;  // cell (0, 0)
  float floor_m = 0.0F;              // altitude less the safety height
  float guide_floor_m = 0.0F;        // altitude plus the allowance
  float climb_rate_mps = 0.0F;
  float acceleration_mps2 = 0.0F;
  float response_s = 0.0F;
  float rate_max_mps = 0.0F;
  float rate_min_mps = 0.0F;
  float greatest_mps = 0.0F;        // out, at least rate_min_mps
  float greatest_later_mps = 0.0F;  // out, of places that braking still helps
};
inline constexpr float kBrakingHelpsAfter_s = 2.0F;

struct StepKernels {
  void (*histogram)(HistogramTask& task, HistogramScratch& scratch) = nullptr;
  int (*cheapest)(const DirectionTask& task) = nullptr;
  void (*forecast)(ForecastTask& task, std::vector<float>& scratch) = nullptr;
};
/// Asking the processor is slow, so ask once. For kPlain those of kBest: what has a plain form
/// elsewhere is called there.
/// @throws std::invalid_argument  if it is not available.
StepKernels step_kernels(Kernel kernel);

}  // namespace hedgehop::local_planning
