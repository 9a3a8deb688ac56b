#pragma once

#include <array>
#include <limits>
#include <optional>
#include <vector>

#include "flight/route.hpp"
#include "global_planning/global_planner.hpp"
#include "global_planning/slope_limits.hpp"
#include "raster/grid.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::global_planning {

/// Highest surface around each cell centre, such that bilinear interpolation keeps the margin:
///
///     bilinear(result, p) >= bilinear(surface, q)   for all q with |q - p| <= margin_m
///
/// The result takes the greatest value over all cell offsets b with (max(|bx| - 1, 0))^2 +
/// (max(|by| - 1, 0))^2 < (margin / cell)^2. Why that is enough: with d = (q - p) / cell, the
/// weights of bilinear interpolation at p and at q can be paired, axis by axis, so that only the
/// offsets floor(d) and ceil(d) occur; each of them lies less than one cell from d in both axes.
///
/// NaN where one of these cells is NaN or outside the raster: unknown ground may hide anything.
/// O(cells * margin / cell).
raster::Grid<float> dilated_surface(const raster::Grid<float>& surface_m, double margin_m);

/// Altitudes that may be flown over one point [m AMSL]; NaN over unknown ground.
struct AltitudeBand {
  double low_m = 0.0;
  double high_m = 0.0;

  /// False for NaN as well.
  [[nodiscard]] bool is_flyable() const { return low_m <= high_m; }
};

/// Where a route may run and what it costs there: the terms of the search between one start and one
/// goal. Immutable, safe for concurrent use.
///
/// The band over a point p is [dilated surface + envelope_floor_m, surface + envelope_ceiling_m],
/// both interpolated bilinearly. A start or goal is usually lower than that (at reference height,
/// and on a slope perhaps lower than the ground beside it), so the floor is a funnel around each of
/// them: at horizontal distance r < end_funnel_m it is the mixture (1 - u) (surface + min(height of
/// the end, floor)) + u (dilated surface + floor) with u = r / end_funnel_m. Hence no route is ever
/// closer to the interpolated surface below than the lower of floor and end height.
///
/// Hard areas narrow the band to the lowest air that is free of them within lateral_margin_m (by
/// whole cells); inside the funnels there is no such margin, but the areas themselves are never
/// entered. Soft areas cost by the altitude flown.
class FlightEnvelope {
 public:
  /// `costs` must outlive the envelope.
  FlightEnvelope(const risk::CostModel& costs, const GlobalOptions& options,
                 const flight::Waypoint& start, const flight::Waypoint& goal);

  /// The same heights, limits and areas under the costs of another model of the same map: nothing
  /// is computed anew, and nothing is avoided.
  FlightEnvelope(const FlightEnvelope& ground, const risk::CostModel& costs);

  /// The same with another start or goal.
  void move_start(const flight::Waypoint& start);
  void move_goal(const flight::Waypoint& goal);

  /// The leg that routes from the start continue; its corner is one of theirs.
  void continue_from(const std::optional<LeadIn>& lead_in) { lead_in_ = lead_in; }
  /// A place on that leg, as far behind the start as the leg is long; none if it is free.
  [[nodiscard]] std::optional<flight::Waypoint> before_start() const;
  /// Whether a route may leave the start along this horizontal vector.
  [[nodiscard]] bool may_leave_start(double x_m, double y_m) const {
    return !lead_in_ || is_turn_allowed(lead_in_->x_m, lead_in_->y_m, x_m, y_m);
  }

  /// From now on each metre over cells whose centre lies within `within_m` of the route, seen from
  /// above, costs `cost` more; where several calls meet, the greatest of theirs. Searches feel it,
  /// the bounds of least_density() do not: they hold without it.
  void avoid(const std::vector<flight::Waypoint>& route, double within_m, double cost);

  /// The total of risk::CostModel::route_cost() and what avoid() adds, midpoint rule with steps of
  /// at most `step_m`.
  [[nodiscard]] double route_cost_m(const std::vector<flight::Waypoint>& route,
                                    double step_m) const;

  [[nodiscard]] const risk::CostModel& costs() const { return *costs_; }
  [[nodiscard]] const raster::GridGeometry& geometry() const { return geometry_; }
  [[nodiscard]] const flight::Waypoint& start() const { return start_; }
  [[nodiscard]] const flight::Waypoint& goal() const { return goal_; }

  /// The band over a point; NaN over unknown ground and outside the map.
  [[nodiscard]] AltitudeBand band_at(const geo::MapPoint& point) const;
  [[nodiscard]] bool contains(const flight::Waypoint& point) const;

  /// Whether the straight leg, flown from a to b, keeps slopes(). Legs without horizontal length do
  /// not.
  [[nodiscard]] bool is_climb_allowed(const flight::Waypoint& a, const flight::Waypoint& b) const;

  /// Cost of a straight leg, midpoint rule with steps of at most check_step_m, wires exactly, or
  /// infinity if a midpoint leaves the band or the climb angle is too steep. About 15 ns a step.
  [[nodiscard]] double leg_cost_m(const flight::Waypoint& a, const flight::Waypoint& b) const;
  /// The same with steps of at most `step_m`.
  [[nodiscard]] double leg_cost_m(const flight::Waypoint& a, const flight::Waypoint& b,
                                  double step_m) const;

  /// leg_cost_m(), to the last bit, of the legs from each altitude over a to each one over b, those
  /// from the first altitude first; what they have below them is looked at once. About 5 ns a step
  /// where there are many.
  void leg_costs_m(const geo::MapPoint& a, const std::vector<double>& from_m,
                   const geo::MapPoint& b, const std::vector<double>& to_m,
                   std::vector<double>& costs_m) const;

  /// Cost per metre at a point for a flight in the horizontal direction (east, north), a unit
  /// vector [-], or infinity where it leaves the band: the integrand of leg_cost_m(), for legs that
  /// are not straight. Wires are left out.
  [[nodiscard]] double density_at(const flight::Waypoint& point, double east, double north) const;

  /// Where a flight along the straight ground track from a to b may arrive.
  struct Arrival {
    AltitudeBand altitudes;  // all that can be had at b; not flyable if none
    double cost_m = 0.0;     // for the lowest of them all along the track
    double owed_m = 0.0;     // with counts_climbs: what the flight is higher by before b
  };
  struct FollowRules {
    double step_m;              // the band is looked at this densely
    double margin_m;            // and kept with this to spare, less inside the funnels
    double climb_share;         // of the climb limit
    bool at_crossings = false;  // look at the crossings() of the leg too
    bool is_backward = false;   // the flight comes from b: altitudes at b that lead to `altitudes`
    /// Where the lowest altitudes rise faster than a flight can, it was higher before. Add what
    /// that cost: on the rise, and as if the ground before were level, by what a metre of height
    /// costs here.
    bool counts_climbs = false;
  };
  /// Exact propagation of altitude intervals: the flight may have any of `altitudes` at a, and
  /// climbs or sinks within the limit between the places where the band is looked at. About 15 ns a
  /// place.
  ///
  /// @param owed_m  what the flight was already higher by at a than the lowest of `altitudes`.
  [[nodiscard]] Arrival follow(const geo::MapPoint& a, const geo::MapPoint& b,
                               const AltitudeBand& altitudes, const FollowRules& rules,
                               double owed_m = 0.0) const;

  /// Where the straight leg crosses lines through cell centres, ascending shares of it in (0, 1).
  /// Between them the surface along the leg has no crest that is sharper than a parabola.
  [[nodiscard]] std::vector<double> crossings(const geo::MapPoint& a, const geo::MapPoint& b) const;

  /// How much of a spare to the band may be asked for at a place: all of it outside the funnels,
  /// less with the square of the distance inside, nothing at start and goal. With more, a level
  /// take-off would not be a flight.
  [[nodiscard]] double spare_share(const geo::MapPoint& point) const;

  [[nodiscard]] const SlopeLimits& slopes() const { return slopes_; }

  /// What a metre costs over a cell as low as its centre may be flown over [-]; infinity where it
  /// may not. >= 1. The slope is left out: it depends on the direction.
  [[nodiscard]] double low_density(raster::CellIndex at) const;

  /// No metre of any route costs less than this over any place of the cell [-]; infinity where no
  /// place of the cell may be flown over. >= 1. Height enters by the least that the envelope
  /// admits between the cell and its neighbours, visibility by the least at or above that height,
  /// soft ceiling and threats by that height, as they do not fall above it; slope and wires do not
  /// enter, since some direction has no slope and poles cost nothing.
  [[nodiscard]] double least_density(raster::CellIndex at) const;

  /// Whether the whole straight leg keeps band and climb limit: between the lines through cell
  /// centres the band is a quadratic function along the leg, so its least distance is found
  /// exactly. Inside the funnels the quadratic is an interpolation over at most final_check_step_m.
  [[nodiscard]] bool is_clear(const flight::Waypoint& a, const flight::Waypoint& b) const;

  /// Whether a corner between two legs, given by their horizontal vectors, may be flown: the turn
  /// is at most turn_angle_max and, if turn_radius_m > 0, the tangents of the arc with the radius
  /// R of turns() fit into half of each leg: R tan(turn / 2) <= min(|first|, |second|) / 2.
  [[nodiscard]] bool is_turn_allowed(double first_x_m, double first_y_m, double second_x_m,
                                     double second_y_m) const;

  /// A band that holds every altitude that may be flown anywhere over one patch, the square between
  /// the centre of a cell and those of its eastern, northern and north-eastern neighbours; not
  /// flyable if there is none. All four must be inside the map. Areas are left out, see below.
  [[nodiscard]] AltitudeBand widest_band_over_patch(raster::CellIndex south_west) const;
  /// The same over a part of the patch, as shares of its side from south-west; not above any band
  /// there, and seldom far below.
  [[nodiscard]] AltitudeBand widest_band_over_part(raster::CellIndex south_west, double west,
                                                   double south, double east, double north) const;

  /// A hard area that takes part in closing the patch, if each of its four cells is held by one as
  /// a whole at all altitudes of `band`; else null.
  [[nodiscard]] const map::Area* area_that_closes_patch(raster::CellIndex south_west,
                                                        const AltitudeBand& band) const;

 private:
  struct Cell {
    float surface_m;
    float dilated_m;
    float semantics;
    float avoidance;  // cost per metre beside eq. (1)
  };
  // What areas mean over a cell.
  struct CellAreas {
    float low_m = -std::numeric_limits<float>::infinity();  // free of hard ones, with the margin
    float high_m = std::numeric_limits<float>::infinity();
    bool has_hard = false;  // touched by one
    bool has_soft = false;
  };
  struct Sample {
    AltitudeBand band;
    double surface_m;
    const Cell* nearest;
    bool is_in_funnel;
  };
  struct End {
    double x_m, y_m, floor_m;
  };

  void sink_floor(std::size_t end, const flight::Waypoint& place);
  // leg_cost_m() with the sample at each step's middle from `ground_at`(point, step, steps).
  template <typename GroundAt>
  [[nodiscard]] double leg_cost_over(const flight::Waypoint& a, const flight::Waypoint& b,
                                     double step_m, const GroundAt& ground_at) const;
  [[nodiscard]] std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(geometry_.columns) +
           static_cast<std::size_t>(column);
  }
  [[nodiscard]] const Cell& cell(int column, int row) const { return cells_[index(column, row)]; }
  [[nodiscard]] std::size_t number_of(const Cell& at) const {
    return static_cast<std::size_t>(&at - cells_.data());
  }
  [[nodiscard]] const float* visibilities_of(const Cell& at) const {
    return costs_->visibilities(number_of(at));
  }
  [[nodiscard]] double density(const Cell& at, double semantics, double height_m) const;
  // The band between ground and ceiling alone.
  [[nodiscard]] Sample sample_ground(double x_m, double y_m) const;
  // The same without what hard areas take.
  [[nodiscard]] Sample sample(double x_m, double y_m) const;
  // Null without areas and over unknown ground.
  [[nodiscard]] const CellAreas* areas_of(const Sample& here) const;
  // Cost of a metre and whether a hard area holds the place, which sample() leaves open in funnels.
  [[nodiscard]] double density(const Sample& here, const geo::MapPoint& point,
                               double altitude_m) const;
  [[nodiscard]] bool is_in_hard_area(const Sample& here, const geo::MapPoint& point,
                                     double altitude_m) const;
  void take_areas(const GlobalOptions& options);

  const risk::CostModel* costs_;
  raster::GridGeometry geometry_;
  std::vector<Cell> cells_;
  std::vector<CellAreas> areas_;  // as cells_; empty without areas
  bool has_avoidance_ = false;
  bool has_threats_, has_slope_, has_wires_;  // of costs_
  double inverse_cell_1pm_;
  double floor_m_;
  double ceiling_m_;
  double check_step_m_;
  double final_check_step_m_;
  SlopeLimits slopes_;
  double turn_cosine_min_;
  TurnLimit turns_;
  double funnel_m_;
  flight::Waypoint start_;
  flight::Waypoint goal_;
  std::optional<LeadIn> lead_in_;
  std::array<End, 2> ends_;
};

}  // namespace hedgehop::global_planning
