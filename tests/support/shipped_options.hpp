#pragma once

#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/shipped_config.hpp"
#include "planning/planning.hpp"

namespace hedgehop::test {

/// The shipped planning config with `key=value` settings on top.
inline planning::PlanningConfig shipped_planning(const std::vector<std::string>& settings = {}) {
  return planning::read_planning_config(planning::effective_planning_config("", settings),
                                        "shipped");
}

/// A section of the shipped evaluation config, read by its own function.
template <typename Read>
auto shipped_evaluation(const char* key, const Read& read) {
  ConfigReader all = ConfigReader::from_text(shipped_config("evaluation.yaml"), "evaluation.yaml");
  ConfigReader section = all.required_section(key);
  return read(section);
}

}  // namespace hedgehop::test
