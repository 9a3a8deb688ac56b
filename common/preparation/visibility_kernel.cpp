#include "preparation/visibility_kernel.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "preparation/visibility_kernel.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace hedgehop::preparation::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using FloatTag = hn::CappedTag<float, kLanesMax>;
using IntTag = hn::RebindToSigned<FloatTag>;
using Floats = hn::Vec<FloatTag>;
constexpr int kLanes = static_cast<int>(hn::MaxLanes(FloatTag()));

// At least so many rows on each side are near; a multiple of kBlockRows.
constexpr int kNearRows = 16;
static_assert(kNearRows % kBlockRows == 0 && kExactSteps <= kNearRows);
// From here on two blocks are asked about at once.
constexpr int kAskedTwiceUntil = 48;

// sum + (condition ? value : 0), in one operation where the processor can.
HWY_INLINE Floats add_if(hn::Mask<FloatTag> condition, Floats sum, Floats value) {
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
  return Floats{_mm512_mask_add_ps(sum.raw, condition.raw, sum.raw, value.raw)};
#else
  return hn::Add(sum, hn::IfThenElseZero(condition, value));
#endif
}

HWY_INLINE void add_to(std::int32_t* target, Floats sum) {
  const IntTag tag;
  hn::StoreU(hn::Add(hn::LoadU(tag, target), hn::ConvertTo(tag, sum)), tag, target);
}

// Arrays of a strip: kLanes values for each row, each block or each row of observers.
struct Strip {
  float* hiding_m = nullptr;           // by row: height of the ground
  float* edge_m = nullptr;             // by row: what is looked at is so much higher
  float* weight = nullptr;             // by row; null: all known ground counts alike
  float* highest_m = nullptr;          // by block, of what is looked at and what hides
  std::int32_t* block_kind = nullptr;  // by block
};

// Arrays for the observers of a strip: kLanes values for each row of them.
struct StripObservers {
  int count = 0;
  float* eyes_m = nullptr;
  float* greatest = nullptr;
  float* seen = nullptr;
  float* unknown = nullptr;
  float* further_greatest = nullptr;  // planes of further_plane
  float* further_seen = nullptr;
  std::ptrdiff_t down = 0;           // from `greatest` of upward rays to that of downward rays
  std::ptrdiff_t further_plane = 0;  // there the planes of all heights lie between
  bool is_some_unknown = false;

  std::int32_t* buffer_row = nullptr;    // rising
  const std::int32_t* behind = nullptr;  // buffer_row counted along the rays, from any row
  std::int32_t* from = nullptr;          // row in the task
  std::int32_t* listed = nullptr;        // those that look at a block
  // With further heights: from which of them, bit 0 being the reference height; parallel to listed
  std::int32_t* listed_heights = nullptr;
};

// Bits of a block's kind.
constexpr std::int32_t kHasEdges = 1;
constexpr std::int32_t kHasUnknown = 2;
constexpr std::int32_t kHasKnown = 4;

// A block in the order in which rays in one direction cross it.
struct Block {
  const float* hiding_m = nullptr;
  const float* edge_m = nullptr;
  const float* weight = nullptr;
  std::ptrdiff_t stride = 0;  // to the next row
  int first_step = 0;         // index in RaySteps of the first row is this less Observers::behind
};

// Lists observers of [begin, end) that may see something of the next `rows` rows, which are at most
// `highest`. Leaving others out changes no bit: operations on heights are monotone, rounding
// included, but for edges, where a margin does.
template <int kFurther>
HWY_NOINLINE int list_observers(const RaySteps& steps, const StripObservers& observers,
                                Floats highest, int first_step, int rows, int begin, int end,
                                std::ptrdiff_t listed_before) {
  const FloatTag tag;
  const float* HWY_RESTRICT inverse_distance = steps.inverse_distance_1pm.data();
  const float* HWY_RESTRICT drop_slope = steps.drop_slope.data();
  const float* HWY_RESTRICT further_slopes = steps.further_slopes.data();
  const float* HWY_RESTRICT eyes_m = observers.eyes_m;
  const float* HWY_RESTRICT greatest = observers.greatest;
  const float* HWY_RESTRICT further_greatest = observers.further_greatest;
  const std::int32_t* HWY_RESTRICT behind = observers.behind;
  const std::ptrdiff_t further_plane = observers.further_plane;
  std::int32_t* HWY_RESTRICT listed = observers.listed + listed_before;
  std::int32_t* HWY_RESTRICT listed_heights = observers.listed_heights + listed_before;
  std::ptrdiff_t count = 0;
  for (std::ptrdiff_t o = begin; o < end; ++o) {
    const std::ptrdiff_t k = first_step - behind[o];
    const Floats above = hn::Sub(highest, hn::Load(tag, eyes_m + o * kLanes));
    const Floats drop = hn::Set(tag, drop_slope[k]);
    const Floats bound =
        hn::Max(hn::MulSub(above, hn::Set(tag, inverse_distance[k]), drop),
                hn::MulSub(above, hn::Set(tag, inverse_distance[k + rows - 1]), drop));
    const auto may_be_seen = hn::Ge(bound, hn::Load(tag, greatest + o * kLanes));
    std::int32_t heights = hn::AllFalse(tag, may_be_seen) ? 0 : 1;
#pragma GCC unroll 4
    for (int h = 0; h < kFurther; ++h) {
      const float least =
          std::min(further_slopes[k * kFurther + h], further_slopes[(k + rows - 1) * kFurther + h]);
      const auto from_there =
          hn::Ge(hn::Sub(bound, hn::Set(tag, least)),
                 hn::Load(tag, further_greatest + h * further_plane + o * kLanes));
      heights |= hn::AllFalse(tag, from_there) ? 0 : 2 << h;
    }
    listed[count] = static_cast<std::int32_t>(o);
    if constexpr (kFurther > 0) {
      listed_heights[count] = heights;
    }
    count += heights == 0 ? 0 : 1;
  }
  return static_cast<int>(count);
}

// The listed observers look at the block.
template <bool kEdges, bool kWeighted>
HWY_NOINLINE void look(const RaySteps& steps, const StripObservers& observers, const Block& block,
                       int count) {
  const FloatTag tag;
  const std::ptrdiff_t stride = block.stride;
  Floats hiding[kBlockRows];
#pragma GCC unroll 8
  for (int i = 0; i < kBlockRows; ++i) {
    hiding[i] = hn::Load(tag, block.hiding_m + i * stride);
  }
  const float* HWY_RESTRICT inverse_distance = steps.inverse_distance_1pm.data();
  const float* HWY_RESTRICT drop_slope = steps.drop_slope.data();
  const float* HWY_RESTRICT weight = steps.weight.data();
  const float* HWY_RESTRICT edge_m = block.edge_m;
  const float* HWY_RESTRICT ground_weight = block.weight;
  const float* HWY_RESTRICT eyes_m = observers.eyes_m;
  float* HWY_RESTRICT all_greatest = observers.greatest;
  float* HWY_RESTRICT all_seen = observers.seen;
  const std::int32_t* HWY_RESTRICT behind = observers.behind;
  const int first_step = block.first_step;
  for (std::ptrdiff_t n = 0; n < count; ++n) {
    const std::ptrdiff_t o = observers.listed[n];
    const std::ptrdiff_t k = first_step - behind[o];
    const Floats eye = hn::Load(tag, eyes_m + o * kLanes);
    Floats greatest = hn::Load(tag, all_greatest + o * kLanes);
    Floats seen = hn::Load(tag, all_seen + o * kLanes);
#pragma GCC unroll 8
    for (int i = 0; i < kBlockRows; ++i) {
      const Floats inverse = hn::Set(tag, inverse_distance[k + i]);
      const Floats slope =
          hn::MulSub(hn::Sub(hiding[i], eye), inverse, hn::Set(tag, drop_slope[k + i]));
      Floats looked_at = slope;
      if constexpr (kEdges) {
        looked_at = hn::MulAdd(hn::Load(tag, edge_m + i * stride), inverse, slope);
      }
      Floats counts = hn::Set(tag, weight[k + i]);
      if constexpr (kWeighted) {
        counts = hn::Mul(counts, hn::Load(tag, ground_weight + i * stride));
      }
      seen = add_if(hn::Ge(looked_at, greatest), seen, counts);
      greatest = hn::Max(greatest, slope);
    }
    hn::Store(greatest, tag, all_greatest + o * kLanes);
    hn::Store(seen, tag, all_seen + o * kLanes);
  }
}

// The same from further heights too.
template <int kFurther, bool kEdges, bool kWeighted>
HWY_NOINLINE void look_from_all(const RaySteps& steps, const StripObservers& observers,
                                const Block& block, int count) {
  const FloatTag tag;
  const float* HWY_RESTRICT inverse_distance = steps.inverse_distance_1pm.data();
  const float* HWY_RESTRICT drop_slope = steps.drop_slope.data();
  const float* HWY_RESTRICT weight = steps.weight.data();
  const float* HWY_RESTRICT further_slopes = steps.further_slopes.data();
  for (std::ptrdiff_t n = 0; n < count; ++n) {
    const std::ptrdiff_t o = observers.listed[n];
    const std::ptrdiff_t k = block.first_step - observers.behind[o];
    const std::ptrdiff_t at = o * kLanes;
    const Floats eye = hn::Load(tag, observers.eyes_m + at);
    Floats slope[kBlockRows];
    Floats looked_at[kBlockRows];
    Floats counts[kBlockRows];
#pragma GCC unroll 8
    for (int i = 0; i < kBlockRows; ++i) {
      const Floats inverse = hn::Set(tag, inverse_distance[k + i]);
      slope[i] = hn::MulSub(hn::Sub(hn::Load(tag, block.hiding_m + i * block.stride), eye), inverse,
                            hn::Set(tag, drop_slope[k + i]));
      looked_at[i] =
          kEdges ? hn::MulAdd(hn::Load(tag, block.edge_m + i * block.stride), inverse, slope[i])
                 : slope[i];
      counts[i] = hn::Set(tag, weight[k + i]);
      if constexpr (kWeighted) {
        counts[i] = hn::Mul(counts[i], hn::Load(tag, block.weight + i * block.stride));
      }
    }
    const std::int32_t heights = observers.listed_heights[n];
    if ((heights & 1) != 0) {
      Floats greatest = hn::Load(tag, observers.greatest + at);
      Floats seen = hn::Load(tag, observers.seen + at);
#pragma GCC unroll 8
      for (int i = 0; i < kBlockRows; ++i) {
        seen = add_if(hn::Ge(looked_at[i], greatest), seen, counts[i]);
        greatest = hn::Max(greatest, slope[i]);
      }
      hn::Store(greatest, tag, observers.greatest + at);
      hn::Store(seen, tag, observers.seen + at);
    }
#pragma GCC unroll 4
    for (int h = 0; h < kFurther; ++h) {
      if ((heights & 2 << h) == 0) {
        continue;
      }
      const std::ptrdiff_t there = h * observers.further_plane + at;
      Floats greatest = hn::Load(tag, observers.further_greatest + there);
      Floats seen = hn::Load(tag, observers.further_seen + there);
#pragma GCC unroll 8
      for (int i = 0; i < kBlockRows; ++i) {
        const Floats lower = hn::Set(tag, further_slopes[(k + i) * kFurther + h]);
        seen = add_if(hn::Ge(hn::Sub(looked_at[i], lower), greatest), seen, counts[i]);
        greatest = hn::Max(greatest, hn::Sub(slope[i], lower));
      }
      hn::Store(greatest, tag, observers.further_greatest + there);
      hn::Store(seen, tag, observers.further_seen + there);
    }
  }
}

// The nearest samples of both rays of a row of observers, `side` 0 ahead and 1 behind.
struct ExactSamples {
  const LineTask* task = nullptr;
  const float* ground_m[2] = {nullptr, nullptr};
  const float* weight[2] = {nullptr, nullptr};

  ExactSamples(const LineTask& of_task, const ObserverRow& row, int skewed_column)
      : task(&of_task) {
    const std::ptrdiff_t at =
        row.buffer_row * of_task.stride + static_cast<std::ptrdiff_t>(skewed_column) - row.shift;
    ground_m[0] = of_task.ground_m + at + of_task.stride;
    ground_m[1] = of_task.ground_m + at - of_task.stride;
    if (of_task.ground_weight != nullptr) {
      weight[0] = of_task.ground_weight + at + of_task.stride;
      weight[1] = of_task.ground_weight + at - of_task.stride;
    }
  }

  [[nodiscard]] HWY_INLINE std::ptrdiff_t offset(int i, int side) const {
    return (side == 0 ? i : -i) * task->stride + task->exact_left[side * kExactSteps + i];
  }
  [[nodiscard]] HWY_INLINE Floats height_m(int i, int side) const {
    const FloatTag tag;
    const float* left = ground_m[side] + offset(i, side);
    const Floats a = hn::LoadU(tag, left);
    const Floats b = hn::LoadU(tag, left + 1);
    return hn::MulAdd(hn::Set(tag, task->exact_fraction[side * kExactSteps + i]), hn::Sub(b, a), a);
  }
  // 0 where the ground, of this height, is unknown.
  [[nodiscard]] HWY_INLINE Floats ground_weight(int i, int side, Floats z) const {
    const FloatTag tag;
    const float fraction = task->exact_fraction[side * kExactSteps + i];
    const float* nearest = weight[side] + offset(i, side) + (fraction < 0.5F ? 0 : 1);
    return hn::IfThenElseZero(hn::Gt(z, hn::Set(tag, kUnknownBelow_m)), hn::LoadU(tag, nearest));
  }
};

// Adds up the weight of unknown ground at the nearest samples.
template <bool kWeighted>
HWY_NOINLINE void add_near_unknown(const LineTask& task, StripObservers& observers,
                                   const ExactSamples& samples, std::ptrdiff_t o) {
  const FloatTag tag;
  const float* step_weight = task.steps->weight.data() + kBlockRows;
  const Floats full = hn::Set(tag, task.ground_weight_max);
  Floats sum = hn::Load(tag, observers.unknown + o * kLanes);
  for (int side = 0; side < 2; ++side) {
    for (int i = 0; i < std::min(kExactSteps, task.steps->count); ++i) {
      const Floats z = samples.height_m(i, side);
      Floats lack = hn::IfThenElseZero(hn::Le(z, hn::Set(tag, kUnknownBelow_m)), full);
      if constexpr (kWeighted) {
        lack = hn::Sub(full, samples.ground_weight(i, side, z));
      }
      sum = hn::MulAdd(lack, hn::Set(tag, step_weight[i]), sum);
    }
  }
  hn::Store(sum, tag, observers.unknown + o * kLanes);
  observers.is_some_unknown = true;
}

// Both rays of a row of observers over the near ground, which some lane nearly always sees: `up`
// and `down` rows of it.
template <int kFurther, bool kEdges, bool kWeighted>
HWY_NOINLINE void look_near(const LineTask& task, const Strip& strip, StripObservers& observers,
                            const ExactSamples& samples, std::ptrdiff_t o, int up, int down) {
  const FloatTag tag;
  const RaySteps& steps = *task.steps;
  const float* HWY_RESTRICT inverse_distance = steps.inverse_distance_1pm.data() + kBlockRows;
  const float* HWY_RESTRICT drop_slope = steps.drop_slope.data() + kBlockRows;
  const float* HWY_RESTRICT step_weight = steps.weight.data() + kBlockRows;
  const float* HWY_RESTRICT further_slopes = steps.further_slopes.data() + kBlockRows * kFurther;
  const std::ptrdiff_t here = static_cast<std::ptrdiff_t>(observers.buffer_row[o]) * kLanes;
  const float* HWY_RESTRICT hiding_m = strip.hiding_m + here;
  const float* HWY_RESTRICT edge_m = strip.edge_m + here;
  const float* HWY_RESTRICT ground_weight = kWeighted ? strip.weight + here : nullptr;
  const Floats eye = hn::Load(tag, observers.eyes_m + o * kLanes);
  Floats greatest[2] = {hn::Set(tag, kLowestSlope), hn::Set(tag, kLowestSlope)};
  Floats seen[2] = {hn::Zero(tag), hn::Zero(tag)};
  Floats further_greatest[kFurther + 1][2];
  Floats further_seen[kFurther + 1];
#pragma GCC unroll 4
  for (int h = 0; h < kFurther; ++h) {
    further_greatest[h][0] = hn::Set(tag, kLowestSlope);
    further_greatest[h][1] = hn::Set(tag, kLowestSlope);
    further_seen[h] = hn::Zero(tag);
  }
  const auto look_at = [&](int i, int side, Floats slope, Floats looked_at,
                           Floats counts) HWY_ATTR {
    seen[side] = add_if(hn::Ge(looked_at, greatest[side]), seen[side], counts);
    greatest[side] = hn::Max(greatest[side], slope);
#pragma GCC unroll 4
    for (int h = 0; h < kFurther; ++h) {
      const Floats lower = hn::Set(tag, further_slopes[i * kFurther + h]);
      further_seen[h] = add_if(hn::Ge(hn::Sub(looked_at, lower), further_greatest[h][side]),
                               further_seen[h], counts);
      further_greatest[h][side] = hn::Max(further_greatest[h][side], hn::Sub(slope, lower));
    }
  };
  Floats lowest = eye;
  const auto exact_step = [&](int i, int side) HWY_ATTR {
    const Floats z = samples.height_m(i, side);
    lowest = hn::Min(lowest, z);
    const Floats slope =
        hn::MulSub(hn::Sub(z, eye), hn::Set(tag, inverse_distance[i]), hn::Set(tag, drop_slope[i]));
    Floats counts = hn::Set(tag, step_weight[i]);
    if constexpr (kWeighted) {
      counts = hn::Mul(counts, samples.ground_weight(i, side, z));
    }
    look_at(i, side, slope, slope, counts);
  };
  const auto step = [&](int i, int side, std::ptrdiff_t at) HWY_ATTR {
    const Floats inverse = hn::Set(tag, inverse_distance[i]);
    const Floats slope = hn::MulSub(hn::Sub(hn::Load(tag, hiding_m + at), eye), inverse,
                                    hn::Set(tag, drop_slope[i]));
    Floats looked_at = slope;
    if constexpr (kEdges) {
      looked_at = hn::MulAdd(hn::Load(tag, edge_m + at), inverse, slope);
    }
    Floats counts = hn::Set(tag, step_weight[i]);
    if constexpr (kWeighted) {
      counts = hn::Mul(counts, hn::Load(tag, ground_weight + at));
    }
    look_at(i, side, slope, looked_at, counts);
  };
  int i = 0;
  for (; i < std::min(kExactSteps, steps.count); ++i) {
    exact_step(i, 0);
    exact_step(i, 1);
  }
  for (; i < std::min(up, down); ++i) {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(i + 1) * kLanes;
    step(i, 0, at);
    step(i, 1, -at);
  }
  for (int k = i; k < up; ++k) {
    step(k, 0, static_cast<std::ptrdiff_t>(k + 1) * kLanes);
  }
  for (int k = i; k < down; ++k) {
    step(k, 1, -static_cast<std::ptrdiff_t>(k + 1) * kLanes);
  }
  hn::Store(greatest[0], tag, observers.greatest + o * kLanes);
  hn::Store(greatest[1], tag, observers.greatest + observers.down + o * kLanes);
  hn::Store(hn::Add(seen[0], seen[1]), tag, observers.seen + o * kLanes);
#pragma GCC unroll 4
  for (int h = 0; h < kFurther; ++h) {
    const std::ptrdiff_t at = h * observers.further_plane + o * kLanes;
    hn::Store(further_greatest[h][0], tag, observers.further_greatest + at);
    hn::Store(further_greatest[h][1], tag,
              observers.further_greatest + kFurther * observers.further_plane + at);
    hn::Store(further_seen[h], tag, observers.further_seen + at);
  }
  if (kWeighted || !hn::AllFalse(tag, hn::Le(lowest, hn::Set(tag, kUnknownBelow_m)))) {
    add_near_unknown<kWeighted>(task, observers, samples, o);
  }
}

// All near rays of a strip, which starts with a skewed column. They end with a block.
template <int kFurther>
void look_near_all(const LineTask& task, const Strip& strip, StripObservers& observers,
                   int column) {
  const RaySteps& steps = *task.steps;
  for (std::ptrdiff_t o = 0; o < observers.count; ++o) {
    const int row = observers.buffer_row[o];
    const int up = std::min(kNearRows + kBlockRows - 1 - row % kBlockRows, steps.count);
    const int down = std::min(kNearRows + row % kBlockRows, steps.count);
    const ExactSamples samples(task, (*task.rows)[static_cast<std::size_t>(observers.from[o])],
                               column);
    std::int32_t kinds = 0;
    for (int b = (row - down) / kBlockRows; b <= (row + up) / kBlockRows; ++b) {
      kinds |= strip.block_kind[b];
    }
    if (strip.weight != nullptr) {
      look_near<kFurther, true, true>(task, strip, observers, samples, o, up, down);
    } else if ((kinds & kHasEdges) != 0) {
      look_near<kFurther, true, false>(task, strip, observers, samples, o, up, down);
    } else {
      look_near<kFurther, false, false>(task, strip, observers, samples, o, up, down);
    }
  }
}

// Adds up the weight of unknown ground of the block for observers of [begin, end).
HWY_NOINLINE void add_unknown(const LineTask& task, StripObservers& observers, const Block& block,
                              std::int32_t kind, int begin, int end) {
  const FloatTag tag;
  const RaySteps& steps = *task.steps;
  observers.is_some_unknown = true;
  for (std::ptrdiff_t o = begin; o < end; ++o) {
    const std::ptrdiff_t k = block.first_step - observers.behind[o];
    float* unknown = observers.unknown + o * kLanes;
    Floats sum = hn::Load(tag, unknown);
    if ((kind & kHasKnown) == 0) {
      const float weight = steps.line_weight_before[k + kBlockRows] - steps.line_weight_before[k];
      sum = hn::Add(sum, hn::Set(tag, weight * task.ground_weight_max));
    } else if (block.weight != nullptr) {
      for (int i = 0; i < kBlockRows; ++i) {
        const Floats lack = hn::Sub(hn::Set(tag, task.ground_weight_max),
                                    hn::Load(tag, block.weight + i * block.stride));
        sum = hn::MulAdd(lack, hn::Set(tag, steps.line_weight[k + i]), sum);
      }
    } else {
      for (int i = 0; i < kBlockRows; ++i) {
        const Floats z = hn::Load(tag, block.hiding_m + i * block.stride);
        sum = add_if(hn::Le(z, hn::Set(tag, kUnknownBelow_m)), sum,
                     hn::Set(tag, steps.line_weight[k + i]));
      }
    }
    hn::Store(sum, tag, unknown);
  }
}

// Interpolates a block of the strip that starts with a skewed column.
HWY_INLINE void build_block(const LineTask& task, const Strip& strip, int column, int row) {
  const FloatTag tag;
  Floats highest = hn::Set(tag, kFarBelow_m);
  Floats lowest = hn::Set(tag, -kFarBelow_m);
  auto has_edges = hn::FirstN(tag, 0);
  for (int r = row; r < row + kBlockRows; ++r) {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(r) * kLanes;
    const float fraction = task.fraction[r];
    const float* left = task.ground_m + r * task.stride + task.left[r] + column;
    const Floats a = hn::LoadU(tag, left);
    const Floats b = hn::LoadU(tag, left + 1);
    const Floats z = hn::MulAdd(hn::Set(tag, fraction), hn::Sub(b, a), a);
    const int to_nearest = fraction < 0.5F ? 0 : 1;
    const Floats nearest = hn::LoadU(tag, left + to_nearest);
    const Floats beside =
        hn::Add(hn::LoadU(tag, left + to_nearest - 1), hn::LoadU(tag, left + to_nearest + 1));
    const Floats bend = hn::Abs(hn::Sub(beside, hn::Add(nearest, nearest)));
    const auto is_edge =
        hn::And(hn::Gt(bend, hn::Set(tag, kEdge_m)), hn::Lt(bend, hn::Set(tag, -kUnknownBelow_m)));
    const Floats edge = hn::IfThenElseZero(is_edge, hn::Sub(nearest, z));
    hn::Store(z, tag, strip.hiding_m + at);
    hn::Store(edge, tag, strip.edge_m + at);
    has_edges = hn::Or(has_edges, is_edge);
    highest = hn::Max(highest, hn::Max(z, hn::Add(z, edge)));
    lowest = hn::Min(lowest, z);
    if (strip.weight != nullptr) {
      const float* weight =
          task.ground_weight + r * task.stride + task.left[r] + column + to_nearest;
      const auto is_known = hn::Gt(z, hn::Set(tag, kUnknownBelow_m));
      hn::Store(hn::IfThenElseZero(is_known, hn::LoadU(tag, weight)), tag, strip.weight + at);
    }
  }
  const Floats unknown_below = hn::Set(tag, kUnknownBelow_m);
  std::int32_t kind = 0;
  if (!hn::AllFalse(tag, has_edges)) {
    kind |= kHasEdges;
    highest = hn::Add(highest, hn::Set(tag, kHeightMargin_m));
  }
  kind |= hn::AllTrue(tag, hn::Gt(lowest, unknown_below)) ? 0 : kHasUnknown;
  kind |= hn::AllFalse(tag, hn::Gt(highest, unknown_below)) ? 0 : kHasKnown;
  strip.block_kind[row / kBlockRows] = kind;
  hn::Store(highest, tag, strip.highest_m + static_cast<std::ptrdiff_t>(row / kBlockRows) * kLanes);
}

HWY_NOINLINE void build(const LineTask& task, const Strip (&strips)[kStripsTogether], int column,
                        int strip_count, int begin, int end) {
  // The raster is too large for the nearer caches, and no processor foresees skewed columns.
  constexpr int kLineFloats = 16;
  constexpr int kRowsAhead = 2 * kBlockRows;
  for (int row = begin; row < end; row += kBlockRows) {
    for (int r = row + kRowsAhead; r < std::min(row + kRowsAhead + kBlockRows, end); ++r) {
      const float* left = task.ground_m + r * task.stride + task.left[r] + column;
      for (int i = 0; i <= strip_count * kLanes; i += kLineFloats) {
        hwy::Prefetch(left + i);
      }
    }
    for (int i = 0; i < strip_count; ++i) {
      build_block(task, strips[i], column + i * kLanes, row);
    }
  }
}

template <int kFurther>
void look_at_block(const RaySteps& steps, const StripObservers& observers, const Block& block,
                   std::int32_t kind, int count) {
  if (count == 0) {
    return;
  }
  const bool has_edges = (kind & kHasEdges) != 0;
  if constexpr (kFurther > 0) {
    if (block.weight != nullptr) {
      look_from_all<kFurther, true, true>(steps, observers, block, count);
    } else if (has_edges) {
      look_from_all<kFurther, true, false>(steps, observers, block, count);
    } else {
      look_from_all<kFurther, false, false>(steps, observers, block, count);
    }
  } else {
    if (block.weight != nullptr) {
      look<true, true>(steps, observers, block, count);
    } else if (has_edges) {
      look<true, false>(steps, observers, block, count);
    } else {
      look<false, false>(steps, observers, block, count);
    }
  }
}

// Who has to do with a block: ranges of observers.
struct BlockPlan {
  std::int32_t reach_begin = 0;  // whose rays get as far
  std::int32_t reach_end = 0;
  std::int32_t asked_begin = 0;  // whether they may see something of it
  std::int32_t asked_end = 0;
  std::int32_t asked_twice_begin = 0;  // the same, of this block and the next; empty in the next
  std::int32_t asked_twice_end = 0;
};

static_assert(sizeof(BlockPlan) == kPlanNumbers * sizeof(std::int32_t));

// The blocks that rays in one direction cross, in this order. Neighbouring strips mostly have the
// same rows of observers and so the same course.
struct Course {
  int direction = 0;
  int first_block = 0;
  int block_count = 0;
  std::int32_t* behind = nullptr;  // by row of observers
  BlockPlan* plans = nullptr;
};

void plan(const RaySteps& steps, const StripObservers& observers, Course& course) {
  const int n = observers.count;
  const int direction = course.direction;
  for (std::ptrdiff_t o = 0; o < n; ++o) {
    course.behind[o] = direction * observers.buffer_row[o];
  }
  const int first_row = observers.buffer_row[direction > 0 ? 0 : n - 1];
  const int last_row = observers.buffer_row[direction > 0 ? n - 1 : 0] + direction * steps.count;
  course.first_block = first_row / kBlockRows;
  course.block_count = direction * (last_row / kBlockRows - course.first_block) + 1;
  // Observers counted along the direction: rays of those of [begin, end) cross the block; the ones
  // of [begin, far) are asked about two blocks, those of [far, near) about this one.
  int begin = 0;
  int far = 0;
  int near = 0;
  int end = 0;
  const auto behind = [&](int i) { return course.behind[direction > 0 ? i : n - 1 - i]; };
  const auto first = [&](int from, int to) { return direction > 0 ? from : n - to; };
  for (int i = 0; i < course.block_count; ++i) {
    const int b = course.first_block + direction * i;
    const int ahead = direction * (b * kBlockRows + (direction > 0 ? 0 : kBlockRows - 1));
    while (end < n && behind(end) - ahead < kBlockRows) {
      ++end;
    }
    while (begin < end && ahead - behind(begin) > steps.count) {
      ++begin;
    }
    near = std::max(near, begin);
    while (near < end && ahead - behind(near) > kNearRows) {
      ++near;
    }
    const bool is_first_of_two = i % 2 == 0;
    if (is_first_of_two) {
      while (far < near && ahead - behind(far) >= kAskedTwiceUntil) {
        ++far;
      }
    }
    const int asked = std::max(begin, far);
    BlockPlan& plan = course.plans[i];
    plan.reach_begin = first(begin, end);
    plan.reach_end = plan.reach_begin + end - begin;
    plan.asked_begin = first(asked, near);
    plan.asked_end = plan.asked_begin + near - asked;
    plan.asked_twice_begin = first(begin, asked);
    plan.asked_twice_end = plan.asked_twice_begin + (is_first_of_two ? asked - begin : 0);
  }
}

// All rays of a strip in one direction.
template <int kFurther>
void look_along(const LineTask& task, const Strip& strip, StripObservers& observers,
                const Course& course) {
  const FloatTag tag;
  const RaySteps& steps = *task.steps;
  const int direction = course.direction;
  observers.behind = course.behind;
  int far_count = 0;
  for (int i = 0; i < course.block_count; ++i) {
    const BlockPlan& plan = course.plans[i];
    const int b = course.first_block + direction * i;
    const int row = b * kBlockRows + (direction > 0 ? 0 : kBlockRows - 1);
    Block block;
    block.stride = direction * kLanes;
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(row) * kLanes;
    block.hiding_m = strip.hiding_m + at;
    block.edge_m = strip.edge_m + at;
    block.weight = strip.weight == nullptr ? nullptr : strip.weight + at;
    block.first_step = direction * row - 1 + kBlockRows;
    const std::int32_t kind = strip.block_kind[b];
    const float* highest_m = strip.highest_m + static_cast<std::ptrdiff_t>(b) * kLanes;
    const Floats highest = hn::Load(tag, highest_m);
    if (i % 2 == 0) {
      const Floats of_two = i + 1 == course.block_count
                                ? highest
                                : hn::Max(highest, hn::Load(tag, highest_m + direction * kLanes));
      far_count =
          list_observers<kFurther>(steps, observers, of_two, block.first_step, 2 * kBlockRows,
                                   plan.asked_twice_begin, plan.asked_twice_end, 0);
    }
    if ((kind & kHasUnknown) != 0 || block.weight != nullptr) {
      add_unknown(task, observers, block, kind, plan.reach_begin, plan.reach_end);
    }
    if ((kind & kHasKnown) == 0) {
      continue;
    }
    const int count =
        list_observers<kFurther>(steps, observers, highest, block.first_step, kBlockRows,
                                 plan.asked_begin, plan.asked_end, far_count);
    look_at_block<kFurther>(steps, observers, block, kind, far_count + count);
  }
}

template <int kFurther>
void run(const LineTask& task, float* floats, std::int32_t* indices) {
  const FloatTag tag;
  const auto take = [](auto*& memory, std::ptrdiff_t count) {
    auto* taken = memory;
    memory += count;
    return taken;
  };
  const std::ptrdiff_t row_floats = static_cast<std::ptrdiff_t>(task.buffer_rows) * kLanes;
  Strip strips[kStripsTogether];
  for (Strip& strip : strips) {
    strip.hiding_m = take(floats, row_floats);
    strip.edge_m = take(floats, row_floats);
    strip.weight = task.ground_weight == nullptr ? nullptr : take(floats, row_floats);
    strip.highest_m = take(floats, row_floats / kBlockRows);
    strip.block_kind = take(indices, task.buffer_rows / kBlockRows);
  }
  auto* plans = reinterpret_cast<BlockPlan*>(
      take(indices, 2 * (task.buffer_rows / kBlockRows) * kPlanNumbers));
  const auto row_count = static_cast<std::ptrdiff_t>(task.rows->size());
  StripObservers observers;
  observers.eyes_m = take(floats, row_count * kLanes);
  observers.down = row_count * kLanes;
  observers.greatest = take(floats, 2 * row_count * kLanes);
  observers.seen = take(floats, row_count * kLanes);
  observers.unknown = take(floats, row_count * kLanes);
  observers.further_plane = row_count * kLanes;
  observers.further_greatest = take(floats, 2 * kFurther * row_count * kLanes);
  observers.further_seen = take(floats, kFurther * row_count * kLanes);
  float* greatest_down = observers.greatest + observers.down;
  float* further_greatest_down = observers.further_greatest + kFurther * observers.further_plane;
  observers.buffer_row = take(indices, row_count);
  observers.from = take(indices, row_count);
  observers.listed = take(indices, row_count);
  observers.listed_heights = take(indices, row_count);
  Course upwards{1, 0, 0, take(indices, row_count), plans};
  Course downwards{-1, 0, 0, take(indices, row_count), plans + task.buffer_rows / kBlockRows};
  const std::vector<ObserverRow>& rows = *task.rows;
  int columns_begin = rows.front().skewed_begin;
  int columns_end = rows.front().skewed_end;
  for (const ObserverRow& row : rows) {
    columns_begin = std::min(columns_begin, row.skewed_begin);
    columns_end = std::max(columns_end, row.skewed_end);
  }
  constexpr int kColumnsTogether = kStripsTogether * kLanes;
  constexpr std::size_t kRowsAhead = 8;
  std::ptrdiff_t planned_count = 0;
  std::int32_t planned_first = 0;
  std::int32_t planned_last = 0;
  for (int group = columns_begin; group < columns_end; group += kColumnsTogether) {
    const int group_end = std::min(group + kColumnsTogether, columns_end);
    int first_row = task.buffer_rows;
    int last_row = -1;
    for (const ObserverRow& row : rows) {
      if (row.skewed_end > group && row.skewed_begin < group_end) {
        first_row = std::min(first_row, row.buffer_row);
        last_row = std::max(last_row, row.buffer_row);
      }
    }
    if (last_row < 0) {
      continue;
    }
    const int reach = task.steps->count;
    build(task, strips, group, (group_end - group + kLanes - 1) / kLanes,
          (first_row - reach) / kBlockRows * kBlockRows,
          ((last_row + reach) / kBlockRows + 1) * kBlockRows);
    for (int column = group; column < group_end; column += kLanes) {
      const Strip& strip = strips[(column - group) / kLanes];
      std::ptrdiff_t n = 0;
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const ObserverRow& row = rows[i];
        if (row.skewed_end <= column || row.skewed_begin >= column + kLanes) {
          continue;
        }
        hwy::Prefetch(task.eyes_m + rows[std::min(i + kRowsAhead, rows.size() - 1)].at + column);
        observers.buffer_row[n] = row.buffer_row;
        observers.from[n] = static_cast<std::int32_t>(i);
        const std::ptrdiff_t at = n * kLanes;
        hn::Store(hn::LoadU(tag, task.eyes_m + row.at + column), tag, observers.eyes_m + at);
        hn::Store(hn::Zero(tag), tag, observers.unknown + at);
        ++n;
      }
      if (n == 0) {
        continue;
      }
      const bool is_planned = n == planned_count && observers.from[0] == planned_first &&
                              observers.from[n - 1] == planned_last;
      observers.count = static_cast<int>(n);
      observers.is_some_unknown = false;
      if (!is_planned) {
        plan(*task.steps, observers, upwards);
        plan(*task.steps, observers, downwards);
        // Others between the same first and last ones would be another course.
        const bool is_without_gap = observers.from[n - 1] - observers.from[0] + 1 == n;
        planned_count = is_without_gap ? n : 0;
        planned_first = observers.from[0];
        planned_last = observers.from[n - 1];
      }
      look_near_all<kFurther>(task, strip, observers, column);
      look_along<kFurther>(task, strip, observers, upwards);
      std::swap(observers.greatest, greatest_down);
      std::swap(observers.further_greatest, further_greatest_down);
      look_along<kFurther>(task, strip, observers, downwards);
      std::swap(observers.greatest, greatest_down);
      std::swap(observers.further_greatest, further_greatest_down);
      for (std::ptrdiff_t o = 0; o < n; ++o) {
        const auto of = static_cast<std::size_t>(observers.from[o]);
        hwy::Prefetch(task.seen + rows[std::min(of + kRowsAhead, rows.size() - 1)].at + column);
        const std::ptrdiff_t to = rows[of].at + column;
        const std::ptrdiff_t at = o * kLanes;
        const Floats seen = hn::Load(tag, observers.seen + at);
        add_to(task.seen + to, seen);
        if constexpr (kFurther > 0) {
          add_to(task.further + to, seen);
          for (int h = 0; h < kFurther; ++h) {
            add_to(task.further + (h + 1) * task.further_plane + to,
                   hn::Load(tag, observers.further_seen + h * observers.further_plane + at));
          }
        }
        if (observers.is_some_unknown) {
          const Floats less = hn::Neg(hn::Load(tag, observers.unknown + at));
          add_to(task.known + to, less);
          if constexpr (kFurther > 0) {
            add_to(task.further + (kFurther + 1) * task.further_plane + to, less);
          }
        }
      }
    }
  }
}

void add_lines_kernel(const LineTask& task, float* floats, std::int32_t* indices) {
  switch (task.further_count) {
    case 0:
      return run<0>(task, floats, indices);
    case 1:
      return run<1>(task, floats, indices);
    case 2:
      return run<2>(task, floats, indices);
    case 3:
      return run<3>(task, floats, indices);
    default:
      return run<4>(task, floats, indices);
  }
}

}  // namespace hedgehop::preparation::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hedgehop::preparation {
namespace {

HWY_EXPORT(add_lines_kernel);

constexpr std::int64_t kAvx512Targets = HWY_AVX3 | HWY_AVX3_DL;

std::int64_t usable_targets() { return hwy::SupportedTargets() & HWY_TARGETS; }

// Start of the aligned part of a vector with room for `count` floats.
float* aligned(std::vector<float>& memory, std::size_t count) {
  constexpr std::size_t kAlignment = 64;
  const std::size_t needed = count + kAlignment / sizeof(float);
  if (memory.size() < needed) {
    memory.resize(needed);
  }
  const auto address = reinterpret_cast<std::uintptr_t>(memory.data());
  return memory.data() + (kAlignment - address % kAlignment) % kAlignment / sizeof(float);
}

}  // namespace

bool is_available(Simd simd) {
  switch (simd) {
    case Simd::kAvx2:
      return (usable_targets() & HWY_AVX2) != 0;
    case Simd::kAvx512:
      return (usable_targets() & kAvx512Targets) != 0;
    case Simd::kBest:
      break;
  }
  return true;
}

const char* name_of_simd(Simd simd) {
  if (simd == Simd::kAvx512 || (simd == Simd::kBest && is_available(Simd::kAvx512))) {
    return "avx512";
  }
  if (simd == Simd::kAvx2 || is_available(Simd::kAvx2)) {
    return "avx2";
  }
  return hwy::TargetName(usable_targets() & -usable_targets());
}

namespace {

void best_kernel(const LineTask& task, float* floats, std::int32_t* indices) {
  HWY_DYNAMIC_DISPATCH(add_lines_kernel)(task, floats, indices);
}

}  // namespace

LineKernel line_kernel(Simd simd) {
  if (!is_available(simd)) {
    throw std::invalid_argument("visibility: this processor lacks the instructions asked for");
  }
#if (HWY_TARGETS & HWY_AVX2) && HWY_TARGETS != HWY_AVX2
  if (simd == Simd::kAvx2) {
    return &N_AVX2::add_lines_kernel;
  }
#endif
  return &best_kernel;
}

void add_lines(const LineTask& task, LineBuffers& buffers, LineKernel kernel) {
  // As the kernel takes it, with the widest vectors.
  const auto rows = static_cast<std::size_t>(task.buffer_rows);
  const std::size_t blocks = rows / kBlockRows;
  const std::size_t observers = task.rows->size();
  const auto further = static_cast<std::size_t>(task.further_count);
  buffers.indices.resize(std::max(buffers.indices.size(),
                                  (kStripsTogether + 2 * kPlanNumbers) * blocks + 6 * observers));
  kernel(task,
         aligned(buffers.floats, kLanesMax * (kStripsTogether * (3 * rows + blocks) +
                                              (5 + 3 * further) * observers)),
         buffers.indices.data());
}

}  // namespace hedgehop::preparation
#endif
