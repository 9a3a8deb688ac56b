#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/time.hpp"
#include "flight/plan.hpp"
#include "map/map.hpp"

namespace hedgehop::cli {

struct ReportRequest {
  std::filesystem::path plan_folder;  // a plan bundle
  std::filesystem::path map_folder;
  std::vector<std::string> settings;  // of config/report.yaml
  std::string config_file;
  std::optional<Time> start_time;
  std::optional<double> declination_rad;
  std::vector<std::string> compare;  // folders of other plans on the same map
};

/// The report of a plan as one HTML page; see output::report_page().
/// Throws UsageError if one of the plans was made on another map.
std::string report_html(const ReportRequest& request, const flight::Plan& plan,
                        const map::Map& map);

}  // namespace hedgehop::cli
