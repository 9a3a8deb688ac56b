#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/time.hpp"
#include "briefing/cost_profile.hpp"
#include "briefing/exposure.hpp"
#include "briefing/flight_legs.hpp"
#include "briefing/manoeuvres.hpp"
#include "flight/plan.hpp"
#include "map/map.hpp"
#include "map/map_bundle.hpp"
#include "output/route_choices.hpp"
#include "verification/plan_check.hpp"

namespace hedgehop::output {

/// Another plan on the same map, to compare with.
struct ReportAlternative {
  std::string name;
  const flight::Plan* plan = nullptr;
  flight::RouteCost flown;  // CostProfile::total() under the config of the reported plan
};

/// A route that was planned together with the reported one, to choose from.
struct ReportChoice {
  ListedRoute route;
  const flight::Plan* flown = nullptr;  // null: not flown, or no flight along it arrives
};

/// Everything that a report tells; what is pointed to must outlive the call.
struct ReportContent {
  const flight::Plan* plan = nullptr;
  const map::Map* map = nullptr;
  std::string map_manifest_json;  // read_map_manifest()
  verification::PlanCheck check;  // of the plan as it stands in its files
  std::vector<briefing::FlightLeg> legs;
  std::vector<briefing::Manoeuvre> manoeuvres;
  briefing::CostProfile costs;
  double beside_m = 0.0;       // CostOptions::beside_m
  flight::RouteCost straight;  // of the straight line over start, via points and goal
  double straight_height_m = 0.0;
  std::vector<map::HeightLayer> threats;      // of the map; empty if it has none
  std::vector<briefing::Exposure> exposures;  // one for each of them
  std::optional<Time> start_time;
  std::optional<double> declination_rad;  // positive where magnetic north lies east of true north
  std::vector<ReportAlternative> alternatives;
  std::vector<ReportChoice> choices;  // the reported plan's own route first; empty without any
  std::string why_no_more_choices;
};

/// The report as one HTML page that needs nothing else: pictures, styles and script are part of it,
/// and a content security policy forbids it to load anything. Figures and tables can be read
/// without the script, which adds a cursor common to all plots and the map, and zooming.
///
/// Text from files is escaped wherever it stands. Same content, same bytes.
///
/// @throws DataError  the plan has fewer than two states or waypoints, or lies outside the map.
/// @note  About 1 s: five pictures of the map are packed as PNG.
std::string report_page(const ReportContent& content);

/// Text inside HTML, also inside quoted attributes: no markup, no control characters, valid UTF-8.
std::string html_escaped(std::string_view text);

}  // namespace hedgehop::output
