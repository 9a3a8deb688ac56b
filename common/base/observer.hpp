#pragma once

#include <string_view>

#include "base/errors.hpp"

namespace hedgehop {

/// What long work tells its caller, and how the caller stops it. Must be safe to call from any
/// thread.
class Observer {
 public:
  virtual ~Observer() = default;

  /// `done` of `total` units of `stage` are finished; called often and cheaply, from 0 to total.
  virtual void progress(std::string_view stage, double done, double total) = 0;

  /// A remark for the user that is no error.
  virtual void note(std::string_view text) = 0;

  /// True once the user wants the work to end.
  [[nodiscard]] virtual bool stop_requested() const = 0;

  /// Throws Interrupted if the user wants the work to end.
  void check_stop() const {
    if (stop_requested()) {
      throw Interrupted();
    }
  }
};

/// Hears nothing and never stops.
class SilentObserver final : public Observer {
 public:
  void progress(std::string_view, double, double) override {}
  void note(std::string_view) override {}
  [[nodiscard]] bool stop_requested() const override { return false; }
};

}  // namespace hedgehop
