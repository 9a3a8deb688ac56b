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
/// Known heights are clamped to what is less than this from zero, so that rounding stays far below
/// kHeightMargin_m.
inline constexpr float kHeightMax_m = 20000.0F;
inline constexpr float kHeightMargin_m = 0.0625F;
/// Slopes start here: below all known ones, above all unknown ones.
inline constexpr float kLowestSlope = -1e6F;
/// An eye this high sees nothing at all, since slopes are below kLowestSlope.
inline constexpr float kBlindEye_m = 1e12F;
/// A cell that lies this much above or below its neighbours to the left and right, added up, is an
/// edge: of a forest or a house, or a ridge.
inline constexpr float kEdge_m = 8.0F;
/// Lanes of the widest vector.
inline constexpr int kLanesMax = 16;
/// Neighbouring strips that are interpolated together, as their ground lies in the same pages.
inline constexpr int kStripsTogether = 4;
/// Numbers that say who looks at a block.
inline constexpr int kPlanNumbers = 6;
/// Rows of a block.
inline constexpr int kBlockRows = 8;
/// So many samples of a ray, the nearest ones, lie exactly on it, wherever the line runs.
inline constexpr int kExactSteps = 8;
/// Further heights in one pass.
inline constexpr int kFurtherHeightsMax = 4;

/// What sample k of every ray of a line has in common; stands at index k - 1 + kBlockRows. Before
/// them stand kBlockRows elements that neither see nor hide anything, after them twice as many that
/// see nothing.
struct RaySteps {
  int count = 0;
  std::vector<float> inverse_distance_1pm;
  std::vector<float> drop_slope;          // how much lower the curved earth makes it look
  std::vector<float> weight;              // whole numbers
  std::vector<float> line_weight;         // the same, but 0 for the nearest kExactSteps
  std::vector<float> line_weight_before;  // sum of line_weight of all elements before
  std::vector<float> further_slopes;  // (height - reference height) / distance, by step and height
};

/// Observers of a row on the lines of one phase.
struct ObserverRow {
  int buffer_row = 0;
  int skewed_begin = 0;  // skewed columns with observers
  int skewed_end = 0;
  std::ptrdiff_t at = 0;  // of skewed column 0 in the arrays for observers
  int shift = 0;          // skewed column less column of the raster
};

/// All lines of one direction and phase in a tile.
struct LineTask {
  const float* ground_m = nullptr;       // column 0 of the raster in buffer row 0
  const float* ground_weight = nullptr;  // likewise, 0..ground_weight_max; null: all ground counts
  float ground_weight_max = 1.0F;
  std::ptrdiff_t stride = 0;           // of both
  const std::int32_t* left = nullptr;  // raster column of skewed column 0, by buffer row
  const float* fraction = nullptr;     // share of its right neighbour, by buffer row
  // Where the nearest samples lie beside their observer: kExactSteps ahead, then as many behind.
  const std::int32_t* exact_left = nullptr;  // columns
  const float* exact_fraction = nullptr;     // share of the right neighbour
  int buffer_rows = 0;                       // multiple of kBlockRows
  const RaySteps* steps = nullptr;
  int further_count = 0;                           // 0..kFurtherHeightsMax
  const std::vector<ObserverRow>* rows = nullptr;  // upwards
  const float* eyes_m = nullptr;                   // arrays for observers
  std::int32_t* seen = nullptr;
  std::int32_t* known = nullptr;     // less what all rays weigh on known ground of full weight
  std::int32_t* further = nullptr;   // planes: seen at reference height, at each further one, known
  std::ptrdiff_t further_plane = 0;  // from one plane to the next
};

/// Memory of a thread that runs tasks.
struct LineBuffers {
  std::vector<float> floats;
  std::vector<std::int32_t> indices;
};

/// The kernel for a set of instructions; asking the processor is slow, so ask once.
/// Throws std::invalid_argument if it is not available.
using LineKernel = void (*)(const LineTask& task, float* floats, std::int32_t* indices);
LineKernel line_kernel(Simd simd);

/// Adds what the rays of these lines see to the sums of their observers, in both directions.
void add_lines(const LineTask& task, LineBuffers& buffers, LineKernel kernel);

}  // namespace hedgehop::preparation
