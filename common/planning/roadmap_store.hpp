#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "base/hash.hpp"
#include "base/observer.hpp"
#include "global_planning/roadmap.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

/// Roadmaps of maps: in a file beside the bundle, or in memory alone.
namespace hedgehop::planning {

/// What a roadmap depends on: the map's hash, and of the config all but what certainly does not
/// shape it (how it is searched and refined afterwards, flying, verification, speed).
Hash128 roadmap_key(const map::Map& map, const PlanningConfig& config);

/// "map" and "map/" -> "map.roadmap".
std::filesystem::path roadmap_file(const std::filesystem::path& bundle);

/// A roadmap that fits a map and a config.
struct ReadyRoadmap {
  std::shared_ptr<const global_planning::Roadmap> roadmap;
  Hash128 key;
  bool is_built = false;    // else read from the file
  bool is_written = false;  // to the file
  std::string why_built;    // why the file did not do; why it could not be written
};

/// Reads the file, or builds the roadmap and writes the file, under a temporary name first. A file
/// that does not fit, is damaged or cannot be read is replaced. A folder that cannot be written is
/// no failure: the roadmap is then built each time.
/// @param file  empty: it is built, nothing is read or written.
ReadyRoadmap ready_roadmap(const map::Map& map, const PlanningConfig& config,
                           const std::filesystem::path& file, Observer& observer);

/// planning::plan_route() for many queries: with `global.planner: roadmap` it keeps the roadmap of
/// the last map and config in memory. The routes are the same.
class RoadmapKeeper {
 public:
  std::variant<flight::RoutePlan, flight::NoPlan> operator()(
      const map::Map& map, const flight::PlanRequest& request, const PlanningConfig& config,
      const global_planning::OnProgress& on_progress, Observer& observer);

 private:
  KeptRoadmap kept_;
};

}  // namespace hedgehop::planning
