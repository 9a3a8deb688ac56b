#include "preparation/visibility_kernel.hpp"

#include <algorithm>
#include <stdexcept>
#include <type_traits>
#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "preparation/visibility_kernel.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace hedgehop::preparation::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
template <typename T>
using Tag = hn::CappedTag<T, kLanesMax>;
template <typename T>
using Vec = hn::Vec<Tag<T>>;
template <typename T>
using Mask = hn::Mask<Tag<T>>;
using Shorts = Vec<std::int16_t>;
using Ints = Vec<std::int32_t>;
template <typename T>
constexpr int kLanes = static_cast<int>(hn::MaxLanes(Tag<T>()));

// From here on two blocks are asked about at once.
constexpr int kAskedTwiceUntil = 48;
// By so much the bound of two blocks may be too low, if the second lies in the next ring: ratio,
// slope and drop are rounded anew there.
constexpr int kRingMargin = 4;

// Arithmetic that saturates at -limit - 1 and limit, which 16 bits do on their own.
template <typename T>
struct Arithmetic;

template <>
struct Arithmetic<std::int16_t> {
  explicit Arithmetic(const RaySteps& /*steps*/) {}

  static constexpr std::int16_t limit = 32767;
  [[nodiscard]] HWY_INLINE Shorts plus(Shorts a, Shorts b) const { return hn::SaturatedAdd(a, b); }
  [[nodiscard]] HWY_INLINE Shorts minus(Shorts a, Shorts b) const { return hn::SaturatedSub(a, b); }
  // value times ratio / kOne
  [[nodiscard]] HWY_INLINE Shorts scaled(Shorts value, Shorts ratio) const {
    return hn::MulFixedPoint15(value, ratio);
  }
  // What samples of this weight count for on ground of this weight.
  [[nodiscard]] HWY_INLINE Shorts counted(Shorts weight, Shorts ground_weight) const {
    const Tag<std::int16_t> tag;
    const hn::RebindToUnsigned<Tag<std::int16_t>> bits;
    return hn::BitCast(tag, hn::MulHigh(hn::BitCast(bits, hn::Add(weight, hn::Set(tag, 1))),
                                        hn::BitCast(bits, ground_weight)));
  }
};

template <>
struct Arithmetic<std::int32_t> {
  explicit Arithmetic(const RaySteps& steps) : limit(steps.limit) {}

  std::int32_t limit;
  [[nodiscard]] HWY_INLINE Ints saturated(Ints value) const {
    const Tag<std::int32_t> tag;
    return hn::Min(hn::Max(value, hn::Set(tag, -limit - 1)), hn::Set(tag, limit));
  }
  [[nodiscard]] HWY_INLINE Ints plus(Ints a, Ints b) const { return saturated(hn::Add(a, b)); }
  [[nodiscard]] HWY_INLINE Ints minus(Ints a, Ints b) const { return saturated(hn::Sub(a, b)); }
  [[nodiscard]] HWY_INLINE Ints scaled(Ints value, Ints ratio) const {
    // In two parts, as the whole product has more than 32 bits.
    constexpr int kLowBits = 12;
    const Tag<std::int32_t> tag;
    const Ints low = hn::And(value, hn::Set(tag, (1 << kLowBits) - 1));
    const Ints low_product = hn::Add(hn::Mul(low, ratio), hn::Set(tag, kOne / 2));
    const Ints high_product = hn::Mul(hn::ShiftRight<kLowBits>(value), ratio);
    return hn::ShiftRight<15 - kLowBits>(
        hn::Add(high_product, hn::ShiftRight<kLowBits>(low_product)));
  }
  [[nodiscard]] HWY_INLINE Ints counted(Ints weight, Ints ground_weight) const {
    const Tag<std::int32_t> tag;
    const hn::RebindToUnsigned<Tag<std::int32_t>> bits;
    return hn::BitCast(
        tag, hn::ShiftRight<16>(hn::Mul(hn::BitCast(bits, hn::Add(weight, hn::Set(tag, 1))),
                                        hn::BitCast(bits, ground_weight))));
  }
};

HWY_INLINE Shorts load_weight(Tag<std::int16_t> tag, const std::uint16_t* from) {
  const hn::RebindToUnsigned<Tag<std::int16_t>> bits;
  return hn::BitCast(tag, hn::LoadU(bits, from));
}
HWY_INLINE Ints load_weight(Tag<std::int32_t> tag, const std::uint16_t* from) {
  return hn::PromoteTo(tag, hn::LoadU(hn::Rebind<std::uint16_t, Tag<std::int32_t>>(), from));
}

// sum + (condition ? value : 0), in one operation where the processor can.
template <typename T>
HWY_INLINE Vec<T> add_if(Mask<T> condition, Vec<T> sum, Vec<T> value) {
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
  if constexpr (sizeof(T) == 2) {
    return Vec<T>{_mm512_mask_add_epi16(sum.raw, condition.raw, sum.raw, value.raw)};
  } else {
    return Vec<T>{_mm512_mask_add_epi32(sum.raw, condition.raw, sum.raw, value.raw)};
  }
#else
  return hn::Add(sum, hn::IfThenElseZero(condition, value));
#endif
}

template <typename T>
HWY_INLINE Vec<T> all(std::int32_t value) {
  const Tag<T> tag;
  return hn::Set(tag, static_cast<T>(value));
}

template <typename T>
HWY_INLINE const StepTable& table_of(const RaySteps& steps) {
  return sizeof(T) == 2 ? steps.pairs : steps.numbers;
}
// Only fine units have it.
template <typename T>
constexpr bool kHasRestOfDrop = sizeof(T) == 4;
// An entry of the table in all lanes.
template <typename T>
HWY_INLINE Vec<T> entry(std::int32_t value) {
  const Tag<T> tag;
  const hn::Repartition<std::int32_t, Tag<T>> entries;
  return hn::BitCast(tag, hn::Set(entries, value));
}

// Adds lanes, which hold unsigned numbers of 16 bits, or takes them off.
template <typename Combine>
HWY_INLINE void combine_with(std::int32_t* target, Shorts values, const Combine& combine) {
  const hn::RebindToUnsigned<Tag<std::int16_t>> bits;
  const hn::Half<hn::RebindToUnsigned<Tag<std::int16_t>>> half;
  const hn::Repartition<std::int32_t, Tag<std::int16_t>> wide;
  const auto unsigned_values = hn::BitCast(bits, values);
  const auto lower = hn::PromoteTo(wide, hn::LowerHalf(half, unsigned_values));
  const auto upper = hn::PromoteTo(wide, hn::UpperHalf(half, unsigned_values));
  std::int32_t* beyond = target + hn::Lanes(wide);
  hn::StoreU(combine(hn::LoadU(wide, target), lower), wide, target);
  hn::StoreU(combine(hn::LoadU(wide, beyond), upper), wide, beyond);
}
template <typename Combine>
HWY_INLINE void combine_with(std::int32_t* target, Ints values, const Combine& combine) {
  const Tag<std::int32_t> tag;
  hn::StoreU(combine(hn::LoadU(tag, target), values), tag, target);
}
template <typename V>
HWY_INLINE void add_to(std::int32_t* target, V values) {
  combine_with(target, values, [](auto a, auto b) HWY_ATTR { return hn::Add(a, b); });
}
template <typename V>
HWY_INLINE void take_from(std::int32_t* target, V values) {
  combine_with(target, values, [](auto a, auto b) HWY_ATTR { return hn::Sub(a, b); });
}

// Arrays of a strip: kLanes values for each row, each block or each row of observers.
template <typename T>
struct Strip {
  T* hiding = nullptr;                 // by row: height of the ground
  T* looked_at = nullptr;              // by row: the same, or an edge's
  T* weight = nullptr;                 // by row; null: all known ground counts alike
  T* highest = nullptr;                // by block, of what is looked at and what hides
  T* lowest = nullptr;                 // likewise
  std::int32_t* block_kind = nullptr;  // by block
};

// Arrays for the observers of a strip: kLanes values for each row of them.
template <typename T>
struct StripObservers {
  int count = 0;
  T* eyes = nullptr;
  Vec<T> lowest_eye;
  Vec<T> highest_eye;
  T* greatest = nullptr;
  T* seen = nullptr;
  T* unknown = nullptr;
  T* further_greatest = nullptr;  // planes of further_plane
  T* further_seen = nullptr;
  std::ptrdiff_t down = 0;           // from `greatest` of upward rays to that of downward rays
  std::ptrdiff_t further_plane = 0;  // there the planes of all heights lie between
  bool is_some_unknown = false;

  std::int32_t* buffer_row = nullptr;    // rising
  const std::int32_t* behind = nullptr;  // buffer_row counted along the rays, from any row
  std::int32_t* from = nullptr;          // row in the task
  // Those that look at a block: from the front those whose first sample of it is even, from the end
  // those whose first sample is odd.
  std::int32_t* listed = nullptr;
  // With further heights: from which of them, bit 0 being the reference height; parallel to listed
  std::int32_t* listed_heights = nullptr;
};

// Bits of a block's kind.
constexpr std::int32_t kHasUnknown = 1;
constexpr std::int32_t kHasKnown = 2;
// From here on a bit for each row with edges, upwards; then the same for each row downwards.
constexpr int kEdgeRowsShift = 8;
constexpr std::int32_t kEdgeRows = (1 << kBlockRows) - 1;

// A block in the order in which rays in one direction cross it.
template <typename T>
struct Block {
  const T* hiding = nullptr;
  const T* looked_at = nullptr;
  const T* weight = nullptr;
  std::ptrdiff_t stride = 0;  // to the next row
  int first_step = 0;         // the first row's sample is this less StripObservers::behind
  std::int32_t edge_rows = 0;
};

// How many are listed.
struct ListedCounts {
  std::ptrdiff_t even = 0;
  std::ptrdiff_t odd = 0;
};

// Lists observers of [begin, end), beside those `before`, that may see something of the next `rows`
// rows, which are at most `highest`. Leaving others out changes no bit: operations are monotone,
// rounding included, but where rays enter a ring, where a margin does.
template <typename T, int kFurther>
HWY_NOINLINE ListedCounts list_observers(const RaySteps& steps, const StripObservers<T>& observers,
                                         Vec<T> highest, int first_step, int rows, int begin,
                                         int end, ListedCounts before) {
  const Tag<T> tag;
  const Arithmetic<T> math(steps);
  const std::int32_t* HWY_RESTRICT ratio = table_of<T>(steps).ratio.data();
  const std::int32_t* HWY_RESTRICT drop = table_of<T>(steps).drop.data();
  const std::int32_t* HWY_RESTRICT lower = table_of<T>(steps).lower.data();
  const std::int32_t* HWY_RESTRICT block_at = steps.block_at.data();
  const T* HWY_RESTRICT eyes = observers.eyes;
  const T* HWY_RESTRICT greatest = observers.greatest;
  const T* HWY_RESTRICT further_greatest = observers.further_greatest;
  const std::int32_t* HWY_RESTRICT behind = observers.behind;
  const std::ptrdiff_t further_plane = observers.further_plane;
  std::int32_t* HWY_RESTRICT listed = observers.listed;
  std::int32_t* HWY_RESTRICT listed_heights = observers.listed_heights;
  std::ptrdiff_t even = before.even;
  std::ptrdiff_t odd_begin = observers.count - before.odd;
  const Vec<T> margin = all<T>(rows > kBlockRows ? kRingMargin : 0);
  for (std::ptrdiff_t o = begin; o < end; ++o) {
    const std::ptrdiff_t first = first_step - behind[o];
    const std::ptrdiff_t at = block_at[first];
    const Vec<T> above = math.minus(highest, hn::Load(tag, eyes + o * kLanes<T>));
    const Vec<T> slope = hn::Max(math.scaled(above, entry<T>(ratio[at])),
                                 math.scaled(above, entry<T>(ratio[at + rows - 1])));
    const Vec<T> bound = math.minus(slope, math.minus(entry<T>(drop[at]), margin));
    std::int32_t heights =
        hn::AllTrue(tag, hn::Gt(hn::Load(tag, greatest + o * kLanes<T>), bound)) ? 0 : 1;
#pragma GCC unroll 4
    for (int h = 0; h < kFurther; ++h) {
      const Vec<T> least = hn::Min(entry<T>(lower[at * kFurther + h]),
                                   entry<T>(lower[(at + rows - 1) * kFurther + h]));
      const Vec<T> there = hn::Load(tag, further_greatest + h * further_plane + o * kLanes<T>);
      const auto is_hidden = hn::Gt(there, math.minus(bound, least));
      heights |= hn::AllTrue(tag, is_hidden) ? 0 : 2 << h;
    }
    // Both lists have room for one more, so there is no need for a branch.
    listed[even] = static_cast<std::int32_t>(o);
    listed[odd_begin - 1] = static_cast<std::int32_t>(o);
    if constexpr (kFurther > 0) {
      listed_heights[even] = heights;
      listed_heights[odd_begin - 1] = heights;
    }
    const std::ptrdiff_t is_listed = heights == 0 ? 0 : 1;
    const std::ptrdiff_t is_odd = is_listed & first;
    even += is_listed ^ is_odd;
    odd_begin -= is_odd;
  }
  return {even, observers.count - odd_begin};
}

// A ray of each lane from one height: the greatest slope so far, and the weights seen.
template <typename T>
struct View {
  Vec<T> greatest;
  Vec<T> seen;
};

// One sample of it. Ties count for every other sample, the odd ones: `kTie`. Lanes that are unknown
// have the lowest slope and count for nothing.
template <bool kTie, typename T>
HWY_INLINE void look_at(View<T>& view, Vec<T> slope, Vec<T> looked_at, Vec<T> counts) {
  if constexpr (!kTie) {
    view.seen = add_if<T>(hn::Gt(looked_at, view.greatest), view.seen, counts);
  } else {
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
    if constexpr (sizeof(T) == 2) {
      const auto is_seen = _mm512_cmpge_epi16_mask(looked_at.raw, view.greatest.raw);
      view.seen = add_if<T>(Mask<T>{is_seen}, view.seen, counts);
    } else {
      const auto is_seen = _mm512_cmpge_epi32_mask(looked_at.raw, view.greatest.raw);
      view.seen = add_if<T>(Mask<T>{is_seen}, view.seen, counts);
    }
#else
    // These have no operation for greater or equal.
    view.seen = hn::Add(view.seen, hn::IfThenZeroElse(hn::Gt(view.greatest, looked_at), counts));
#endif
  }
  view.greatest = hn::Max(view.greatest, slope);
}
// The same in row i of a block, which is known when its loop is unrolled. kOdd: row 0 is odd.
template <bool kOdd, typename T>
HWY_INLINE void look_at_row(int i, View<T>& view, Vec<T> slope, Vec<T> looked_at, Vec<T> counts) {
  if (i % 2 == 0) {
    look_at<kOdd>(view, slope, looked_at, counts);
  } else {
    look_at<!kOdd>(view, slope, looked_at, counts);
  }
}

// What samples of this weight count for where the ground is known; `ground_weight` null: all
// counts.
template <typename T>
HWY_INLINE Vec<T> counted_where(const Arithmetic<T>& math, Mask<T> is_known, Vec<T> weight,
                                const T* ground_weight) {
  const Tag<T> tag;
  return hn::IfThenElseZero(is_known, ground_weight == nullptr
                                          ? weight
                                          : math.counted(weight, hn::Load(tag, ground_weight)));
}

// What rays have seen is the same slope in the next ring, where it counts twice.
template <typename T>
HWY_INLINE Vec<T> in_next_ring(const Arithmetic<T>& math, Vec<T> greatest) {
  const Tag<T> tag;
  // The lowest number stays free for what saturates.
  return hn::Max(math.plus(greatest, greatest), hn::Set(tag, static_cast<T>(-math.limit)));
}

// Some of the listed observers look at the block. kOdd: its first sample is odd. kMild: no height
// differs from an eye by more than saturates.
template <typename T, bool kOdd, bool kMasked, bool kMild, bool kAllEdges>
HWY_NOINLINE void look(const RaySteps& steps, const StripObservers<T>& observers,
                       const Block<T>& block, const std::int32_t* HWY_RESTRICT listed, int count) {
  const Tag<T> tag;
  const Arithmetic<T> math(steps);
  const std::ptrdiff_t stride = block.stride;
  Vec<T> hiding[kBlockRows];
#pragma GCC unroll 8
  for (int i = 0; i < kBlockRows; ++i) {
    hiding[i] = hn::Load(tag, block.hiding + i * stride);
  }
  const std::int32_t* HWY_RESTRICT ratio = table_of<T>(steps).ratio.data();
  const std::int32_t* HWY_RESTRICT drop = table_of<T>(steps).drop.data();
  const std::int32_t* HWY_RESTRICT weight = table_of<T>(steps).weight.data();
  const std::int32_t* HWY_RESTRICT block_at = steps.block_at.data();
  const std::int32_t* HWY_RESTRICT rest_of_drop = table_of<T>(steps).rest_of_drop.data();
  const T* HWY_RESTRICT looked_at = block.looked_at;
  const T* HWY_RESTRICT ground_weight = block.weight;
  const T* HWY_RESTRICT eyes = observers.eyes;
  T* HWY_RESTRICT all_greatest = observers.greatest;
  T* HWY_RESTRICT all_seen = observers.seen;
  const std::int32_t* HWY_RESTRICT behind = observers.behind;
  const int first_step = block.first_step;
  const std::int32_t edge_rows = block.edge_rows;
  for (std::ptrdiff_t n = 0; n < count; ++n) {
    const std::ptrdiff_t o = listed[n];
    const std::ptrdiff_t at = block_at[first_step - behind[o]];
    const Vec<T> eye = hn::Load(tag, eyes + o * kLanes<T>);
    const Vec<T> lowered = entry<T>(drop[at]);
    View<T> view{math.plus(hn::Load(tag, all_greatest + o * kLanes<T>), lowered),
                 hn::Load(tag, all_seen + o * kLanes<T>)};
#pragma GCC unroll 8
    for (int i = 0; i < kBlockRows; ++i) {
      const Vec<T> step_ratio = entry<T>(ratio[at + i]);
      const auto slope_of = [&](Vec<T> z) HWY_ATTR {
        const Vec<T> slope = math.scaled(kMild ? hn::Sub(z, eye) : math.minus(z, eye), step_ratio);
        return kHasRestOfDrop<T> ? math.minus(slope, entry<T>(rest_of_drop[at + i])) : slope;
      };
      Vec<T> slope = slope_of(hiding[i]);
      Vec<T> looked_at_slope = slope;
      if (kAllEdges || (edge_rows & 1 << i) != 0) {
        looked_at_slope = slope_of(hn::Load(tag, looked_at + i * stride));
      }
      Vec<T> counts = entry<T>(weight[at + i]);
      if constexpr (kMasked) {
        const Mask<T> is_known = hn::Ne(hiding[i], hn::Set(tag, kUnknownHeight<T>));
        slope = hn::IfThenElse(is_known, slope, all<T>(-math.limit - 1));
        counts = counted_where<T>(math, is_known, counts,
                                  ground_weight == nullptr ? nullptr : ground_weight + i * stride);
      }
      look_at_row<kOdd>(i, view, slope, looked_at_slope, counts);
    }
    hn::Store(math.minus(view.greatest, lowered), tag, all_greatest + o * kLanes<T>);
    hn::Store(view.seen, tag, all_seen + o * kLanes<T>);
  }
}

// The same from further heights too.
template <typename T, int kFurther, bool kOdd, bool kMasked>
HWY_NOINLINE void look_from_all(const RaySteps& steps, const StripObservers<T>& observers,
                                const Block<T>& block, const std::int32_t* HWY_RESTRICT listed,
                                const std::int32_t* HWY_RESTRICT listed_heights, int count) {
  const Tag<T> tag;
  const Arithmetic<T> math(steps);
  const std::int32_t* HWY_RESTRICT ratio = table_of<T>(steps).ratio.data();
  const std::int32_t* HWY_RESTRICT weight = table_of<T>(steps).weight.data();
  const std::int32_t* HWY_RESTRICT lower = table_of<T>(steps).lower.data();
  const std::int32_t* HWY_RESTRICT rest_of_drop = table_of<T>(steps).rest_of_drop.data();
  for (std::ptrdiff_t n = 0; n < count; ++n) {
    const std::ptrdiff_t o = listed[n];
    const std::ptrdiff_t step = steps.block_at[block.first_step - observers.behind[o]];
    const std::ptrdiff_t at = o * kLanes<T>;
    const Vec<T> eye = hn::Load(tag, observers.eyes + at);
    const Vec<T> lowered = entry<T>(table_of<T>(steps).drop[step]);
    Vec<T> slope[kBlockRows];
    Vec<T> looked_at[kBlockRows];
    Vec<T> counts[kBlockRows];
#pragma GCC unroll 8
    for (int i = 0; i < kBlockRows; ++i) {
      const Vec<T> step_ratio = entry<T>(ratio[step + i]);
      const Vec<T> hiding = hn::Load(tag, block.hiding + i * block.stride);
      const auto slope_of = [&](Vec<T> z) HWY_ATTR {
        const Vec<T> of_z = math.scaled(math.minus(z, eye), step_ratio);
        return kHasRestOfDrop<T> ? math.minus(of_z, entry<T>(rest_of_drop[step + i])) : of_z;
      };
      slope[i] = slope_of(hiding);
      looked_at[i] = slope[i];
      if ((block.edge_rows & 1 << i) != 0) {
        looked_at[i] = slope_of(hn::Load(tag, block.looked_at + i * block.stride));
      }
      counts[i] = entry<T>(weight[step + i]);
      if constexpr (kMasked) {
        const Mask<T> is_known = hn::Ne(hiding, hn::Set(tag, kUnknownHeight<T>));
        slope[i] = hn::IfThenElse(is_known, slope[i], all<T>(-math.limit - 1));
        counts[i] =
            counted_where<T>(math, is_known, counts[i],
                             block.weight == nullptr ? nullptr : block.weight + i * block.stride);
      }
    }
    const std::int32_t heights = listed_heights[n];
    if ((heights & 1) != 0) {
      View<T> view{math.plus(hn::Load(tag, observers.greatest + at), lowered),
                   hn::Load(tag, observers.seen + at)};
#pragma GCC unroll 8
      for (int i = 0; i < kBlockRows; ++i) {
        look_at_row<kOdd>(i, view, slope[i], looked_at[i], counts[i]);
      }
      hn::Store(math.minus(view.greatest, lowered), tag, observers.greatest + at);
      hn::Store(view.seen, tag, observers.seen + at);
    }
#pragma GCC unroll 4
    for (int h = 0; h < kFurther; ++h) {
      if ((heights & 2 << h) == 0) {
        continue;
      }
      const std::ptrdiff_t there = h * observers.further_plane + at;
      View<T> view{math.plus(hn::Load(tag, observers.further_greatest + there), lowered),
                   hn::Load(tag, observers.further_seen + there)};
#pragma GCC unroll 8
      for (int i = 0; i < kBlockRows; ++i) {
        const Vec<T> from_there = entry<T>(lower[(step + i) * kFurther + h]);
        look_at_row<kOdd>(i, view, math.minus(slope[i], from_there),
                          math.minus(looked_at[i], from_there), counts[i]);
      }
      hn::Store(math.minus(view.greatest, lowered), tag, observers.further_greatest + there);
      hn::Store(view.seen, tag, observers.further_seen + there);
    }
  }
}

// The nearest samples of both rays of a row of observers, `side` 0 ahead and 1 behind.
template <typename T>
struct ExactSamples {
  const LineTask<T>* task = nullptr;
  Arithmetic<T> math;
  const T* ground = nullptr;  // at the observers
  const std::uint16_t* weight = nullptr;

  ExactSamples(const LineTask<T>& of_task, const ObserverRow& row, int skewed_column)
      : task(&of_task), math(*of_task.steps) {
    const std::ptrdiff_t at =
        row.buffer_row * of_task.stride + static_cast<std::ptrdiff_t>(skewed_column) - row.shift;
    ground = of_task.ground + at;
    if (of_task.ground_weight != nullptr) {
      weight = of_task.ground_weight + at;
    }
  }

  // Of sample k.
  [[nodiscard]] HWY_INLINE std::ptrdiff_t offset(int k, int side) const {
    return (side == 0 ? k : -k) * task->stride + task->exact_left[side * kExactSteps + k - 1];
  }
  [[nodiscard]] HWY_INLINE std::int16_t fraction(int k, int side) const {
    return task->exact_fraction[side * kExactSteps + k - 1];
  }
  // Height if both cells beside it are known; `lowest` becomes the lower one if it is lower.
  [[nodiscard]] HWY_INLINE Vec<T> height(int k, int side, Vec<T>& lowest) const {
    const Tag<T> tag;
    const T* left = ground + offset(k, side);
    const Vec<T> a = hn::LoadU(tag, left);
    const Vec<T> b = hn::LoadU(tag, left + (fraction(k, side) == 0 ? 0 : 1));
    lowest = hn::Min(lowest, hn::Min(a, b));
    return hn::Add(a, math.scaled(math.minus(b, a), all<T>(fraction(k, side))));
  }
  // What a sample of this weight counts for if it is known.
  [[nodiscard]] HWY_INLINE Vec<T> counted_at(int k, int side, Vec<T> step_weight) const {
    const Tag<T> tag;
    if (weight == nullptr) {
      return step_weight;
    }
    const int nearest = fraction(k, side) < kOne / 2 ? 0 : 1;
    return math.counted(step_weight, load_weight(tag, weight + offset(k, side) + nearest));
  }
};

// Both rays of a row of observers over the near ground, which some lane nearly always sees: `up`
// and `down` rows of it. kMasked: some of it may be unknown or weighted. Returns false, with
// nothing done, if it must be masked and is not.
template <typename T, int kFurther, bool kEdges, bool kMasked>
HWY_NOINLINE bool look_near(const LineTask<T>& task, const Strip<T>& strip,
                            StripObservers<T>& observers, const ExactSamples<T>& samples,
                            std::ptrdiff_t o, int up, int down) {
  const Tag<T> tag;
  const RaySteps& steps = *task.steps;
  const Arithmetic<T> math(steps);
  const std::int32_t* HWY_RESTRICT ratio = table_of<T>(steps).ratio.data();
  const std::int32_t* HWY_RESTRICT drop = table_of<T>(steps).drop.data();
  const std::int32_t* HWY_RESTRICT weight = table_of<T>(steps).weight.data();
  const std::int32_t* HWY_RESTRICT lower = table_of<T>(steps).lower.data();
  const std::ptrdiff_t here = static_cast<std::ptrdiff_t>(observers.buffer_row[o]) * kLanes<T>;
  const T* HWY_RESTRICT hiding = strip.hiding + here;
  const T* HWY_RESTRICT looked_at = strip.looked_at + here;
  const T* HWY_RESTRICT ground_weight = strip.weight == nullptr ? nullptr : strip.weight + here;
  const std::ptrdiff_t lanes_at = o * kLanes<T>;
  const Vec<T> eye = hn::Load(tag, observers.eyes + lanes_at);
  const Vec<T> unknown_height = hn::Set(tag, kUnknownHeight<T>);
  const Vec<T> first_slope = hn::IfThenElse(hn::Eq(eye, hn::Set(tag, kBlindEye<T>)),
                                            all<T>(math.limit), all<T>(-math.limit - 1));
  View<T> views[2];
  View<T> further[kFurther + 1][2];
  for (int side = 0; side < 2; ++side) {
    views[side] = {first_slope, hn::Zero(tag)};
#pragma GCC unroll 4
    for (int h = 0; h < kFurther; ++h) {
      further[h][side] = views[side];
    }
  }
  Vec<T> lowest = hn::Set(tag, kBlindEye<T>);
  Vec<T> unknown = hn::Zero(tag);
  const auto enter_ring = [&]() HWY_ATTR {
    for (int side = 0; side < 2; ++side) {
      views[side].greatest = in_next_ring<T>(math, views[side].greatest);
#pragma GCC unroll 4
      for (int h = 0; h < kFurther; ++h) {
        further[h][side].greatest = in_next_ring<T>(math, further[h][side].greatest);
      }
    }
  };
  // `tie`: whether k is odd.
  const auto step = [&](auto tie, int k, int side, Vec<T> z, Vec<T> looked_at_z, Vec<T> counts,
                        Mask<T> is_known) HWY_ATTR {
    const Vec<T> step_ratio = entry<T>(ratio[k]);
    const Vec<T> step_drop = entry<T>(drop[k]);
    Vec<T> slope = math.minus(math.scaled(math.minus(z, eye), step_ratio), step_drop);
    const Vec<T> looked_at_slope =
        kEdges ? math.minus(math.scaled(math.minus(looked_at_z, eye), step_ratio), step_drop)
               : slope;
    if constexpr (kMasked) {
      slope = hn::IfThenElse(is_known, slope, all<T>(-math.limit - 1));
    }
    look_at<decltype(tie)::value>(views[side], slope, looked_at_slope, counts);
#pragma GCC unroll 4
    for (int h = 0; h < kFurther; ++h) {
      const Vec<T> from_there = entry<T>(lower[k * kFurther + h]);
      look_at<decltype(tie)::value>(further[h][side], math.minus(slope, from_there),
                                    math.minus(looked_at_slope, from_there), counts);
    }
  };
  const auto exact_step = [&](auto tie, int k, int side) HWY_ATTR {
    Vec<T> lower_one = hn::Set(tag, kBlindEye<T>);
    const Vec<T> z = samples.height(k, side, lower_one);
    lowest = hn::Min(lowest, lower_one);
    Vec<T> counts = entry<T>(weight[k]);
    const Mask<T> is_known = hn::Ne(lower_one, unknown_height);
    if constexpr (kMasked) {
      const Vec<T> full = counts;
      counts = hn::IfThenElseZero(is_known, samples.counted_at(k, side, full));
      unknown = hn::Add(unknown, hn::Sub(full, counts));
    }
    step(tie, k, side, z, z, counts, is_known);
  };
  const auto line_step = [&](auto tie, int k, int side) HWY_ATTR {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(side == 0 ? k : -k) * kLanes<T>;
    const Vec<T> z = hn::Load(tag, hiding + at);
    Vec<T> counts = entry<T>(weight[k]);
    const Mask<T> is_known = hn::Ne(z, unknown_height);
    if constexpr (kMasked) {
      counts = counted_where<T>(math, is_known, counts,
                                ground_weight == nullptr ? nullptr : ground_weight + at);
    }
    step(tie, k, side, z, kEdges ? hn::Load(tag, looked_at + at) : z, counts, is_known);
  };
  constexpr std::true_type kOdd;
  constexpr std::false_type kEven;
  const int exact_steps = std::min(kExactSteps, steps.count);
#pragma GCC unroll 4
  for (int k = 1; k < kExactSteps; k += 2) {
    if (k > exact_steps) {
      break;
    }
    exact_step(kOdd, k, 0);
    exact_step(kOdd, k, 1);
    if (k == exact_steps) {
      break;
    }
    if ((k & (k + 1)) == 0) {
      enter_ring();
    }
    exact_step(kEven, k + 1, 0);
    exact_step(kEven, k + 1, 1);
  }
  if (!kMasked && !hn::AllFalse(tag, hn::Eq(lowest, unknown_height))) {
    return false;
  }
  const int both = std::min(up, down);
  for (int k = kExactSteps + 1; k <= both; k += 2) {
    line_step(kOdd, k, 0);
    line_step(kOdd, k, 1);
    if (k == both) {
      break;
    }
    if ((k & (k + 1)) == 0) {
      enter_ring();
    }
    line_step(kEven, k + 1, 0);
    line_step(kEven, k + 1, 1);
  }
  const int side = up > down ? 0 : 1;
  for (int k = std::max(both, exact_steps) + 1; k <= std::max(up, down); ++k) {
    if (k % 2 != 0) {
      line_step(kOdd, k, side);
    } else {
      line_step(kEven, k, side);
    }
  }
  hn::Store(views[0].greatest, tag, observers.greatest + lanes_at);
  hn::Store(views[1].greatest, tag, observers.greatest + observers.down + lanes_at);
  hn::Store(hn::Add(views[0].seen, views[1].seen), tag, observers.seen + lanes_at);
#pragma GCC unroll 4
  for (int h = 0; h < kFurther; ++h) {
    const std::ptrdiff_t at = h * observers.further_plane + lanes_at;
    hn::Store(further[h][0].greatest, tag, observers.further_greatest + at);
    hn::Store(further[h][1].greatest, tag,
              observers.further_greatest + kFurther * observers.further_plane + at);
    hn::Store(hn::Add(further[h][0].seen, further[h][1].seen), tag, observers.further_seen + at);
  }
  if constexpr (kMasked) {
    hn::Store(unknown, tag, observers.unknown + lanes_at);
    observers.is_some_unknown = true;
  }
  return true;
}

// All near rays of a strip, which starts with a skewed column. They end with a block.
template <typename T, int kFurther>
void look_near_all(const LineTask<T>& task, const Strip<T>& strip, StripObservers<T>& observers,
                   int column) {
  const RaySteps& steps = *task.steps;
  for (std::ptrdiff_t o = 0; o < observers.count; ++o) {
    const int row = observers.buffer_row[o];
    const int up = std::min(kNearRows + kBlockRows - 1 - row % kBlockRows, steps.count);
    const int down = std::min(kNearRows + row % kBlockRows, steps.count);
    const ExactSamples<T> samples(task, (*task.rows)[static_cast<std::size_t>(observers.from[o])],
                                  column);
    std::int32_t kinds = 0;
    for (int b = (row - down) / kBlockRows; b <= (row + up) / kBlockRows; ++b) {
      kinds |= strip.block_kind[b];
    }
    const bool is_masked = task.ground_weight != nullptr || (kinds & kHasUnknown) != 0;
    const bool has_edges = (kinds >> kEdgeRowsShift & kEdgeRows) != 0;
    const bool is_done =
        !is_masked &&
        (has_edges
             ? look_near<T, kFurther, true, false>(task, strip, observers, samples, o, up, down)
             : look_near<T, kFurther, false, false>(task, strip, observers, samples, o, up, down));
    if (!is_done) {
      look_near<T, kFurther, true, true>(task, strip, observers, samples, o, up, down);
    }
  }
}

// Adds up the weight of unknown ground of the block for observers of [begin, end).
template <typename T>
HWY_NOINLINE void add_unknown(const RaySteps& steps, StripObservers<T>& observers,
                              const Block<T>& block, std::int32_t kind, int begin, int end) {
  const Tag<T> tag;
  const Arithmetic<T> math(steps);
  observers.is_some_unknown = true;
  for (std::ptrdiff_t o = begin; o < end; ++o) {
    const std::ptrdiff_t k = block.first_step - observers.behind[o] + kBlockRows;
    T* unknown = observers.unknown + o * kLanes<T>;
    Vec<T> sum = hn::Load(tag, unknown);
    if ((kind & kHasKnown) == 0) {
      const std::int32_t weight =
          steps.line_weight_before[k + kBlockRows] - steps.line_weight_before[k];
      sum = hn::Add(sum, hn::Set(tag, static_cast<T>(weight)));
    } else {
      for (int i = 0; i < kBlockRows; ++i) {
        const Vec<T> z = hn::Load(tag, block.hiding + i * block.stride);
        const Vec<T> full = all<T>(steps.line_weight[k + i]);
        const Vec<T> counts =
            counted_where<T>(math, hn::Ne(z, hn::Set(tag, kUnknownHeight<T>)), full,
                             block.weight == nullptr ? nullptr : block.weight + i * block.stride);
        sum = hn::Add(sum, hn::Sub(full, counts));
      }
    }
    hn::Store(sum, tag, unknown);
  }
}

// Interpolates a block of the strip that starts with a skewed column.
template <typename T>
HWY_INLINE void build_block(const LineTask<T>& task, const Strip<T>& strip, int column, int row) {
  const Tag<T> tag;
  const Vec<T> unknown_height = hn::Set(tag, kUnknownHeight<T>);
  const Arithmetic<T> math(*task.steps);
  const Vec<T> edge_bend = all<T>(kEdge_m * task.steps->units_per_metre);
  const Vec<T> level_raise = all<T>(task.steps->level_raise);
  const Vec<T> smooth_raise = all<T>(task.steps->smooth_raise);
  Vec<T> highest = unknown_height;
  Vec<T> lowest = hn::Set(tag, kBlindEye<T>);
  std::int32_t kind = 0;
  for (int i = 0; i < kBlockRows; ++i) {
    const int r = row + i;
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(r) * kLanes<T>;
    const std::int16_t fraction = task.fraction[r];
    const T* left = task.ground + r * task.stride + task.left[r] + column;
    const Vec<T> a = hn::LoadU(tag, left);
    const Vec<T> b = hn::LoadU(tag, left + (fraction == 0 ? 0 : 1));
    const Vec<T> between = hn::Add(a, math.scaled(math.minus(b, a), all<T>(fraction)));
    const Vec<T> z = hn::IfThenElse(hn::Eq(hn::Min(a, b), unknown_height), unknown_height, between);
    const int to_nearest = fraction < kOne / 2 ? 0 : 1;
    const Vec<T> before = hn::LoadU(tag, left + to_nearest - 1);
    const Vec<T> nearest = hn::LoadU(tag, left + to_nearest);
    const Vec<T> after = hn::LoadU(tag, left + to_nearest + 1);
    const Vec<T> rise_before = math.minus(before, nearest);
    const Vec<T> rise_after = math.minus(after, nearest);
    const Vec<T> bend = math.plus(rise_before, rise_after);
    const auto is_known = hn::Ne(hn::Min(hn::Min(before, after), nearest), unknown_height);
    const Vec<T> bend_size = hn::Max(bend, math.minus(hn::Zero(tag), bend));
    const auto is_edge = hn::And(is_known, hn::Gt(bend_size, edge_bend));
    const auto is_smooth = hn::And(is_known, hn::Gt(all<T>(kSmoothBendUnits + 1), bend_size));
    const auto is_level = hn::Eq(hn::Or(rise_before, rise_after), hn::Zero(tag));
    const Vec<T> raise =
        hn::IfThenElseZero(is_smooth, hn::IfThenElse(is_level, level_raise, smooth_raise));
    const Vec<T> looked_at = hn::IfThenElse(is_edge, nearest, hn::Add(z, raise));
    hn::Store(z, tag, strip.hiding + at);
    hn::Store(looked_at, tag, strip.looked_at + at);
    if (!hn::AllTrue(tag, hn::Eq(looked_at, z))) {
      const std::int32_t rows = 1 << i | 1 << (kBlockRows + kBlockRows - 1 - i);
      kind |= rows << kEdgeRowsShift;
    }
    highest = hn::Max(highest, hn::Max(z, looked_at));
    lowest = hn::Min(lowest, hn::Min(z, looked_at));
    if (strip.weight != nullptr) {
      hn::Store(load_weight(
                    tag, task.ground_weight + r * task.stride + task.left[r] + column + to_nearest),
                tag, strip.weight + at);
    }
  }
  kind |= hn::AllFalse(tag, hn::Eq(lowest, unknown_height)) ? 0 : kHasUnknown;
  kind |= hn::AllTrue(tag, hn::Eq(highest, unknown_height)) ? 0 : kHasKnown;
  strip.block_kind[row / kBlockRows] = kind;
  const std::ptrdiff_t of_block = static_cast<std::ptrdiff_t>(row / kBlockRows) * kLanes<T>;
  hn::Store(highest, tag, strip.highest + of_block);
  hn::Store(lowest, tag, strip.lowest + of_block);
}

template <typename T>
HWY_NOINLINE void build(const LineTask<T>& task, const Strip<T> (&strips)[kStripsTogether],
                        int column, int strip_count, int begin, int end) {
  // The raster is too large for the nearer caches, and no processor foresees skewed columns.
  constexpr int kCacheLine = 64 / static_cast<int>(sizeof(T));
  constexpr int kRowsAhead = 2 * kBlockRows;
  for (int row = begin; row < end; row += kBlockRows) {
    for (int r = row + kRowsAhead; r < std::min(row + kRowsAhead + kBlockRows, end); ++r) {
      const T* left = task.ground + r * task.stride + task.left[r] + column;
      for (int i = 0; i <= strip_count * kLanes<T>; i += kCacheLine) {
        hwy::Prefetch(left + i);
      }
    }
    for (int i = 0; i < strip_count; ++i) {
      build_block(task, strips[i], column + i * kLanes<T>, row);
    }
  }
}

// Those of the listed observers whose first sample of the block is odd, or even.
template <typename T, int kFurther, bool kOdd>
void look_at_block(const RaySteps& steps, const StripObservers<T>& observers, const Block<T>& block,
                   bool is_masked, bool is_mild, ListedCounts listed) {
  const std::ptrdiff_t begin = kOdd ? observers.count - listed.odd : 0;
  const int count = static_cast<int>(kOdd ? listed.odd : listed.even);
  const std::int32_t* of = observers.listed + begin;
  if (count == 0) {
    return;
  }
  if constexpr (kFurther > 0) {
    const std::int32_t* heights = observers.listed_heights + begin;
    if (is_masked) {
      look_from_all<T, kFurther, kOdd, true>(steps, observers, block, of, heights, count);
    } else {
      look_from_all<T, kFurther, kOdd, false>(steps, observers, block, of, heights, count);
    }
  } else {
    if (is_masked) {
      look<T, kOdd, true, false, true>(steps, observers, block, of, count);
    } else if (is_mild && block.edge_rows == kEdgeRows) {
      look<T, kOdd, false, true, true>(steps, observers, block, of, count);
    } else if (is_mild) {
      look<T, kOdd, false, true, false>(steps, observers, block, of, count);
    } else {
      look<T, kOdd, false, false, true>(steps, observers, block, of, count);
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

template <typename T>
void plan(const RaySteps& steps, const StripObservers<T>& observers, Course& course) {
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

// Rays have up to 2000 steps.
constexpr int kRingsMax = 8;

// Moves rays into the next ring as they enter it with far blocks.
template <typename T, int kFurther>
class Rings {
 public:
  Rings(const StripObservers<T>& observers, const Course& course, const RaySteps& steps)
      : observers_(&observers), course_(&course), math_(steps) {
    for (int ring = 2 * kNearRows; ring <= steps.count; ring *= 2) {
      ++count_;
    }
  }

  // `first_step` of the block.
  void enter(int first_step) {
    const int n = observers_->count;
    for (int i = 0; i < count_; ++i) {
      int& entered = entered_[i];
      for (; entered < n; ++entered) {
        const std::ptrdiff_t o = course_->direction > 0 ? entered : n - 1 - entered;
        if (first_step - course_->behind[o] < 2 * kNearRows << i) {
          break;
        }
        enter(observers_->greatest + o * kLanes<T>);
        for (int h = 0; h < kFurther; ++h) {
          enter(observers_->further_greatest + h * observers_->further_plane + o * kLanes<T>);
        }
      }
    }
  }

 private:
  HWY_INLINE void enter(T* greatest) const {
    const Tag<T> tag;
    hn::Store(in_next_ring<T>(math_, hn::Load(tag, greatest)), tag, greatest);
  }

  const StripObservers<T>* observers_;
  const Course* course_;
  Arithmetic<T> math_;
  int count_ = 0;
  int entered_[kRingsMax] = {};  // observers counted along the direction, by ring
};

// All rays of a strip in one direction.
template <typename T, int kFurther>
void look_along(const LineTask<T>& task, const Strip<T>& strip, StripObservers<T>& observers,
                const Course& course) {
  const Tag<T> tag;
  const RaySteps& steps = *task.steps;
  const Arithmetic<T> math(steps);
  const int direction = course.direction;
  observers.behind = course.behind;
  Rings<T, kFurther> rings(observers, course, steps);
  ListedCounts far;
  for (int i = 0; i < course.block_count; ++i) {
    const BlockPlan& plan = course.plans[i];
    const int b = course.first_block + direction * i;
    const int row = b * kBlockRows + (direction > 0 ? 0 : kBlockRows - 1);
    const std::int32_t kind = strip.block_kind[b];
    Block<T> block;
    block.stride = direction * kLanes<T>;
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(row) * kLanes<T>;
    block.hiding = strip.hiding + at;
    block.looked_at = strip.looked_at + at;
    block.weight = strip.weight == nullptr ? nullptr : strip.weight + at;
    block.first_step = direction * row;
    block.edge_rows = kind >> (kEdgeRowsShift + (direction > 0 ? 0 : kBlockRows)) & kEdgeRows;
    rings.enter(block.first_step);
    const T* highest_of_block = strip.highest + static_cast<std::ptrdiff_t>(b) * kLanes<T>;
    const Vec<T> highest = hn::Load(tag, highest_of_block);
    if (i % 2 == 0) {
      const Vec<T> of_two =
          i + 1 == course.block_count
              ? highest
              : hn::Max(highest, hn::Load(tag, highest_of_block + direction * kLanes<T>));
      far = list_observers<T, kFurther>(steps, observers, of_two, block.first_step, 2 * kBlockRows,
                                        plan.asked_twice_begin, plan.asked_twice_end, {});
    }
    if ((kind & kHasUnknown) != 0 || block.weight != nullptr) {
      add_unknown(steps, observers, block, kind, plan.reach_begin, plan.reach_end);
    }
    if ((kind & kHasKnown) == 0) {
      continue;
    }
    const ListedCounts listed =
        list_observers<T, kFurther>(steps, observers, highest, block.first_step, kBlockRows,
                                    plan.asked_begin, plan.asked_end, far);
    const Vec<T> lowest = hn::Load(tag, strip.lowest + static_cast<std::ptrdiff_t>(b) * kLanes<T>);
    const bool is_mild = hn::AllTrue(
        tag, hn::And(hn::Gt(all<T>(math.limit), math.minus(highest, observers.lowest_eye)),
                     hn::Gt(math.minus(lowest, observers.highest_eye), all<T>(-math.limit - 1))));
    const bool is_masked = (kind & kHasUnknown) != 0 || block.weight != nullptr;
    look_at_block<T, kFurther, false>(steps, observers, block, is_masked, is_mild, listed);
    look_at_block<T, kFurther, true>(steps, observers, block, is_masked, is_mild, listed);
  }
}

template <typename T, int kFurther>
void run(const LineTask<T>& task, T* values, std::int32_t* indices) {
  const Tag<T> tag;
  const auto take = [](auto*& memory, std::ptrdiff_t count) {
    auto* taken = memory;
    memory += count;
    return taken;
  };
  const std::ptrdiff_t row_values = static_cast<std::ptrdiff_t>(task.buffer_rows) * kLanes<T>;
  Strip<T> strips[kStripsTogether];
  for (Strip<T>& strip : strips) {
    strip.hiding = take(values, row_values);
    strip.looked_at = take(values, row_values);
    strip.weight = task.ground_weight == nullptr ? nullptr : take(values, row_values);
    strip.highest = take(values, row_values / kBlockRows);
    strip.lowest = take(values, row_values / kBlockRows);
    strip.block_kind = take(indices, task.buffer_rows / kBlockRows);
  }
  auto* plans = reinterpret_cast<BlockPlan*>(
      take(indices, 2 * (task.buffer_rows / kBlockRows) * kPlanNumbers));
  const auto row_count = static_cast<std::ptrdiff_t>(task.rows->size());
  StripObservers<T> observers;
  observers.eyes = take(values, row_count * kLanes<T>);
  observers.down = row_count * kLanes<T>;
  observers.greatest = take(values, 2 * row_count * kLanes<T>);
  observers.seen = take(values, row_count * kLanes<T>);
  observers.unknown = take(values, row_count * kLanes<T>);
  observers.further_plane = row_count * kLanes<T>;
  observers.further_greatest = take(values, 2 * kFurther * row_count * kLanes<T>);
  observers.further_seen = take(values, kFurther * row_count * kLanes<T>);
  T* greatest_down = observers.greatest + observers.down;
  T* further_greatest_down = observers.further_greatest + kFurther * observers.further_plane;
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
  constexpr int kColumnsTogether = kStripsTogether * kLanes<T>;
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
    build(task, strips, group, (group_end - group + kLanes<T> - 1) / kLanes<T>,
          (first_row - reach) / kBlockRows * kBlockRows,
          ((last_row + reach) / kBlockRows + 1) * kBlockRows);
    for (int column = group; column < group_end; column += kLanes<T>) {
      const Strip<T>& strip = strips[(column - group) / kLanes<T>];
      const Vec<T> blind = hn::Set(tag, kBlindEye<T>);
      observers.lowest_eye = blind;
      observers.highest_eye = hn::Set(tag, kUnknownHeight<T>);
      std::ptrdiff_t n = 0;
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const ObserverRow& row = rows[i];
        if (row.skewed_end <= column || row.skewed_begin >= column + kLanes<T>) {
          continue;
        }
        hwy::Prefetch(task.eyes + rows[std::min(i + kRowsAhead, rows.size() - 1)].at + column);
        observers.buffer_row[n] = row.buffer_row;
        observers.from[n] = static_cast<std::int32_t>(i);
        const std::ptrdiff_t at = n * kLanes<T>;
        const Vec<T> eyes = hn::LoadU(tag, task.eyes + row.at + column);
        observers.lowest_eye = hn::Min(observers.lowest_eye, eyes);
        observers.highest_eye =
            hn::Max(observers.highest_eye,
                    hn::IfThenElse(hn::Eq(eyes, blind), hn::Set(tag, kUnknownHeight<T>), eyes));
        hn::Store(eyes, tag, observers.eyes + at);
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
      look_near_all<T, kFurther>(task, strip, observers, column);
      look_along<T, kFurther>(task, strip, observers, upwards);
      std::swap(observers.greatest, greatest_down);
      std::swap(observers.further_greatest, further_greatest_down);
      look_along<T, kFurther>(task, strip, observers, downwards);
      std::swap(observers.greatest, greatest_down);
      std::swap(observers.further_greatest, further_greatest_down);
      for (std::ptrdiff_t o = 0; o < n; ++o) {
        const auto of = static_cast<std::size_t>(observers.from[o]);
        hwy::Prefetch(task.seen + rows[std::min(of + kRowsAhead, rows.size() - 1)].at + column);
        const std::ptrdiff_t to = rows[of].at + column;
        const std::ptrdiff_t at = o * kLanes<T>;
        const auto is_blind = hn::Eq(hn::Load(tag, observers.eyes + at), blind);
        const auto seen_by = [&](const T* lanes) HWY_ATTR {
          return hn::IfThenZeroElse(is_blind, hn::Load(tag, lanes + at));
        };
        add_to(task.seen + to, seen_by(observers.seen));
        if constexpr (kFurther > 0) {
          add_to(task.further + to, seen_by(observers.seen));
          for (int h = 0; h < kFurther; ++h) {
            add_to(task.further + (h + 1) * task.further_plane + to,
                   seen_by(observers.further_seen + h * observers.further_plane));
          }
        }
        if (observers.is_some_unknown) {
          const Vec<T> less = hn::Load(tag, observers.unknown + at);
          take_from(task.known + to, less);
          if constexpr (kFurther > 0) {
            take_from(task.further + (kFurther + 1) * task.further_plane + to, less);
          }
        }
      }
    }
  }
}

template <typename T>
void add_lines_with(const LineTask<T>& task, T* values, std::int32_t* indices) {
  switch (task.further_count) {
    case 0:
      return run<T, 0>(task, values, indices);
    case 1:
      return run<T, 1>(task, values, indices);
    case 2:
      return run<T, 2>(task, values, indices);
    case 3:
      return run<T, 3>(task, values, indices);
    default:
      return run<T, 4>(task, values, indices);
  }
}

void add_narrow_lines(const LineTask<std::int16_t>& task, std::int16_t* values,
                      std::int32_t* indices) {
  add_lines_with(task, values, indices);
}
void add_wide_lines(const LineTask<std::int32_t>& task, std::int32_t* values,
                    std::int32_t* indices) {
  add_lines_with(task, values, indices);
}

}  // namespace hedgehop::preparation::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hedgehop::preparation {
namespace {

HWY_EXPORT(add_narrow_lines);
HWY_EXPORT(add_wide_lines);

constexpr std::int64_t kAvx512Targets = HWY_AVX3 | HWY_AVX3_DL;

std::int64_t usable_targets() { return hwy::SupportedTargets() & HWY_TARGETS; }

// Start of the aligned part of a vector with room for `count` values.
template <typename T>
T* aligned(std::vector<T>& memory, std::size_t count) {
  constexpr std::size_t kAlignment = 64;
  const std::size_t needed = count + kAlignment / sizeof(T);
  if (memory.size() < needed) {
    memory.resize(needed);
  }
  const auto address = reinterpret_cast<std::uintptr_t>(memory.data());
  return memory.data() + (kAlignment - address % kAlignment) % kAlignment / sizeof(T);
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

void best_narrow(const LineTask<std::int16_t>& task, std::int16_t* values, std::int32_t* indices) {
  HWY_DYNAMIC_DISPATCH(add_narrow_lines)(task, values, indices);
}
void best_wide(const LineTask<std::int32_t>& task, std::int32_t* values, std::int32_t* indices) {
  HWY_DYNAMIC_DISPATCH(add_wide_lines)(task, values, indices);
}

// As the kernel takes its memory, with the widest vectors.
template <typename T>
void add_lines_by(void (*kernel)(const LineTask<T>&, T*, std::int32_t*), const LineTask<T>& task,
                  LineBuffers<T>& buffers) {
  const auto rows = static_cast<std::size_t>(task.buffer_rows);
  const std::size_t blocks = rows / kBlockRows;
  const std::size_t observers = task.rows->size();
  const auto further = static_cast<std::size_t>(task.further_count);
  buffers.indices.resize(std::max(buffers.indices.size(),
                                  (kStripsTogether + 2 * kPlanNumbers) * blocks + 6 * observers));
  kernel(task,
         aligned(buffers.values, kLanesMax * (kStripsTogether * (3 * rows + 2 * blocks) +
                                              (5 + 3 * further) * observers)),
         buffers.indices.data());
}

}  // namespace

LineKernel line_kernel(Simd simd) {
  if (!is_available(simd)) {
    throw std::invalid_argument("visibility: this processor lacks the instructions asked for");
  }
#if (HWY_TARGETS & HWY_AVX2) && HWY_TARGETS != HWY_AVX2
  if (simd == Simd::kAvx2) {
    return {&N_AVX2::add_narrow_lines, &N_AVX2::add_wide_lines};
  }
#endif
  return {&best_narrow, &best_wide};
}

void add_lines(const LineTask<std::int16_t>& task, LineBuffers<std::int16_t>& buffers,
               const LineKernel& kernel) {
  add_lines_by(kernel.narrow, task, buffers);
}

void add_lines(const LineTask<std::int32_t>& task, LineBuffers<std::int32_t>& buffers,
               const LineKernel& kernel) {
  add_lines_by(kernel.wide, task, buffers);
}

}  // namespace hedgehop::preparation
#endif
