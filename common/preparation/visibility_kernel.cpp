#include "preparation/visibility_kernel.hpp"

#include <algorithm>
#include <stdexcept>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "preparation/visibility_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace hedgehop::preparation::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using FloatTag = hn::CappedTag<float, 16>;
using IntTag = hn::RebindToSigned<FloatTag>;
using Floats = hn::Vec<FloatTag>;

// Rows of the buffer whose greatest height is kept, to pass over what nobody can see.
constexpr int kBlockRows = 8;

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

// How samples are known to be known.
enum class Known { kAll, kInterval, kCount };

// One ray of kVectors neighbouring vectors of observers. `ground_m`, `highest_m` and `weight` are
// those of the first lane. Blocks whose highest point lies below the line of sight of every lane
// are passed over, which changes no bit: every operation on heights is monotone, rounding included.
template <int kVectors, int kFurther, bool kCountKnown, bool kWeighted>
HWY_NOINLINE void add_ray(const GroupTask& task, const ObserverRow& observer, int lane,
                          int direction, int step_count, const float* HWY_RESTRICT ground_m,
                          const float* HWY_RESTRICT highest_m, const float* HWY_RESTRICT weight) {
  const FloatTag tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  Floats eye[kVectors];
  Floats greatest[kVectors];
  Floats seen[kVectors];
  Floats known[kVectors];
  Floats further_greatest[kFurther + 1][kVectors];
  Floats further_seen[kFurther + 1][kVectors];
#pragma GCC unroll 2
  for (int v = 0; v < kVectors; ++v) {
    eye[v] = hn::LoadU(tag, observer.eyes_m + lane + v * lanes);
    greatest[v] = hn::Set(tag, kLowestSlope);
    seen[v] = hn::Zero(tag);
    known[v] = hn::Zero(tag);
#pragma GCC unroll 4
    for (int i = 0; i < kFurther; ++i) {
      further_greatest[i][v] = hn::Set(tag, kLowestSlope);
      further_seen[i][v] = hn::Zero(tag);
    }
  }
  const RayStep* HWY_RESTRICT steps = task.steps;
  const float* HWY_RESTRICT further_slopes = task.further_slopes;
  int row = observer.buffer_row + direction;
  for (int k = 0; k < step_count;) {
    const int rows_left = direction > 0 ? kBlockRows - row % kBlockRows : row % kBlockRows + 1;
    const int end = std::min(k + rows_left, step_count);
    if constexpr (!kCountKnown) {
      const float* highest = highest_m + (row / kBlockRows) * kGroupLanes;
      const Floats near = hn::Set(tag, steps[k].inverse_distance_1pm);
      const Floats far = hn::Set(tag, steps[end - 1].inverse_distance_1pm);
      const Floats drop = hn::Set(tag, steps[k].drop_slope);
      auto may_be_seen = hn::FirstN(tag, 0);
#pragma GCC unroll 2
      for (int v = 0; v < kVectors; ++v) {
        const Floats above = hn::Sub(hn::Load(tag, highest + v * lanes), eye[v]);
        const Floats bound = hn::Max(hn::MulSub(above, near, drop), hn::MulSub(above, far, drop));
        may_be_seen = hn::Or(may_be_seen, hn::Ge(bound, greatest[v]));
#pragma GCC unroll 4
        for (int i = 0; i < kFurther; ++i) {
          const float least =
              std::min(further_slopes[k * kFurther + i], further_slopes[(end - 1) * kFurther + i]);
          may_be_seen = hn::Or(may_be_seen,
                               hn::Ge(hn::Sub(bound, hn::Set(tag, least)), further_greatest[i][v]));
        }
      }
      if (hn::AllFalse(tag, may_be_seen)) {
        row += direction * (end - k);
        k = end;
        continue;
      }
    }
    for (; k < end; ++k, row += direction) {
      const Floats inverse_distance = hn::Set(tag, steps[k].inverse_distance_1pm);
      const Floats drop = hn::Set(tag, steps[k].drop_slope);
      const Floats step_weight = hn::Set(tag, steps[k].weight);
      const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(row) * kGroupLanes;
#pragma GCC unroll 2
      for (int v = 0; v < kVectors; ++v) {
        const Floats z = hn::Load(tag, ground_m + at + v * lanes);
        Floats counts = step_weight;
        if constexpr (kWeighted) {
          counts = hn::Mul(step_weight, hn::Load(tag, weight + at + v * lanes));
        }
        const Floats slope = hn::MulSub(hn::Sub(z, eye[v]), inverse_distance, drop);
        seen[v] = add_if(hn::Ge(slope, greatest[v]), seen[v], counts);
        greatest[v] = hn::Max(greatest[v], slope);
#pragma GCC unroll 4
        for (int i = 0; i < kFurther; ++i) {
          const Floats lower = hn::Sub(slope, hn::Set(tag, further_slopes[k * kFurther + i]));
          further_seen[i][v] =
              add_if(hn::Ge(lower, further_greatest[i][v]), further_seen[i][v], counts);
          further_greatest[i][v] = hn::Max(further_greatest[i][v], lower);
        }
        if constexpr (kCountKnown) {
          known[v] = add_if(hn::Gt(z, hn::Set(tag, kUnknownBelow_m)), known[v], counts);
        }
      }
    }
  }
#pragma GCC unroll 2
  for (int v = 0; v < kVectors; ++v) {
    const std::ptrdiff_t at = lane + v * lanes;
    add_to(observer.seen + at, seen[v]);
    if constexpr (kCountKnown) {
      add_to(observer.known + at, known[v]);
    }
    if constexpr (kFurther > 0) {
      add_to(observer.further + at, seen[v]);
#pragma GCC unroll 4
      for (int i = 0; i < kFurther; ++i) {
        add_to(observer.further + (i + 1) * task.further_plane + at, further_seen[i][v]);
      }
      if constexpr (kCountKnown) {
        add_to(observer.further + (kFurther + 1) * task.further_plane + at, known[v]);
      }
    }
  }
}

struct GroupLimits {
  Known known = Known::kAll;
  HWY_ALIGN std::int32_t first[kGroupLanes];  // known buffer rows of each lane, for kInterval
  HWY_ALIGN std::int32_t last[kGroupLanes];
};

// Interpolates the buffer.
void build(const GroupTask& task, float* HWY_RESTRICT ground_m, float* HWY_RESTRICT highest_m,
           float* HWY_RESTRICT weight, GroupLimits& limits) {
  const FloatTag tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const int block_begin = task.buffer_begin / kBlockRows;
  const int block_end = (task.buffer_end + kBlockRows - 1) / kBlockRows;
  Floats lowest = hn::Zero(tag);
  for (int block = block_begin; block < block_end; ++block) {
    const int row_begin = std::max(block * kBlockRows, task.buffer_begin);
    const int row_end = std::min((block + 1) * kBlockRows, task.buffer_end);
    for (int lane = 0; lane < kGroupLanes; lane += lanes) {
      Floats highest = hn::Set(tag, kFarBelow_m);
      for (int row = row_begin; row < row_end; ++row) {
        const float* left =
            task.ground_m + row * task.stride + task.left[row] + task.first_column + lane;
        const Floats a = hn::LoadU(tag, left);
        const Floats b = hn::LoadU(tag, left + 1);
        const Floats z = hn::MulAdd(hn::Set(tag, task.fraction[row]), hn::Sub(b, a), a);
        hn::Store(z, tag, ground_m + static_cast<std::ptrdiff_t>(row) * kGroupLanes + lane);
        highest = hn::Max(highest, z);
        lowest = hn::Min(lowest, z);
      }
      hn::Store(highest, tag, highest_m + static_cast<std::ptrdiff_t>(block) * kGroupLanes + lane);
    }
  }
  if (weight != nullptr) {
    for (int row = task.buffer_begin; row < task.buffer_end; ++row) {
      const float* nearest = task.ground_weight + row * task.stride + task.left[row] +
                             task.first_column + (task.fraction[row] < 0.5F ? 0 : 1);
      for (int lane = 0; lane < kGroupLanes; lane += lanes) {
        hn::Store(hn::LoadU(tag, nearest + lane), tag,
                  weight + static_cast<std::ptrdiff_t>(row) * kGroupLanes + lane);
      }
    }
  }
  limits.known = Known::kAll;
  if (weight != nullptr) {
    limits.known = Known::kCount;
    return;
  }
  if (hn::AllTrue(tag, hn::Gt(lowest, hn::Set(tag, kUnknownBelow_m)))) {
    return;
  }
  // Beside the border each line is known from one row to another, which needs no counting.
  limits.known = Known::kInterval;
  const IntTag int_tag;
  for (int lane = 0; lane < kGroupLanes; lane += lanes) {
    Floats first = hn::Set(tag, 1e9F);
    Floats last = hn::Set(tag, -1.0F);
    Floats count = hn::Zero(tag);
    for (int row = task.buffer_begin; row < task.buffer_end; ++row) {
      const Floats z =
          hn::Load(tag, ground_m + static_cast<std::ptrdiff_t>(row) * kGroupLanes + lane);
      const auto is_known = hn::Gt(z, hn::Set(tag, kUnknownBelow_m));
      const Floats here = hn::Set(tag, static_cast<float>(row));
      first = hn::IfThenElse(is_known, hn::Min(first, here), first);
      last = hn::IfThenElse(is_known, here, last);
      count = add_if(is_known, count, hn::Set(tag, 1.0F));
    }
    const auto is_one_piece =
        hn::Or(hn::Eq(hn::Add(hn::Sub(last, first), hn::Set(tag, 1.0F)), count),
               hn::Eq(count, hn::Zero(tag)));
    if (!hn::AllTrue(tag, is_one_piece)) {
      limits.known = Known::kCount;
      return;
    }
    hn::Store(hn::ConvertTo(int_tag, first), int_tag, limits.first + lane);
    hn::Store(hn::ConvertTo(int_tag, last), int_tag, limits.last + lane);
  }
}

template <int kFurther, bool kCountKnown, bool kWeighted>
void add_rays(const GroupTask& task, const ObserverRow& observer, int direction, int step_count,
              const float* ground_m, const float* highest_m, const float* weight) {
  // Two vectors hide the latency of max; with 16 registers there is no room for more than one and
  // its further heights.
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
  constexpr int kVectors = 2;
#else
  constexpr int kVectors = kFurther > 0 ? 1 : 2;
#endif
  const int lanes = kVectors * static_cast<int>(hn::Lanes(FloatTag()));
  for (int lane = 0; lane < kGroupLanes; lane += lanes) {
    add_ray<kVectors, kFurther, kCountKnown, kWeighted>(task, observer, lane, direction, step_count,
                                                        ground_m + lane, highest_m + lane,
                                                        kWeighted ? weight + lane : nullptr);
  }
}

// Adds to `known` what lies between the ends of the known interval; returns how many steps there
// are to look at.
int add_known_interval(const GroupTask& task, const ObserverRow& observer, int direction,
                       const GroupLimits& limits) {
  const IntTag tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const auto here = hn::Set(tag, observer.buffer_row);
  const auto zero = hn::Zero(tag);
  const auto one = hn::Set(tag, 1);
  const auto all = hn::Set(tag, task.step_count);
  auto most = zero;
  std::int32_t* further_known =
      task.further_count == 0 ? nullptr
                              : observer.further + (task.further_count + 1) * task.further_plane;
  for (int lane = 0; lane < kGroupLanes; lane += lanes) {
    const auto first = hn::Load(tag, limits.first + lane);
    const auto last = hn::Load(tag, limits.last + lane);
    const auto to = direction > 0 ? hn::Sub(last, here) : hn::Sub(here, first);
    const auto from = hn::Sub(direction > 0 ? hn::Sub(first, here) : hn::Sub(here, last), one);
    const auto end = hn::Max(zero, hn::Min(to, all));
    const auto begin = hn::Max(zero, hn::Min(from, all));
    most = hn::Max(most, end);
    const auto sum = hn::Max(zero, hn::Sub(hn::GatherIndex(tag, task.known_prefix, end),
                                           hn::GatherIndex(tag, task.known_prefix, begin)));
    hn::StoreU(hn::Add(hn::LoadU(tag, observer.known + lane), sum), tag, observer.known + lane);
    if (further_known != nullptr) {
      hn::StoreU(hn::Add(hn::LoadU(tag, further_known + lane), sum), tag, further_known + lane);
    }
  }
  return hn::GetLane(hn::MaxOfLanes(tag, most));
}

void add_known_all(const GroupTask& task, const ObserverRow& observer) {
  const IntTag tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const auto sum = hn::Set(tag, task.known_prefix[task.step_count]);
  for (int lane = 0; lane < kGroupLanes; lane += lanes) {
    hn::StoreU(hn::Add(hn::LoadU(tag, observer.known + lane), sum), tag, observer.known + lane);
    if (task.further_count > 0) {
      std::int32_t* known = observer.further + (task.further_count + 1) * task.further_plane + lane;
      hn::StoreU(hn::Add(hn::LoadU(tag, known), sum), tag, known);
    }
  }
}

template <int kFurther>
void run(const GroupTask& task, float* ground_m, float* highest_m, float* weight) {
  GroupLimits limits;
  build(task, ground_m, highest_m, weight, limits);
  for (const int direction : {1, -1}) {
    for (const ObserverRow& observer : *task.observers) {
      if (weight != nullptr) {
        add_rays<kFurther, true, true>(task, observer, direction, task.step_count, ground_m,
                                       highest_m, weight);
      } else if (limits.known == Known::kCount) {
        add_rays<kFurther, true, false>(task, observer, direction, task.step_count, ground_m,
                                        highest_m, nullptr);
      } else {
        int step_count = task.step_count;
        if (limits.known == Known::kInterval) {
          step_count = add_known_interval(task, observer, direction, limits);
        } else {
          add_known_all(task, observer);
        }
        add_rays<kFurther, false, false>(task, observer, direction, step_count, ground_m, highest_m,
                                         nullptr);
      }
    }
  }
}

void add_group_kernel(const GroupTask& task, float* ground_m, float* highest_m, float* weight) {
  switch (task.further_count) {
    case 0:
      return run<0>(task, ground_m, highest_m, weight);
    case 1:
      return run<1>(task, ground_m, highest_m, weight);
    case 2:
      return run<2>(task, ground_m, highest_m, weight);
    case 3:
      return run<3>(task, ground_m, highest_m, weight);
    default:
      return run<4>(task, ground_m, highest_m, weight);
  }
}

}  // namespace hedgehop::preparation::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hedgehop::preparation {
namespace {

HWY_EXPORT(add_group_kernel);

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

void best_kernel(const GroupTask& task, float* ground_m, float* highest_m, float* weight) {
  HWY_DYNAMIC_DISPATCH(add_group_kernel)(task, ground_m, highest_m, weight);
}

}  // namespace

GroupKernel group_kernel(Simd simd) {
  if (!is_available(simd)) {
    throw std::invalid_argument("visibility: this processor lacks the instructions asked for");
  }
#if (HWY_TARGETS & HWY_AVX2) && HWY_TARGETS != HWY_AVX2
  if (simd == Simd::kAvx2) {
    return &N_AVX2::add_group_kernel;
  }
#endif
  return &best_kernel;
}

void add_group(const GroupTask& task, GroupBuffers& buffers, GroupKernel kernel) {
  const auto cells = static_cast<std::size_t>(task.buffer_end) * kGroupLanes;
  float* ground_m = aligned(buffers.ground_m, cells);
  float* highest_m = aligned(buffers.highest_m, cells);
  float* weight = task.ground_weight == nullptr ? nullptr : aligned(buffers.weight, cells);
  kernel(task, ground_m, highest_m, weight);
}

}  // namespace hedgehop::preparation
#endif
