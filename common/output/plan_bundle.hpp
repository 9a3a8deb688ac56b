#pragma once

#include <filesystem>
#include <string>

#include "flight/plan.hpp"
#include "flight/vehicle.hpp"

namespace hedgehop::output {

inline constexpr int kPlanSchemaVersion = 1;
inline constexpr char kPlanFile[] = "plan.json";

/// Writes plan.json, route.geojson and trajectory.csv into an existing, empty folder. Same plan,
/// same bytes. Throws SystemFailure.
void write_plan_bundle(const flight::Plan& plan, const std::filesystem::path& folder);

/// Reads a bundle back. Throws DataError naming file, line and field.
flight::Plan read_plan_bundle(const std::filesystem::path& folder);

/// The three files' texts.
std::string plan_json(const flight::Plan& plan);
std::string route_geojson(const flight::Plan& plan);
std::string trajectory_csv(const flight::Plan& plan);

}  // namespace hedgehop::output
