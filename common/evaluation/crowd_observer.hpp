#pragma once

#include "base/observer.hpp"

namespace hedgehop::evaluation {

/// What a planner in a crowd may say: nothing, but it hears when to stop.
class CrowdObserver final : public Observer {
 public:
  explicit CrowdObserver(const Observer& whole) : whole_(&whole) {}
  void progress(std::string_view, double, double) override {}
  void note(std::string_view) override {}
  [[nodiscard]] bool stop_requested() const override { return whole_->stop_requested(); }

 private:
  const Observer* whole_;
};

}  // namespace hedgehop::evaluation
