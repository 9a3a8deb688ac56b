#pragma once

#include <cstdint>
#include <vector>

#include "geo/map_projection.hpp"
#include "map/map.hpp"

namespace hedgehop::risk {

/// Where ground tracks cross overhead wires, and how far from what holds these up.
///
/// A crossing of a span of length L, at distance d along it from the nearer of its two supports,
/// weighs
///
///     2 min(d, L - d) / L
///
/// nothing over a support, which shows where the wire is, and 1 in the middle. Supports are poles
/// and vertices of a line alike: both hold up the spans beside them. All kinds of lines count.
class WireCrossings {
 public:
  WireCrossings() = default;
  explicit WireCrossings(const std::vector<map::OverheadLine>& lines);

  [[nodiscard]] bool is_empty() const { return spans_.empty(); }

  /// Sum of the weights of all crossings of the straight track from a to b [-]. Tracks that go on
  /// from b count a wire right below it once, and so do two spans a track over their support. The
  /// same in both directions, but for such places.
  ///
  /// @note  Spans are found by squares of half a kilometre; some nanoseconds where there are none.
  [[nodiscard]] double weight(const geo::MapPoint& a, const geo::MapPoint& b) const;

 private:
  struct Span {
    geo::MapPoint from, to;
    std::int32_t west, south;  // first square that its box touches
  };
  struct Range {
    std::int32_t first, last;
  };
  // Squares from one coordinate to another, cut at the index's edges; empty: first > last.
  [[nodiscard]] static Range squares(double a_m, double b_m, double origin_m, std::int32_t count);

  std::vector<Span> spans_;
  double west_m_ = 0.0, south_m_ = 0.0;
  std::int32_t columns_ = 0, rows_ = 0;
  std::vector<std::uint32_t> first_;   // of each square, and one more
  std::vector<std::uint32_t> listed_;  // spans whose box touches a square, square by square
};

}  // namespace hedgehop::risk
