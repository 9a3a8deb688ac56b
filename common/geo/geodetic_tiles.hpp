#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <unordered_map>

namespace hedgehop::geo {

/// Latitude and longitude over squares of the map frame, as polynomials through what a projection
/// says at some places: for many questions about places near each other.
///
/// Over a square of 2 km the inverse of a map projection is so smooth that in each coordinate a
/// cubic through 4 places,
///
///     angle(x, y) = sum over i, j of c_ij u^i v^j,   i, j = 0 ... 3,
///
/// u and v the place in the square from -1 to 1, misses it by about (1 km / 6378 km)^4 / 192 =
/// 3e-18 rad. Whether it does is tested where the polynomial of the nodes is greatest, in the
/// corners and the middle: a square that is missed by more than kError_rad there, as one over a
/// pole or a seam of the longitude, has no answers.
class GeodeticTiles {
 public:
  static constexpr double kError_rad = 1e-14;  // 0.06 um on the ground

  struct Angles {
    double latitude_rad = 0.0;
    double longitude_rad = 0.0;
  };
  /// The projection itself; nothing where it has no answer.
  using Projection = std::function<std::optional<Angles>(double x_m, double y_m)>;

  /// Nothing where a square has no answers, or for coordinates beyond 1e8 m.
  /// @note  21 questions to the projection for the first place in a square, then 0.03 us.
  std::optional<Angles> at(double x_m, double y_m, const Projection& projection);

 private:
  struct Tile {
    bool is_held = false;  // by its polynomials
    std::array<std::array<Angles, 4>, 4> coefficients{};
  };
  static Angles value(const Tile& tile, double u, double v);
  static Tile made(double middle_x_m, double middle_y_m, const Projection& projection);

  std::unordered_map<std::uint64_t, Tile> tiles_;
};

}  // namespace hedgehop::geo
