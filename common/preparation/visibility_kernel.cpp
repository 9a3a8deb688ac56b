#include "preparation/visibility_kernel.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "preparation/visibility_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace hedgehop::preparation::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using FloatTag = hn::CappedTag<float, 16>;
using Floats = hn::Vec<FloatTag>;

// Two groups of lanes at once: enough to hide the latency of max, few enough for 16 registers.
template <bool kCountKnown>
HWY_NOINLINE void add_ray(const float* HWY_RESTRICT ground_m, const float* HWY_RESTRICT eyes_m,
                          const Ray& ray, std::int32_t* HWY_RESTRICT seen,
                          std::int32_t* HWY_RESTRICT known) {
  const FloatTag tag;
  const hn::RebindToSigned<FloatTag> int_tag;
  const std::size_t lanes = hn::Lanes(tag);
  const Floats eye_a = hn::LoadU(tag, eyes_m);
  const Floats eye_b = hn::LoadU(tag, eyes_m + lanes);
  Floats greatest_a = hn::Set(tag, kUnknownSlope);
  Floats greatest_b = greatest_a;
  Floats seen_a = hn::Zero(tag);
  Floats seen_b = seen_a;
  Floats known_a = seen_a;
  Floats known_b = seen_a;
  for (const RaySample& sample : ray.samples) {
    const float* HWY_RESTRICT left = ground_m + sample.offset;
    const Floats fraction = hn::Set(tag, sample.fraction);
    const Floats inverse_distance = hn::Set(tag, sample.inverse_distance_1pm);
    const Floats weight = hn::Set(tag, sample.weight);
    const Floats left_a = hn::LoadU(tag, left);
    const Floats left_b = hn::LoadU(tag, left + lanes);
    const Floats z_a = hn::MulAdd(fraction, hn::Sub(hn::LoadU(tag, left + 1), left_a), left_a);
    const Floats z_b =
        hn::MulAdd(fraction, hn::Sub(hn::LoadU(tag, left + lanes + 1), left_b), left_b);
    const Floats slope_a = hn::Mul(hn::Sub(z_a, eye_a), inverse_distance);
    const Floats slope_b = hn::Mul(hn::Sub(z_b, eye_b), inverse_distance);
    seen_a = hn::Add(seen_a, hn::IfThenElseZero(hn::Ge(slope_a, greatest_a), weight));
    seen_b = hn::Add(seen_b, hn::IfThenElseZero(hn::Ge(slope_b, greatest_b), weight));
    greatest_a = hn::Max(greatest_a, slope_a);
    greatest_b = hn::Max(greatest_b, slope_b);
    if constexpr (kCountKnown) {
      const Floats limit = hn::Set(tag, kUnknownSlope);
      known_a = hn::Add(known_a, hn::IfThenElseZero(hn::Gt(slope_a, limit), weight));
      known_b = hn::Add(known_b, hn::IfThenElseZero(hn::Gt(slope_b, limit), weight));
    }
  }
  const auto add = [&](Floats sum, std::int32_t* HWY_RESTRICT target) {
    hn::StoreU(hn::Add(hn::LoadU(int_tag, target), hn::ConvertTo(int_tag, sum)), int_tag, target);
  };
  add(seen_a, seen);
  add(seen_b, seen + lanes);
  if constexpr (kCountKnown) {
    add(known_a, known);
    add(known_b, known + lanes);
  }
}

void add_seen_kernel(const float* ground_m, const float* eyes_m, int count,
                     const std::vector<Ray>& rays, std::int32_t* seen, std::int32_t* known) {
  const FloatTag tag;
  const int step = 2 * static_cast<int>(hn::Lanes(tag));
  for (const Ray& ray : rays) {
    for (int i = 0; i < count; i += step) {
      if (known == nullptr) {
        add_ray<false>(ground_m + i, eyes_m + i, ray, seen + i, nullptr);
      } else {
        add_ray<true>(ground_m + i, eyes_m + i, ray, seen + i, known + i);
      }
    }
  }
}

}  // namespace hedgehop::preparation::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hedgehop::preparation {

HWY_EXPORT(add_seen_kernel);

void add_seen(const float* ground_m, const float* eyes_m, int count, const std::vector<Ray>& rays,
              std::int32_t* seen, std::int32_t* known) {
  HWY_DYNAMIC_DISPATCH(add_seen_kernel)(ground_m, eyes_m, count, rays, seen, known);
}

}  // namespace hedgehop::preparation
#endif
