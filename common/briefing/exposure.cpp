#include "briefing/exposure.hpp"

#include "briefing/flight_legs.hpp"

namespace hedgehop::briefing {

std::vector<Exposure> exposures(const std::vector<map::HeightLayer>& lowest_seen,
                                const flight::Trajectory& trajectory) {
  const auto& states = trajectory.states;
  const std::vector<double> along_m = distances_m(trajectory);
  std::vector<Exposure> list;
  for (const map::HeightLayer& layer : lowest_seen) {
    Exposure exposure;
    exposure.name = layer.name;
    bool was_seen = false;
    for (std::size_t i = 0; i + 1 < states.size(); ++i) {
      const flight::FlightState& state = states[i];
      const raster::GridGeometry& geometry = layer.height_m.geometry();
      const bool is_seen =
          geometry.contains(state.point()) &&
          state.altitude_m - state.surface_m >=
              static_cast<double>(layer.height_m.at(geometry.cell_at(state.point())));
      if (is_seen) {
        if (!was_seen) {
          exposure.stretches.push_back({state.time_s, state.time_s, along_m[i], along_m[i]});
        }
        exposure.stretches.back().to_s = states[i + 1].time_s;
        exposure.stretches.back().to_m = along_m[i + 1];
      }
      was_seen = is_seen;
    }
    for (const Exposure::Stretch& stretch : exposure.stretches) {
      exposure.seen_s += stretch.to_s - stretch.from_s;
      exposure.seen_m += stretch.to_m - stretch.from_m;
    }
    if (!along_m.empty() && along_m.back() > 0.0) {
      exposure.share = exposure.seen_m / along_m.back();
    }
    list.push_back(std::move(exposure));
  }
  return list;
}

}  // namespace hedgehop::briefing
