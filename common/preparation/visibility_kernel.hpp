#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

/// The inner loops of the visibility layer: SIMD across neighbouring observers, chosen at run time.
///
/// Rays of one direction run along lines that are one skewed column each of a small buffer: row R
/// of the raster, shifted so that every line is upright. As many neighbouring lines as a vector has
/// lanes are a strip. The ground of a strip is interpolated once, and serves the observers of many
/// rows and the rays of the opposite direction too. It is worked through in blocks of a few rows,
/// which stay in registers: a list of the observers that may see something of the block is made
/// first, then the listed ones look at it.
///
/// Numbers are whole: heights in units of 1/16 m, slopes as what they are at the start of their
/// ring (see visibility.hpp). Lanes have 16 bits where all heights of a tile fit, else 32;
/// operations saturate at the same numbers in both, so which of them it is changes no bit.
namespace hedgehop::preparation {

/// Which instructions are used; results are the same bytes. kBest is the widest there is.
enum class Simd : std::uint8_t { kBest, kAvx2, kAvx512 };

/// "avx512", "avx2" or the name of a lesser set.
const char* name_of_simd(Simd simd);
/// Whether processor and build offer it.
bool is_available(Simd simd);

/// Units of height, and finer ones for which lanes always have 32 bits.
inline constexpr int kUnitsPerMetre = 16;
inline constexpr int kFineUnitsPerMetre = 32768;
/// Unknown heights are this.
template <typename T>
inline constexpr T kUnknownHeight = sizeof(T) == 2 ? -32768 : -(1 << 30);
/// Eyes that see nothing at all are this.
template <typename T>
inline constexpr T kBlindEye = sizeof(T) == 2 ? 32767 : 1 << 30;
/// A cell that lies this much above or below its neighbours to the left and right, added up, is an
/// edge: of a forest or a house, or a ridge.
inline constexpr int kEdge_m = 8;
/// Ground whose neighbours to the left and right lie above or below it by no more than this, added
/// up, is smooth; level, if they lie on its height.
inline constexpr int kSmoothBendUnits = 1;
/// Shares of the right neighbour, and what turns a height into a slope, are counted in this.
inline constexpr int kOne = 32768;
/// Ground of this weight counts fully, known ground without weights too.
inline constexpr int kFullWeight = 65535;
/// Lanes of the widest vector.
inline constexpr int kLanesMax = 32;
/// Neighbouring strips that are interpolated together, as their ground lies in the same pages.
inline constexpr int kStripsTogether = 4;
/// Numbers that say who looks at a block.
inline constexpr int kPlanNumbers = 6;
/// Rows of a block. Blocks begin at multiples of it, counted from the origin of the map frame.
inline constexpr int kBlockRows = 8;
/// So many samples of a ray, the nearest ones, lie exactly on it, wherever the line runs.
inline constexpr int kExactSteps = 8;
/// Blocks whose first row is farther than this are far; a multiple of kBlockRows.
inline constexpr int kNearRows = 16;
static_assert(kNearRows % kBlockRows == 0 && kExactSteps <= kNearRows);
/// Further heights in one pass.
inline constexpr int kFurtherHeightsMax = 4;

/// Numbers of samples. Sample k of the near ones stands at index k, sample k of a far block at
/// RaySteps::block_at[its first sample] and so many further on.
struct StepTable {
  std::vector<std::int32_t> ratio;  // slope of a height above the eye, in 1 / kOne
  std::vector<std::int32_t> drop;   // how much lower the curved earth makes a near sample look, or
                                    // all of the far block that begins with this one
  std::vector<std::int32_t> rest_of_drop;  // of a far sample
  std::vector<std::int32_t> weight;        // 0 beyond the ray
  std::vector<std::int32_t> lower;  // how much lower it looks from a further height; by step and
                                    // height
};

/// What the samples of every ray of a line have in common.
struct RaySteps {
  int count = 0;
  int units_per_metre = 0;
  // By so much higher smooth and level ground are looked at, lest rounding hides it.
  int smooth_raise = 0;
  int level_raise = 0;
  int limit = 0;  // what slopes and differences of heights saturate at
  StepTable numbers;
  StepTable pairs;                        // the same for lanes of 16 bits: each number twice
  std::vector<std::int32_t> line_weight;  // at k + kBlockRows: weight, 0 for the exact samples
  std::vector<std::int32_t> line_weight_before;  // likewise: sum of all before
  std::vector<std::int32_t> block_at;            // by first sample
};

/// Observers of a row on the lines of one phase.
struct ObserverRow {
  int buffer_row = 0;
  int skewed_begin = 0;  // skewed columns with observers
  int skewed_end = 0;
  std::ptrdiff_t at = 0;  // of skewed column 0 in the arrays for observers
  int shift = 0;          // skewed column less column of the raster
};

/// All lines of one direction and phase in a tile. T: std::int16_t or std::int32_t.
template <typename T>
struct LineTask {
  const T* ground = nullptr;  // column 0 of the raster in buffer row 0
  const std::uint16_t* ground_weight =
      nullptr;                             // likewise, 0..kFullWeight; null: all ground counts
  std::ptrdiff_t stride = 0;               // of both
  const std::int32_t* left = nullptr;      // raster column of skewed column 0, by buffer row
  const std::int16_t* fraction = nullptr;  // share of its right neighbour, by buffer row
  // Where the nearest samples lie beside their observer: kExactSteps ahead, then as many behind.
  const std::int32_t* exact_left = nullptr;      // columns
  const std::int16_t* exact_fraction = nullptr;  // share of the right neighbour
  int buffer_rows = 0;                           // multiple of kBlockRows
  const RaySteps* steps = nullptr;
  int further_count = 0;                           // 0..kFurtherHeightsMax
  const std::vector<ObserverRow>* rows = nullptr;  // upwards
  const T* eyes = nullptr;                         // arrays for observers
  std::int32_t* seen = nullptr;
  std::int32_t* known = nullptr;     // less what all rays weigh on known ground of full weight
  std::int32_t* further = nullptr;   // planes: seen at reference height, at each further one, known
  std::ptrdiff_t further_plane = 0;  // from one plane to the next
};

/// Memory of a thread that runs tasks.
template <typename T>
struct LineBuffers {
  std::vector<T> values;
  std::vector<std::int32_t> indices;
};

/// The kernel for a set of instructions; asking the processor is slow, so ask once.
/// Throws std::invalid_argument if it is not available.
struct LineKernel {
  void (*narrow)(const LineTask<std::int16_t>& task, std::int16_t* values,
                 std::int32_t* indices) = nullptr;
  void (*wide)(const LineTask<std::int32_t>& task, std::int32_t* values,
               std::int32_t* indices) = nullptr;
};
LineKernel line_kernel(Simd simd);

/// Adds what the rays of these lines see to the sums of their observers, in both directions.
void add_lines(const LineTask<std::int16_t>& task, LineBuffers<std::int16_t>& buffers,
               const LineKernel& kernel);
void add_lines(const LineTask<std::int32_t>& task, LineBuffers<std::int32_t>& buffers,
               const LineKernel& kernel);

}  // namespace hedgehop::preparation
