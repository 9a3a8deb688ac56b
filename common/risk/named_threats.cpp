#include "risk/named_threats.hpp"

#include <algorithm>
#include <cmath>

#include "base/errors.hpp"

namespace hedgehop::risk {

NamedThreats::NamedThreats(const map::Map& map) : observers_(map.threats.size()) {
  lowest_seen_m_.resize(map.geometry.cell_count() * observers_);
  update(map, {0, 0, map.geometry.columns, map.geometry.rows});
}

void NamedThreats::update(const map::Map& map, const raster::Window& window) {
  HEDGEHOP_ASSERT(map.threats.size() == observers_);
  for (int row = window.row; row < window.row + window.rows; ++row) {
    for (int column = window.column; column < window.column + window.columns; ++column) {
      const std::size_t cell =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(map.geometry.columns) +
          static_cast<std::size_t>(column);
      float* lowest_m = lowest_seen_m_.data() + cell * observers_;
      for (std::size_t i = 0; i < observers_; ++i) {
        const float value = map.threats[i].height_m.at(column, row);
        lowest_m[i] = std::isnan(value) ? std::numeric_limits<float>::infinity() : value;
      }
      std::sort(lowest_m, lowest_m + observers_);
    }
  }
}

}  // namespace hedgehop::risk
