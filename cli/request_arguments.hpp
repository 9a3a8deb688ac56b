#pragma once

#include <optional>
#include <string>
#include <vector>

#include "console.hpp"
#include "flight/plan_request.hpp"
#include "map/map.hpp"
#include "map_sources/mission_file.hpp"
#include "planning/timetable.hpp"

namespace CLI {
class App;
}

namespace hedgehop::cli {

/// The options that `plan` and `request` share: what to plan and under which config.
struct RequestArguments {
  std::string start;
  std::string goal;
  std::vector<std::string> via;
  std::string mission_file;
  bool ignores_heights = false;
  double start_heading_deg = 0.0;
  bool has_start_heading = false;
  double speed_mps = 0.0;
  std::string departure;
  std::string arrival;
  std::uint64_t seed = 1;
  std::int64_t work = 0;
  std::string config_file;
  std::vector<std::string> settings;

  void add_to(CLI::App& verb);

  /// Where to fly, from --mission or from --start, --goal and --via. Throws UsageError for what
  /// cannot be meant, and what read_mission() throws; tells its remarks.
  [[nodiscard]] map_sources::Mission mission(const Console& console) const;

  /// The same as a request. Areas, and heights that are counted from the sea or the ground, need
  /// the map; without one (nullptr) they are refused with a UsageError.
  [[nodiscard]] flight::PlanRequest plan_request(const map_sources::Mission& mission,
                                                 const map::Map* map, Observer& observer) const;

  /// When to be where; nothing if nobody says. Throws UsageError for times that cannot be read, and
  /// where a speed is given beside times that fix it.
  [[nodiscard]] std::optional<planning::TimeDemand> time_demand(
      const map_sources::Mission& mission) const;
};

/// An instant as an option states it. Throws UsageError.
Time parse_time(const std::string& text, const std::string& option);

/// "LAT,LON" or "LAT,LON,HEIGHT_M" in degrees and metres. `option` is what errors call it.
flight::RequestPoint parse_request_point(const std::string& text, const std::string& option);

}  // namespace hedgehop::cli
