#include "geo/geodetic_tiles.hpp"

#include <cmath>
#include <cstddef>

namespace hedgehop::geo {
namespace {

using Angles = GeodeticTiles::Angles;

constexpr double kHalfSide_m = 1000.0;
constexpr double kFarthest_m = 1e8;
// Zeros of the Chebyshev polynomial of degree 4: of all nodes they miss least.
constexpr double kOuterNode = 0.92387953251128674;
constexpr double kInnerNode = 0.38268343236508977;
constexpr std::array<double, 4> kNodes{kOuterNode, kInnerNode, -kInnerNode, -kOuterNode};

Angles operator+(const Angles& a, const Angles& b) {
  return {a.latitude_rad + b.latitude_rad, a.longitude_rad + b.longitude_rad};
}
Angles operator*(double factor, const Angles& a) {
  return {factor * a.latitude_rad, factor * a.longitude_rad};
}
Angles operator-(const Angles& a, const Angles& b) { return a + -1.0 * b; }

// Of the cubic with these values at kNodes: its even part from the sums over opposite nodes, its
// odd part from their differences.
std::array<Angles, 4> cubic(const std::array<Angles, 4>& values) {
  constexpr double kOuter2 = kOuterNode * kOuterNode;
  constexpr double kInner2 = kInnerNode * kInnerNode;
  const Angles even_outer = 0.5 * (values[0] + values[3]);
  const Angles even_inner = 0.5 * (values[1] + values[2]);
  const Angles odd_outer = (0.5 / kOuterNode) * (values[0] - values[3]);
  const Angles odd_inner = (0.5 / kInnerNode) * (values[1] - values[2]);
  const Angles second = (1.0 / (kOuter2 - kInner2)) * (even_outer - even_inner);
  const Angles third = (1.0 / (kOuter2 - kInner2)) * (odd_outer - odd_inner);
  return {even_inner - kInner2 * second, odd_inner - kInner2 * third, second, third};
}

Angles sum(const std::array<Angles, 4>& c, double u) {
  return c[0] + u * (c[1] + u * (c[2] + u * c[3]));
}

}  // namespace

Angles GeodeticTiles::value(const Tile& tile, double u, double v) {
  return sum({sum(tile.coefficients[0], u), sum(tile.coefficients[1], u),
              sum(tile.coefficients[2], u), sum(tile.coefficients[3], u)},
             v);
}

GeodeticTiles::Tile GeodeticTiles::made(double middle_x_m, double middle_y_m,
                                        const Projection& projection) {
  Tile tile;
  std::array<std::array<Angles, 4>, 4> along_u;  // cubics of the rows of nodes
  for (std::size_t row = 0; row < kNodes.size(); ++row) {
    std::array<Angles, 4> values;
    for (std::size_t column = 0; column < kNodes.size(); ++column) {
      const auto angles = projection(middle_x_m + kHalfSide_m * kNodes[column],
                                     middle_y_m + kHalfSide_m * kNodes[row]);
      if (!angles) {
        return tile;
      }
      values[column] = *angles;
    }
    along_u[row] = cubic(values);
  }
  for (std::size_t i = 0; i < kNodes.size(); ++i) {
    const std::array<Angles, 4> along_v =
        cubic({along_u[0][i], along_u[1][i], along_u[2][i], along_u[3][i]});
    for (std::size_t j = 0; j < along_v.size(); ++j) {
      tile.coefficients[j][i] = along_v[j];
    }
  }
  struct Place {
    double u, v;
  };
  for (const Place& place : {Place{0.0, 0.0}, {-1.0, -1.0}, {1.0, -1.0}, {-1.0, 1.0}, {1.0, 1.0}}) {
    const auto angles =
        projection(middle_x_m + kHalfSide_m * place.u, middle_y_m + kHalfSide_m * place.v);
    if (!angles) {
      return tile;
    }
    const Angles missed = value(tile, place.u, place.v) - *angles;
    if (!(std::fabs(missed.latitude_rad) <= kError_rad &&
          std::fabs(missed.longitude_rad) <= kError_rad)) {
      return tile;
    }
  }
  tile.is_held = true;
  return tile;
}

std::optional<Angles> GeodeticTiles::at(double x_m, double y_m, const Projection& projection) {
  if (!(std::fabs(x_m) <= kFarthest_m && std::fabs(y_m) <= kFarthest_m)) {
    return std::nullopt;
  }
  const double column = std::floor(x_m / (2.0 * kHalfSide_m));
  const double row = std::floor(y_m / (2.0 * kHalfSide_m));
  const double middle_x_m = (column + 0.5) * (2.0 * kHalfSide_m);
  const double middle_y_m = (row + 0.5) * (2.0 * kHalfSide_m);
  const auto key = static_cast<std::uint64_t>(static_cast<std::uint32_t>(static_cast<int>(row)))
                       << 32U |
                   static_cast<std::uint32_t>(static_cast<int>(column));
  auto found = tiles_.find(key);
  if (found == tiles_.end()) {
    found = tiles_.emplace(key, made(middle_x_m, middle_y_m, projection)).first;
  }
  if (!found->second.is_held) {
    return std::nullopt;
  }
  return value(found->second, (x_m - middle_x_m) / kHalfSide_m, (y_m - middle_y_m) / kHalfSide_m);
}

}  // namespace hedgehop::geo
