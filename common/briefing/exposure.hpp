#pragma once

#include <string>
#include <vector>

#include "flight/trajectory.hpp"
#include "map/map_bundle.hpp"

namespace hedgehop::briefing {

/// How long a flight is in the sight of one named observer.
struct Exposure {
  struct Stretch {
    double from_s = 0.0;  // since the start of the flight
    double to_s = 0.0;
    double from_m = 0.0;  // distance flown
    double to_m = 0.0;
  };
  std::string name;
  double seen_s = 0.0;
  double seen_m = 0.0;
  double share = 0.0;              // of the distance flown, in [0, 1]
  std::vector<Stretch> stretches;  // in their order
};

/// One for each layer of lowest seen heights [m above the surface; NaN: out of the observer's range
/// or unknown], in their order.
///
/// A state is seen if it flies at least as high as the layer's value in the cell below; a step is
/// seen if the state that begins it is. O(states x layers).
std::vector<Exposure> exposures(const std::vector<map::HeightLayer>& lowest_seen,
                                const flight::Trajectory& trajectory);

}  // namespace hedgehop::briefing
