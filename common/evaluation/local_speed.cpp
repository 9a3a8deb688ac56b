#include "evaluation/local_speed.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <variant>

#include "base/errors.hpp"
#include "local_planning/local_planner.hpp"
#include "local_planning/surroundings.hpp"

namespace hedgehop::evaluation {
namespace {

using local_planning::Flight;
using local_planning::FlownStep;
using local_planning::Kernel;
using local_planning::LocalGround;
using local_planning::LocalMode;
using local_planning::LocalOptions;
using local_planning::Surroundings;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kSpeed_mps = 40.0;
constexpr double kStep_s = 0.05;
constexpr double kUsualWindow_m = 350.0;
constexpr int kUsualSectors = 64;
constexpr double kPaperCell_m = 30.0;
constexpr double kGuideSpacing_m = 50.0;
constexpr double kGuideHeight_m = 22.0;  // above the greatest surface within the safety disc
constexpr double kGuideSlopeMax = 0.14;

struct PaperRow {
  int window_m;
  std::array<double, 4> ms_per_km;
};
constexpr std::array<int, 4> kPaperSectors{32, 64, 128, 256};
// Table 1 of the paper; what it prints as a second row of 550 m is 450 m.
constexpr std::array<PaperRow, 7> kPaper{{{300, {103.4, 125.9, 167.2, 217.3}},
                                          {350, {125.92, 149.5, 231.8, 296.5}},
                                          {400, {158.0, 202.2, 284.0, 378.3}},
                                          {450, {197.0, 239.6, 328.2, 473.4}},
                                          {500, {236.3, 283.7, 384.0, 550.0}},
                                          {550, {288.6, 334.9, 456.5, 618.7}},
                                          {600, {326.2, 405.3, 492.8, 694.0}}}};

double paper_ms_per_km(double window_m, int sectors) {
  for (const PaperRow& row : kPaper) {
    for (std::size_t i = 0; i < kPaperSectors.size(); ++i) {
      if (row.window_m == window_m && kPaperSectors[i] == sectors) {
        return row.ms_per_km[i];
      }
    }
  }
  return kNaN;
}

// Gradient noise over a lattice of side 1, in about [-1, 1].
class Noise {
 public:
  explicit Noise(std::uint32_t seed) : seed_(seed) {}

  [[nodiscard]] double operator()(double x, double y) const {
    const double column = std::floor(x);
    const double row = std::floor(y);
    const double u = x - column;
    const double v = y - row;
    const auto corner = [&](int right, int up) {
      const std::uint32_t bits =
          hash(static_cast<std::int32_t>(column) + right, static_cast<std::int32_t>(row) + up);
      const double a = static_cast<double>(bits & 0xffffU) / 32767.5 - 1.0;
      const double b = static_cast<double>(bits >> 16U) / 32767.5 - 1.0;
      return a * (u - right) + b * (v - up);
    };
    const auto fade = [](double t) { return t * t * t * (t * (t * 6.0 - 15.0) + 10.0); };
    const double low = corner(0, 0) + fade(u) * (corner(1, 0) - corner(0, 0));
    const double high = corner(0, 1) + fade(u) * (corner(1, 1) - corner(0, 1));
    return low + fade(v) * (high - low);
  }

 private:
  [[nodiscard]] std::uint32_t hash(std::int32_t column, std::int32_t row) const {
    std::uint32_t h = seed_ ^ (static_cast<std::uint32_t>(column) * 0x9e3779b1U) ^
                      (static_cast<std::uint32_t>(row) * 0x85ebca77U);
    h = (h ^ (h >> 15U)) * 0x2c1b3c6dU;
    h = (h ^ (h >> 12U)) * 0x297a2d39U;
    return h ^ (h >> 15U);
  }

  std::uint32_t seed_;
};

// A route's stand-in: straight legs through shares of the map, as low as the slope limit lets them.
std::vector<flight::Waypoint> guide_through(const Surroundings& surroundings,
                                            const raster::GridGeometry& map,
                                            const std::vector<geo::MapPoint>& shares,
                                            double length_m) {
  constexpr double kFine_m = 10.0;
  std::vector<flight::Waypoint> fine;
  double flown_m = 0.0;
  for (std::size_t i = 1; i < shares.size(); ++i) {
    const auto place = [&](const geo::MapPoint& share) {
      return geo::MapPoint{map.west_m + share.x_m * (map.east_m() - map.west_m),
                           map.south_m + share.y_m * (map.north_m() - map.south_m)};
    };
    const geo::MapPoint from = place(shares[i - 1]);
    const geo::MapPoint to = place(shares[i]);
    const double leg_m = std::hypot(to.x_m - from.x_m, to.y_m - from.y_m);
    for (double on_leg_m = 0.0; on_leg_m < leg_m && flown_m <= length_m; on_leg_m += kFine_m) {
      const geo::MapPoint point{from.x_m + (to.x_m - from.x_m) * on_leg_m / leg_m,
                                from.y_m + (to.y_m - from.y_m) * on_leg_m / leg_m};
      fine.push_back({point.x_m, point.y_m, surroundings.dilated_m(point) + kGuideHeight_m});
      flown_m += kFine_m;
    }
  }
  for (std::size_t i = 1; i < fine.size(); ++i) {
    fine[i].altitude_m =
        std::max(fine[i].altitude_m, fine[i - 1].altitude_m - kGuideSlopeMax * kFine_m);
  }
  for (std::size_t i = fine.size() - 1; i > 0; --i) {
    fine[i - 1].altitude_m =
        std::max(fine[i - 1].altitude_m, fine[i].altitude_m - kGuideSlopeMax * kFine_m);
  }
  std::vector<flight::Waypoint> guide;
  const auto every = static_cast<std::size_t>(kGuideSpacing_m / kFine_m);
  for (std::size_t i = 0; i < fine.size(); i += every) {
    guide.push_back(fine[i]);
  }
  return guide;
}

const std::vector<std::vector<geo::MapPoint>>& candidate_lines() {
  static const std::vector<std::vector<geo::MapPoint>> lines{
      {{0.12, 0.2}, {0.5, 0.45}, {0.88, 0.6}},
      {{0.15, 0.5}, {0.85, 0.5}},
      {{0.2, 0.8}, {0.5, 0.5}, {0.8, 0.2}},
      {{0.3, 0.3}, {0.7, 0.7}},
      {{0.5, 0.15}, {0.45, 0.5}, {0.5, 0.85}},
      {{0.35, 0.6}, {0.65, 0.4}},
      {{0.25, 0.25}, {0.75, 0.3}},
      {{0.25, 0.75}, {0.75, 0.7}}};
  return lines;
}

bool is_same_bytes(const Flight& a, const Flight& b) {
  return a.steps.size() == b.steps.size() &&
         std::memcmp(a.steps.data(), b.steps.data(), a.steps.size() * sizeof(FlownStep)) == 0;
}

class SpeedRun {
 public:
  SpeedRun(const map::Map& map, const planning::PlanningConfig& config,
           const LocalSpeedOptions& options, const std::function<double()>& thread_cpu_s,
           Observer& observer)
      : map_(map),
        config_(config),
        options_(options),
        thread_cpu_s_(thread_cpu_s),
        observer_(observer),
        costs_(map, config.weights, config.semantics, config.unknown_visibility,
               map.reference_height_m) {
    const LocalGround ground = local_planning::local_ground(costs_, config.local);
    for (const auto& line : candidate_lines()) {
      const auto guide = guide_through(ground.surroundings, map.geometry, line, options.length_m);
      const bool is_known = std::all_of(
          guide.begin(), guide.end(),
          [](const flight::Waypoint& point) { return std::isfinite(point.altitude_m); });
      if (!is_known || guide.size() < 3) {
        continue;
      }
      guide_ = guide;
      if (std::holds_alternative<Flight>(flown(ground, config.local, options.kernel))) {
        return;
      }
    }
    throw DataError("no straight line over the map could be flown by the local planner",
                    "take a map with more known ground, at least 4 km on a side");
  }

  LocalSpeedRow tvfh_row(LocalOptions local, double window_m, int sectors) {
    local.mode = LocalMode::kTvfh;
    local.window_m = window_m;
    local.sectors = sectors;
    LocalSpeedRow row = timed(local);
    row.planner = "tvfh";
    row.window_m = window_m;
    row.sectors = sectors;
    row.reference_ms_per_km = row.plain_form_ms_per_km;
    row.paper_ms_per_km = paper_ms_per_km(window_m, sectors);
    return row;
  }

  LocalSpeedRow rollout_row(LocalOptions local) {
    local.mode = LocalMode::kTvfh;
    local.window_m = kUsualWindow_m;
    local.sectors = kUsualSectors;
    const double plain_tvfh = timed(local).plain_form_ms_per_km;
    local.mode = LocalMode::kRollout;
    LocalSpeedRow row = timed(local);
    row.planner = "rollout";
    row.window_m = local.rollout.horizon_s * kSpeed_mps;
    row.sectors = local_planning::kCandidates;
    row.reference_ms_per_km = plain_tvfh;
    row.paper_ms_per_km =
        row.cell_m == kPaperCell_m ? paper_ms_per_km(kUsualWindow_m, kUsualSectors) : kNaN;
    return row;
  }

 private:
  LocalSpeedRow timed(const LocalOptions& local) {
    LocalSpeedRow row;
    row.cell_m = map_.geometry.cell_m;
    const double before_s = thread_cpu_s_();
    const LocalGround ground = local_planning::local_ground(costs_, local);
    row.setup_ms = 1e3 * (thread_cpu_s_() - before_s);
    double fast_s = std::numeric_limits<double>::infinity();
    double plain_s = fast_s;
    Flight fast;
    Flight plain;
    for (int i = 0; i < std::max(options_.repeats, options_.reference_repeats); ++i) {
      if (observer_.stop_requested()) {
        throw Interrupted();
      }
      if (i < options_.repeats) {
        fast_s = std::min(fast_s, seconds(ground, local, options_.kernel, fast));
      }
      if (i < options_.reference_repeats) {
        plain_s = std::min(plain_s, seconds(ground, local, Kernel::kPlain, plain));
      }
    }
    row.length_km = static_cast<double>(fast.decisions) * kStep_s * kSpeed_mps / 1000.0;
    row.ms_per_km = 1e3 * fast_s / row.length_km;
    row.plain_form_ms_per_km = 1e3 * plain_s / row.length_km;
    row.is_same_bytes = is_same_bytes(fast, plain);
    return row;
  }

  std::variant<Flight, flight::NoPlan> flown(const LocalGround& ground, const LocalOptions& local,
                                             Kernel kernel) {
    SilentObserver silent;
    return local_planning::fly_along(
        ground, config_.vehicle, local, guide_,
        local_planning::state_at_start(guide_, kSpeed_mps, config_.vehicle.limits), kSpeed_mps, {},
        silent, kernel);
  }

  double seconds(const LocalGround& ground, const LocalOptions& local, Kernel kernel,
                 Flight& flight) {
    const double before_s = thread_cpu_s_();
    auto result = flown(ground, local, kernel);
    const double taken_s = thread_cpu_s_() - before_s;
    if (const auto* no_plan = std::get_if<flight::NoPlan>(&result)) {
      throw DataError("the flight that is timed did not end: " + no_plan->explanation);
    }
    flight = std::move(std::get<Flight>(result));
    return taken_s;
  }

  const map::Map& map_;
  const planning::PlanningConfig& config_;
  const LocalSpeedOptions& options_;
  const std::function<double()>& thread_cpu_s_;
  Observer& observer_;
  risk::CostModel costs_;
  std::vector<flight::Waypoint> guide_;
};

}  // namespace

map::Map synthetic_hills(double cell_m, double east_m, double north_m) {
  map::Map map;
  map.geometry = {0.0, 0.0, cell_m, static_cast<int>(east_m / cell_m),
                  static_cast<int>(north_m / cell_m)};
  map.vertical_datum = "synthetic";
  map.label = "SYNTHETIC REGION";
  map.reference_height_m = 15.24;
  map.visibility_radius_m = 5000.0;
  map.terrain_m = raster::Grid<float>(map.geometry, 0.0F);
  map.semantics = raster::Grid<std::uint16_t>(map.geometry, 0);
  map.visibility = raster::Grid<std::uint16_t>(map.geometry, 0);
  const Noise noise(20261122U);
  const Noise blobs(51U);
  const Noise houses(77U);
  for (int row = 0; row < map.geometry.rows; ++row) {
    for (int column = 0; column < map.geometry.columns; ++column) {
      const geo::MapPoint place = map.geometry.centre({column, row});
      double height_m = 250.0;
      double amplitude_m = 260.0;
      for (double wavelength_m = 6000.0; wavelength_m > 100.0; wavelength_m *= 0.5) {
        height_m += amplitude_m *
                    noise(place.x_m / wavelength_m + 0.37 * wavelength_m, place.y_m / wavelength_m);
        amplitude_m *= 0.45;
      }
      map.terrain_m.at(column, row) = static_cast<float>(height_m);
      const double seen = std::clamp(0.35 + 0.6 * blobs(place.x_m / 900.0, place.y_m / 900.0) +
                                         0.3 * blobs(place.x_m / 150.0, place.y_m / 150.0),
                                     0.0, 1.0);
      map.visibility.at(column, row) =
          static_cast<std::uint16_t>(seen * map::kVisibilityScale + 0.5);
      if (houses(place.x_m / 1500.0, place.y_m / 1500.0) > 0.45) {
        map.semantics.at(column, row) = static_cast<std::uint16_t>(map::SemanticClass::kSettlement);
      }
    }
  }
  map.surface_m = map.terrain_m;
  map.hash = map::map_hash(map);
  return map;
}

namespace {

map::Map hills_for(const LocalSpeedOptions& options, double cell_m) {
  return synthetic_hills(cell_m, options.length_m + 4000.0, 6000.0);
}

}  // namespace

LocalSpeedResult evaluate_local_speed(const map::Map* map, const planning::PlanningConfig& config,
                                      const LocalSpeedOptions& options,
                                      const std::function<double()>& thread_cpu_s,
                                      Observer& observer) {
  LocalSpeedResult result;
  result.kernel = local_planning::name_of_kernel(options.kernel);
  result.map = map != nullptr ? "given" : "synthetic hills";
  planning::PlanningConfig used = config;
  used.local.step_s = kStep_s;
  used.local.passes = 1;
  const double rows =
      static_cast<double>(kPaper.size() * kPaperSectors.size()) + (map != nullptr ? 1.0 : 3.0);
  const auto add = [&](const LocalSpeedRow& row) {
    result.rows.push_back(row);
    observer.progress("local speed", static_cast<double>(result.rows.size()), rows);
  };
  const auto run_all = [&] {
    const map::Map hills = map != nullptr ? map::Map{} : hills_for(options, kPaperCell_m);
    SpeedRun run(map != nullptr ? *map : hills, used, options, thread_cpu_s, observer);
    for (const PaperRow& paper : kPaper) {
      for (const int sectors : kPaperSectors) {
        add(run.tvfh_row(used.local, paper.window_m, sectors));
      }
    }
    add(run.rollout_row(used.local));
    if (map == nullptr) {
      for (const double cell_m : {10.0, 5.0}) {
        const map::Map finer = hills_for(options, cell_m);
        SpeedRun finer_run(finer, used, options, thread_cpu_s, observer);
        add(finer_run.rollout_row(used.local));
      }
    }
  };
  try {
    run_all();
  } catch (const Interrupted&) {
    if (result.rows.empty()) {
      throw;
    }
    result.is_stopped = true;
  }
  return result;
}

std::string local_speed_json(const LocalSpeedResult& result) {
  nlohmann::ordered_json json;
  json["schema"] = "hedgehop evaluate local-speed";
  json["schema_version"] = 1;
  json["kernel"] = result.kernel;
  json["map"] = result.map;
  json["is_stopped"] = result.is_stopped;
  json["rows"] = nlohmann::ordered_json::array();
  for (const LocalSpeedRow& row : result.rows) {
    nlohmann::ordered_json one;
    one["planner"] = row.planner;
    one["cell_m"] = row.cell_m;
    one["window_m"] = row.window_m;
    one["sectors"] = row.sectors;
    one["ms_per_km"] = row.ms_per_km;
    one["reference_ms_per_km"] = row.reference_ms_per_km;
    one["plain_form_ms_per_km"] = row.plain_form_ms_per_km;
    one["paper_ms_per_km"] = std::isnan(row.paper_ms_per_km)
                                 ? nlohmann::ordered_json(nullptr)
                                 : nlohmann::ordered_json(row.paper_ms_per_km);
    one["setup_ms"] = row.setup_ms;
    one["length_km"] = row.length_km;
    one["same_bytes"] = row.is_same_bytes;
    json["rows"].push_back(std::move(one));
  }
  return json.dump(2) + "\n";
}

}  // namespace hedgehop::evaluation
