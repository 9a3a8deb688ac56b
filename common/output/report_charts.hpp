#pragma once

#include <string>
#include <vector>

#include "flight/plan.hpp"
#include "output/plan_view.hpp"
#include "output/report_page.hpp"

namespace hedgehop::output {

/// What plots and the script show of a flight: states so thinned that a page stays small. All lists
/// have the same length; unknown is NaN.
struct ReportSamples {
  std::vector<std::size_t> states;
  std::vector<double> along_m, time_s, altitude_m, terrain_m, surface_m, height_m, speed_mps,
      climb_mps, bank_deg, heading_deg, target_deg, grid_deg, cost;
};
ReportSamples report_samples(const ReportContent& content);

/// Plots of altitude, height, bank and heading, and of the cost, over the distance flown.
std::string profile_charts(const ReportContent& content, const ReportSamples& samples);
std::string cost_chart(const ReportContent& content);

}  // namespace hedgehop::output
