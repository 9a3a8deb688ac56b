#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/observer.hpp"
#include "evaluation/drawn_routes.hpp"
#include "planning/route_flight.hpp"

namespace hedgehop::evaluation {

/// A planning config with `key=value` settings on top. Throws ConfigError.
planning::PlanningConfig config_with(const std::string& text,
                                     const std::vector<std::string>& settings);

/// `key=value`, with up to ten digits.
std::string setting_of(const std::string& key, double value);
/// The number that a planning config has under a dotted key. Throws ConfigError.
double value_of(const planning::PlanningConfig& config, const std::string& key);

/// Flies a route in each way that the config allows; nothing if the flight did not reach the goal.
std::optional<planning::RouteFlight> flown(const risk::CostModel& costs,
                                           const planning::PlanningConfig& config,
                                           const DrawnRoute& route, const Observer& observer);

/// The same on grounds that were made for config.local.
std::optional<planning::RouteFlight> flown(const planning::RouteGrounds& grounds,
                                           const planning::PlanningConfig& config,
                                           const DrawnRoute& route, const Observer& observer);

}  // namespace hedgehop::evaluation
