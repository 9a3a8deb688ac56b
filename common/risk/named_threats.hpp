#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "map/map.hpp"
#include "raster/window.hpp"

namespace hedgehop::risk {

/// How many named observers see a place: the layers of Map::threats, ready for fast queries.
///
/// An observer sees what flies over a cell at least as high above the surface as its layer says
/// there; what is out of its range or unknown it never sees.
class NamedThreats {
 public:
  NamedThreats() = default;
  explicit NamedThreats(const map::Map& map);

  [[nodiscard]] bool is_empty() const { return observers_ == 0; }

  /// @param cell  its number, row by row from the south.
  [[nodiscard]] int count_seeing(std::size_t cell, double height_m) const {
    const float* lowest_m = lowest_seen_m_.data() + cell * observers_;
    std::size_t count = 0;
    while (count < observers_ && height_m >= static_cast<double>(lowest_m[count])) {
      ++count;
    }
    return static_cast<int>(count);
  }

  /// Takes in what the layers have become inside a window; there must be as many as before.
  void update(const map::Map& map, const raster::Window& window);

 private:
  std::size_t observers_ = 0;
  std::vector<float> lowest_seen_m_;  // by cell, then ascending; infinity: never seen
};

}  // namespace hedgehop::risk
