#pragma once

#include <optional>
#include <string>

#include "planning/planning.hpp"

namespace hedgehop::services {

/// The newest planning config, read once: questions come with their config, mostly the same.
class ConfigMemory {
 public:
  /// As planning::read_planning_config(); valid until the next call.
  const planning::PlanningConfig& read(const std::string& text, const std::string& name) {
    if (!config_ || text_ != text) {
      config_.reset();
      config_.emplace(planning::read_planning_config(text, name));
      text_ = text;
    }
    return *config_;
  }

 private:
  std::string text_;
  std::optional<planning::PlanningConfig> config_;
};

}  // namespace hedgehop::services
