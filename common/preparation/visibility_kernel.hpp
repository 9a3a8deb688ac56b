#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace hedgehop::preparation {

/// Heights stand in a padded raster; unknown ones are this, far below everything.
inline constexpr float kFarBelow_m = -1e30F;
/// Slopes below this belong to unknown samples.
inline constexpr float kUnknownSlope = -1e6F;
/// The kernel works on this many neighbouring observers at once and reads as far beyond a row's
/// end.
inline constexpr int kLanesMax = 64;

/// One sample of a ray, for every observer alike.
struct RaySample {
  std::ptrdiff_t offset = 0;  // from the observer to the left one of two neighbours
  float fraction = 0.0F;      // weight of the right one
  float inverse_distance_1pm = 0.0F;
  float weight = 0.0F;  // whole number
};

struct Ray {
  std::vector<RaySample> samples;  // outwards
};

/// Adds, for `count` observers in a row from `ground_m` on, the weights of the samples they see to
/// `seen`, and of those that are known to `known` unless it is null. The eye of the first is at
/// `eyes_m[0]`. All but `ground_m`, which stands in its padded raster, have room for kLanesMax
/// more.
void add_seen(const float* ground_m, const float* eyes_m, int count, const std::vector<Ray>& rays,
              std::int32_t* seen, std::int32_t* known);

}  // namespace hedgehop::preparation
