#pragma once

#include <array>

#include "flight/trajectory.hpp"

namespace hedgehop::output {

/// A column of trajectory.csv: its name and, unless it follows from others, the member it holds.
struct TrajectoryColumn {
  const char* name;
  double flight::FlightState::*member;
};

inline constexpr std::array<TrajectoryColumn, 23> kTrajectoryColumns = {{
    {"time_s", &flight::FlightState::time_s},
    {"latitude_deg", nullptr},
    {"longitude_deg", nullptr},
    {"altitude_m", &flight::FlightState::altitude_m},
    {"height_above_surface_m", nullptr},
    {"x_m", &flight::FlightState::x_m},
    {"y_m", &flight::FlightState::y_m},
    {"speed_mps", &flight::FlightState::speed_mps},
    {"heading_true_rad", &flight::FlightState::heading_true_rad},
    {"heading_grid_rad", nullptr},
    {"convergence_rad", &flight::FlightState::convergence_rad},
    {"bank_rad", &flight::FlightState::bank_rad},
    {"roll_rate_radps", &flight::FlightState::roll_rate_radps},
    {"pitch_rad", &flight::FlightState::pitch_rad},
    {"pitch_rate_radps", &flight::FlightState::pitch_rate_radps},
    {"climb_rate_mps", &flight::FlightState::climb_rate_mps},
    {"vertical_acceleration_mps2", &flight::FlightState::vertical_acceleration_mps2},
    {"target_heading_true_rad", &flight::FlightState::target_heading_true_rad},
    {"commanded_heading_true_rad", &flight::FlightState::commanded_heading_true_rad},
    {"commanded_climb_angle_rad", &flight::FlightState::commanded_climb_angle_rad},
    {"commanded_speed_mps", &flight::FlightState::commanded_speed_mps},
    {"surface_m", &flight::FlightState::surface_m},
    {"terrain_m", &flight::FlightState::terrain_m},
}};

}  // namespace hedgehop::output
