#include "base/elementary.hpp"

#include <cmath>
#include <initializer_list>
#include <limits>
#include <numbers>

namespace hedgehop::elementary {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// pi/2 in three parts; the first two have trailing zero bits, so that n * part is exact for n <
// 2^20.
constexpr double kHalfPi1 = 0x1.921fb544p+0;
constexpr double kHalfPi2 = 0x1.0b4611a6p-34;
constexpr double kHalfPi3 = 0x1.3198a2e037073p-69;

// Taylor series; on [-pi/4, pi/4] the first neglected term is below 2e-20.
double sin_series(double x) {
  const double x2 = x * x;
  double sum = 1.0 / 355687428096000.0;
  sum = -1.0 / 1307674368000.0 + x2 * sum;
  sum = 1.0 / 6227020800.0 + x2 * sum;
  sum = -1.0 / 39916800.0 + x2 * sum;
  sum = 1.0 / 362880.0 + x2 * sum;
  sum = -1.0 / 5040.0 + x2 * sum;
  sum = 1.0 / 120.0 + x2 * sum;
  sum = -1.0 / 6.0 + x2 * sum;
  return x + x * (x2 * sum);
}

double cos_series(double x) {
  const double x2 = x * x;
  double sum = -1.0 / 6402373705728000.0;
  sum = 1.0 / 20922789888000.0 + x2 * sum;
  sum = -1.0 / 87178291200.0 + x2 * sum;
  sum = 1.0 / 479001600.0 + x2 * sum;
  sum = -1.0 / 3628800.0 + x2 * sum;
  sum = 1.0 / 40320.0 + x2 * sum;
  sum = -1.0 / 720.0 + x2 * sum;
  sum = 1.0 / 24.0 + x2 * sum;
  // 1 - x2/2 is split so that its rounding error is carried into the small terms.
  const double half = 0.5 * x2;
  const double head = 1.0 - half;
  return head + ((1.0 - head) - half + x2 * x2 * sum);
}

struct Reduced {
  double remainder;
  long long quadrant;
};

Reduced reduce_by_half_pi(double x) {
  const double n = std::floor(x * (2.0 / std::numbers::pi) + 0.5);
  return {((x - n * kHalfPi1) - n * kHalfPi2) - n * kHalfPi3, static_cast<long long>(n)};
}

bool is_in_trigonometric_range(double x) { return std::fabs(x) <= 1e6; }

// atan(k / 8)
constexpr double kAtanEighths[9] = {0.0,
                                    0.12435499454676144,
                                    0.24497866312686414,
                                    0.35877067027057225,
                                    0.4636476090008061,
                                    0.5585993153435624,
                                    0.6435011087932844,
                                    0.7188299996216245,
                                    0.7853981633974483};

// x in [0, 1]: the angle to the nearest eighth is below 1/16.
double atan_unit(double x) {
  const int k = static_cast<int>(x * 8.0 + 0.5);
  const double c = static_cast<double>(k) / 8.0;
  const double t = (x - c) / (1.0 + x * c);
  const double t2 = t * t;
  double sum = 1.0 / 13.0;
  sum = -1.0 / 11.0 + t2 * sum;
  sum = 1.0 / 9.0 + t2 * sum;
  sum = -1.0 / 7.0 + t2 * sum;
  sum = 1.0 / 5.0 + t2 * sum;
  sum = -1.0 / 3.0 + t2 * sum;
  return kAtanEighths[k] + (t + t * (t2 * sum));
}

}  // namespace

double sin(double x_rad) {
  if (!is_in_trigonometric_range(x_rad)) {
    return kNaN;
  }
  const auto [r, quadrant] = reduce_by_half_pi(x_rad);
  switch (quadrant & 3) {
    case 0:
      return sin_series(r);
    case 1:
      return cos_series(r);
    case 2:
      return -sin_series(r);
    default:
      return -cos_series(r);
  }
}

double cos(double x_rad) {
  if (!is_in_trigonometric_range(x_rad)) {
    return kNaN;
  }
  const auto [r, quadrant] = reduce_by_half_pi(x_rad);
  switch (quadrant & 3) {
    case 0:
      return cos_series(r);
    case 1:
      return -sin_series(r);
    case 2:
      return -cos_series(r);
    default:
      return sin_series(r);
  }
}

SineCosine sine_cosine(double x_rad) {
  if (!is_in_trigonometric_range(x_rad)) {
    return {kNaN, kNaN};
  }
  const auto [r, quadrant] = reduce_by_half_pi(x_rad);
  const double s = sin_series(r);
  const double c = cos_series(r);
  switch (quadrant & 3) {
    case 0:
      return {s, c};
    case 1:
      return {c, -s};
    case 2:
      return {-s, -c};
    default:
      return {-c, s};
  }
}

double tan(double x_rad) {
  if (x_rad == 0.0) {
    return x_rad;  // flight at constant speed asks for it at each step
  }
  const SineCosine both = sine_cosine(x_rad);
  return both.sine / both.cosine;
}

double atan(double x) {
  if (std::isnan(x)) {
    return kNaN;
  }
  const double magnitude = std::fabs(x);
  const double angle =
      magnitude <= 1.0 ? atan_unit(magnitude) : 0.5 * std::numbers::pi - atan_unit(1.0 / magnitude);
  return std::signbit(x) ? -angle : angle;
}

double atan2(double y, double x) {
  if (std::isnan(x) || std::isnan(y)) {
    return kNaN;
  }
  const double ax = std::fabs(x);
  const double ay = std::fabs(y);
  double angle = 0.0;
  if (ax == 0.0 && ay == 0.0) {
    return 0.0;
  }
  if (std::isinf(ax) && std::isinf(ay)) {
    angle = 0.25 * std::numbers::pi;
  } else if (ay <= ax) {
    angle = atan_unit(ay / ax);
  } else {
    angle = 0.5 * std::numbers::pi - atan_unit(ax / ay);
  }
  if (std::signbit(x)) {
    angle = std::numbers::pi - angle;
  }
  return std::signbit(y) ? -angle : angle;
}

double asin(double x) {
  if (!(std::fabs(x) <= 1.0)) {
    return kNaN;
  }
  return atan2(x, std::sqrt((1.0 - x) * (1.0 + x)));
}

double exp(double x) {
  if (std::isnan(x)) {
    return kNaN;
  }
  if (x > 709.782712893384) {
    return kInfinity;
  }
  if (x < -745.2) {
    return 0.0;
  }
  constexpr double kLn2High = 0x1.62e42fee00000p-1;
  constexpr double kLn2Low = 0x1.a39ef35793c76p-33;
  const double n = std::floor(x / std::numbers::ln2 + 0.5);
  const double r = (x - n * kLn2High) - n * kLn2Low;
  double sum = 1.0 / 6227020800.0;
  for (const double factorial : {479001600.0, 39916800.0, 3628800.0, 362880.0, 40320.0, 5040.0,
                                 720.0, 120.0, 24.0, 6.0, 2.0}) {
    sum = 1.0 / factorial + r * sum;
  }
  const double value = 1.0 + (r + r * r * sum);
  // Two steps, so that 2^n itself neither overflows nor underflows before the result does.
  const int exponent = static_cast<int>(n);
  const int first = exponent / 2;
  return std::ldexp(std::ldexp(value, first), exponent - first);
}

double log(double x) {
  if (std::isnan(x) || x < 0.0) {
    return kNaN;
  }
  if (x == 0.0) {
    return -kInfinity;
  }
  if (std::isinf(x)) {
    return x;
  }
  int exponent = 0;
  double mantissa = std::frexp(x, &exponent);
  if (mantissa < 0.5 * std::numbers::sqrt2) {
    mantissa *= 2.0;
    --exponent;
  }
  constexpr double kLn2High = 0x1.62e42fee00000p-1;
  constexpr double kLn2Low = 0x1.a39ef35793c76p-33;
  const double f = mantissa - 1.0;
  const double s = f / (2.0 + f);
  const double s2 = s * s;
  double sum = 1.0 / 23.0;
  for (const double odd : {21.0, 19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0}) {
    sum = 1.0 / odd + s2 * sum;
  }
  // log(1 + f) = 2 s + 2 s^3 sum, and 2 s = f - s f keeps the small part apart.
  const double n = static_cast<double>(exponent);
  return n * kLn2High + (f - (s * f - 2.0 * s * s2 * sum - n * kLn2Low));
}

}  // namespace hedgehop::elementary
