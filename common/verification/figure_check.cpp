#include "verification/figure_check.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/angles.hpp"
#include "base/config_reader.hpp"
#include "geo/map_projection.hpp"
#include "verification/area_entry.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kPiece_m = 0.5;
constexpr double kSlopeReach_m = 60.0;
constexpr double kStepOfPlanners_m = 1.0;
constexpr double kCostDeviations = 8.0;
constexpr double kCostShare = 1e-4;
constexpr double kCost_m = 0.1;
constexpr double kMeasureShare = 1e-5;
constexpr double kMeasure_m = 1e-3;
constexpr double kShare = 1e-6;
constexpr double kPlace_m = 0.01;
constexpr double kHeading_rad = 1e-6;

std::uint16_t bits_of(const std::vector<std::string>& names, const ConfigReader& reader) {
  std::uint16_t bits = 0;
  for (const std::string& name : names) {
    const auto& known = map::semantic_names();
    const auto entry = std::find_if(known.begin(), known.end(), [&](const map::SemanticName& each) {
      return each.name == name;
    });
    reader.require(entry != known.end(), "classes", "names the unknown class '" + name + "'");
    bits = static_cast<std::uint16_t>(bits | static_cast<std::uint16_t>(entry->bit));
  }
  return bits;
}

// A row of cells from a first cell: across and up.
using Row = std::vector<raster::CellIndex>;

// Rows that cover a length, in eight directions; those along slopes 1/2 and 2 in both ways in which
// they step aside.
std::vector<Row> rows_of(double length_cells) {
  std::vector<Row> rows;
  for (const int half_steps : {0, 2, 1}) {
    const double cell_length = std::sqrt(1.0 + 0.25 * half_steps * half_steps);
    const int count = static_cast<int>(std::ceil(length_cells / cell_length));
    for (int first = 0; first <= (half_steps == 1 ? 1 : 0); ++first) {
      Row row;
      for (int i = 0; i < count; ++i) {
        row.push_back({i, (half_steps * i + first) / 2});
      }
      const auto add = [&](int sign, bool is_swapped) {
        Row other = row;
        for (raster::CellIndex& cell : other) {
          cell.row *= sign;
          if (is_swapped) {
            std::swap(cell.column, cell.row);
          }
        }
        rows.push_back(std::move(other));
      };
      add(1, false);
      add(1, true);
      if (half_steps != 0) {
        add(-1, false);
        add(-1, true);
      }
    }
  }
  return rows;
}

}  // namespace

CostRules read_cost_rules(const std::string& config_text, const std::string& name) {
  ConfigReader reader = ConfigReader::from_text(config_text, name);
  CostRules rules;
  rules.reference_height_m = reader.required_double("reference_height_m");
  rules.unknown_visibility = reader.required_double("unknown_visibility");
  rules.small_patch_m = reader.required_double("small_patch_m");
  reader.require(rules.small_patch_m >= 0.0 && rules.small_patch_m <= 10000.0, "small_patch_m",
                 "must lie between 0 and 10000");
  ConfigReader weights = reader.required_section("weights");
  rules.visibility = weights.required_double("visibility");
  rules.visibility_per_height_1pm = weights.required_double("visibility_per_height_1pm");
  rules.semantics = weights.required_double("semantics");
  rules.height_1pm = weights.required_double("height_1pm");
  const auto read_if_there = [&weights](const char* key, double& value) {
    if (weights.has(key)) {
      value = weights.required_double(key);
    }
  };
  read_if_there("soft_ceiling_m", rules.soft_ceiling_m);
  read_if_there("soft_ceiling_1pm", rules.soft_ceiling_1pm);
  read_if_there("threats", rules.threats);
  read_if_there("wire_crossing_m", rules.wire_crossing_m);
  read_if_there("slope_along", rules.slope_along);
  ConfigReader semantics = reader.required_section("semantics");
  for (ConfigReader& entry : semantics.required_sections("rules")) {
    rules.rules.push_back(
        {bits_of(entry.required_strings("classes"), entry), entry.required_double("cost")});
  }
  rules.otherwise = semantics.required_double("otherwise");
  rules.soft_area = semantics.required_double("soft_area");
  rules.lateral_margin_m = reader.required_section("global").required_double("lateral_margin_m");
  return rules;
}

PathSums::PathSums(const map::Map& map, const CostRules& rules) : map_(map), rules_(rules) {
  bands_.push_back({map.reference_height_m, &map.visibility, {}});
  for (const map::VisibilityBand& band : map.further_visibility) {
    bands_.push_back({band.height_m, &band.share, {}});
  }
  std::sort(bands_.begin(), bands_.end(),
            [](const Band& a, const Band& b) { return a.height_m < b.height_m; });
  for (const map::Area& area : map.areas) {
    if (!area.is_hard) {
      soft_areas_.push_back({&area, box_of(area)});
    }
  }
}

double PathSums::share_of(const Band& band, raster::CellIndex cell) const {
  const std::uint16_t stored = band.share->at(cell);
  return stored == map::kVisibilityUnknown ? rules_.unknown_visibility
                                           : stored / map::kVisibilityScale;
}

double PathSums::seen_by_planners(std::size_t band_number, raster::CellIndex cell) {
  Band& band = bands_[band_number];
  const raster::GridGeometry& g = map_.geometry;
  const double length_cells = rules_.small_patch_m / g.cell_m;
  if (!(length_cells >= 2.0) || length_cells > std::min(g.columns, g.rows)) {
    return share_of(band, cell);
  }
  if (band.without_patches.empty()) {
    band.without_patches.assign(g.cell_count(), std::numeric_limits<float>::quiet_NaN());
  }
  float& kept = band.without_patches[static_cast<std::size_t>(cell.row) *
                                         static_cast<std::size_t>(g.columns) +
                                     static_cast<std::size_t>(cell.column)];
  if (!std::isnan(kept)) {
    return static_cast<double>(kept);
  }
  double least = std::numeric_limits<double>::infinity();
  for (const Row& row : rows_of(length_cells)) {
    for (const raster::CellIndex& here : row) {  // where in the row the cell stands
      double greatest = 0.0;
      for (const raster::CellIndex& other : row) {
        const raster::CellIndex at{cell.column + other.column - here.column,
                                   cell.row + other.row - here.row};
        greatest = g.contains(at) ? std::max(greatest, share_of(band, at))
                                  : std::numeric_limits<double>::infinity();
        if (!(greatest < least)) {
          break;
        }
      }
      least = std::min(least, greatest);
    }
  }
  kept = static_cast<float>(least);
  return static_cast<double>(kept);
}

double PathSums::seen(const geo::MapPoint& point, double height_m, bool is_by_planners) {
  if (!map_.geometry.contains(point)) {
    return kNan;
  }
  const raster::CellIndex cell = map_.geometry.cell_at(point);
  const auto share = [&](std::size_t band) {
    return is_by_planners ? seen_by_planners(band, cell) : share_of(bands_[band], cell);
  };
  std::size_t above = 0;  // the first band that is higher
  while (above < bands_.size() && !(height_m < bands_[above].height_m)) {
    ++above;
  }
  if (above == 0) {
    return share(0);
  }
  const double low_m = bands_[above - 1].height_m;
  if (above == bands_.size()) {
    return share(above - 1) * (1.0 + rules_.visibility_per_height_1pm * (height_m - low_m));
  }
  const double part = (height_m - low_m) / (bands_[above].height_m - low_m);
  return (1.0 - part) * share(above - 1) + part * share(above);
}

double PathSums::semantics(const geo::MapPoint& point, double altitude_m) const {
  if (!map_.geometry.contains(point)) {
    return kNan;
  }
  const std::uint16_t bits = map_.semantics.at(map_.geometry.cell_at(point));
  double cost = rules_.otherwise;
  for (const CostRules::Rule& rule : rules_.rules) {
    if ((bits & rule.all_of) == rule.all_of) {
      cost = rule.cost;
      break;
    }
  }
  Box here;
  here.add(point);
  for (const auto& [area, box] : soft_areas_) {
    if (cost >= rules_.soft_area) {
      break;
    }
    if (!box.is_within(0.0, here)) {
      continue;
    }
    const PathPoint place{point.x_m, point.y_m, altitude_m};
    const double height_m = altitude_m - interpolated_height_m(map_.terrain_m, point);
    if (depth_in_area_m(*area, place, place, 0.0) &&
        may_lie_within(*area, {altitude_m, altitude_m}, {height_m, height_m})) {
      cost = rules_.soft_area;
    }
  }
  return cost;
}

double PathSums::threats(raster::CellIndex cell, double height_m) const {
  return static_cast<double>(
      std::count_if(map_.threats.begin(), map_.threats.end(), [&](const map::HeightLayer& threat) {
        return static_cast<double>(threat.height_m.at(cell)) <= height_m;  // not for NaN
      }));
}

double PathSums::square_of_slope(raster::CellIndex cell, double east, double north) {
  if (!(cell == slope_cell_)) {
    slope_cell_ = cell;
    // Normal equations of the plane a + b x + c y through the cells around, solved by Cramer's
    // rule.
    const raster::GridGeometry& g = map_.geometry;
    const long reach = std::max(1L, std::lround(std::floor(kSlopeReach_m / g.cell_m + 0.5)));
    std::array<std::array<double, 3>, 3> m{};
    std::array<double, 3> right{};
    for (long row = cell.row - reach; row <= cell.row + reach; ++row) {
      for (long column = cell.column - reach; column <= cell.column + reach; ++column) {
        const raster::CellIndex at{static_cast<int>(column), static_cast<int>(row)};
        const double z_m = g.contains(at) ? static_cast<double>(map_.terrain_m.at(at)) : kNan;
        if (std::isnan(z_m)) {
          continue;
        }
        const std::array<double, 3> term = {1.0,
                                            g.cell_m * static_cast<double>(column - cell.column),
                                            g.cell_m * static_cast<double>(row - cell.row)};
        for (std::size_t i = 0; i < 3; ++i) {
          for (std::size_t k = 0; k < 3; ++k) {
            m[i][k] += term[i] * term[k];
          }
          right[i] += term[i] * z_m;
        }
      }
    }
    const auto determinant = [](const std::array<std::array<double, 3>, 3>& a) {
      return a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) -
             a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
             a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
    };
    for (std::size_t k = 1; k < 3; ++k) {
      auto replaced = m;
      for (std::size_t i = 0; i < 3; ++i) {
        replaced[i][k] = right[i];
      }
      slope_[k - 1] = determinant(replaced) / determinant(m);
    }
  }
  const double along = slope_[0] * east + slope_[1] * north;
  return along * along;
}

double PathSums::wire_crossings(const geo::MapPoint& a, const geo::MapPoint& b) const {
  double sum = 0.0;
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  for (const map::OverheadLine& line : map_.overhead_lines) {
    for (std::size_t i = 1; i < line.supports.size(); ++i) {
      const geo::MapPoint& p = line.supports[i - 1].point;
      const geo::MapPoint& q = line.supports[i].point;
      const double span_x_m = q.x_m - p.x_m;
      const double span_y_m = q.y_m - p.y_m;
      // a + t (b - a) = p + u (q - p)
      const double cross = dx_m * span_y_m - dy_m * span_x_m;
      const double t = ((p.x_m - a.x_m) * span_y_m - (p.y_m - a.y_m) * span_x_m) / cross;
      const double u = ((p.x_m - a.x_m) * dy_m - (p.y_m - a.y_m) * dx_m) / cross;
      if (t >= 0.0 && t < 1.0 && u >= 0.0 && u <= 1.0) {  // not for NaN: parallel
        sum += 1.0 - std::fabs(2.0 * u - 1.0);
      }
    }
  }
  return sum;
}

RouteSum PathSums::route_cost(const std::vector<flight::Waypoint>& waypoints) {
  RouteSum result;
  flight::RouteCost& sum = result.cost;
  flight::RouteCost jumps;  // sums of their squares
  const raster::GridGeometry& g = map_.geometry;
  for (std::size_t i = 1; i < waypoints.size(); ++i) {
    const flight::Waypoint& a = waypoints[i - 1];
    const flight::Waypoint& b = waypoints[i];
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    const double dz_m = b.altitude_m - a.altitude_m;
    const double leg_m = std::sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m);
    sum.length_m += leg_m;
    if (!g.contains(a.point()) || !g.contains(b.point())) {
      sum.visibility_m = sum.semantics_m = sum.height_m = kNan;
      continue;
    }
    if (rules_.wire_crossing_m > 0.0) {
      sum.wire_crossings_m += rules_.wire_crossing_m * wire_crossings(a.point(), b.point());
    }
    const double track_m = distance_m(a.point(), b.point());
    std::vector<double> cuts = {0.0, 1.0};
    const auto cut_at_edges = [&](double start_m, double delta_m, double origin_m) {
      const double first = (start_m - origin_m) / g.cell_m;
      const double last = (start_m + delta_m - origin_m) / g.cell_m;
      for (double edge = std::ceil(std::min(first, last)); edge <= std::max(first, last);
           edge += 1.0) {
        if (const double t = (origin_m + edge * g.cell_m - start_m) / delta_m; t > 0.0 && t < 1.0) {
          cuts.push_back(t);
        }
      }
    };
    cut_at_edges(a.x_m, dx_m, g.west_m);
    cut_at_edges(a.y_m, dy_m, g.south_m);
    std::sort(cuts.begin(), cuts.end());
    double visible_before = kNan;
    double semantics_before = kNan;
    double threats_before = kNan;
    double slope_before = kNan;
    for (std::size_t k = 1; k < cuts.size(); ++k) {
      const double span_m = (cuts[k] - cuts[k - 1]) * leg_m;
      const int pieces = std::max(1, static_cast<int>(std::ceil(span_m / kPiece_m)));
      for (int p = 0; p < pieces; ++p) {
        const double from = cuts[k - 1] + (cuts[k] - cuts[k - 1]) * p / pieces;
        const double to = cuts[k - 1] + (cuts[k] - cuts[k - 1]) * (p + 1) / pieces;
        // Ends are taken a trifle inwards, so that they fall into the cell of the piece.
        constexpr std::array<double, 3> kAt = {1e-6, 0.5, 1.0 - 1e-6};
        constexpr std::array<double, 3> kWeight = {1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0};
        for (std::size_t s = 0; s < kAt.size(); ++s) {
          const double t = from + kAt[s] * (to - from);
          const geo::MapPoint point{a.x_m + t * dx_m, a.y_m + t * dy_m};
          const double altitude_m = a.altitude_m + t * dz_m;
          const double height_m = altitude_m - interpolated_height_m(map_.surface_m, point);
          const double ds_m = kWeight[s] * (to - from) * leg_m;
          const double seen_here = seen(point, height_m, true);
          const double visible = rules_.visibility * seen_here * seen_here;
          const double semantic = rules_.semantics * semantics(point, altitude_m);
          // fmax passes over the NaN of the first place. Areas begin anywhere, cells at cuts.
          const double semantic_jump = std::fmax(std::fabs(semantic - semantics_before), 0.0);
          jumps.semantics_m += semantic_jump * semantic_jump;
          if (p == 0 && s == 0) {
            const double jump = std::fmax(std::fabs(visible - visible_before), 0.0);
            jumps.visibility_m += jump * jump;
          }
          visible_before = visible;
          semantics_before = semantic;
          const raster::CellIndex cell = g.cell_at(point);
          const auto add_stepwise = [ds_m](double value, double& before, double& term_m,
                                           double& jumps_m2) {
            const double jump = std::fmax(std::fabs(value - before), 0.0);
            jumps_m2 += jump * jump;
            before = value;
            term_m += value * ds_m;
          };
          if (rules_.threats > 0.0) {
            add_stepwise(rules_.threats * threats(cell, height_m), threats_before, sum.threats_m,
                         jumps.threats_m);
          }
          if (rules_.slope_along > 0.0 && track_m > 0.0) {
            add_stepwise(rules_.slope_along * square_of_slope(cell, dx_m / track_m, dy_m / track_m),
                         slope_before, sum.slope_m, jumps.slope_m);
          }
          sum.soft_ceiling_m +=
              rules_.soft_ceiling_1pm * std::fmax(height_m - rules_.soft_ceiling_m, 0.0) * ds_m;
          sum.visibility_m += visible * ds_m;
          sum.semantics_m += semantic * ds_m;
          sum.height_m +=
              rules_.height_1pm * std::fabs(height_m - rules_.reference_height_m) * ds_m;
        }
      }
    }
  }
  for (double flight::RouteCost::*term :
       {&flight::RouteCost::visibility_m, &flight::RouteCost::semantics_m,
        &flight::RouteCost::threats_m, &flight::RouteCost::slope_m}) {
    result.deviation.*term = kStepOfPlanners_m * std::sqrt(jumps.*term / 12.0);
  }
  return result;
}

flight::PathMeasures PathSums::measures(const flight::Trajectory& trajectory,
                                        double ceiling_height_m) {
  flight::PathMeasures sum;
  const auto& states = trajectory.states;
  double height_m2 = 0.0;
  double low_m = 0.0;
  struct Here {
    double visible, semantics, bank_rad, height_m;
  };
  const auto here = [&](const flight::FlightState& state) {
    if (!is_finite(state)) {
      return Here{kNan, kNan, kNan, kNan};
    }
    const double height_m = state.altitude_m - interpolated_height_m(map_.surface_m, state.point());
    return Here{seen(state.point(), height_m, false), semantics(state.point(), state.altitude_m),
                std::fabs(state.bank_rad), height_m};
  };
  Here a = here(states.front());
  sum.max_height_m = a.height_m;
  for (std::size_t i = 1; i < states.size(); ++i) {
    const Here b = here(states[i]);
    const double half_m = 0.5 * distance_m(states[i - 1].point(), states[i].point());
    sum.length_m += 2.0 * half_m;
    sum.visibility_m += half_m * (a.visible + b.visible);
    sum.semantics_m += half_m * (a.semantics + b.semantics);
    sum.bank_rad_m += half_m * (a.bank_rad + b.bank_rad);
    height_m2 += half_m * (a.height_m + b.height_m);
    low_m += 0.5 * (a.height_m + b.height_m) <= ceiling_height_m ? 2.0 * half_m : 0.0;
    sum.max_height_m = std::max(sum.max_height_m, b.height_m);
    a = b;
  }
  sum.duration_s = states.back().time_s - states.front().time_s;
  sum.mean_height_m = height_m2 / sum.length_m;
  sum.share_under_ceiling = low_m / sum.length_m;
  return sum;
}

namespace {

class FigureCheck {
 public:
  explicit FigureCheck(Findings& findings) : findings_(findings) {}

  // Unknown on both sides is the same.
  void compare(const std::string& field, double claimed, double found, double tolerance) {
    if (std::isnan(claimed) && std::isnan(found)) {
      return;
    }
    if (!(std::fabs(claimed - found) <= tolerance)) {
      findings_.add(field, kNan, {kNan, kNan}, claimed, found);
    }
  }
  void compare_place(const std::string& field, const flight::Waypoint& claimed,
                     const geo::MapPoint& point, const HeightRange& altitude) {
    if (!(distance_m(claimed.point(), point) <= kPlace_m)) {
      findings_.add(field, kNan, claimed.point(), distance_m(claimed.point(), point), kPlace_m);
    }
    if (!(claimed.altitude_m >= altitude.low_m - kPlace_m &&
          claimed.altitude_m <= altitude.high_m + kPlace_m)) {
      findings_.add(field, kNan, claimed.point(), claimed.altitude_m, altitude.low_m);
    }
  }

 private:
  Findings& findings_;
};

// The highest cell that a disc touches, NaN if one of them is unknown or outside.
double highest_around_m(const raster::Grid<float>& heights_m, const geo::MapPoint& centre,
                        double radius_m) {
  const raster::GridGeometry& g = heights_m.geometry();
  const int reach = static_cast<int>(std::ceil(radius_m / g.cell_m)) + 1;
  const raster::CellIndex middle = g.cell_at(centre);
  double highest_m = -std::numeric_limits<double>::infinity();
  for (int row = middle.row - reach; row <= middle.row + reach; ++row) {
    for (int column = middle.column - reach; column <= middle.column + reach; ++column) {
      const geo::MapPoint at = g.centre({column, row});
      const double dx_m = std::max(std::fabs(at.x_m - centre.x_m) - 0.5 * g.cell_m, 0.0);
      const double dy_m = std::max(std::fabs(at.y_m - centre.y_m) - 0.5 * g.cell_m, 0.0);
      if (dx_m * dx_m + dy_m * dy_m > radius_m * radius_m) {
        continue;
      }
      const double here_m = g.contains(raster::CellIndex{column, row})
                                ? static_cast<double>(heights_m.at(column, row))
                                : kNan;
      if (std::isnan(here_m)) {
        return kNan;
      }
      highest_m = std::max(highest_m, here_m);
    }
  }
  return highest_m;
}

void check_request(const map::Map& map, const flight::RoutePlan& plan,
                   const flight::FlightState* first, const CostRules& rules, FigureCheck& check) {
  if (!map.crs_wkt.empty()) {
    const geo::MapProjection projection(map.crs_wkt);
    const auto check_end = [&](const char* field, const flight::RequestPoint& asked,
                               const flight::Waypoint& end) {
      const geo::MapPoint point = projection.to_map(asked.position);
      if (asked.height_m) {
        const double altitude_m = interpolated_height_m(map.surface_m, point) + *asked.height_m;
        check.compare_place(field, end, point, {altitude_m, altitude_m});
        return;
      }
      // A cell may lie at the margin, to the last bits.
      const auto altitude_m = [&](double margin_m) {
        return highest_around_m(map.surface_m, point, margin_m) + rules.reference_height_m;
      };
      check.compare_place(field, end, point,
                          {altitude_m(std::max(rules.lateral_margin_m - kPlace_m, 0.0)),
                           altitude_m(rules.lateral_margin_m + kPlace_m)});
    };
    check_end("request.start", plan.request.start, plan.start);
    check_end("request.goal", plan.request.goal, plan.goal);
  }
  if (plan.request.start_heading_true_rad && first != nullptr) {
    check.compare("request.start_heading_true_rad",
                  wrap_to_pi(first->heading_true_rad - *plan.request.start_heading_true_rad), 0.0,
                  kHeading_rad);
  }
  const auto check_waypoint = [&](const flight::Waypoint& waypoint, const flight::Waypoint& end) {
    check.compare_place("route.waypoints", waypoint, end.point(), {end.altitude_m, end.altitude_m});
  };
  check_waypoint(plan.route.waypoints.front(), plan.start);
  check_waypoint(plan.route.waypoints.back(), plan.goal);
}

// Whether the flight is at its places when the timetable says so.
void check_timetable(const flight::Plan& plan, const std::vector<geo::MapPoint>& via,
                     const Demands& demands, FigureCheck& check, Findings& findings) {
  const auto& states = plan.trajectory.states;
  const auto& entries = plan.timetable->entries;
  if (entries.size() != via.size() + 2) {
    findings.add("timetable.places", kNan, {kNan, kNan}, static_cast<double>(entries.size()),
                 static_cast<double>(via.size() + 2));
    return;
  }
  const Time departure = entries.front().expected;
  check.compare("timetable.arrival_s", seconds_between(departure, entries.back().expected),
                states.back().time_s - states.front().time_s, kMeasure_m);
  for (std::size_t i = 0; i < via.size(); ++i) {
    const double time_s =
        states.front().time_s + seconds_between(departure, entries[i + 1].expected);
    const auto after = std::lower_bound(
        states.begin(), states.end(), time_s - 0.5 * plan.trajectory.step_s,
        [](const flight::FlightState& state, double time) { return state.time_s < time; });
    const double missed_m = after == states.end() ? kNan : distance_m(after->point(), via[i]);
    if (!(missed_m <= demands.via_radius_m)) {
      findings.add("timetable.via", time_s, via[i], missed_m, demands.via_radius_m);
    }
  }
}

}  // namespace

void check_figures(const map::Map& map, const flight::Plan& plan, const CostRules& rules,
                   const std::vector<geo::MapPoint>& via, const Demands& demands,
                   const flight::Verdict& verdict, Findings& findings) {
  FigureCheck check(findings);
  if (plan.timetable && plan.trajectory.states.size() >= 2) {
    check_timetable(plan, via, demands, check, findings);
  }
  PathSums sums(map, rules);
  const flight::Route& route = plan.route_plan.route;
  if (route.waypoints.size() >= 2) {
    check_request(map, plan.route_plan,
                  plan.trajectory.states.empty() ? nullptr : &plan.trajectory.states.front(), rules,
                  check);
    const auto [cost, deviation] = sums.route_cost(route.waypoints);
    const auto compare = [&](const char* term, double claimed_m, double found_m,
                             double deviation_m) {
      check.compare(std::string("route.cost.") + term, claimed_m, found_m,
                    kCostDeviations * deviation_m + kCostShare * found_m + kCost_m);
    };
    check.compare("route.cost.length_m", route.cost.length_m, cost.length_m,
                  kMeasureShare * cost.length_m + kMeasure_m);
    for (const flight::CostTerm& term : flight::kCostTerms) {
      if (term.value_m != &flight::RouteCost::length_m) {
        compare(term.name, route.cost.*term.value_m, cost.*term.value_m, deviation.*term.value_m);
      }
    }
    const double total_m = cost.total_m();
    const double tolerance_m = kCostDeviations * deviation.total_m() + kCostShare * total_m;
    if (route.lower_bound_m > total_m + tolerance_m + kCost_m) {
      findings.add("route.lower_bound_m", kNan, {kNan, kNan}, route.lower_bound_m, total_m);
    }
  }
  if (plan.trajectory.states.size() >= 2) {
    const flight::PathMeasures& claimed = plan.measures;
    const flight::PathMeasures found = sums.measures(plan.trajectory, demands.ceiling_height_m);
    const auto compare = [&](const char* name, double flight::PathMeasures::*field,
                             double tolerance) {
      check.compare(std::string("measures.") + name, claimed.*field, found.*field,
                    kMeasureShare * std::fabs(found.*field) + tolerance);
    };
    compare("length_m", &flight::PathMeasures::length_m, kMeasure_m);
    compare("duration_s", &flight::PathMeasures::duration_s, kMeasure_m);
    compare("visibility_m", &flight::PathMeasures::visibility_m, kMeasure_m);
    compare("semantics_m", &flight::PathMeasures::semantics_m, kMeasure_m);
    compare("bank_rad_m", &flight::PathMeasures::bank_rad_m, kMeasure_m);
    compare("mean_height_m", &flight::PathMeasures::mean_height_m, kMeasure_m);
    compare("max_height_m", &flight::PathMeasures::max_height_m, kMeasure_m);
    check.compare("measures.share_under_ceiling", claimed.share_under_ceiling,
                  found.share_under_ceiling, kShare);
  }
  const flight::Verdict& claimed = plan.verdict;
  const auto compare = [&](const char* name, double of_plan, double found, double tolerance) {
    check.compare(std::string("verification.") + name, of_plan, found, tolerance);
  };
  compare("is_verified", claimed.is_verified ? 1.0 : 0.0, verdict.is_verified ? 1.0 : 0.0, 0.0);
  compare("violation_count", static_cast<double>(claimed.violation_count),
          static_cast<double>(verdict.violation_count), 0.0);
  compare("clearance_min_m", claimed.clearance_min_m, verdict.clearance_min_m, kMeasure_m);
  compare("clearance_min_place", claimed.clearance_min_place.x_m, verdict.clearance_min_place.x_m,
          kPlace_m);
  compare("clearance_min_place", claimed.clearance_min_place.y_m, verdict.clearance_min_place.y_m,
          kPlace_m);
  compare("bank_max_rad", claimed.bank_max_rad, verdict.bank_max_rad, kShare);
  compare("roll_rate_max_radps", claimed.roll_rate_max_radps, verdict.roll_rate_max_radps, kShare);
  compare("climb_rate_max_mps", claimed.climb_rate_max_mps, verdict.climb_rate_max_mps, kShare);
  compare("descent_rate_max_mps", claimed.descent_rate_max_mps, verdict.descent_rate_max_mps,
          kShare);
  compare("speed_min_mps", claimed.speed_min_mps, verdict.speed_min_mps, kShare);
  compare("speed_max_mps", claimed.speed_max_mps, verdict.speed_max_mps, kShare);
  compare("share_under_ceiling", claimed.share_under_ceiling, verdict.share_under_ceiling, kShare);
  compare("goal_distance_m", claimed.goal_distance_m, verdict.goal_distance_m, kMeasure_m);
}

}  // namespace hedgehop::verification
