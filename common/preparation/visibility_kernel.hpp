#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

/// The inner loops of the visibility layer: SIMD across neighbouring observers, chosen at run time.
///
/// Rays of one direction run along lines that are one skewed column each of a small buffer: row R
/// of the raster, shifted so that every line is upright. The buffer is interpolated once and serves
/// the observers of many rows, and the rays of the opposite direction too.
namespace hedgehop::preparation {

/// Which instructions are used; results are the same bytes. kBest is the widest there is.
enum class Simd : std::uint8_t { kBest, kAvx2, kAvx512 };

/// "avx512", "avx2" or the name of a lesser set.
const char* name_of_simd(Simd simd);
/// Whether processor and build offer it.
bool is_available(Simd simd);

/// Heights stand in a padded raster; unknown ones are this, far below everything.
inline constexpr float kFarBelow_m = -1e30F;
/// Interpolated heights below this have an unknown neighbour that counts.
inline constexpr float kUnknownBelow_m = -1e20F;
/// Slopes start here: below all known ones, above all unknown ones.
inline constexpr float kLowestSlope = -1e6F;
/// Neighbouring observers that are worked on together.
inline constexpr int kGroupLanes = 32;
/// Further heights in one pass.
inline constexpr int kFurtherHeightsMax = 4;

/// What sample k = 1, 2, .. of every ray of a line has in common; stands at index k - 1.
struct RayStep {
  float inverse_distance_1pm = 0.0F;
  float drop_slope = 0.0F;  // how much lower the curved earth makes it look
  float weight = 0.0F;      // whole number
};

/// A row of observers: lane 0 of the group in each array.
struct ObserverRow {
  int buffer_row = 0;
  const float* eyes_m = nullptr;
  std::int32_t* seen = nullptr;
  std::int32_t* known = nullptr;
  std::int32_t* further = nullptr;  // planes: seen at reference height, at each further one, known
};

/// One group of skewed columns with the observers on it.
struct GroupTask {
  const float* ground_m = nullptr;       // column 0 of the raster in buffer row 0
  const float* ground_weight = nullptr;  // likewise, whole numbers; null: all ground counts alike
  std::ptrdiff_t stride = 0;             // of both
  const std::int32_t* left = nullptr;    // raster column of skewed column 0, by buffer row
  const float* fraction = nullptr;       // share of its right neighbour, by buffer row
  int first_column = 0;                  // skewed column of lane 0
  int buffer_begin = 0;                  // buffer rows that are used
  int buffer_end = 0;
  const RayStep* steps = nullptr;
  int step_count = 0;
  const std::int32_t* known_prefix = nullptr;  // sum of the first k weights, k = 0..step_count
  const float* further_slopes = nullptr;  // by step: (height - reference height) / distance of each
  int further_count = 0;                  // 0..kFurtherHeightsMax
  std::ptrdiff_t further_plane = 0;       // from one plane of ObserverRow::further to the next
  const std::vector<ObserverRow>* observers = nullptr;
};

/// Memory of a thread that runs tasks.
struct GroupBuffers {
  std::vector<float> ground_m;
  std::vector<float> highest_m;
  std::vector<float> weight;
};

/// The kernel for a set of instructions; asking the processor is slow, so ask once.
/// Throws std::invalid_argument if it is not available.
using GroupKernel = void (*)(const GroupTask& task, float* ground_m, float* highest_m,
                             float* weight);
GroupKernel group_kernel(Simd simd);

/// Adds what the rays of a group see to the sums of its observers, in both directions of the line.
void add_group(const GroupTask& task, GroupBuffers& buffers, GroupKernel kernel);

}  // namespace hedgehop::preparation
