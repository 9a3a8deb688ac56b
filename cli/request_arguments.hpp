#pragma once

#include <string>
#include <vector>

#include "flight/plan_request.hpp"

namespace CLI {
class App;
}

namespace hedgehop::cli {

/// The options that `plan` and `request` share: what to plan and under which config.
struct RequestArguments {
  std::string start;
  std::string goal;
  std::vector<std::string> via;
  double start_heading_deg = 0.0;
  bool has_start_heading = false;
  double speed_mps = 0.0;
  std::uint64_t seed = 1;
  std::int64_t work = 0;
  std::string config_file;
  std::vector<std::string> settings;

  void add_to(CLI::App& verb);

  /// Throws UsageError for what cannot be meant.
  [[nodiscard]] flight::PlanRequest plan_request() const;
};

/// "LAT,LON" or "LAT,LON,HEIGHT_M" in degrees and metres. `option` is what errors call it.
flight::RequestPoint parse_request_point(const std::string& text, const std::string& option);

}  // namespace hedgehop::cli
