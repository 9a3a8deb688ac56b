#include "messages/vehicle_messages.hpp"

#include <numbers>

#include "messages/wire.hpp"

#include "hedgehop/local_histogram_t.hpp"
#include "hedgehop/vehicle_state_t.hpp"
#include "hedgehop/vehicle_target_t.hpp"

namespace hedgehop::messages {
namespace {

static_assert(kMaxSectors == local_histogram_t::MAX_SECTORS);

void put(model_state_t& field, const command_model::ModelState& state) {
  field.x_m = state.x_m;
  field.y_m = state.y_m;
  field.altitude_m = state.altitude_m;
  field.speed_mps = state.speed_mps;
  field.heading_math_rad = state.heading_math_rad;
  field.bank_left_rad = state.bank_left_rad;
  field.roll_rate_left_radps = state.roll_rate_left_radps;
  field.pitch_rad = state.pitch_rad;
  field.pitch_rate_radps = state.pitch_rate_radps;
  field.climb_rate_mps = state.climb_rate_mps;
  field.vertical_acceleration_mps2 = state.vertical_acceleration_mps2;
  field.climb_integral_mps = state.climb_integral_mps;
}

command_model::ModelState state_in(const wire::Check& check, const model_state_t& field) {
  command_model::ModelState state;
  state.x_m = check.finite("state.x_m", field.x_m);
  state.y_m = check.finite("state.y_m", field.y_m);
  state.altitude_m = check.finite("state.altitude_m", field.altitude_m);
  state.speed_mps = check.finite("state.speed_mps", field.speed_mps);
  state.heading_math_rad = check.finite("state.heading_math_rad", field.heading_math_rad);
  state.bank_left_rad = check.finite("state.bank_left_rad", field.bank_left_rad);
  state.roll_rate_left_radps =
      check.finite("state.roll_rate_left_radps", field.roll_rate_left_radps);
  state.pitch_rad = check.finite("state.pitch_rad", field.pitch_rad);
  state.pitch_rate_radps = check.finite("state.pitch_rate_radps", field.pitch_rate_radps);
  state.climb_rate_mps = check.finite("state.climb_rate_mps", field.climb_rate_mps);
  state.vertical_acceleration_mps2 =
      check.finite("state.vertical_acceleration_mps2", field.vertical_acceleration_mps2);
  state.climb_integral_mps = check.finite("state.climb_integral_mps", field.climb_integral_mps);
  return state;
}

template <typename T>
void put_command(T& message, const command_model::Command& command) {
  message.commanded_speed_mps = command.speed_mps;
  message.commanded_heading_math_rad = command.heading_math_rad;
  message.commanded_climb_rate_mps = command.climb_rate_mps;
}

template <typename T>
command_model::Command command_in(const wire::Check& check, const T& message) {
  command_model::Command command;
  command.speed_mps = check.not_negative("commanded_speed_mps", message.commanded_speed_mps);
  command.heading_math_rad =
      check.finite("commanded_heading_math_rad", message.commanded_heading_math_rad);
  command.climb_rate_mps =
      check.finite("commanded_climb_rate_mps", message.commanded_climb_rate_mps);
  return command;
}

}  // namespace

Bytes to_message(const VehicleTarget& target, const Stamp& stamp) {
  vehicle_target_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.request_id, target.request_id);
  message.step_number = target.step_number;
  message.is_lockstep = target.is_lockstep ? 1 : 0;
  message.step_s = target.step_s;
  put(message.state, target.state);
  put_command(message, target.command);
  return wire::published<VehicleTarget>(message);
}

template <>
VehicleTarget from_message<VehicleTarget>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<vehicle_target_t>(bytes, stamp);
  const wire::Check check(vehicle_target_t::getTypeName());
  VehicleTarget target;
  target.request_id = wire::hash_in(message.request_id);
  target.step_number = check.count("step_number", message.step_number);
  target.is_lockstep = check.boolean("is_lockstep", message.is_lockstep);
  target.step_s = check.positive("step_s", message.step_s);
  check.within("step_s", message.step_s, 0.0, 1.0);
  target.state = state_in(check, message.state);
  target.command = command_in(check, message);
  return target;
}

Bytes to_message(const VehicleState& state, const Stamp& stamp) {
  vehicle_state_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.request_id, state.request_id);
  message.step_number = state.step_number;
  message.is_lockstep = state.is_lockstep ? 1 : 0;
  message.flight_time_s = state.flight_time_s;
  put(message.state, state.state);
  message.heading_true_rad = wire::value_or_nan(state.heading_true_rad);
  message.height_m = wire::value_or_nan(state.height_m);
  put_command(message, state.command);
  return wire::published<VehicleState>(message);
}

template <>
VehicleState from_message<VehicleState>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<vehicle_state_t>(bytes, stamp);
  const wire::Check check(vehicle_state_t::getTypeName());
  VehicleState state;
  state.request_id = wire::hash_in(message.request_id);
  state.step_number = check.count("step_number", message.step_number);
  state.is_lockstep = check.boolean("is_lockstep", message.is_lockstep);
  state.flight_time_s = check.not_negative("flight_time_s", message.flight_time_s);
  state.state = state_in(check, message.state);
  state.heading_true_rad = check.optional(message.heading_true_rad, [&](double value) {
    return check.within("heading_true_rad", value, 0.0, 2.0 * std::numbers::pi);
  });
  state.height_m = check.optional(message.height_m,
                                  [&](double value) { return check.finite("height_m", value); });
  state.command = command_in(check, message);
  return state;
}

Bytes to_message(const LocalHistogram& histogram, const Stamp& stamp) {
  local_histogram_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.request_id, histogram.request_id);
  message.step_number = histogram.step_number;
  message.x_m = histogram.x_m;
  message.y_m = histogram.y_m;
  message.altitude_m = histogram.altitude_m;
  message.heading_math_rad = histogram.heading_math_rad;
  message.chosen_sector = histogram.chosen_sector.value_or(-1);
  message.num_sectors = static_cast<std::int32_t>(histogram.sectors.size());
  for (const LocalHistogram::Sector& sector : histogram.sectors) {
    message.climb_angle_rad.push_back(sector.climb_angle_rad);
    message.sector_cost.push_back(sector.cost);
    message.mask.push_back(static_cast<std::uint8_t>(sector.mask));
  }
  return wire::published<LocalHistogram>(message);
}

template <>
LocalHistogram from_message<LocalHistogram>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<local_histogram_t>(bytes, stamp);
  const wire::Check check(local_histogram_t::getTypeName());
  LocalHistogram histogram;
  histogram.request_id = wire::hash_in(message.request_id);
  histogram.step_number = check.count("step_number", message.step_number);
  histogram.x_m = check.finite("x_m", message.x_m);
  histogram.y_m = check.finite("y_m", message.y_m);
  histogram.altitude_m = check.finite("altitude_m", message.altitude_m);
  histogram.heading_math_rad = check.finite("heading_math_rad", message.heading_math_rad);
  check.within<std::int32_t>("num_sectors", message.num_sectors, 4, local_histogram_t::MAX_SECTORS);
  if (check.within("chosen_sector", message.chosen_sector, -1, message.num_sectors - 1) >= 0) {
    histogram.chosen_sector = message.chosen_sector;
  }
  for (std::size_t k = 0; k < message.mask.size(); ++k) {
    LocalHistogram::Sector sector;
    sector.climb_angle_rad = message.climb_angle_rad[k];
    check.finite_or_nan("climb_angle_rad", sector.climb_angle_rad);
    sector.cost = message.sector_cost[k];
    check.finite_or_nan("sector_cost", sector.cost);
    sector.mask = static_cast<SectorMask>(check.within<std::uint8_t>(
        "mask", message.mask[k], local_histogram_t::MASK_FREE, local_histogram_t::MASK_UNKNOWN));
    histogram.sectors.push_back(sector);
  }
  return histogram;
}

}  // namespace hedgehop::messages
