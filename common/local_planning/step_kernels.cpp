#include "local_planning/step_kernels.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "local_planning/surroundings.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "local_planning/step_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace hedgehop::local_planning::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using FloatTag = hn::CappedTag<float, kLanes>;
using IntTag = hn::RebindToSigned<FloatTag>;
using UintTag = hn::RebindToUnsigned<FloatTag>;
using Floats = hn::Vec<FloatTag>;
using FloatMask = hn::Mask<FloatTag>;

constexpr std::size_t kMaskTurns = 4;
constexpr float kNothing = -std::numeric_limits<float>::infinity();
// Iota() is made anew each time.
HWY_ALIGN constexpr float kNumbers[kLanes] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
HWY_ALIGN constexpr std::int32_t kIndices[kLanes] = {0, 1, 2,  3,  4,  5,  6,  7,
                                                     8, 9, 10, 11, 12, 13, 14, 15};

HWY_INLINE Floats constant(float value) { return hn::Set(FloatTag(), value); }

HWY_INLINE Floats numbers_from(int first) {
  return hn::Add(hn::Load(FloatTag(), kNumbers), constant(static_cast<float>(first)));
}

template <typename Memory>
HWY_INLINE typename Memory::value_type* with_room(Memory& memory, std::size_t count) {
  if (memory.size() < count) {
    memory.resize(count);
  }
  return memory.data();
}

// The nearest whole number of values in [0, 2^22], like nearest_whole().
HWY_INLINE hn::Vec<UintTag> whole(Floats value) {
  const UintTag tag;
  return hn::Sub(hn::BitCast(tag, hn::Add(value, hn::Set(FloatTag(), kWholeShift))),
                 hn::Set(tag, kWholeShiftBits));
}

// The greatest whole number up to a value, |value| < 2^22.
HWY_INLINE hn::Vec<IntTag> whole_below(Floats value) {
#if HWY_TARGET <= HWY_AVX3
  return {_mm512_cvt_roundps_epi32(value.raw, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC)};
#else
  // In the range of the mantissa: ConvertTo() would look after what cannot be converted.
  const IntTag tag;
  constexpr float kShift = 12582912.0F;  // 1.5 * 2^23
  return hn::Sub(hn::BitCast(tag, hn::Add(hn::Floor(value), constant(kShift))),
                 hn::BitCast(tag, constant(kShift)));
#endif
}

// N / max(d - r, eps) above, N / (d + r) else; adding zero makes -0 a +0.
HWY_INLINE Floats tangent_of(Floats too_high, Floats distance, Floats disc, Floats near) {
  const FloatTag tag;
  const Floats zero = hn::Zero(tag);
  const Floats run = hn::IfThenElse(hn::Gt(too_high, zero), hn::Max(hn::Sub(distance, disc), near),
                                    hn::Add(distance, disc));
  return hn::Add(hn::Div(too_high, run), zero);
}

// Tangents of all cells; those that do not count get kNothing.
HWY_INLINE void scan_cells(const HistogramTask& task, float* HWY_RESTRICT tangents) {
  const FloatTag tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const PolarConstants& c = *task.constants;
  const PolarQuestion& q = *task.question;
  const Floats zero = hn::Zero(tag);
  const Floats floor = constant(q.floor_m);
  const Floats nothing = constant(kNothing);
  const float* HWY_RESTRICT distances = task.table->distance_m.data();
  const float* HWY_RESTRICT azimuths = task.table->azimuth_rad.data();
  const float* HWY_RESTRICT rises = task.table->rise_1pm.data();
  const float* HWY_RESTRICT falls = task.table->fall_1pm.data();
  std::ptrdiff_t at = 0;
  for (const std::int32_t first : task.table->runs) {
    const float* HWY_RESTRICT surface = task.surface_m + first;
    for (int i = 0; i < kLanes; i += lanes, at += lanes) {
      const Floats too_high = hn::Sub(hn::LoadU(tag, surface + i), floor);
      const Floats per_metre = hn::IfThenElse(hn::Gt(too_high, zero), hn::Load(tag, rises + at),
                                              hn::Load(tag, falls + at));
      hn::Store(hn::Add(hn::Mul(too_high, per_metre), zero), tag, tangents + at);
    }
  }
  const auto leave_out = [&](std::ptrdiff_t run, const auto& is_out) {
    for (std::ptrdiff_t i = run * kLanes; i < (run + 1) * kLanes; i += lanes) {
      const Floats tangent = hn::Load(tag, tangents + i);
      hn::Store(hn::IfThenElse(is_out(i), nothing, tangent), tag, tangents + i);
    }
  };
  for (const std::uint16_t run : task.table->truncated) {
    leave_out(run, [&](std::ptrdiff_t i) {
      const Floats d = hn::Load(tag, distances + i);
      const Floats turned = hn::Abs(hn::Sub(hn::Load(tag, azimuths + i), constant(q.heading_rad)));
      const Floats off = hn::Min(turned, hn::Sub(constant(kTwoPi_f), turned));
      return hn::And(hn::And(hn::Lt(d, constant(c.truncation_distance)),
                             hn::Gt(off, constant(c.truncation_angle))),
                     hn::Gt(d, constant(c.disc)));
    });
  }
  if (q.reach_m < static_cast<float>(c.window_m)) {
    for (std::size_t run = 0; run < task.table->runs.size(); ++run) {
      leave_out(static_cast<std::ptrdiff_t>(run), [&](std::ptrdiff_t i) {
        return hn::Gt(hn::Load(tag, distances + i), constant(q.reach_m));
      });
    }
  }
}

// An arc is at most 1.11 times as long as its chord.
HWY_INLINE float least_arc_chord(const PolarQuestion& question) {
  return question.arc_min * (1.0F / 1.12F);
}

// Runs that may hold cells that mask. Returns how many.
HWY_INLINE std::size_t list_ahead(const HistogramTask& task, std::int32_t* HWY_RESTRICT ahead) {
  const FloatTag tag;
  const IntTag int_tag;
  const std::size_t lanes = hn::Lanes(tag);
  const PolarTable& table = *task.table;
  const Floats zero = hn::Zero(tag);
  const Floats heading = constant(task.question->heading_rad);
  const Floats least_distance = constant(least_arc_chord(*task.question));
  const auto step = hn::Set(int_tag, static_cast<std::int32_t>(lanes));
  auto number = hn::Load(int_tag, kIndices);
  std::size_t found = 0;
  for (std::size_t i = 0; i < table.runs.size(); i += lanes) {
    const Floats turned = hn::Abs(hn::Sub(hn::Load(tag, table.middle_rad.data() + i), heading));
    const Floats off = hn::Sub(hn::Min(turned, hn::Sub(constant(kTwoPi_f), turned)),
                               hn::Load(tag, table.spread_rad.data() + i));
    const FloatMask may_mask = hn::And(hn::Lt(off, constant(kQuarterPi_f)),
                                       hn::Ge(hn::Load(tag, table.farthest_m.data() + i),
                                              hn::Mul(hn::Max(off, zero), least_distance)));
    const auto is_listed = hn::RebindMask(int_tag, may_mask);
    hn::StoreU(hn::Compress(number, is_listed), int_tag, ahead + found);
    found += hn::CountTrue(tag, may_mask);
    number = hn::Add(number, step);
  }
  return found;
}

// Gathers the cells that may mask. Returns how many there are.
HWY_INLINE std::size_t gather_ahead(const HistogramTask& task,
                                    const std::int32_t* HWY_RESTRICT ahead, std::size_t count,
                                    float* HWY_RESTRICT distance, float* HWY_RESTRICT turned_by,
                                    float* HWY_RESTRICT height) {
  const FloatTag tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const PolarQuestion& q = *task.question;
  const Floats heading = constant(q.heading_rad);
  const Floats least_distance = constant(least_arc_chord(q));
  const Floats disc = constant(task.constants->disc);
  const Floats reach = constant(q.reach_m);
  const Floats floor = constant(q.floor_m);
  std::size_t found = 0;
  for (std::size_t n = 0; n < count; ++n) {
    const std::ptrdiff_t run = ahead[n];
    const float* HWY_RESTRICT surface = task.surface_m + task.table->runs[ahead[n]];
    for (int i = 0; i < kLanes; i += lanes) {
      const std::ptrdiff_t at = run * kLanes + i;
      const Floats d = hn::Load(tag, task.table->distance_m.data() + at);
      const Floats turned = hn::Sub(hn::Load(tag, task.table->azimuth_rad.data() + at), heading);
      const Floats turned_abs = hn::Abs(turned);
      const Floats off = hn::Min(turned_abs, hn::Sub(constant(kTwoPi_f), turned_abs));
      const FloatMask is_ahead = hn::And(
          hn::And(hn::Lt(off, constant(kQuarterPi_f)), hn::Ge(off, constant(kStraightAhead_rad))),
          hn::And(hn::Ge(d, hn::Mul(off, least_distance)),
                  hn::And(hn::Gt(d, disc), hn::Le(d, reach))));
      const Floats too_high = hn::Sub(hn::LoadU(tag, surface + i), floor);
      hn::StoreU(hn::Compress(d, is_ahead), tag, distance + found);
      hn::StoreU(hn::Compress(turned, is_ahead), tag, turned_by + found);
      hn::StoreU(hn::Compress(too_high, is_ahead), tag, height + found);
      found += hn::CountTrue(tag, is_ahead);
    }
  }
  return found;
}

// Tangents of the arc mask with their sectors, in no order. Returns how many there are.
HWY_INLINE std::size_t arc_masks(const HistogramTask& task, std::size_t count,
                                 const float* HWY_RESTRICT distance,
                                 const float* HWY_RESTRICT turned_by,
                                 const float* HWY_RESTRICT height,
                                 std::int32_t* HWY_RESTRICT mask_sectors,
                                 float* HWY_RESTRICT mask_tangents) {
  const FloatTag tag;
  const IntTag int_tag;
  const auto lanes = static_cast<std::size_t>(hn::Lanes(tag));
  const PolarConstants& c = *task.constants;
  const PolarQuestion& q = *task.question;
  const Floats zero = hn::Zero(tag);
  const Floats one = hn::Set(tag, 1.0F);
  const Floats half = hn::Set(tag, 0.5F);
  const Floats disc = hn::Set(tag, c.disc);
  const Floats near = hn::Set(tag, c.near);
  const Floats heading = hn::Set(tag, q.heading_rad);
  const auto sectors = hn::Set(int_tag, task.sectors);
  std::size_t found = 0;
  for (std::size_t i = 0; i < count; i += lanes) {
    const Floats d = hn::LoadU(tag, distance + i);
    const Floats turned = hn::LoadU(tag, turned_by + i);
    const Floats turned_abs = hn::Abs(turned);
    const Floats off = hn::Min(turned_abs, hn::Sub(hn::Set(tag, kTwoPi_f), turned_abs));
    const Floats off2 = hn::Mul(off, off);
    Floats series = hn::Set(tag, kArcSeries[5]);
#pragma GCC unroll 5
    for (int power = 4; power >= 0; --power) {
      series = hn::Add(hn::Mul(series, off2), hn::Set(tag, kArcSeries[power]));
    }
    const Floats arc = hn::Mul(d, hn::Add(hn::Mul(series, off2), one));
    const Floats bend = hn::Sub(one, hn::Mul(off, hn::Set(tag, kFourOverPi_f)));
    const Floats arc_max =
        hn::Add(hn::Set(tag, q.arc_max), hn::Mul(hn::Set(tag, q.arc_spread), bend));
    const FloatMask is_masking = hn::And(hn::Ge(arc, hn::Mul(off, hn::Set(tag, q.arc_min))),
                                         hn::Le(arc, hn::Mul(off, arc_max)));
    const FloatMask is_right =
        hn::Xor(hn::Gt(turned, zero), hn::Lt(turned_abs, hn::Set(tag, kPi_f)));
    const Floats twice = hn::Add(off, off);
    const Floats led_to = hn::Add(heading, hn::IfThenElse(is_right, hn::Neg(twice), twice));
    const auto index = whole_below(hn::Add(hn::Mul(led_to, hn::Set(tag, c.sectors_per_rad)), half));
    const auto sector =
        hn::IfThenElse(hn::Lt(index, hn::Zero(int_tag)), hn::Add(index, sectors),
                       hn::IfThenElse(hn::Lt(index, sectors), index, hn::Sub(index, sectors)));
    const Floats tangent = tangent_of(hn::LoadU(tag, height + i), arc, disc, near);
    const FloatMask is_one = hn::And(is_masking, hn::Lt(numbers_from(static_cast<int>(i)),
                                                        hn::Set(tag, static_cast<float>(count))));
    hn::StoreU(hn::Compress(sector, hn::RebindMask(int_tag, is_one)), int_tag,
               mask_sectors + found);
    hn::StoreU(hn::Compress(tangent, is_one), tag, mask_tangents + found);
    found += hn::CountTrue(tag, is_one);
  }
  return found;
}

// Calls use(k, v) for each vector of a ring that is turned on by `shift`: v holds the entries
// (k - shift) mod count and so on of `from`.
template <typename Use>
HWY_INLINE void turn_ring(const float* HWY_RESTRICT from, int count, int shift,
                          float* HWY_RESTRICT wide, const Use& use) {
  const FloatTag tag;
  const IntTag int_tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const int padded = padded_to_lanes(count);
  if (count % lanes != 0) {
    for (int k = 0; k < padded; k += lanes) {
      hn::StoreU(hn::LoadU(tag, from + k), tag, wide + k);
    }
    for (int k = 0; k < padded; k += lanes) {
      hn::StoreU(hn::LoadU(tag, from + k), tag, wide + count + k);
    }
    for (int k = 0; k < padded; k += lanes) {
      use(k, hn::LoadU(tag, wide + count - shift + k));
    }
    return;
  }
  // Loads of what was stored just so: those that straddle two stores wait for both.
  const int start = shift == 0 ? 0 : count - shift;
  int at = start / lanes * lanes;
  const int part = start - at;
  const auto places = hn::And(hn::Add(hn::Load(int_tag, kIndices), hn::Set(int_tag, part)),
                              hn::Set(int_tag, lanes - 1));
  const auto turned = hn::IndicesFromVec(tag, places);
  const FloatMask is_of_first =
      hn::Lt(hn::Load(tag, kNumbers), constant(static_cast<float>(lanes - part)));
  Floats first = hn::TableLookupLanes(hn::Load(tag, from + at), turned);
  for (int k = 0; k < count; k += lanes) {
    at = at + lanes == count ? 0 : at + lanes;
    const Floats next = hn::TableLookupLanes(hn::Load(tag, from + at), turned);
    use(k, hn::IfThenElse(is_of_first, first, next));
    first = next;
  }
  for (int k = count; k < padded; k += lanes) {
    use(k, constant(kNothing));
  }
}

// Windows of the widest sort are resolved into two of the next one, and so on.
HWY_INLINE void resolve_windows(const HistogramTask& task, float* HWY_RESTRICT windows,
                                float* HWY_RESTRICT wide) {
  const FloatTag tag;
  const int padded = padded_to_lanes(task.sectors);
  for (int i = 0; i + 1 < task.width_count; ++i) {
    const float* HWY_RESTRICT from = windows + static_cast<std::ptrdiff_t>(i) * padded;
    float* HWY_RESTRICT to = windows + static_cast<std::ptrdiff_t>(i + 1) * padded;
    turn_ring(from, task.sectors, task.widths[i] - task.widths[i + 1], wide,
              [&](int k, Floats turned) {
                const Floats greatest = hn::Max(hn::Load(tag, from + k), turned);
                hn::Store(hn::Max(hn::Load(tag, to + k), greatest), tag, to + k);
              });
  }
}

// Algorithm 1 on both sides of the heading: `wide` is what each sector takes,
// from the heading on.
HWY_INLINE void mask_sectors_aside(const HistogramTask& task, float* HWY_RESTRICT wide) {
  const FloatTag tag;
  const int count = task.sectors;
  const int padded = padded_to_lanes(count);
  const int last = (count - 1) / 2;
  // Arcs turn by less than 90 degrees.
  const int reach = std::min(last, count / 4 + 2);
  float left = kNothing;
  float right = kNothing;
  wide[0] = kNothing;
  int k_left = task.heading_sector;
  int k_right = task.heading_sector;
  int i = 1;
  for (; i <= reach; ++i) {
    k_left = k_left + 1 == count ? 0 : k_left + 1;
    k_right = k_right == 0 ? count - 1 : k_right - 1;
    left = std::max(left, task.tan_mask[k_left]);
    right = std::max(right, task.tan_mask[k_right]);
    wide[i] = left;
    wide[count - i] = right;
  }
  for (; i <= last; ++i) {
    wide[i] = left;
    wide[count - i] = right;
  }
  if (count % 2 == 0) {
    wide[count / 2] = std::min(left, right);
  }
  turn_ring(wide, count, task.heading_sector, wide + 2 * padded, [&](int k, Floats turned) {
    hn::StoreU(hn::Max(hn::LoadU(tag, task.tan_climb + k), turned), tag, task.tan_masked + k);
  });
  for (int k = count; k < padded; ++k) {
    task.tan_masked[k] = std::numeric_limits<float>::infinity();
  }
}

void histogram_kernel(HistogramTask& task, HistogramScratch& scratch) {
  const FloatTag tag;
  const auto lanes = static_cast<std::size_t>(hn::Lanes(tag));
  const PolarTable& table = *task.table;
  const int count = task.sectors;
  const auto padded = static_cast<std::size_t>(padded_to_lanes(count));
  const std::size_t cells = table.distance_m.size();
  const std::size_t slots = static_cast<std::size_t>(task.width_count) * padded;
  float* HWY_RESTRICT tangents = with_room(scratch.tangents, cells);
  float* HWY_RESTRICT windows = with_room(scratch.windows, slots);
  float* HWY_RESTRICT wide = with_room(scratch.wide, 4 * padded + 2 * kLanes);
  std::int32_t* HWY_RESTRICT ahead = with_room(scratch.ahead, table.farthest_m.size() + kLanes);

  scan_cells(task, tangents);
  const std::size_t runs = list_ahead(task, ahead);
  const std::size_t room = (runs + 1) * kLanes;
  float* HWY_RESTRICT distance = with_room(scratch.ahead_distance, room);
  float* HWY_RESTRICT turned = with_room(scratch.ahead_turned, room);
  float* HWY_RESTRICT height = with_room(scratch.ahead_height, room);
  const std::size_t gathered = gather_ahead(task, ahead, runs, distance, turned, height);

  const Floats nothing = hn::Set(tag, kNothing);
  for (std::size_t i = 0; i < slots; i += lanes) {
    hn::StoreU(nothing, tag, windows + i);
  }
  const PolarSlot* const slots_end = table.slots.data() + table.slots.size();
#pragma GCC unroll 8
  for (const PolarSlot* slot = table.slots.data(); slot != slots_end; ++slot) {
    float& greatest = windows[slot->slot];
    greatest = std::max(greatest, tangents[slot->cell]);
  }
  float climb_near = kNothing;
  for (const std::uint16_t cell : table.near) {
    climb_near = std::max(climb_near, tangents[cell]);
  }
  task.tan_climb_near = climb_near;

  std::int32_t* HWY_RESTRICT mask_sectors = with_room(scratch.mask_sectors, room);
  float* HWY_RESTRICT mask_tangents = with_room(scratch.mask_tangents, room);
  const std::size_t masking =
      arc_masks(task, gathered, distance, turned, height, mask_sectors, mask_tangents);
  // Neighbours mask the same sectors: taking turns, their stores need not wait for each other.
  float* HWY_RESTRICT masks = with_room(scratch.masks, kMaskTurns * padded);
  for (std::size_t i = 0; i < kMaskTurns * padded; i += lanes) {
    hn::StoreU(nothing, tag, masks + i);
  }
  for (std::size_t i = 0; i < masking; ++i) {
    float& mask = masks[i % kMaskTurns * padded + static_cast<std::size_t>(mask_sectors[i])];
    mask = std::max(mask, mask_tangents[i]);
  }
  for (std::size_t k = 0; k < padded; k += lanes) {
    Floats greatest = hn::LoadU(tag, masks + k);
    for (std::size_t turn = 1; turn < kMaskTurns; ++turn) {
      greatest = hn::Max(greatest, hn::LoadU(tag, masks + turn * padded + k));
    }
    hn::StoreU(greatest, tag, task.tan_mask + k);
  }

  resolve_windows(task, windows, wide);
  const float* HWY_RESTRICT narrow = windows + slots - padded;
  for (std::size_t k = 0; k < padded; k += lanes) {
    hn::StoreU(hn::LoadU(tag, narrow + k), tag, task.tan_climb + k);
  }
  for (std::size_t k = static_cast<std::size_t>(count); k < padded; ++k) {
    task.tan_climb[k] = kNothing;
  }
  mask_sectors_aside(task, wide);
}

void risk_kernel(const RiskTask& task, HistogramScratch& scratch) {
  const FloatTag tag;
  const IntTag int_tag;
  const UintTag uint_tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const PolarConstants& c = *task.constants;
  const PolarTable& table = *task.table;
  const auto count = static_cast<std::size_t>(task.sectors);
  const auto padded = static_cast<std::size_t>(padded_to_lanes(task.sectors));
  std::uint64_t* HWY_RESTRICT shares = with_room(scratch.shares, table.distance_m.size());
  std::uint64_t* HWY_RESTRICT differences = with_room(scratch.differences, padded + kLanes);
  const Floats zero = hn::Zero(tag);
  const Floats one = hn::Set(tag, 1.0F);
  const Floats inverse_window2 = hn::Set(tag, c.inverse_window2);
  const Floats weight_scale = hn::Set(tag, c.weight_scale);
  const Floats risk_scale = hn::Set(tag, c.risk_scale);
  std::size_t at = 0;
  for (const std::int32_t first : table.runs) {
    for (int i = 0; i < kLanes; i += lanes, at += static_cast<std::size_t>(lanes)) {
      const Floats d = hn::Load(tag, table.distance_m.data() + at);
      const Floats share = hn::Max(hn::Sub(one, hn::Mul(hn::Mul(d, d), inverse_window2)), zero);
      const Floats risk =
          hn::Mul(hn::Mul(share, hn::LoadU(tag, task.risk + first + i)), risk_scale);
      hn::StoreInterleaved2(whole(hn::Mul(share, weight_scale)), whole(risk), uint_tag,
                            reinterpret_cast<std::uint32_t*>(shares + at));
    }
  }
  std::fill_n(differences, padded + 1, 0);
  for (const PolarEntry entry : table.entries) {
    const std::uint64_t share = shares[entry.cell];
    differences[entry.low] += share;
    differences[entry.end] -= share;
  }
  std::uint64_t sum = 0;
  for (const std::uint16_t cell : table.wrapped) {
    sum += shares[cell];
  }
  for (const std::uint16_t cell : table.near) {
    sum += shares[cell];
  }
  for (std::size_t k = 0; k < count; ++k) {
    sum += differences[k];
    differences[k] = sum;
  }
  std::fill(differences + count, differences + padded, 0);
  const Floats weight_unit = hn::Set(tag, 1.0F / c.weight_scale);
  const Floats risk_max = hn::Set(tag, c.risk_max);
  for (std::size_t k = 0; k < padded; k += static_cast<std::size_t>(lanes)) {
    hn::Vec<IntTag> weights;
    hn::Vec<IntTag> risks;
    hn::LoadInterleaved2(int_tag, reinterpret_cast<const std::int32_t*>(differences + k), weights,
                         risks);
    const Floats weight = hn::ConvertTo(tag, weights);
    const Floats risk = hn::Mul(hn::Div(hn::ConvertTo(tag, risks), weight), risk_max);
    hn::StoreU(hn::IfThenElseZero(hn::Gt(weight, zero), risk), tag, task.sector_risk + k);
    hn::StoreU(hn::Mul(weight, weight_unit), tag, task.sector_weight + k);
  }
}

// The shorter way between two angles in [0, 2 pi).
HWY_INLINE Floats apart(Floats a, Floats b) {
  const FloatTag tag;
  const Floats difference = hn::Abs(hn::Sub(a, b));
  return hn::Min(difference, hn::Sub(hn::Set(tag, kTwoPi_f), difference));
}

constexpr int kVectorsOfLanes = static_cast<int>(kLanes / hn::MaxLanes(FloatTag()));

// What was summed in kLanes parts.
HWY_INLINE float whole_sum(const Floats (&sums)[kVectorsOfLanes]) {
  const FloatTag tag;
  HWY_ALIGN float parts[kLanes];
  for (int v = 0; v < kVectorsOfLanes; ++v) {
    hn::Store(sums[v], tag, parts + static_cast<std::size_t>(v) * hn::Lanes(tag));
  }
  return sum_of_parts(parts);
}

// Fills task.polar; returns its mean over the sectors with cells.
HWY_INLINE float mean_polar(const DirectionTask& task) {
  const FloatTag tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const int padded = padded_to_lanes(task.sectors);
  const Floats zero = hn::Zero(tag);
  Floats sums[kVectorsOfLanes];
  std::size_t known = 0;
  for (int v = 0; v < kVectorsOfLanes; ++v) {
    sums[v] = zero;
  }
  for (int k = 0; k < padded; k += kLanes) {
#pragma GCC unroll 4
    for (int v = 0; v < kVectorsOfLanes; ++v) {
      const int at = k + v * lanes;
      const Floats tangent =
          hn::Min(hn::Max(hn::LoadU(tag, task.tan_masked + at), hn::Set(tag, task.tangent_min)),
                  hn::Set(tag, task.tangent_max));
      const Floats above = hn::Max(hn::Sub(tangent, hn::Set(tag, task.goal_tangent)), zero);
      const Floats polar = hn::Add(hn::Add(hn::LoadU(tag, task.risk + at),
                                           hn::Mul(hn::Set(tag, task.climb_weight), tangent)),
                                   hn::Mul(hn::Set(tag, task.climb_relative_weight), above));
      const FloatMask is_known = hn::Gt(hn::LoadU(tag, task.risk_weight + at), zero);
      sums[v] = hn::Add(sums[v], hn::IfThenElseZero(is_known, polar));
      known += hn::CountTrue(tag, is_known);
      hn::StoreU(polar, tag, task.polar + at);
    }
  }
  return known > 0 ? whole_sum(sums) / static_cast<float>(known) : 0.0F;
}

// Costs of risk and climb so far off the heading.
class PolarCosts {
 public:
  PolarCosts(const DirectionTask& task, float mean)
      : share_(hn::Set(FloatTag(), task.polar_share)),
        mean_(hn::Set(FloatTag(), mean)),
        offset_(hn::Set(FloatTag(), task.polar_offset)) {}
  [[nodiscard]] HWY_INLINE Floats at(Floats off, Floats polar, Floats weight) const {
    const Floats zero = hn::Zero(FloatTag());
    const Floats cube = hn::Add(hn::Mul(hn::Mul(off, off), off), offset_);
    const Floats extra = hn::Div(hn::Mul(share_, hn::Sub(polar, mean_)), cube);
    return hn::IfThenElseZero(hn::And(hn::Gt(weight, zero), hn::Gt(share_, zero)), extra);
  }

 private:
  Floats share_, mean_, offset_;
};

int cheapest_kernel(const DirectionTask& task) {
  const FloatTag tag;
  const IntTag int_tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const int padded = padded_to_lanes(task.sectors);
  const Floats zero = hn::Zero(tag);
  const PolarCosts polar_costs(task, mean_polar(task));
  const Floats heading = hn::Set(tag, task.heading_rad);
  const Floats goal = hn::Set(tag, task.goal_rad);
  Floats best = hn::Set(tag, std::numeric_limits<float>::infinity());
  auto best_at = hn::Set(int_tag, kNoDirection);
  auto index = hn::Load(int_tag, kIndices);
  const auto step = hn::Set(int_tag, lanes);
  const FloatMask is_quadratic = hn::Gt(hn::Set(tag, task.is_quadratic ? 1.0F : 0.0F), zero);
  for (int k = 0; k < padded; k += lanes) {
    const Floats centre = hn::LoadU(tag, task.centre_rad + k);
    const Floats off_goal = apart(centre, goal);
    const Floats goal_cost =
        hn::Mul(hn::Set(tag, task.goal_weight),
                hn::IfThenElse(is_quadratic, hn::Mul(off_goal, off_goal), off_goal));
    const Floats cost =
        hn::Add(goal_cost, polar_costs.at(apart(centre, heading), hn::LoadU(tag, task.polar + k),
                                          hn::LoadU(tag, task.risk_weight + k)));
    const FloatMask is_better =
        hn::And(hn::Lt(cost, best),
                hn::Le(hn::LoadU(tag, task.tan_needed + k), hn::Set(tag, task.tangent_max)));
    best = hn::IfThenElse(is_better, cost, best);
    best_at = hn::IfThenElse(hn::RebindMask(int_tag, is_better), index, best_at);
    index = hn::Add(index, step);
  }
  const Floats least = hn::MinOfLanes(tag, best);
  const float least_cost = hn::GetLane(least);
  int chosen = kNoDirection;
  if (least_cost < std::numeric_limits<float>::infinity()) {
    const auto is_least = hn::RebindMask(int_tag, hn::Eq(best, least));
    chosen = hn::GetLane(
        hn::MinOfLanes(int_tag, hn::IfThenElse(is_least, best_at, hn::Set(int_tag, task.sectors))));
  }
  if (task.tan_needed[task.goal_sector] <= task.tangent_max) {
    const Floats extra =
        polar_costs.at(apart(goal, heading), hn::Set(tag, task.polar[task.goal_sector]),
                       hn::Set(tag, task.risk_weight[task.goal_sector]));
    if (chosen == kNoDirection || !(least_cost < hn::GetLane(extra))) {
      return kGoalDirection;
    }
  }
  return chosen;
}

float torque_kernel(const TorqueTask& turn) {
  const DirectionTask& task = turn.costs;
  const FloatTag tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const int padded = padded_to_lanes(task.sectors);
  const Floats zero = hn::Zero(tag);
  const Floats one = hn::Set(tag, 1.0F);
  const PolarCosts polar_costs(task, mean_polar(task));
  const Floats heading = hn::Set(tag, task.heading_rad);
  const Floats indicator = hn::Set(tag, turn.indicator_rad);
  const Floats inverse_width2 = hn::Set(tag, turn.inverse_width2);
  Floats sums[kVectorsOfLanes];
  for (int v = 0; v < kVectorsOfLanes; ++v) {
    sums[v] = zero;
  }
  for (int k = 0; k < padded; k += kLanes) {
#pragma GCC unroll 4
    for (int v = 0; v < kVectorsOfLanes; ++v) {
      const int at = k + v * lanes;
      const Floats centre = hn::LoadU(tag, task.centre_rad + at);
      const Floats cost = polar_costs.at(apart(centre, heading), hn::LoadU(tag, task.polar + at),
                                         hn::LoadU(tag, task.risk_weight + at));
      Floats off = hn::Sub(centre, indicator);
      off = hn::Sub(off,
                    hn::IfThenElseZero(hn::Gt(off, hn::Set(tag, kPi_f)), hn::Set(tag, kTwoPi_f)));
      off = hn::Add(off,
                    hn::IfThenElseZero(hn::Lt(off, hn::Set(tag, -kPi_f)), hn::Set(tag, kTwoPi_f)));
      const Floats fall = hn::Add(one, hn::Mul(hn::Mul(off, off), inverse_width2));
      const Floats pull = hn::Mul(cost, off);
      const Floats push = hn::Div(pull, hn::Mul(fall, fall));
      const FloatMask is_feasible =
          hn::Le(hn::LoadU(tag, task.tan_masked + at), hn::Set(tag, task.tangent_max));
      sums[v] = hn::Add(
          sums[v], hn::IfThenElseZero(is_feasible, hn::IfThenElse(hn::Gt(cost, zero), push, pull)));
    }
  }
  return whole_sum(sums);
}

// Sine and cosine of angles within a few turns, to 1e-6.
HWY_INLINE void sine_cosine(Floats angle, Floats& sine, Floats& cosine) {
  const FloatTag tag;
  const auto constant = [&](float value) { return hn::Set(tag, value); };
  const Floats turns =
      hn::Floor(hn::Add(hn::Mul(angle, constant(1.0F / kTwoPi_f)), constant(0.5F)));
  // A quarter of the angle, then doubled twice.
  const Floats x = hn::Mul(hn::Sub(angle, hn::Mul(turns, constant(kTwoPi_f))), constant(0.25F));
  const Floats x2 = hn::Mul(x, x);
  Floats s = hn::Add(hn::Mul(constant(1.0F / 362880.0F), x2), constant(-1.0F / 5040.0F));
  s = hn::Add(hn::Mul(s, x2), constant(1.0F / 120.0F));
  s = hn::Add(hn::Mul(s, x2), constant(-1.0F / 6.0F));
  s = hn::Add(x, hn::Mul(x, hn::Mul(s, x2)));
  Floats c = hn::Add(hn::Mul(constant(1.0F / 40320.0F), x2), constant(-1.0F / 720.0F));
  c = hn::Add(hn::Mul(c, x2), constant(1.0F / 24.0F));
  c = hn::Add(hn::Mul(c, x2), constant(-0.5F));
  c = hn::Add(hn::Mul(c, x2), constant(1.0F));
#pragma GCC unroll 2
  for (int i = 0; i < 2; ++i) {
    const Floats twice = hn::Add(s, s);
    const Floats double_cosine = hn::Sub(constant(1.0F), hn::Mul(twice, s));
    s = hn::Mul(twice, c);
    c = double_cosine;
  }
  sine = s;
  cosine = c;
}

// The guide at the samples: bearing of its target, altitude above what is asked
// for.
HWY_INLINE void look_along_guide(const ForecastTask& task, FlightScratch& scratch,
                                 float* HWY_RESTRICT bearing, float* HWY_RESTRICT guide_rise) {
  const FloatTag tag;
  const IntTag int_tag;
  const hn::CappedTag<float, 4> places_tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const int padded = padded_to_lanes(task.samples);
  std::int32_t* HWY_RESTRICT first_of = with_room(scratch.cells, static_cast<std::size_t>(padded));
  float* HWY_RESTRICT places = with_room(scratch.places, 4 * static_cast<std::size_t>(padded));
  const Floats last = constant(static_cast<float>(task.table_count - 2));
  const auto in_table = [&](int i) {
    return hn::Add(constant(task.from_in_table),
                   hn::Mul(constant(task.step_in_table), numbers_from(i + 1)));
  };
  const auto whole_of = [&](Floats at) { return hn::Min(hn::Floor(at), last); };
  for (int i = 0; i < padded; i += lanes) {
    hn::Store(hn::ConvertTo(int_tag, whole_of(in_table(i))), int_tag, first_of + i);
  }
  // A place and the next one are neighbours: one load.
  for (int i = 0; i < padded; ++i) {
    hn::Store(hn::LoadU(places_tag, task.guide + 2 * static_cast<std::ptrdiff_t>(first_of[i])),
              places_tag, places + 4 * static_cast<std::ptrdiff_t>(i));
  }
  for (int i = 0; i < padded; i += lanes) {
    const Floats at = in_table(i);
    const Floats share = hn::Sub(at, whole_of(at));
    Floats bearing_before;
    Floats altitude_before;
    Floats bearing_after;
    Floats altitude_after;
    hn::LoadInterleaved4(tag, places + 4 * static_cast<std::ptrdiff_t>(i), bearing_before,
                         altitude_before, bearing_after, altitude_after);
    const auto between = [&](Floats before, Floats after) {
      return hn::Add(before, hn::Mul(share, hn::Sub(after, before)));
    };
    hn::Store(between(bearing_before, bearing_after), tag, bearing + i);
    hn::Store(hn::Sub(between(altitude_before, altitude_after), constant(task.guide_floor_m)), tag,
              guide_rise + i);
  }
}

// The greatest climb rate that the samples ask for.
HWY_INLINE void greatest_rates(ForecastTask& task, const float* HWY_RESTRICT ground_rise,
                               const float* HWY_RESTRICT guide_rise) {
  const FloatTag tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const int padded = padded_to_lanes(task.samples);
  const Floats zero = hn::Zero(tag);
  const Floats a = constant(task.acceleration_mps2);
  Floats greatest = constant(task.rate_min_mps);
  Floats greatest_later = greatest;
  for (int i = 0; i < padded; i += lanes) {
    const Floats number = numbers_from(i + 1);
    const Floats rise = hn::Max(hn::LoadU(tag, ground_rise + i), hn::LoadU(tag, guide_rise + i));
    const Floats time = hn::Mul(number, constant(task.sample_s));
    const Floats climb_rate = constant(task.climb_rate_mps);
    const Floats missing = hn::Sub(rise, hn::Mul(climb_rate, time));
    const Floats free = hn::Sub(time, constant(task.response_s));
    const Floats root = hn::Sub(hn::Mul(free, free), hn::Div(hn::Add(missing, missing), a));
    const Floats climbing =
        hn::Add(climb_rate, hn::Mul(a, hn::Sub(free, hn::Sqrt(hn::Max(root, zero)))));
    const FloatMask is_hopeless = hn::Or(hn::Le(free, zero), hn::Lt(root, zero));
    const Floats rate =
        hn::IfThenElse(hn::Le(missing, zero), hn::Div(rise, time),
                       hn::IfThenElse(is_hopeless, constant(task.rate_max_mps), climbing));
    const FloatMask is_valid = hn::And(
        hn::Le(number, constant(static_cast<float>(task.samples))),
        hn::Le(hn::Add(constant(task.from_in_table), hn::Mul(constant(task.step_in_table), number)),
               constant(task.end_in_table)));
    greatest = hn::IfThenElse(is_valid, hn::Max(greatest, rate), greatest);
    greatest_later = hn::IfThenElse(hn::And(is_valid, hn::Ge(time, constant(kBrakingHelpsAfter_s))),
                                    hn::Max(greatest_later, rate), greatest_later);
  }
  task.greatest_mps = hn::GetLane(hn::MaxOfLanes(tag, greatest));
  task.greatest_later_mps = hn::GetLane(hn::MaxOfLanes(tag, greatest_later));
}

void forecast_kernel(ForecastTask& task, FlightScratch& scratch) {
  const FloatTag tag;
  const IntTag int_tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const int padded = padded_to_lanes(task.samples);
  const auto room = static_cast<std::size_t>(padded);
  float* HWY_RESTRICT bearing = with_room(scratch.lines, 6 * room);
  float* HWY_RESTRICT guide_rise = bearing + room;
  float* HWY_RESTRICT middle = guide_rise + room;
  float* HWY_RESTRICT forward = middle + room;
  float* HWY_RESTRICT leftward = forward + room;
  float* HWY_RESTRICT ground_rise = leftward + room;
  std::int32_t* HWY_RESTRICT cells = with_room(scratch.cells, room);
  look_along_guide(task, scratch, bearing, guide_rise);
  // The turn; headings are relative to the present one.
  const float turn_max = task.roll_share * task.turn_max_radps;
  const float pull = task.roll_share * task.gain;
  const float keep = 1.0F - task.roll_share;
  const float half_s = 0.5F * task.sample_s;
  const float ahead = task.wanted_rad - task.beside_rad - task.bearing_now_rad;
  float heading = 0.0F;
  float turn = task.turn_radps;
  float wanted = task.wanted_rad;
  float beside = task.beside_rad;
  for (int i = 0; i < task.samples; ++i) {
    const float wanted_turn = std::min(std::max(pull * (wanted - heading), -turn_max), turn_max);
    middle[i] = heading + half_s * turn;
    heading += task.sample_s * turn;
    turn = keep * turn + wanted_turn;
    beside *= task.fading;
    wanted = ahead + bearing[i] + beside;
  }
  std::fill(middle + task.samples, middle + padded, 0.0F);
  for (int i = 0; i < padded; i += lanes) {
    Floats sine;
    Floats cosine;
    sine_cosine(hn::LoadU(tag, middle + i), sine, cosine);
    hn::StoreU(cosine, tag, forward + i);
    hn::StoreU(sine, tag, leftward + i);
  }
  // In registers: read back from the arrays, each sum would wait for its store.
  float forward_sum = 0.0F;
  float leftward_sum = 0.0F;
  for (int i = 0; i < padded; ++i) {
    forward_sum += forward[i];
    leftward_sum += leftward[i];
    forward[i] = forward_sum;
    leftward[i] = leftward_sum;
  }
  for (int i = 0; i < padded; i += lanes) {
    const Floats x = hn::LoadU(tag, forward + i);
    const Floats y = hn::LoadU(tag, leftward + i);
    const Floats number = numbers_from(i + 1);
    const Floats east = hn::Add(
        hn::Sub(hn::Mul(x, constant(task.east_cells)), hn::Mul(y, constant(task.north_cells))),
        hn::Mul(number, constant(task.drift_east_cells)));
    const Floats north = hn::Add(
        hn::Add(hn::Mul(x, constant(task.north_cells)), hn::Mul(y, constant(task.east_cells))),
        hn::Mul(number, constant(task.drift_north_cells)));
    const auto cell_of = [&](Floats away, float part, int from, int count) {
      const auto cell = hn::Add(whole_below(hn::Add(away, constant(part))), hn::Set(int_tag, from));
      return hn::Min(hn::Max(cell, hn::Zero(int_tag)), hn::Set(int_tag, count - 1));
    };
    const auto column = cell_of(east, task.part_of_column, task.column, task.columns);
    const auto row = cell_of(north, task.part_of_row, task.row, task.rows);
    hn::Store(hn::Add(hn::Mul(row, hn::Set(int_tag, task.columns)), column), int_tag, cells + i);
  }
  for (int i = 0; i < task.samples; ++i) {
    ground_rise[i] = task.dilated_m[cells[i]];
  }
  for (int i = 0; i < padded; i += lanes) {
    hn::Store(hn::Sub(hn::Load(tag, ground_rise + i), constant(task.floor_m)), tag,
              ground_rise + i);
  }
  greatest_rates(task, ground_rise, guide_rise);
}

// Flies some vectors of candidates and fetches the ground at all samples. kInside: no path leaves
// the raster; kCalm: there is no drift. Loading one by one is faster than gathering.
template <int kVectors, bool kInside, bool kCalm>
HWY_INLINE void fly_paths(const RolloutTask& task, int first, const float* HWY_RESTRICT bend,
                          std::int32_t* HWY_RESTRICT cells, std::uint32_t* HWY_RESTRICT words) {
  const FloatTag tag;
  const IntTag int_tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const ForecastTask& path = task.path;
  const Floats turn_max = constant(path.roll_share * path.turn_max_radps);
  const Floats turn_min = hn::Neg(turn_max);
  const Floats pull = constant(path.roll_share * path.gain);
  const Floats keep = constant(1.0F - path.roll_share);
  const Floats sample_s = constant(path.sample_s);
  const Floats half_s = constant(0.5F * path.sample_s);
  const Floats one = constant(1.0F);
  const Floats half = constant(0.5F);
  const Floats sixth = constant(1.0F / 6.0F);
  const auto columns = hn::Set(int_tag, path.columns);
  const std::uint32_t* const ground = task.ground;
  const Floats drift_east = constant(path.drift_east_cells);
  const Floats drift_north = constant(path.drift_north_cells);
  Floats wanted[kVectors];
  Floats heading[kVectors];
  Floats turn[kVectors];
  Floats turn_before[kVectors];
  Floats east[kVectors];  // one sample onwards [cells]
  Floats north[kVectors];
  Floats x[kVectors];
  Floats y[kVectors];
#pragma GCC unroll 4
  for (int v = 0; v < kVectors; ++v) {
    wanted[v] = hn::LoadU(tag, task.wanted_rad + first + v * lanes);
    heading[v] = hn::Zero(tag);
    turn[v] = constant(path.turn_radps);
    turn_before[v] = hn::Zero(tag);
    east[v] = constant(path.east_cells);
    north[v] = constant(path.north_cells);
    x[v] = constant(path.part_of_column);
    y[v] = constant(path.part_of_row);
  }
  words += first;
  // One sample later, when the stores of its cells are done.
  const std::int32_t* HWY_RESTRICT cells_before = cells;
  const auto fetch = [&] {
#pragma GCC unroll 32
    for (int k = 0; k < kVectors * lanes; ++k) {
      words[k] = ground[cells_before[k]];
    }
    words += kCandidates;
    cells_before += kVectors * lanes;
  };
  for (int i = 0; i < path.samples; ++i) {
    const Floats bent = constant(bend[i]);
#pragma GCC unroll 4
    for (int v = 0; v < kVectors; ++v) {
      const Floats off = hn::Sub(hn::Add(wanted[v], bent), heading[v]);
      const Floats wanted_turn = hn::Min(hn::Max(hn::Mul(pull, off), turn_min), turn_max);
      // Direction in the middle of the sample, from that of the one before.
      const Floats angle = hn::Mul(half_s, hn::Add(turn[v], turn_before[v]));
      heading[v] = hn::Add(heading[v], hn::Mul(sample_s, turn[v]));
      turn_before[v] = turn[v];
      turn[v] = hn::Add(hn::Mul(keep, turn[v]), wanted_turn);
      const Floats angle2 = hn::Mul(angle, angle);
      const Floats sine = hn::Mul(angle, hn::Sub(one, hn::Mul(angle2, sixth)));
      const Floats cosine =
          hn::Sub(one, hn::Mul(angle2, hn::Sub(half, hn::Mul(angle2, constant(1.0F / 24.0F)))));
      const Floats turned_east = hn::Sub(hn::Mul(east[v], cosine), hn::Mul(north[v], sine));
      north[v] = hn::Add(hn::Mul(east[v], sine), hn::Mul(north[v], cosine));
      east[v] = turned_east;
      x[v] = hn::Add(x[v], east[v]);
      y[v] = hn::Add(y[v], north[v]);
      if constexpr (!kCalm) {
        x[v] = hn::Add(x[v], drift_east);
        y[v] = hn::Add(y[v], drift_north);
      }
      auto column = whole_below(x[v]);
      auto row = whole_below(y[v]);
      if constexpr (!kInside) {
        column = hn::Min(hn::Max(column, hn::Set(int_tag, -path.column)),
                         hn::Set(int_tag, path.columns - 1 - path.column));
        row = hn::Min(hn::Max(row, hn::Set(int_tag, -path.row)),
                      hn::Set(int_tag, path.rows - 1 - path.row));
      }
      hn::Store(hn::Add(hn::Mul(row, columns), column), int_tag, cells + v * lanes);
    }
    cells += kVectors * lanes;
    if (i > 0) {
      fetch();
    }
  }
  fetch();
}

// Height of packed ground above the floor.
HWY_INLINE Floats rise_over(hn::Vec<UintTag> word, Floats floor) {
  const FloatTag tag;
  const auto steps = hn::BitCast(IntTag(), hn::ShiftRight<PackedGround::kRiskBits>(word));
  return hn::Sub(hn::Mul(hn::ConvertTo(tag, steps), constant(1.0F / PackedGround::kStepsPerMetre)),
                 floor);
}

// What the ground asks of each candidate: the greatest tangent from sample `from` on, and its risk.
// Sums of shares of the greatest risk stay below 2^24: floats would add up to the same.
HWY_INLINE void judge_paths(const RolloutTask& task, int from, const float* HWY_RESTRICT early,
                            const float* HWY_RESTRICT late,
                            const std::uint32_t* HWY_RESTRICT words) {
  const FloatTag tag;
  const IntTag int_tag;
  const UintTag uint_tag;
  constexpr int kVectors = static_cast<int>(kCandidates / hn::MaxLanes(FloatTag()));
  const int lanes = static_cast<int>(hn::Lanes(tag));
  const Floats floor = constant(task.path.floor_m - PackedGround::kLowest_m);
  const auto risk_bits = hn::Set(uint_tag, PackedGround::kRiskMax);
  hn::Vec<UintTag> risk[kVectors];
  Floats needed[kVectors];
#pragma GCC unroll 8
  for (int v = 0; v < kVectors; ++v) {
    risk[v] = hn::Zero(uint_tag);
    needed[v] = constant(kNothing);
  }
  for (int i = 0; i < from; ++i, words += kCandidates) {
#pragma GCC unroll 8
    for (int v = 0; v < kVectors; ++v) {
      risk[v] = hn::Add(risk[v], hn::And(hn::Load(uint_tag, words + v * lanes), risk_bits));
    }
  }
  for (int i = from; i < task.path.samples; ++i, words += kCandidates) {
    const Floats share = constant(early[i]);
    const Floats late_share = constant(late[i]);
#pragma GCC unroll 8
    for (int v = 0; v < kVectors; ++v) {
      const auto word = hn::Load(uint_tag, words + v * lanes);
      risk[v] = hn::Add(risk[v], hn::And(word, risk_bits));
      const Floats rise = rise_over(word, floor);
      needed[v] = hn::Max(needed[v], hn::Max(hn::Mul(rise, share), hn::Mul(rise, late_share)));
    }
  }
#pragma GCC unroll 8
  for (int v = 0; v < kVectors; ++v) {
    hn::StoreU(hn::ConvertTo(tag, hn::BitCast(int_tag, risk[v])), tag, task.risk + v * lanes);
    hn::StoreU(needed[v], tag, task.needed + v * lanes);
  }
}

void rollout_kernel(RolloutTask& task, FlightScratch& scratch) {
  const FloatTag tag;
  const IntTag int_tag;
  const UintTag uint_tag;
  const int lanes = static_cast<int>(hn::Lanes(tag));
  ForecastTask& path = task.path;
  const auto padded = static_cast<std::size_t>(padded_to_lanes(path.samples));
  float* HWY_RESTRICT bearing = with_room(scratch.lines, 6 * padded);
  float* HWY_RESTRICT guide_rise = bearing + padded;
  float* HWY_RESTRICT bend = guide_rise + padded;
  float* HWY_RESTRICT early = bend + padded;
  float* HWY_RESTRICT late = early + padded;
  float* HWY_RESTRICT ground_rise = late + padded;
  std::uint32_t* HWY_RESTRICT words = with_room(scratch.words, (kCandidates + 1) * padded);
  std::uint32_t* HWY_RESTRICT commanded = words + kCandidates * padded;
  look_along_guide(path, scratch, bearing, guide_rise);
  float beside = path.beside_rad;
  bend[0] = 0.0F;
  for (int i = 1; i < path.samples; ++i) {
    beside *= path.fading;
    bend[i] = bearing[i - 1] - path.bearing_now_rad + (beside - path.beside_rad);
  }
  // Shares of the distance in a tangent.
  const int end = path.samples;
  for (int i = 0; i < end; i += lanes) {
    const Floats run_m = hn::Mul(numbers_from(i + 1), constant(task.step_m));
    const Floats lag_m = constant(task.lag_m);
    const Floats one = constant(1.0F);
    hn::Store(hn::Div(one, hn::Max(hn::Sub(run_m, lag_m), constant(task.shortest_m))), tag,
              early + i);
    hn::Store(hn::Div(one, hn::Add(run_m, lag_m)), tag, late + i);
  }
  int far = 0;  // first sample beyond the lag
  while (far < end && static_cast<float>(far + 1) * task.step_m <= task.lag_m) {
    ++far;
  }
  constexpr int kVectors = 2;
  const float reach_cells =
      static_cast<float>(path.samples) *
          (std::max(std::fabs(path.east_cells), std::fabs(path.north_cells)) * 1.5F +
           std::max(std::fabs(path.drift_east_cells), std::fabs(path.drift_north_cells))) +
      3.0F;
  const auto reach = static_cast<int>(std::min(reach_cells, 1e6F));
  const bool is_inside = path.column >= reach && path.row >= reach &&
                         path.column + reach < path.columns && path.row + reach < path.rows;
  const bool is_calm = path.drift_east_cells == 0.0F && path.drift_north_cells == 0.0F;
  std::int32_t* HWY_RESTRICT cells = with_room(scratch.cells, kCandidates * padded);
  for (int first = 0; first < kCandidates; first += kVectors * lanes) {
    if (is_inside && is_calm) {
      fly_paths<kVectors, true, true>(task, first, bend, cells, words);
    } else if (is_inside) {
      fly_paths<kVectors, true, false>(task, first, bend, cells, words);
    } else {
      fly_paths<kVectors, false, false>(task, first, bend, cells, words);
    }
  }
  for (int i = 0; i < end; ++i) {
    commanded[i] = words[i * kCandidates + kCommandedCandidate];
  }
  judge_paths(task, far, early, late, words);

  Floats near = constant(kNothing);
  const Floats floor = constant(path.floor_m - PackedGround::kLowest_m);
  for (int i = 0; i < end; i += lanes) {
    const Floats rise = rise_over(hn::Load(uint_tag, commanded + i), floor);
    hn::Store(rise, tag, ground_rise + i);
    const Floats tangent =
        hn::Max(hn::Mul(rise, hn::Load(tag, early + i)), hn::Mul(rise, hn::Load(tag, late + i)));
    const FloatMask is_near = hn::Le(numbers_from(i + 1), constant(static_cast<float>(far)));
    near = hn::IfThenElse(is_near, hn::Max(near, tangent), near);
  }
  task.near[0] = hn::GetLane(hn::MaxOfLanes(tag, near));
  greatest_rates(path, ground_rise, guide_rise);

  // The choice.
  const Floats zero = hn::Zero(tag);
  const Floats goal = constant(task.goal_off_rad);
  const Floats before = constant(task.before_off_rad);
  const FloatMask is_quadratic = hn::Gt(constant(task.is_quadratic ? 1.0F : 0.0F), zero);
  Floats best = constant(std::numeric_limits<float>::infinity());
  auto best_at = hn::Set(int_tag, kNoDirection);
  auto index = hn::Load(int_tag, kIndices);
  for (int k = 0; k < kCandidates; k += lanes) {
    const Floats wanted = hn::LoadU(tag, task.wanted_rad + k);
    const Floats needed = hn::LoadU(tag, task.needed + k);
    const auto away = [&](Floats from) {
      const Floats difference = hn::Abs(hn::Sub(wanted, from));
      return hn::Abs(hn::Min(difference, hn::Sub(constant(kTwoPi_f), difference)));
    };
    const Floats off = away(goal);
    const Floats tangent =
        hn::Min(hn::Max(needed, constant(task.tangent_min)), constant(task.tangent_max));
    const Floats above = hn::Max(hn::Sub(tangent, constant(task.goal_tangent)), zero);
    const Floats goal_cost =
        hn::Mul(constant(task.goal_weight), hn::IfThenElse(is_quadratic, hn::Mul(off, off), off));
    const Floats ground_cost =
        hn::Add(hn::Add(hn::Mul(constant(task.risk_weight), hn::LoadU(tag, task.risk + k)),
                        hn::Mul(constant(task.climb_weight), tangent)),
                hn::Mul(constant(task.climb_relative_weight), above));
    const Floats cost = hn::Add(hn::Add(goal_cost, ground_cost),
                                hn::Mul(constant(task.change_weight), away(before)));
    const FloatMask is_better =
        hn::And(hn::Lt(cost, best), hn::Le(needed, constant(task.tangent_max)));
    best = hn::IfThenElse(is_better, cost, best);
    best_at = hn::IfThenElse(hn::RebindMask(int_tag, is_better), index, best_at);
    index = hn::Add(index, hn::Set(int_tag, lanes));
  }
  const Floats least = hn::MinOfLanes(tag, best);
  task.chosen = kNoDirection;
  if (hn::GetLane(least) < std::numeric_limits<float>::infinity()) {
    const auto is_least = hn::RebindMask(int_tag, hn::Eq(best, least));
    task.chosen = hn::GetLane(
        hn::MinOfLanes(int_tag, hn::IfThenElse(is_least, best_at, hn::Set(int_tag, kCandidates))));
  }
}

}  // namespace hedgehop::local_planning::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hedgehop::local_planning {
namespace {

HWY_EXPORT(histogram_kernel);
HWY_EXPORT(risk_kernel);
HWY_EXPORT(cheapest_kernel);
HWY_EXPORT(torque_kernel);
HWY_EXPORT(forecast_kernel);
HWY_EXPORT(rollout_kernel);

constexpr std::int64_t kAvx512Targets = HWY_AVX3 | HWY_AVX3_DL;

std::int64_t usable_targets() { return hwy::SupportedTargets() & HWY_TARGETS; }

void best_histogram(HistogramTask& task, HistogramScratch& scratch) {
  HWY_DYNAMIC_DISPATCH(histogram_kernel)(task, scratch);
}

void best_risk(const RiskTask& task, HistogramScratch& scratch) {
  HWY_DYNAMIC_DISPATCH(risk_kernel)(task, scratch);
}

void best_forecast(ForecastTask& task, FlightScratch& scratch) {
  HWY_DYNAMIC_DISPATCH(forecast_kernel)(task, scratch);
}

void best_rollout(RolloutTask& task, FlightScratch& scratch) {
  HWY_DYNAMIC_DISPATCH(rollout_kernel)(task, scratch);
}

int best_cheapest(const DirectionTask& task) { return HWY_DYNAMIC_DISPATCH(cheapest_kernel)(task); }

float best_torque(const TorqueTask& task) { return HWY_DYNAMIC_DISPATCH(torque_kernel)(task); }

}  // namespace

bool is_available(Kernel kernel) {
  switch (kernel) {
    case Kernel::kAvx2:
      return (usable_targets() & HWY_AVX2) != 0;
    case Kernel::kAvx512:
      return (usable_targets() & kAvx512Targets) != 0;
    case Kernel::kBest:
    case Kernel::kPlain:
      break;
  }
  return true;
}

const char* name_of_kernel(Kernel kernel) {
  switch (kernel) {
    case Kernel::kPlain:
      return "plain";
    case Kernel::kAvx2:
      return "avx2";
    case Kernel::kAvx512:
      return "avx512";
    case Kernel::kBest:
      break;
  }
  if (is_available(Kernel::kAvx512)) {
    return "avx512";
  }
  return is_available(Kernel::kAvx2) ? "avx2"
                                     : hwy::TargetName(usable_targets() & -usable_targets());
}

StepKernels step_kernels(Kernel kernel) {
  if (!is_available(kernel)) {
    throw std::invalid_argument("this processor lacks the instructions asked for");
  }
#if (HWY_TARGETS & HWY_AVX2) && HWY_TARGETS != HWY_AVX2
  if (kernel == Kernel::kAvx2) {
    return {&N_AVX2::histogram_kernel, &N_AVX2::risk_kernel,     &N_AVX2::cheapest_kernel,
            &N_AVX2::torque_kernel,    &N_AVX2::forecast_kernel, &N_AVX2::rollout_kernel};
  }
#endif
  return {&best_histogram, &best_risk, &best_cheapest, &best_torque, &best_forecast, &best_rollout};
}

}  // namespace hedgehop::local_planning
#endif
