#include "risk/wire_crossings.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hedgehop::risk {
namespace {

constexpr double kSquare_m = 500.0;

// Twice the area of the triangle a, b, c; positive where c lies to the left of the way from a to b.
double area_m2(const geo::MapPoint& a, const geo::MapPoint& b, const geo::MapPoint& c) {
  return (b.x_m - a.x_m) * (c.y_m - a.y_m) - (b.y_m - a.y_m) * (c.x_m - a.x_m);
}

}  // namespace

WireCrossings::Range WireCrossings::squares(double a_m, double b_m, double origin_m,
                                            std::int32_t count) {
  const double low = std::floor((std::min(a_m, b_m) - origin_m) / kSquare_m);
  const double high = std::floor((std::max(a_m, b_m) - origin_m) / kSquare_m);
  const auto cut = [count](double square) {
    return static_cast<std::int32_t>(std::clamp(square, -1.0, static_cast<double>(count)));
  };
  return {std::max(cut(low), 0), std::min(cut(high), count - 1)};
}

WireCrossings::WireCrossings(const std::vector<map::OverheadLine>& lines) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double east_m = -kInfinity;
  double north_m = -kInfinity;
  west_m_ = south_m_ = kInfinity;
  for (const map::OverheadLine& line : lines) {
    for (std::size_t i = 0; i < line.supports.size(); ++i) {
      const geo::MapPoint& here = line.supports[i].point;
      west_m_ = std::min(west_m_, here.x_m);
      east_m = std::max(east_m, here.x_m);
      south_m_ = std::min(south_m_, here.y_m);
      north_m = std::max(north_m, here.y_m);
      if (i > 0) {
        spans_.push_back({line.supports[i - 1].point, here, 0, 0});
      }
    }
  }
  if (spans_.empty()) {
    return;
  }
  columns_ = static_cast<std::int32_t>((east_m - west_m_) / kSquare_m) + 1;
  rows_ = static_cast<std::int32_t>((north_m - south_m_) / kSquare_m) + 1;
  const auto for_each_square = [this](const Span& span, const auto& visit) {
    const Range columns = squares(span.from.x_m, span.to.x_m, west_m_, columns_);
    const Range rows = squares(span.from.y_m, span.to.y_m, south_m_, rows_);
    for (std::int32_t row = rows.first; row <= rows.last; ++row) {
      for (std::int32_t column = columns.first; column <= columns.last; ++column) {
        visit(static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
              static_cast<std::size_t>(column));
      }
    }
  };
  first_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0);
  for (Span& span : spans_) {
    span.west = squares(span.from.x_m, span.to.x_m, west_m_, columns_).first;
    span.south = squares(span.from.y_m, span.to.y_m, south_m_, rows_).first;
    for_each_square(span, [this](std::size_t square) { ++first_[square + 1]; });
  }
  for (std::size_t square = 1; square < first_.size(); ++square) {
    first_[square] += first_[square - 1];
  }
  listed_.resize(first_.back());
  std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
  for (std::size_t i = 0; i < spans_.size(); ++i) {
    for_each_square(spans_[i], [&](std::size_t square) {
      listed_[next[square]++] = static_cast<std::uint32_t>(i);
    });
  }
}

double WireCrossings::weight(const geo::MapPoint& a, const geo::MapPoint& b) const {
  const Range columns = squares(a.x_m, b.x_m, west_m_, columns_);
  const Range rows = squares(a.y_m, b.y_m, south_m_, rows_);
  double sum = 0.0;
  for (std::int32_t row = rows.first; row <= rows.last; ++row) {
    for (std::int32_t column = columns.first; column <= columns.last; ++column) {
      const std::size_t square =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
          static_cast<std::size_t>(column);
      for (std::uint32_t k = first_[square]; k < first_[square + 1]; ++k) {
        const Span& span = spans_[listed_[k]];
        // Each span once: in the first square that both boxes touch.
        if (column != std::max(columns.first, span.west) ||
            row != std::max(rows.first, span.south)) {
          continue;
        }
        if ((area_m2(span.from, span.to, a) >= 0.0) == (area_m2(span.from, span.to, b) >= 0.0)) {
          continue;
        }
        const double from_m2 = area_m2(a, b, span.from);
        const double to_m2 = area_m2(a, b, span.to);
        if ((from_m2 >= 0.0) == (to_m2 >= 0.0)) {
          continue;
        }
        const double share = from_m2 / (from_m2 - to_m2);
        sum += 2.0 * std::min(share, 1.0 - share);
      }
    }
  }
  return sum;
}

}  // namespace hedgehop::risk
