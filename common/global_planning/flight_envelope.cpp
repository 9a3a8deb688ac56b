#include "global_planning/flight_envelope.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/elementary.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr float kNaNFloat = std::numeric_limits<float>::quiet_NaN();

// A start exactly on the floor must not fail by the rounding of its own height.
constexpr double kHeightTolerance_m = 1e-6;
constexpr double kHigher_m = 10.0;  // over which the cost of a metre of height is taken

constexpr int kLanes = 16;

// Makes each of `count` numbers at least the other one; a multiple of kLanes, which lets the
// compiler use SIMD.
void raise_to(float* __restrict values, const float* __restrict others, int count) {
  for (int from = 0; from < count; from += kLanes) {
    for (int k = from; k < from + kLanes; ++k) {
      values[k] = values[k] > others[k] ? values[k] : others[k];
    }
  }
}

}  // namespace

raster::Grid<float> dilated_surface(const raster::Grid<float>& surface_m, double margin_m) {
  const raster::GridGeometry& geometry = surface_m.geometry();
  const double margin = margin_m / geometry.cell_m;
  if (!(margin > 0.0)) {
    return surface_m;
  }
  // Half width of the row of offsets at distance `by` rows; -1 where there is none.
  std::vector<int> half_widths;
  for (int by = 0;; ++by) {
    const double dy = std::max(by - 1, 0);
    if (dy * dy >= margin * margin) {
      break;
    }
    int bx = 0;
    while (bx * static_cast<double>(bx) + dy * dy < margin * margin) {
      ++bx;  // offset bx + 1 would have max(|b| - 1, 0) = bx
    }
    half_widths.push_back(bx);
  }
  const int reach = static_cast<int>(half_widths.size()) - 1;
  const int widest = half_widths.front();
  // Unknown cells and those outside count as infinitely high until the end.
  constexpr float kUnknown = std::numeric_limits<float>::infinity();
  const int wide = (geometry.columns + kLanes - 1) / kLanes * kLanes;
  const auto row_of = [&](std::vector<float>& values, int row) {
    return values.data() + static_cast<std::size_t>(row) * static_cast<std::size_t>(wide);
  };
  std::vector<float> result(
      static_cast<std::size_t>(wide) * static_cast<std::size_t>(geometry.rows), -kUnknown);
  std::vector<float> padded(static_cast<std::size_t>(wide + 2 * widest), kUnknown);
  std::vector<float> greatest(static_cast<std::size_t>(wide));
  float* const middle = padded.data() + widest;
  for (int row = 0; row < geometry.rows; ++row) {
    std::transform(surface_m.row(row), surface_m.row(row) + geometry.columns, middle,
                   [](float value) { return std::isnan(value) ? kUnknown : value; });
    std::copy_n(middle, wide, greatest.begin());
    int half_width = 0;
    for (int by = reach; by >= 0; --by) {
      while (half_width < half_widths[static_cast<std::size_t>(by)]) {
        ++half_width;
        raise_to(greatest.data(), middle - half_width, wide);
        raise_to(greatest.data(), middle + half_width, wide);
      }
      if (row - by >= 0) {
        raise_to(row_of(result, row - by), greatest.data(), wide);
      }
      if (by > 0 && row + by < geometry.rows) {
        raise_to(row_of(result, row + by), greatest.data(), wide);
      }
    }
  }
  raster::Grid<float> dilated(geometry, kNaNFloat);
  for (int row = reach; row + reach < geometry.rows; ++row) {
    const float* const values = row_of(result, row);
    std::transform(values, values + geometry.columns, dilated.row(row),
                   [](float value) { return value == kUnknown ? kNaNFloat : value; });
  }
  return dilated;
}

FlightEnvelope::FlightEnvelope(const risk::CostModel& costs, const GlobalOptions& options,
                               const flight::Waypoint& start, const flight::Waypoint& goal)
    : costs_(&costs),
      geometry_(costs.map().geometry),
      has_threats_(costs.has_threats()),
      has_slope_(costs.has_slope()),
      has_wires_(costs.has_wires()),
      inverse_cell_1pm_(1.0 / geometry_.cell_m),
      floor_m_(options.envelope_floor_m),
      ceiling_m_(options.envelope_ceiling_m),
      check_step_m_(options.check_step_m),
      final_check_step_m_(options.final_check_step_m),
      slopes_(options.slopes()),
      turn_cosine_min_(elementary::cos(options.turn_angle_max_rad)),
      turns_(options.turns()),
      funnel_m_(options.end_funnel_m),
      start_(start),
      goal_(goal) {
  const map::Map& map = costs.map();
  const raster::Grid<float> dilated = dilated_surface(map.surface_m, options.lateral_margin_m);
  cells_.reserve(geometry_.cell_count());
  for (int row = 0; row < geometry_.rows; ++row) {
    for (int column = 0; column < geometry_.columns; ++column) {
      cells_.push_back({map.surface_m.at(column, row), dilated.at(column, row),
                        costs.semantics_layer().at(column, row), 0.0F});
    }
  }
  const std::array<flight::Waypoint, 2> ends = {start, goal};
  for (std::size_t i = 0; i < ends.size(); ++i) {
    const double height_m =
        ends[i].altitude_m - raster::sample_bilinear(map.surface_m, ends[i].point());
    ends_[i] = {ends[i].x_m, ends[i].y_m, std::min(height_m, floor_m_)};
  }
  take_areas(options);
}

FlightEnvelope::FlightEnvelope(const FlightEnvelope& ground, const risk::CostModel& costs)
    : FlightEnvelope(ground) {
  costs_ = &costs;
  has_avoidance_ = false;
  has_threats_ = costs.has_threats();
  has_slope_ = costs.has_slope();
  has_wires_ = costs.has_wires();
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    cells_[i].semantics = costs.semantics_layer().values()[i];
    cells_[i].avoidance = 0.0F;
  }
}

void FlightEnvelope::sink_floor(std::size_t end, const flight::Waypoint& place) {
  const double height_m =
      place.altitude_m - raster::sample_bilinear(costs_->map().surface_m, place.point());
  ends_[end] = {place.x_m, place.y_m, std::min(height_m, floor_m_)};
}

void FlightEnvelope::move_start(const flight::Waypoint& start) {
  start_ = start;
  sink_floor(0, start);
}

void FlightEnvelope::move_goal(const flight::Waypoint& goal) {
  goal_ = goal;
  sink_floor(1, goal);
}

std::optional<flight::Waypoint> FlightEnvelope::before_start() const {
  if (!lead_in_) {
    return std::nullopt;
  }
  return flight::Waypoint{start_.x_m - lead_in_->x_m, start_.y_m - lead_in_->y_m,
                          start_.altitude_m};
}

void FlightEnvelope::avoid(const std::vector<flight::Waypoint>& route, double within_m,
                           double cost) {
  has_avoidance_ = has_avoidance_ || cost > 0.0;
  for (std::size_t leg = 1; leg < route.size(); ++leg) {
    const flight::Waypoint& a = route[leg - 1];
    const flight::Waypoint& b = route[leg];
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    const double square_m2 = dx_m * dx_m + dy_m * dy_m;
    const auto first = [&](double a_m, double b_m, double origin_m) {
      return std::max(0, static_cast<int>(std::floor((std::min(a_m, b_m) - within_m - origin_m) *
                                                     inverse_cell_1pm_)));
    };
    const auto last = [&](double a_m, double b_m, double origin_m, int count) {
      return std::min(count - 1,
                      static_cast<int>(std::floor((std::max(a_m, b_m) + within_m - origin_m) *
                                                  inverse_cell_1pm_)));
    };
    const int west = first(a.x_m, b.x_m, geometry_.west_m);
    const int east = last(a.x_m, b.x_m, geometry_.west_m, geometry_.columns);
    const int north = last(a.y_m, b.y_m, geometry_.south_m, geometry_.rows);
    for (int row = first(a.y_m, b.y_m, geometry_.south_m); row <= north; ++row) {
      for (int column = west; column <= east; ++column) {
        const geo::MapPoint centre = geometry_.centre({column, row});
        const double along =
            square_m2 > 0.0
                ? std::clamp(
                      ((centre.x_m - a.x_m) * dx_m + (centre.y_m - a.y_m) * dy_m) / square_m2, 0.0,
                      1.0)
                : 0.0;
        const double off_x_m = centre.x_m - (a.x_m + along * dx_m);
        const double off_y_m = centre.y_m - (a.y_m + along * dy_m);
        if (off_x_m * off_x_m + off_y_m * off_y_m <= within_m * within_m) {
          float& here = cells_[index(column, row)].avoidance;
          here = std::max(here, static_cast<float>(cost));
        }
      }
    }
  }
}

double FlightEnvelope::route_cost_m(const std::vector<flight::Waypoint>& route,
                                    double step_m) const {
  const double own_m = costs_->route_cost(route, step_m).total_m();
  if (!has_avoidance_) {
    return own_m;
  }
  double avoided_m = 0.0;
  for (std::size_t i = 1; i < route.size(); ++i) {
    const flight::Waypoint& a = route[i - 1];
    const flight::Waypoint& b = route[i];
    const double leg_m = flight::length_m({a, b});
    const int steps = std::max(1, static_cast<int>(std::ceil(leg_m / step_m)));
    for (int k = 0; k < steps; ++k) {
      const double t = (k + 0.5) / steps;
      const geo::MapPoint point{a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)};
      if (geometry_.contains(point)) {
        const raster::CellIndex at = geometry_.cell_at(point);
        avoided_m += static_cast<double>(cell(at.column, at.row).avoidance) * leg_m / steps;
      }
    }
  }
  return own_m + avoided_m;
}

void FlightEnvelope::take_areas(const GlobalOptions& options) {
  const risk::AreaIndex& areas = costs_->areas();
  if (areas.is_empty()) {
    return;
  }
  areas_.resize(cells_.size());
  const int reach = 1 + static_cast<int>(options.lateral_margin_m * inverse_cell_1pm_);
  for (int row = 0; row < geometry_.rows; ++row) {
    for (int column = 0; column < geometry_.columns; ++column) {
      const raster::CellIndex at{column, row};
      if (areas.list_at(at) == 0) {
        continue;
      }
      const std::size_t here = index(column, row);
      areas_[here].has_hard = areas.has_hard(at);
      areas_[here].has_soft = areas.has_soft(at);
      if (!areas_[here].has_hard || std::isnan(cells_[here].dilated_m)) {
        continue;
      }
      const risk::AreaIndex::Span free =
          areas.free_over(at, static_cast<double>(cells_[here].dilated_m) + floor_m_);
      // Neighbours keep clear of what this cell has to keep clear of.
      for (int r = std::max(row - reach, 0); r <= std::min(row + reach, geometry_.rows - 1); ++r) {
        for (int c = std::max(column - reach, 0);
             c <= std::min(column + reach, geometry_.columns - 1); ++c) {
          CellAreas& near = areas_[index(c, r)];
          if (free.low_m > static_cast<double>(cells_[here].dilated_m) + floor_m_) {
            near.low_m =
                std::max(near.low_m, std::nextafter(static_cast<float>(free.low_m),
                                                    std::numeric_limits<float>::infinity()));
          }
          near.high_m =
              std::min(near.high_m, std::nextafter(static_cast<float>(free.high_m),
                                                   -std::numeric_limits<float>::infinity()));
        }
      }
    }
  }
}

FlightEnvelope::Sample FlightEnvelope::sample(double x_m, double y_m) const {
  Sample here = sample_ground(x_m, y_m);
  const CellAreas* areas = areas_of(here);
  if (areas != nullptr && !here.is_in_funnel) {
    here.band.low_m = std::max(here.band.low_m, static_cast<double>(areas->low_m));
    here.band.high_m = std::min(here.band.high_m, static_cast<double>(areas->high_m));
  }
  return here;
}

const FlightEnvelope::CellAreas* FlightEnvelope::areas_of(const Sample& here) const {
  return areas_.empty() || here.nearest == nullptr ? nullptr : &areas_[number_of(*here.nearest)];
}

bool FlightEnvelope::is_in_hard_area(const Sample& here, const geo::MapPoint& point,
                                     double altitude_m) const {
  const CellAreas* areas = areas_of(here);
  return areas != nullptr && areas->has_hard &&
         costs_->areas().hard_area_at(point, altitude_m) != nullptr;
}

double FlightEnvelope::density(const Sample& here, const geo::MapPoint& point,
                               double altitude_m) const {
  const CellAreas* areas = areas_of(here);
  return density(*here.nearest,
                 areas == nullptr || !areas->has_soft ? static_cast<double>(here.nearest->semantics)
                                                      : costs_->semantics(point, altitude_m),
                 altitude_m - here.surface_m);
}

FlightEnvelope::Sample FlightEnvelope::sample_ground(double x_m, double y_m) const {
  const double column_position = (x_m - geometry_.west_m) * inverse_cell_1pm_;
  const double row_position = (y_m - geometry_.south_m) * inverse_cell_1pm_;
  // Beyond the outermost centres the margin is unknown, so the point is not flyable anyway.
  const double u = column_position - 0.5;
  const double v = row_position - 0.5;
  if (!(u >= 0.0 && u < geometry_.columns - 1 && v >= 0.0 && v < geometry_.rows - 1)) {
    return {{kNaN, kNaN}, kNaN, nullptr, false};
  }
  const int column = static_cast<int>(u);
  const int row = static_cast<int>(v);
  const double fu = u - column;
  const double fv = v - row;
  const Cell* south = &cell(column, row);
  const Cell* north = south + geometry_.columns;
  const auto mix = [&](double a, double b, double c, double d) {
    return (1.0 - fv) * ((1.0 - fu) * a + fu * b) + fv * ((1.0 - fu) * c + fu * d);
  };
  const double surface_m =
      mix(static_cast<double>(south[0].surface_m), static_cast<double>(south[1].surface_m),
          static_cast<double>(north[0].surface_m), static_cast<double>(north[1].surface_m));
  const double dilated_m =
      mix(static_cast<double>(south[0].dilated_m), static_cast<double>(south[1].dilated_m),
          static_cast<double>(north[0].dilated_m), static_cast<double>(north[1].dilated_m));
  double low_m = dilated_m + floor_m_;
  bool is_in_funnel = false;
  for (const End& end : ends_) {
    const double dx_m = x_m - end.x_m;
    const double dy_m = y_m - end.y_m;
    const double square_m2 = dx_m * dx_m + dy_m * dy_m;
    if (square_m2 < funnel_m_ * funnel_m_) {
      is_in_funnel = true;
      const double share = std::sqrt(square_m2) / funnel_m_;
      low_m = std::min(low_m, (1.0 - share) * (surface_m + end.floor_m) +
                                  share * (dilated_m + floor_m_) - kHeightTolerance_m);
    }
  }
  const Cell* nearest = (fv < 0.5 ? south : north) + (fu < 0.5 ? 0 : 1);
  return {{low_m, surface_m + ceiling_m_}, surface_m, nearest, is_in_funnel};
}

AltitudeBand FlightEnvelope::band_at(const geo::MapPoint& point) const {
  return sample(point.x_m, point.y_m).band;
}

AltitudeBand FlightEnvelope::widest_band_over_patch(raster::CellIndex south_west) const {
  const geo::MapPoint corner = geometry_.centre(south_west);
  double end_floor_m = kInfinity;
  for (const End& end : ends_) {
    // From the end to the nearest point of the patch.
    const double dx_m = end.x_m - std::clamp(end.x_m, corner.x_m, corner.x_m + geometry_.cell_m);
    const double dy_m = end.y_m - std::clamp(end.y_m, corner.y_m, corner.y_m + geometry_.cell_m);
    if (dx_m * dx_m + dy_m * dy_m <= funnel_m_ * funnel_m_) {
      end_floor_m = std::min(end_floor_m, end.floor_m);
    }
  }
  // Interpolation stays between the values at the corners; one that is unknown may weigh nothing
  // along an edge of the patch.
  AltitudeBand band{kInfinity, -kInfinity};
  for (int row = south_west.row; row <= south_west.row + 1; ++row) {
    for (int column = south_west.column; column <= south_west.column + 1; ++column) {
      const Cell& here = cell(column, row);
      if (std::isnan(here.dilated_m)) {
        continue;
      }
      const double floor_m = std::min(static_cast<double>(here.dilated_m) + floor_m_,
                                      static_cast<double>(here.surface_m) + end_floor_m);
      band.low_m = std::min(band.low_m, floor_m - kHeightTolerance_m);
      band.high_m = std::max(band.high_m, static_cast<double>(here.surface_m) + ceiling_m_);
    }
  }
  return band;
}

AltitudeBand FlightEnvelope::widest_band_over_part(raster::CellIndex south_west, double west,
                                                   double south, double east, double north) const {
  const Cell* below = &cell(south_west.column, south_west.row);
  const Cell* above = below + geometry_.columns;
  if (std::isnan(below[0].dilated_m) || std::isnan(below[1].dilated_m) ||
      std::isnan(above[0].dilated_m) || std::isnan(above[1].dilated_m)) {
    return widest_band_over_patch(south_west);
  }
  // What is interpolated has its least and greatest value over a rectangle at the corners.
  double surface_low_m = kInfinity;
  double surface_high_m = -kInfinity;
  double floor_low_m = kInfinity;
  double gap_low_m = kInfinity;  // between floor and surface
  for (const double v : {south, north}) {
    for (const double u : {west, east}) {
      const auto mix = [&](float a, float b, float c, float d) {
        return (1.0 - v) * ((1.0 - u) * static_cast<double>(a) + u * static_cast<double>(b)) +
               v * ((1.0 - u) * static_cast<double>(c) + u * static_cast<double>(d));
      };
      const double surface_m =
          mix(below[0].surface_m, below[1].surface_m, above[0].surface_m, above[1].surface_m);
      const double floor_m =
          mix(below[0].dilated_m, below[1].dilated_m, above[0].dilated_m, above[1].dilated_m) +
          floor_m_;
      surface_low_m = std::min(surface_low_m, surface_m);
      surface_high_m = std::max(surface_high_m, surface_m);
      floor_low_m = std::min(floor_low_m, floor_m);
      gap_low_m = std::min(gap_low_m, floor_m - surface_m);
    }
  }
  const geo::MapPoint corner = geometry_.centre(south_west);
  const double cell_m = geometry_.cell_m;
  AltitudeBand band{floor_low_m, surface_high_m + ceiling_m_};
  for (const End& end : ends_) {
    const double dx_m =
        end.x_m - std::clamp(end.x_m, corner.x_m + west * cell_m, corner.x_m + east * cell_m);
    const double dy_m =
        end.y_m - std::clamp(end.y_m, corner.y_m + south * cell_m, corner.y_m + north * cell_m);
    const double distance_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    if (distance_m < funnel_m_) {
      band.low_m = std::min(band.low_m, surface_low_m + end.floor_m +
                                            distance_m / funnel_m_ * (gap_low_m - end.floor_m));
    }
  }
  band.low_m -= kHeightTolerance_m;
  return band;
}

const map::Area* FlightEnvelope::area_that_closes_patch(raster::CellIndex south_west,
                                                        const AltitudeBand& band) const {
  const map::Area* closing = nullptr;
  for (int row = south_west.row; row <= south_west.row + 1; ++row) {
    for (int column = south_west.column; column <= south_west.column + 1; ++column) {
      const map::Area* area =
          areas_.empty() || !areas_[index(column, row)].has_hard
              ? nullptr
              : costs_->areas().closing({column, row}, {band.low_m, band.high_m});
      if (area == nullptr) {
        return nullptr;
      }
      closing = area;
    }
  }
  return closing;
}

bool FlightEnvelope::contains(const flight::Waypoint& point) const {
  const Sample here = sample_ground(point.x_m, point.y_m);
  return point.altitude_m >= here.band.low_m && point.altitude_m <= here.band.high_m &&
         !is_in_hard_area(here, point.point(), point.altitude_m);
}

bool FlightEnvelope::is_climb_allowed(const flight::Waypoint& a, const flight::Waypoint& b) const {
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  const double dz_m = b.altitude_m - a.altitude_m;
  const double square_m2 = dx_m * dx_m + dy_m * dy_m;
  if (slopes_.is_symmetric()) {
    const double tangent = slopes_.greatest().up;
    return square_m2 > 0.0 && dz_m * dz_m <= tangent * tangent * square_m2;
  }
  const double length_m = std::sqrt(square_m2);
  if (!(square_m2 > 0.0)) {
    return false;
  }
  const SlopeLimits::Tangents limit = slopes_.at(std::max(a.altitude_m, b.altitude_m), dx_m, dy_m);
  return dz_m <= limit.up * length_m && -dz_m <= limit.down * length_m;
}

template <typename GroundAt>
double FlightEnvelope::leg_cost_over(const flight::Waypoint& a, const flight::Waypoint& b,
                                     double step_m, const GroundAt& ground_at) const {
  if (!is_climb_allowed(a, b)) {
    return kInfinity;
  }
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  const double dz_m = b.altitude_m - a.altitude_m;
  const double leg_m = std::sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m);
  const int steps = std::max(1, static_cast<int>(std::ceil(leg_m / step_m)));
  const double share = 1.0 / steps;
  const double inverse_track_1pm = has_slope_ ? 1.0 / std::sqrt(dx_m * dx_m + dy_m * dy_m) : 0.0;
  double sum = 0.0;
  const auto add = [&](int k) {
    const double t = (k + 0.5) * share;
    const geo::MapPoint point{a.x_m + t * dx_m, a.y_m + t * dy_m};
    const Sample& here = ground_at(point, k, steps);
    const double altitude_m = a.altitude_m + t * dz_m;
    if (!(altitude_m >= here.band.low_m && altitude_m <= here.band.high_m) ||
        (here.is_in_funnel && is_in_hard_area(here, point, altitude_m))) {
      return false;
    }
    sum += density(here, point, altitude_m);
    if (has_slope_) {
      sum += costs_->slope_density(number_of(*here.nearest), dx_m * inverse_track_1pm,
                                   dy_m * inverse_track_1pm);
    }
    return true;
  };
  // Legs between two good states fail in the middle, if anywhere: begin there.
  const int middle = steps / 2;
  for (int k = middle; k < steps; ++k) {
    if (!add(k)) {
      return kInfinity;
    }
  }
  for (int k = middle - 1; k >= 0; --k) {
    if (!add(k)) {
      return kInfinity;
    }
  }
  const double cost_m = sum * share * leg_m;
  return has_wires_ ? cost_m + costs_->wire_cost_m(a.point(), b.point()) : cost_m;
}

double FlightEnvelope::leg_cost_m(const flight::Waypoint& a, const flight::Waypoint& b) const {
  return leg_cost_m(a, b, check_step_m_);
}

double FlightEnvelope::leg_cost_m(const flight::Waypoint& a, const flight::Waypoint& b,
                                  double step_m) const {
  return leg_cost_over(a, b, step_m, [&](const geo::MapPoint& point, int, int) {
    return sample(point.x_m, point.y_m);
  });
}

void FlightEnvelope::leg_costs_m(const geo::MapPoint& a, const std::vector<double>& from_m,
                                 const geo::MapPoint& b, const std::vector<double>& to_m,
                                 std::vector<double>& costs_m) const {
  // Altitudes count for the length of a leg, and so for its number of steps, though seldom.
  std::vector<Sample> ground;
  std::vector<bool> is_known;
  const auto ground_at = [&](const geo::MapPoint& point, int k, int steps) -> const Sample& {
    const auto at = static_cast<std::size_t>(k);
    if (ground.size() != static_cast<std::size_t>(steps)) {
      ground.resize(static_cast<std::size_t>(steps));
      is_known.assign(static_cast<std::size_t>(steps), false);
    }
    if (!is_known[at]) {
      ground[at] = sample(point.x_m, point.y_m);
      is_known[at] = true;
    }
    return ground[at];
  };
  costs_m.clear();
  for (const double first_m : from_m) {
    for (const double last_m : to_m) {
      costs_m.push_back(
          leg_cost_over({a.x_m, a.y_m, first_m}, {b.x_m, b.y_m, last_m}, check_step_m_, ground_at));
    }
  }
}

double FlightEnvelope::density_at(const flight::Waypoint& point, double east, double north) const {
  const Sample here = sample(point.x_m, point.y_m);
  if (!(point.altitude_m >= here.band.low_m && point.altitude_m <= here.band.high_m)) {
    return kInfinity;
  }
  const double density = this->density(*here.nearest, static_cast<double>(here.nearest->semantics),
                                       point.altitude_m - here.surface_m);
  return has_slope_ ? density + costs_->slope_density(number_of(*here.nearest), east, north)
                    : density;
}

bool FlightEnvelope::is_clear(const flight::Waypoint& a, const flight::Waypoint& b) const {
  if (!is_climb_allowed(a, b) || !contains(a) || !contains(b)) {
    return false;
  }
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  const double dz_m = b.altitude_m - a.altitude_m;
  const double step = final_check_step_m_ / std::sqrt(dx_m * dx_m + dy_m * dy_m);
  struct Gaps {
    double below_m, above_m;
  };
  const auto gaps_at = [&](double t) {
    const Sample here = sample_ground(a.x_m + t * dx_m, a.y_m + t * dy_m);
    const double altitude_m = a.altitude_m + t * dz_m;
    const CellAreas* areas = areas_of(here);
    if (areas != nullptr && !here.is_in_funnel &&
        !(altitude_m >= static_cast<double>(areas->low_m) &&
          altitude_m <= static_cast<double>(areas->high_m))) {
      return Gaps{-kInfinity, -kInfinity};
    }
    return Gaps{altitude_m - here.band.low_m, here.band.high_m - altitude_m};
  };
  // Least value on [0, 1] of the parabola through (0, f0), (1/2, fm), (1, f1).
  const auto least = [](double f0, double fm, double f1) {
    const double quadratic = 2.0 * (f0 + f1) - 4.0 * fm;
    const double linear = 4.0 * fm - 3.0 * f0 - f1;
    double value = std::min(f0, f1);
    if (quadratic > 0.0 && linear < 0.0 && -linear < 2.0 * quadratic) {
      value = std::min(value, f0 - linear * linear / (4.0 * quadratic));
    }
    return value;
  };
  // Share of the leg at which it crosses the next line through cell centres, per axis.
  const auto first_crossing = [&](double position_m, double origin_m, double delta_m) {
    const double place = (position_m - origin_m) * inverse_cell_1pm_ - 0.5;
    return delta_m > 0.0 ? std::floor(place) + 1.0 : std::ceil(place) - 1.0;
  };
  double line_x = first_crossing(a.x_m, geometry_.west_m, dx_m);
  double line_y = first_crossing(a.y_m, geometry_.south_m, dy_m);
  const auto share_of = [&](double line, double position_m, double origin_m, double delta_m) {
    return delta_m == 0.0 ? kInfinity
                          : (origin_m + (line + 0.5) * geometry_.cell_m - position_m) / delta_m;
  };
  double next_x = share_of(line_x, a.x_m, geometry_.west_m, dx_m);
  double next_y = share_of(line_y, a.y_m, geometry_.south_m, dy_m);
  double t = 0.0;
  Gaps before = gaps_at(0.0);
  while (t < 1.0) {
    double end = std::min(t + step, 1.0);
    if (next_x <= t) {
      line_x += dx_m > 0.0 ? 1.0 : -1.0;
      next_x = share_of(line_x, a.x_m, geometry_.west_m, dx_m);
      continue;
    }
    if (next_y <= t) {
      line_y += dy_m > 0.0 ? 1.0 : -1.0;
      next_y = share_of(line_y, a.y_m, geometry_.south_m, dy_m);
      continue;
    }
    end = std::min(end, std::min(next_x, next_y));
    const Gaps middle = gaps_at(0.5 * (t + end));
    const Gaps after = gaps_at(end);
    // Written so that NaN fails.
    if (!(least(before.below_m, middle.below_m, after.below_m) >= 0.0 &&
          least(before.above_m, middle.above_m, after.above_m) >= 0.0 && middle.below_m >= 0.0 &&
          middle.above_m >= 0.0)) {
      return false;
    }
    before = after;
    t = end;
  }
  return areas_.empty() || costs_->areas().hard_area_on(a, b) == nullptr;
}

double FlightEnvelope::spare_share(const geo::MapPoint& point) const {
  double share = 1.0;
  for (const End& end : ends_) {
    const double dx_m = point.x_m - end.x_m;
    const double dy_m = point.y_m - end.y_m;
    share = std::min(share, (dx_m * dx_m + dy_m * dy_m) / (funnel_m_ * funnel_m_));
  }
  return share;
}

std::vector<double> FlightEnvelope::crossings(const geo::MapPoint& a,
                                              const geo::MapPoint& b) const {
  std::vector<double> shares;
  const auto add = [&](double from_m, double to_m, double origin_m) {
    if (from_m == to_m) {
      return;
    }
    const double from = (from_m - origin_m) * inverse_cell_1pm_ - 0.5;
    const double to = (to_m - origin_m) * inverse_cell_1pm_ - 0.5;
    const double last = std::ceil(std::max(from, to));
    for (double line = std::floor(std::min(from, to)) + 1.0; line < last; line += 1.0) {
      shares.push_back((line - from) / (to - from));
    }
  };
  add(a.x_m, b.x_m, geometry_.west_m);
  add(a.y_m, b.y_m, geometry_.south_m);
  std::sort(shares.begin(), shares.end());
  return shares;
}

FlightEnvelope::Arrival FlightEnvelope::follow(const geo::MapPoint& a, const geo::MapPoint& b,
                                               const AltitudeBand& altitudes,
                                               const FollowRules& rules, double owed_m) const {
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  const double leg_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
  const int steps = std::max(1, static_cast<int>(std::ceil(leg_m / rules.step_m)));
  const double inverse_leg_1pm = has_slope_ && leg_m > 0.0 ? 1.0 / leg_m : 0.0;
  Arrival result{altitudes, 0.0, owed_m};
  double sum = 0.0;
  double climbs_m = 0.0;
  // To the next place, `share` of the leg farther; false if no altitude is left there.
  const auto advance = [&](double t, double share) {
    const geo::MapPoint point{a.x_m + t * dx_m, a.y_m + t * dy_m};
    const double way_m = rules.climb_share * leg_m * share;
    double rise_m = 0.0;
    double fall_m = 0.0;
    if (slopes_.is_symmetric()) {
      rise_m = rules.climb_share * slopes_.greatest().up * leg_m * share;
      fall_m = rise_m;
    } else if (rules.is_backward) {
      // Before the highest altitude the flight was up to so much higher, before the lowest lower.
      const double high_m = result.altitudes.high_m + slopes_.greatest().down * way_m;
      rise_m = slopes_.at(high_m, -dx_m, -dy_m).down * way_m;
      fall_m = slopes_.at(result.altitudes.low_m, -dx_m, -dy_m).up * way_m;
    } else {
      const double high_m = result.altitudes.high_m + slopes_.greatest().up * way_m;
      rise_m = slopes_.at(high_m, dx_m, dy_m).up * way_m;
      fall_m = slopes_.at(result.altitudes.low_m, dx_m, dy_m).down * way_m;
    }
    const Sample here = sample(point.x_m, point.y_m);
    const double margin_m = rules.margin_m * spare_share(point);
    const double before_m = result.altitudes.low_m;
    result.altitudes.low_m = std::max(result.altitudes.low_m - fall_m, here.band.low_m + margin_m);
    result.altitudes.high_m =
        std::min(result.altitudes.high_m + rise_m, here.band.high_m - margin_m);
    // Unknown ground leaves NaN in the band, which max and min would lose.
    if (!(result.altitudes.low_m <= result.altitudes.high_m) || here.nearest == nullptr ||
        !here.band.is_flyable() ||
        (here.is_in_funnel && is_in_hard_area(here, point, result.altitudes.low_m))) {
      return false;
    }
    const double low_density = density(here, point, result.altitudes.low_m);
    sum += share * low_density;
    if (has_slope_) {
      sum += share * costs_->slope_density(number_of(*here.nearest), dx_m * inverse_leg_1pm,
                                           dy_m * inverse_leg_1pm);
    }
    if (rules.counts_climbs && rise_m > 0.0) {
      const double owed_before_m = result.owed_m;
      result.owed_m = std::max(0.0, owed_before_m + (result.altitudes.low_m - before_m) - rise_m);
      if (result.owed_m > owed_before_m) {
        const double per_metre =
            (density(here, point, result.altitudes.low_m + kHigher_m) - low_density) / kHigher_m;
        // What is owed more raises the flight on the climb so far and on the level before it.
        const double area_m2 = 0.5 * (result.owed_m + owed_before_m) * leg_m * share *
                               (1.0 + (result.owed_m - owed_before_m) / rise_m);
        climbs_m += std::max(per_metre, 0.0) * area_m2;
      }
    }
    return true;
  };
  const Arrival none{{kInfinity, -kInfinity}, kInfinity};
  if (rules.at_crossings) {
    std::vector<double> shares = crossings(a, b);
    for (int k = 1; k <= steps; ++k) {
      shares.push_back(static_cast<double>(k) / steps);
    }
    std::sort(shares.begin(), shares.end());
    double before = 0.0;
    for (const double t : shares) {
      if (!advance(t, t - before)) {
        return none;
      }
      before = t;
    }
  } else {
    for (int k = 1; k <= steps; ++k) {
      if (!advance(static_cast<double>(k) / steps, 1.0 / steps)) {
        return none;
      }
    }
  }
  result.cost_m = sum * leg_m + climbs_m;
  if (has_wires_) {
    result.cost_m += costs_->wire_cost_m(a, b);
  }
  return result;
}

double FlightEnvelope::low_density(raster::CellIndex at) const {
  const Cell& here = cell(at.column, at.row);
  double lowest_m = static_cast<double>(here.dilated_m) + floor_m_;
  const double surface_m = static_cast<double>(here.surface_m);
  double highest_m = surface_m + ceiling_m_;
  if (!areas_.empty()) {
    const CellAreas& areas = areas_[index(at.column, at.row)];
    lowest_m = std::max(lowest_m, static_cast<double>(areas.low_m));
    highest_m = std::min(highest_m, static_cast<double>(areas.high_m));
  }
  if (!(lowest_m <= highest_m)) {
    return kInfinity;
  }
  return density(here, static_cast<double>(here.semantics), lowest_m - surface_m);
}

double FlightEnvelope::least_density(raster::CellIndex at) const {
  const double west_m = geometry_.west_m + geometry_.cell_m * at.column;
  const double south_m = geometry_.south_m + geometry_.cell_m * at.row;
  double end_floor_m = kInfinity;
  for (const End& end : ends_) {
    const double dx_m = end.x_m - std::clamp(end.x_m, west_m, west_m + geometry_.cell_m);
    const double dy_m = end.y_m - std::clamp(end.y_m, south_m, south_m + geometry_.cell_m);
    if (dx_m * dx_m + dy_m * dy_m <= funnel_m_ * funnel_m_) {
      end_floor_m = std::min(end_floor_m, end.floor_m);
    }
  }
  // The floor's height over the surface is bilinear over each quarter of the cell, hence least at a
  // corner of one: in the centre, half way to a neighbour or between four.
  const auto margin_m = [&](int column, int row) {
    if (column < 0 || row < 0 || column >= geometry_.columns || row >= geometry_.rows) {
      return kNaN;
    }
    const Cell& here = cell(column, row);
    return static_cast<double>(here.dilated_m) - static_cast<double>(here.surface_m);
  };
  const double centre_m = margin_m(at.column, at.row);
  double least_m = kInfinity;
  for (const int dx : {-1, 1}) {
    for (const int dy : {-1, 1}) {
      const double aside_m = margin_m(at.column + dx, at.row);
      const double along_m = margin_m(at.column, at.row + dy);
      const double four_m =
          0.25 * (centre_m + aside_m + along_m + margin_m(at.column + dx, at.row + dy));
      if (!std::isnan(four_m)) {  // else nothing flies over this quarter
        least_m = std::min(
            {least_m, centre_m, 0.5 * (centre_m + aside_m), 0.5 * (centre_m + along_m), four_m});
      }
    }
  }
  const bool is_flyable = least_m < kInfinity;
  const double floor_m = least_m + floor_m_;
  const double height_m = std::min(floor_m, end_floor_m) - kHeightTolerance_m;
  if (!is_flyable || height_m > ceiling_m_) {
    return kInfinity;
  }
  const Cell& here = cell(at.column, at.row);
  const double least = costs_->density_rule().least_above(
      visibilities_of(here), static_cast<double>(costs_->land_use_layer().at(at)), height_m);
  return has_threats_ ? least + costs_->threat_density(number_of(here), height_m) : least;
}

double FlightEnvelope::density(const Cell& at, double semantics, double height_m) const {
  const double sum = costs_->density_rule()(visibilities_of(at), semantics, height_m) +
                     static_cast<double>(at.avoidance);
  return has_threats_ ? sum + costs_->threat_density(number_of(at), height_m) : sum;
}

bool FlightEnvelope::is_turn_allowed(double first_x_m, double first_y_m, double second_x_m,
                                     double second_y_m) const {
  const double first_m2 = first_x_m * first_x_m + first_y_m * first_y_m;
  const double second_m2 = second_x_m * second_x_m + second_y_m * second_y_m;
  const double cosine =
      (first_x_m * second_x_m + first_y_m * second_y_m) / std::sqrt(first_m2 * second_m2);
  if (!(cosine >= turn_cosine_min_)) {
    return false;
  }
  const double radius_m = turns_.radius_m(first_x_m, first_y_m, second_x_m, second_y_m);
  if (!(radius_m > 0.0)) {
    return true;
  }
  // tan^2(turn / 2) = (1 - cos) / (1 + cos)
  return radius_m * radius_m * std::max(1.0 - cosine, 0.0) <=
         0.25 * std::min(first_m2, second_m2) * (1.0 + cosine);
}

}  // namespace hedgehop::global_planning
