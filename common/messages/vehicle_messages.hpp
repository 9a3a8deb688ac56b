#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "command_model/command_model.hpp"
#include "messages/message.hpp"

namespace hedgehop::messages {

inline constexpr std::size_t kMaxSectors = 128;

/// Channel VEHICLE_TARGET. In lockstep it holds all that a step depends on, so the answer is the
/// same however often it is asked for.
struct VehicleTarget {
  Hash128 request_id;  // its ROUTE names the config, and so the vehicle
  std::int64_t step_number = 0;
  bool is_lockstep = false;
  double step_s = 0.0;  // in (0, 1]
  command_model::ModelState state;
  command_model::Command command;
};
Bytes to_message(const VehicleTarget& target, const Stamp& stamp);
template <>
VehicleTarget from_message<VehicleTarget>(ByteView bytes, Stamp& stamp);

/// Channel VEHICLE_STATE.
struct VehicleState {
  Hash128 request_id;
  std::int64_t step_number = 0;
  bool is_lockstep = false;
  double flight_time_s = 0.0;
  command_model::ModelState state;
  std::optional<double> heading_true_rad;  // none: convergence not known
  std::optional<double> height_m;          // above the surface; none: no map
  command_model::Command command;
};
Bytes to_message(const VehicleState& state, const Stamp& stamp);
template <>
VehicleState from_message<VehicleState>(ByteView bytes, Stamp& stamp);

/// What keeps a sector from being chosen.
enum class SectorMask : std::uint8_t { kFree = 0, kClimb = 1, kTurn = 2, kUnknown = 3 };

/// Channel LOCAL_HISTOGRAM, for displays. Sector k is centred on 2 pi k / sectors,
/// counter-clockwise from grid east.
struct LocalHistogram {
  struct Sector {
    float climb_angle_rad = 0.0F;  // NaN: no known cell
    float cost = 0.0F;             // NaN: masked
    SectorMask mask = SectorMask::kFree;
  };
  Hash128 request_id;
  std::int64_t step_number = 0;
  double x_m = 0.0;
  double y_m = 0.0;
  double altitude_m = 0.0;
  double heading_math_rad = 0.0;
  std::optional<int> chosen_sector;
  std::vector<Sector> sectors;  // 4 to kMaxSectors
};
Bytes to_message(const LocalHistogram& histogram, const Stamp& stamp);
template <>
LocalHistogram from_message<LocalHistogram>(ByteView bytes, Stamp& stamp);

}  // namespace hedgehop::messages
