#pragma once

#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

#include "local_planning/polar_geometry.hpp"

/// The inner loops of a step of the local planner: SIMD, chosen at run time.
namespace hedgehop::local_planning {

/// What computes a step. All give the same bits; kBest is the widest
/// instructions there are, kPlain the straightforward form that the others are
/// measured against.
enum class Kernel : std::uint8_t { kBest, kPlain, kAvx2, kAvx512 };

/// "avx512", "avx2", "plain" or the name of a lesser set of instructions.
const char* name_of_kernel(Kernel kernel);
/// Whether processor and build offer it.
bool is_available(Kernel kernel);

/// Memory that vectors of any width are aligned in.
template <typename T>
struct VectorAllocator {
  using value_type = T;
  static constexpr std::align_val_t kAlignment{64};

  VectorAllocator() = default;
  template <typename U>
  VectorAllocator(const VectorAllocator<U>& /*other*/) {}
  T* allocate(std::size_t count) {
    return static_cast<T*>(::operator new(count * sizeof(T), kAlignment));
  }
  void deallocate(T* memory, std::size_t /*count*/) { ::operator delete(memory, kAlignment); }
  bool operator==(const VectorAllocator& /*other*/) const { return true; }
};
template <typename T>
using Aligned = std::vector<T, VectorAllocator<T>>;

/// What one cell beyond the disc adds to when risks are summed: its number in the order of the
/// runs, its first sector, the one after its last sector (1..K).
struct PolarEntry {
  std::uint32_t cell = 0;
  std::uint16_t low = 0;
  std::uint16_t end = 0;
};
/// The same for climbs: the window of sectors that begins at its first one.
struct PolarSlot {
  std::uint16_t cell = 0;
  std::uint16_t slot = 0;
};

/// The window as seen from one sub-cell, in runs of kLanes neighbours in a row.
struct PolarTable {
  std::vector<std::int32_t>
      runs;                   // first cell of the raster, from the one that holds the viewpoint
  Aligned<float> distance_m;  // by cell of the runs, kFarAway_m beside the window
  Aligned<float> azimuth_rad;
  Aligned<float> rise_1pm;
  Aligned<float> fall_1pm;
  // Of cells beyond the disc, by run: azimuths lie within the spread of the middle.
  Aligned<float> middle_rad;
  Aligned<float> spread_rad;  // with a margin for rounding; below -2 pi where there are none
  Aligned<float> farthest_m;
  std::vector<std::uint16_t> truncated;  // runs with cells that may be left out beside the heading
  std::vector<PolarSlot> slots;          // for climbs
  std::vector<PolarEntry> entries;       // for risks
  std::vector<std::uint16_t> wrapped;    // cells whose sectors go on at 0
  std::vector<std::uint16_t> near;       // cells within the disc
};
inline constexpr float kFarAway_m = 1e9F;

/// Memory of a histogram, aligned by its users.
struct HistogramScratch {
  Aligned<float> tangents;        // by cell of the runs
  Aligned<std::uint64_t> shares;  // likewise: weighted risk * 2^32 + weight
  Aligned<float> windows;         // greatest tangents, by slot
  Aligned<float> wide;            // turns of one width
  Aligned<std::uint64_t> differences;
  Aligned<std::int32_t> ahead;    // runs
  Aligned<float> ahead_distance;  // of cells that may mask
  Aligned<float> ahead_turned;
  Aligned<float> ahead_height;
  Aligned<std::int32_t> mask_sectors;
  Aligned<float> mask_tangents;
  Aligned<float> masks;
};

struct HistogramTask {
  const PolarConstants* constants = nullptr;
  const PolarQuestion* question = nullptr;
  const PolarTable* table = nullptr;
  const float* surface_m = nullptr;  // at the cell that holds the viewpoint
  const int* widths = nullptr;
  int width_count = 0;
  int sectors = 0;
  int heading_sector = 0;
  float* tan_climb = nullptr;  // out, as in PolarHistogram
  float* tan_masked = nullptr;
  float* tan_mask = nullptr;
  float tan_climb_near = 0.0F;
};

struct RiskTask {
  const PolarConstants* constants = nullptr;
  const PolarTable* table = nullptr;
  const float* risk = nullptr;  // at the cell that holds the viewpoint
  int sectors = 0;
  float* sector_risk = nullptr;  // out, as in PolarHistogram
  float* sector_weight = nullptr;
};

/// Cost of each direction and the cheapest one, see cheapest_direction_rad().
struct DirectionTask {
  const float* tan_masked = nullptr;
  const float* tan_needed = nullptr;  // the same, or infinite for a sector that is no candidate
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

/// Sum over the sectors of what cost_torque_rad() adds up, with the other sign.
struct TorqueTask {
  DirectionTask costs;
  float indicator_rad = 0.0F;   // in [0, 2 pi)
  float inverse_width2 = 0.0F;  // 1 / s^2
};

/// The flight of the next seconds and the climb rate that it needs, see
/// ClimbForecast.
struct ForecastTask {
  int samples = 0;
  const float* guide = nullptr;  // by place along it: bearing of its target [rad], altitude [m]
  int table_count = 0;           // places
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
  float east_cells = 0.0F;  // one sample straight on, through the air
  float north_cells = 0.0F;
  float drift_east_cells = 0.0F;  // of the air, in one sample
  float drift_north_cells = 0.0F;
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

/// Headings that are rolled out together.
inline constexpr int kCandidates = 32;
/// The last of them: what was commanded before. The one before that: the goal
/// direction.
inline constexpr int kCommandedCandidate = kCandidates - 1;
inline constexpr int kGoalCandidate = kCandidates - 2;

/// Flights ahead towards several headings, see Rollout.
struct RolloutTask {
  ForecastTask path;                  // wanted_rad is not used; beside it, what one path and all
                                      // of them need
  const float* wanted_rad = nullptr;  // kCandidates headings less the present one
  const std::uint32_t* ground = nullptr;  // packed, at the cell that holds the place
  float step_m = 0.0F;                    // between samples
  float lag_m = 0.0F;                     // flown before a climb begins
  float shortest_m = 0.0F;                // least distance in a climb tangent
  float goal_off_rad = 0.0F;              // goal direction less the present heading
  float before_off_rad = 0.0F;            // heading chosen before less the present one
  bool is_quadratic = false;
  float goal_weight = 0.0F;
  float risk_weight = 0.0F;  // of the mean share of the greatest risk
  float climb_weight = 0.0F;
  float climb_relative_weight = 0.0F;
  float change_weight = 0.0F;
  float goal_tangent = 0.0F;
  float tangent_min = 0.0F;
  float tangent_max = 0.0F;
  float* needed = nullptr;    // out, kCandidates: tangents beyond the lag
  float* risk = nullptr;      // out, kCandidates: sum over the samples [packed units]
  float* near = nullptr;      // out, one: within the lag, along the commanded heading
  int chosen = kNoDirection;  // out: cheapest feasible candidate
};

/// Memory of flights ahead, aligned by its users.
struct FlightScratch {
  Aligned<float> lines;   // along the samples
  Aligned<float> places;  // of the guide, two for each sample
  Aligned<std::int32_t> cells;
  Aligned<std::uint32_t> words;  // of packed ground: candidates of the first sample, of the next
};

struct StepKernels {
  void (*histogram)(HistogramTask& task, HistogramScratch& scratch) = nullptr;
  void (*risk)(const RiskTask& task, HistogramScratch& scratch) = nullptr;
  int (*cheapest)(const DirectionTask& task) = nullptr;
  float (*torque)(const TorqueTask& task) = nullptr;
  void (*forecast)(ForecastTask& task, FlightScratch& scratch) = nullptr;
  void (*rollout)(RolloutTask& task, FlightScratch& scratch) = nullptr;
};
/// Asking the processor is slow, so ask once. For kPlain those of kBest: what
/// has a plain form elsewhere is called there.
/// @throws std::invalid_argument  if it is not available.
StepKernels step_kernels(Kernel kernel);

}  // namespace hedgehop::local_planning
