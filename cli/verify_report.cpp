#include "verify_report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/angles.hpp"
#include "geo/map_projection.hpp"

namespace hedgehop::cli {
namespace {

using Json = nlohmann::ordered_json;
using verification::NearMiss;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kLinesMax = 20;

// A place of the flight with everything by which people find it.
struct Place {
  double time_s = kNan;
  geo::MapPoint point{kNan, kNan};
  geo::GeodeticPosition position{kNan, kNan};
  double altitude_m = kNan;
  double height_m = kNan;  // above the surface

  [[nodiscard]] Json json() const {
    return {{"time_s", time_s},
            {"latitude_deg", degrees_from_radians(position.latitude_rad)},
            {"longitude_deg", degrees_from_radians(position.longitude_rad)},
            {"x_m", point.x_m},
            {"y_m", point.y_m},
            {"altitude_m", altitude_m},
            {"height_m", height_m}};
  }
  [[nodiscard]] std::string text() const {
    if (std::isnan(time_s) && std::isnan(point.x_m)) {
      return "";
    }
    char time[40] = "at ";
    if (!std::isnan(time_s)) {
      std::snprintf(time, sizeof time, "at %.2f s, ", time_s);
    }
    char buffer[200];
    std::snprintf(buffer, sizeof buffer, "%s%.6f,%.6f, altitude %.1f m, height %.1f m", time,
                  degrees_from_radians(position.latitude_rad),
                  degrees_from_radians(position.longitude_rad), altitude_m, height_m);
    return buffer;
  }
};

class Places {
 public:
  Places(const map::Map& map, const flight::Trajectory& trajectory)
      : map_(map), trajectory_(trajectory) {
    if (!map.crs_wkt.empty()) {
      projection_.emplace(map.crs_wkt);
    }
  }

  [[nodiscard]] Place at(double time_s, const geo::MapPoint& point) const {
    return at(time_s, point, altitude_at(time_s));
  }
  [[nodiscard]] Place at(double time_s, const geo::MapPoint& point, double altitude_m) const {
    Place place;
    place.time_s = time_s;
    place.point = point;
    place.altitude_m = altitude_m;
    // Falsified places may lie anywhere, also where the projection cannot follow.
    if (map_.geometry.contains(point)) {
      place.height_m = altitude_m - raster::sample_bilinear(map_.surface_m, point);
      if (projection_) {
        place.position = projection_->to_geodetic(point);
      }
    }
    return place;
  }

 private:
  [[nodiscard]] double altitude_at(double time_s) const {
    const auto& states = trajectory_.states;
    for (std::size_t i = 1; i < states.size(); ++i) {
      if (states[i - 1].time_s <= time_s && time_s <= states[i].time_s) {
        const double t =
            (time_s - states[i - 1].time_s) / (states[i].time_s - states[i - 1].time_s);
        return states[i - 1].altitude_m + t * (states[i].altitude_m - states[i - 1].altitude_m);
      }
    }
    return kNan;
  }

  const map::Map& map_;
  const flight::Trajectory& trajectory_;
  std::optional<geo::MapProjection> projection_;
};

Json json_of(const NearMiss& miss, const Places& places) {
  Json json = {{"hazard", verification::name_of(miss.hazard)},
               {"name", miss.name},
               {"distance_m", miss.distance_m},
               {"required_m", miss.required_m},
               {"spare_m", miss.spare_m()}};
  json.update(places.at(miss.time_s, miss.place, miss.altitude_m).json());
  return json;
}

Json json_of(const verification::Margins& margins, const Places& places) {
  Json json;
  json["clearance_m"] = {{"min", margins.clearance_min_m},
                         {"p01", margins.clearance_p01_m},
                         {"p05", margins.clearance_p05_m},
                         {"median", margins.clearance_median_m},
                         {"unknown_share", margins.unknown_share}};
  json["height_max_m"] = margins.height_max_m;
  json["ceiling_margin_m"] = margins.ceiling_margin_m;
  json["load_factor_max"] = margins.load_factor_max;
  json["load_factor_limit"] = margins.load_factor_limit;
  json["nearest"] = Json::array();
  for (const NearMiss& miss : margins.nearest) {
    json["nearest"].push_back(json_of(miss, places));
  }
  const NearMiss* nearest = margins.nearest_miss();
  json["nearest_miss"] = nearest == nullptr ? Json() : json_of(*nearest, places);
  json["via"] = Json::array();
  for (const verification::ViaPass& via : margins.via) {
    json["via"].push_back({{"distance_m", via.distance_m}, {"time_s", via.time_s}});
  }
  return json;
}

Json json_of(const evaluation::ClearanceRisk& risk, const Places& places) {
  return {{"dem_error_m", risk.errors.dem_m},
          {"navigation_error_m", risk.errors.navigation_m},
          {"seed", risk.seed},
          {"clearance_m", risk.clearance_m},
          {"draws", risk.draws},
          {"nodes", risk.nodes},
          {"violations", risk.violations},
          {"probability", risk.probability},
          {"probability_low", risk.low},
          {"probability_high", risk.high},
          {"confidence", risk.confidence},
          {"least_clearance_m",
           {{"p01", risk.clearance_p01_m},
            {"p05", risk.clearance_p05_m},
            {"median", risk.clearance_median_m}}},
          {"worst", places.at(risk.worst_time_s, risk.worst_place).json()}};
}

void print_text(const evaluation::ClearanceRisk& risk, const Places& places) {
  std::printf("errors        surface %.1f m, position %.1f m (standard deviations), %lld draws\n",
              risk.errors.dem_m, risk.errors.navigation_m, static_cast<long long>(risk.draws));
  std::printf(
      "risk          clearance below %.1f m with probability %.4f (%.4f to %.4f, %.0f %% "
      "confidence)\n",
      risk.clearance_m, risk.probability, risk.low, risk.high, 100.0 * risk.confidence);
  std::printf(
      "              least clearance %.1f m in 1 %%, %.1f m in 5 %%, %.1f m in half of the "
      "draws\n",
      risk.clearance_p01_m, risk.clearance_p05_m, risk.clearance_median_m);
  if (risk.violations > 0) {
    std::printf("              most often %s\n",
                places.at(risk.worst_time_s, risk.worst_place).text().c_str());
  }
}

void print_json(const std::string& folder, const flight::Plan& plan,
                const verification::PlanCheck& check,
                const std::optional<evaluation::ClearanceRisk>& risk, const Places& places) {
  const flight::Verdict& verdict = check.verdict;
  Json json;
  json["schema"] = "hedgehop verify";
  json["schema_version"] = 1;
  json["plan"] = folder;
  json["request_id"] = plan.route_plan.request_id.hex();
  json["map_hash"] = plan.route_plan.map.hash.hex();
  json["is_verified"] = verdict.is_verified;
  json["violation_count"] = verdict.violation_count;
  json["violations"] = Json::array();
  for (const flight::Violation& violation : verdict.violations) {
    Json entry = {{"rule", violation.rule},
                  {"value", violation.value},
                  {"limit", violation.limit},
                  {"unit", verification::unit_of(violation.rule)}};
    entry.update(places.at(violation.time_s, violation.place).json());
    json["violations"].push_back(std::move(entry));
  }
  json["length_m"] = plan.measures.length_m;
  json["duration_s"] = plan.measures.duration_s;
  json["clearance_min_m"] = verdict.clearance_min_m;
  json["share_under_ceiling"] = verdict.share_under_ceiling;
  json["margins"] = json_of(check.margins, places);
  if (risk) {
    json["uncertainty"] = json_of(*risk, places);
  }
  std::printf("%s\n", json.dump(2, ' ', false, Json::error_handler_t::replace).c_str());
}

void print_text(const std::string& folder, const flight::Plan& plan,
                const verification::PlanCheck& check, const Places& places) {
  const flight::Verdict& verdict = check.verdict;
  const verification::Margins& margins = check.margins;
  if (!plan.route_plan.map.label.empty()) {
    std::printf("%s\n", plan.route_plan.map.label.c_str());
  }
  std::printf("plan          %s\n", folder.c_str());
  if (verdict.is_verified) {
    std::printf("verified      yes, no violation\n");
  } else {
    std::printf("verified      NO, %lld violations\n",
                static_cast<long long>(verdict.violation_count));
  }
  std::printf(
      "clearance     at least %.1f m; %.1f m at 1 %%, %.1f m at 5 %% and %.1f m at half of "
      "the way\n",
      margins.clearance_min_m, margins.clearance_p01_m, margins.clearance_p05_m,
      margins.clearance_median_m);
  std::printf("height        at most %.1f m above the surface, %.1f m %s the ceiling\n",
              margins.height_max_m, std::fabs(margins.ceiling_margin_m),
              margins.ceiling_margin_m < 0.0 ? "above" : "below");
  std::printf("load factor   at most %.2f, limit %.2f\n", margins.load_factor_max,
              margins.load_factor_limit);
  const NearMiss* nearest = margins.nearest_miss();
  for (const NearMiss& miss : margins.nearest) {
    const std::string name = miss.name.empty() ? "" : " '" + miss.name + "'";
    std::printf("%-13s %s%s: %.1f m, %.1f m to spare, %s\n",
                &miss == nearest ? "nearest miss" : "nearest", verification::name_of(miss.hazard),
                name.c_str(), miss.distance_m, miss.spare_m(),
                places.at(miss.time_s, miss.place, miss.altitude_m).text().c_str());
  }
  for (std::size_t i = 0; i < margins.via.size(); ++i) {
    std::printf("via point %-3zu passed at %.0f m after %.0f s\n", i + 1, margins.via[i].distance_m,
                margins.via[i].time_s);
  }
}

}  // namespace

ExitCode report_check(const Console& console, const std::string& folder, const map::Map& map,
                      const flight::Plan& plan, const verification::PlanCheck& check,
                      const std::optional<evaluation::ClearanceRisk>& risk) {
  const Places places(map, plan.trajectory);
  if (console.is_json) {
    print_json(folder, plan, check, risk, places);
  } else {
    print_text(folder, plan, check, places);
    if (risk) {
      print_text(*risk, places);
    }
  }
  const flight::Verdict& verdict = check.verdict;
  if (verdict.is_verified) {
    return ExitCode::kOk;
  }
  const std::size_t lines = std::min(verdict.violations.size(), kLinesMax);
  for (std::size_t i = 0; i < lines; ++i) {
    const flight::Violation& violation = verdict.violations[i];
    const std::string unit(verification::unit_of(violation.rule));
    std::fprintf(stderr, "violation: %s: %.6g %s, should be %.6g; %s\n", violation.rule.c_str(),
                 violation.value, unit.c_str(), violation.limit,
                 places.at(violation.time_s, violation.place).text().c_str());
  }
  if (static_cast<std::size_t>(verdict.violation_count) > lines) {
    std::fprintf(stderr,
                 "and %lld more; --json lists up to 100 of the flight, the worst of each "
                 "rule first\n",
                 static_cast<long long>(verdict.violation_count) - static_cast<long long>(lines));
  }
  return ExitCode::kNotVerified;
}

ExitCode report_legs(const Console& console, const std::string& file, const map::Map& map,
                     std::size_t waypoints, double required_clearance_m,
                     const verification::LegCheck& check) {
  const flight::Trajectory none;
  const Places places(map, none);
  const auto place_of = [&](const verification::LegViolation& violation) {
    return places.at(kNan, violation.place.point(), violation.place.altitude_m);
  };
  if (console.is_json) {
    Json json;
    json["schema"] = "hedgehop verify legs";
    json["schema_version"] = 1;
    json["file"] = file;
    json["map_hash"] = map.hash.hex();
    json["waypoints"] = waypoints;
    json["length_m"] = check.length_m;
    json["required_clearance_m"] = required_clearance_m;
    json["is_verified"] = check.is_verified;
    json["violation_count"] = check.violations.size();
    json["violations"] = Json::array();
    for (const verification::LegViolation& violation : check.violations) {
      Json entry = {{"rule", violation.rule},
                    {"leg", violation.leg},
                    {"value", violation.value},
                    {"limit", violation.limit},
                    {"unit", verification::unit_of(violation.rule)}};
      entry.update(place_of(violation).json());
      json["violations"].push_back(std::move(entry));
    }
    json["clearance_min_m"] = check.clearance_min_m;
    json["nearest"] = Json::array();
    for (const NearMiss& miss : check.nearest) {
      json["nearest"].push_back(json_of(miss, places));
    }
    std::printf("%s\n", json.dump(2, ' ', false, Json::error_handler_t::replace).c_str());
  } else {
    std::printf("legs          %s, %zu waypoints, %.2f km\n", file.c_str(), waypoints,
                1e-3 * check.length_m);
    if (check.is_verified) {
      std::printf("verified      yes, as straight lines\n");
    } else {
      std::printf("verified      NO, %zu violations\n", check.violations.size());
    }
    for (const NearMiss& miss : check.nearest) {
      const std::string name = miss.name.empty() ? "" : " '" + miss.name + "'";
      std::printf("nearest       %s%s: %.1f m, %.1f m to spare, %s\n",
                  verification::name_of(miss.hazard), name.c_str(), miss.distance_m, miss.spare_m(),
                  places.at(miss.time_s, miss.place, miss.altitude_m).text().c_str());
    }
  }
  for (std::size_t i = 0; i < std::min(check.violations.size(), kLinesMax); ++i) {
    const verification::LegViolation& violation = check.violations[i];
    const std::string unit(verification::unit_of(violation.rule));
    std::fprintf(stderr, "violation: leg %zu: %s: %.6g %s, should be %.6g; %s\n", violation.leg,
                 violation.rule.c_str(), violation.value, unit.c_str(), violation.limit,
                 place_of(violation).text().c_str());
  }
  return check.is_verified ? ExitCode::kOk : ExitCode::kNotVerified;
}

}  // namespace hedgehop::cli
