#pragma once

/// Elementary functions whose bits do not depend on the processor or the C library.
///
/// glibc picks fused or unfused variants of its transcendental functions at run time, which differ
/// in the last bit. Everything that decides something (a path, a turn, a cost) uses these instead:
/// plain IEEE-754 double arithmetic without fused operations. sqrt, floor and fabs of C++ are
/// exact and may be used as they are. Accuracy: within 4 ulp of the true value, held by test
/// against libm.
namespace hedgehop::elementary {

/// Sine and cosine of x [rad]. |x| <= 1e6; NaN outside and for NaN.
double sin(double x_rad);
double cos(double x_rad);
/// Both at once: the bits of sin() and cos().
struct SineCosine {
  double sine;
  double cosine;
};
SineCosine sine_cosine(double x_rad);
/// tan(x) = sin(x) / cos(x), |x| <= 1e6.
double tan(double x_rad);
/// Result in [-pi/2, pi/2].
double atan(double x);
/// Angle of (x, y), counter-clockwise from +x, in [-pi, pi]; atan2(0, 0) = 0.
double atan2(double y, double x);
/// |x| <= 1, else NaN. Result in [-pi/2, pi/2].
double asin(double x);
/// Underflows to 0 below -745, infinity above 709.78.
double exp(double x);
/// Natural logarithm; x <= 0 gives NaN (0 gives -infinity).
double log(double x);

}  // namespace hedgehop::elementary
