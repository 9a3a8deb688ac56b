#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>

#include "evaluation/framework_comparison.hpp"

namespace hedgehop::evaluation {

/// All that an answer depends on besides the number of its problem.
nlohmann::ordered_json framework_identity(const map::Map& map,
                                          const planning::PlanningConfig& config,
                                          const FrameworkOptions& options, std::uint64_t seed);

nlohmann::ordered_json framework_problem_json(const FrameworkProblem& problem);

/// Nothing if it is damaged.
std::optional<FrameworkProblem> framework_problem_of(const nlohmann::ordered_json& json,
                                                     std::int64_t number);

}  // namespace hedgehop::evaluation
