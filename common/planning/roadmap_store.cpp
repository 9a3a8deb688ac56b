#include "planning/roadmap_store.hpp"

#include <algorithm>
#include <array>
#include <string_view>
#include <system_error>

#include "base/config_entries.hpp"
#include "base/files.hpp"

namespace hedgehop::planning {
namespace {

// Of what is not in this list, a roadmap is taken to depend.
constexpr std::array<std::string_view, 18> kWithoutInfluence = {
    "local.",
    "verification.",
    "speed_mps",
    "global.batch_size",
    "global.check_step_m",
    "global.end_funnel_m",
    "global.field_block_m",
    "global.final_check_step_m",
    "global.guide_spacing_m",
    "global.heuristic",
    "global.planner",
    "global.radius_factor",
    "global.radius_max_m",
    "global.refine",
    "global.sampler",
    "global.turn_angle_max_deg",
    "global.turn_rule",
    "global.work_budget",
};

constexpr char kFormat[] = "hedgehop roadmap 1\n";

}  // namespace

Hash128 roadmap_key(const map::Map& map, const PlanningConfig& config) {
  std::string text = kFormat + map.hash.hex() + "\n";
  for (const ConfigEntry& entry : config_entries(config.text, "configuration")) {
    const bool has_influence =
        std::none_of(kWithoutInfluence.begin(), kWithoutInfluence.end(), [&](std::string_view key) {
          return key.ends_with('.') ? entry.key.starts_with(key) : entry.key == key;
        });
    if (has_influence) {
      text += entry.key + "=" + entry.value + "\n";
    }
  }
  return hash128(text);
}

std::filesystem::path roadmap_file(const std::filesystem::path& bundle) {
  std::filesystem::path folder = bundle.lexically_normal();
  if (!folder.has_filename()) {
    folder = folder.parent_path();  // "map/"
  }
  if (folder == "." || folder == ".." || folder.filename() == "..") {
    folder = std::filesystem::absolute(bundle).lexically_normal();
    if (!folder.has_filename()) {
      folder = folder.parent_path();
    }
  }
  folder += ".roadmap";
  return folder;
}

ReadyRoadmap ready_roadmap(const map::Map& map, const PlanningConfig& config,
                           const std::filesystem::path& file, Observer& observer) {
  ReadyRoadmap ready;
  ready.key = roadmap_key(map, config);
  if (!file.empty()) {
    std::error_code error;
    if (std::filesystem::exists(file, error)) {
      try {
        const std::string bytes = read_file(file);
        auto read = global_planning::Roadmap::read(bytes_of(bytes), ready.key, map.geometry,
                                                   ready.why_built);
        if (read) {
          ready.roadmap = std::make_shared<const global_planning::Roadmap>(std::move(*read));
          return ready;
        }
        ready.why_built = file.string() + " is not used: " + ready.why_built;
      } catch (const DataError& unreadable) {
        ready.why_built = unreadable.what();
      }
    } else {
      ready.why_built = "there is no " + file.string() + " yet";
    }
  }
  const risk::CostModel costs = cost_model(map, config);
  ready.roadmap = std::make_shared<const global_planning::Roadmap>(costs, config.global, observer);
  ready.is_built = true;
  if (!file.empty()) {
    try {
      write_file_atomically(file, ready.roadmap->written(ready.key));
      ready.is_written = true;
    } catch (const SystemFailure& failure) {
      ready.why_built += std::string("; it could not be kept: ") + failure.what();
    }
  }
  return ready;
}

std::variant<flight::RoutePlan, flight::NoPlan> RoadmapKeeper::operator()(
    const map::Map& map, const flight::PlanRequest& request, const PlanningConfig& config,
    const global_planning::OnProgress& on_progress, Observer& observer) {
  if (!config.global.use_roadmap) {
    return plan_route(map, request, config, on_progress, observer);
  }
  PlanningConfig with = config;
  with.roadmap = kept_;
  if (!kept_.roadmap || kept_.key != roadmap_key(map, config)) {
    const ReadyRoadmap ready = ready_roadmap(map, config, {}, observer);
    kept_ = with.roadmap = {ready.roadmap, ready.key};
  }
  return plan_route(map, request, with, on_progress, observer);
}

}  // namespace hedgehop::planning
