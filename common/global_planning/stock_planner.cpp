#include "global_planning/stock_planner.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <ompl/base/MotionValidator.h>
#include <ompl/base/Planner.h>
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateSampler.h>
#include <ompl/base/objectives/PathLengthOptimizationObjective.h>
#include <ompl/base/samplers/InformedStateSampler.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/base/spaces/SO2StateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/planners/informedtrees/ABITstar.h>
#include <ompl/geometric/planners/informedtrees/AITstar.h>
#include <ompl/geometric/planners/informedtrees/BITstar.h>
#include <ompl/geometric/planners/prm/PRMstar.h>
#include <ompl/geometric/planners/rrt/InformedRRTstar.h>
#include <ompl/geometric/planners/rrt/RRTstar.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>
#include <optional>
#include <stdexcept>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "global_planning/bit_star.hpp"
#include "global_planning/dubins_path.hpp"

namespace hedgehop::global_planning {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;
using flight::Waypoint;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// An exact heuristic makes the library prune start and goal of trivial problems.
constexpr double kHeuristicShare = 0.999;
constexpr int kDrawsMax = 10000;
// Chords of a Dubins curve are shorter than their arcs, so they climb a little more steeply.
constexpr double kChordSpare = 1e-4;

using Vector3 = ob::RealVectorStateSpace::StateType;

Waypoint waypoint_of(const Vector3& vector) {
  return {vector.values[0], vector.values[1], vector.values[2]};
}

void assign(Vector3& vector, const Waypoint& waypoint) {
  vector.values[0] = waypoint.x_m;
  vector.values[1] = waypoint.y_m;
  vector.values[2] = waypoint.altitude_m;
}

double distance_m(const Waypoint& a, const Waypoint& b) {
  const double dx_m = a.x_m - b.x_m;
  const double dy_m = a.y_m - b.y_m;
  const double dz_m = a.altitude_m - b.altitude_m;
  return std::sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m);
}

/// What a state is and what lies between two of them.
class Frame {
 public:
  virtual ~Frame() = default;
  [[nodiscard]] virtual Waypoint waypoint(const ob::State* state) const = 0;
  virtual void assign_state(ob::State* state, const Waypoint& waypoint,
                            double heading_math_rad) const = 0;
  /// Eq. (1), infinity where samples leave the envelope or the climb limit.
  [[nodiscard]] virtual double cost_m(const ob::State* from, const ob::State* to) const = 0;
  /// Adds the way behind `from`, up to and with `to`.
  virtual void append(const ob::State* from, const ob::State* to,
                      std::vector<Waypoint>& route) const = 0;
};

bool is_clear(const FlightEnvelope& envelope, const std::vector<Waypoint>& route) {
  for (std::size_t i = 1; i < route.size(); ++i) {
    if (!envelope.is_clear(route[i - 1], route[i])) {
      return false;
    }
  }
  return true;
}

class StraightFrame final : public Frame {
 public:
  explicit StraightFrame(const FlightEnvelope& envelope) : envelope_(&envelope) {}
  [[nodiscard]] Waypoint waypoint(const ob::State* state) const override {
    return waypoint_of(*state->as<Vector3>());
  }
  void assign_state(ob::State* state, const Waypoint& waypoint, double) const override {
    assign(*state->as<Vector3>(), waypoint);
  }
  [[nodiscard]] double cost_m(const ob::State* from, const ob::State* to) const override {
    return envelope_->leg_cost_m(waypoint(from), waypoint(to));
  }
  void append(const ob::State*, const ob::State* to, std::vector<Waypoint>& route) const override {
    route.push_back(waypoint(to));
  }

 private:
  const FlightEnvelope* envelope_;
};

/// The distance by which planners choose neighbours counts altitude as the way that it takes to
/// climb or sink so far: near but steep edges are none.
double neighbour_distance_m(const Waypoint& a, const Waypoint& b, double climb_cotangent) {
  const double dx_m = a.x_m - b.x_m;
  const double dy_m = a.y_m - b.y_m;
  const double dz_m = climb_cotangent * (a.altitude_m - b.altitude_m);
  return std::sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m);
}

/// Position.
class ClimbSpace final : public ob::RealVectorStateSpace {
 public:
  explicit ClimbSpace(double climb_tangent_max)
      : ob::RealVectorStateSpace(3), climb_cotangent_(1.0 / climb_tangent_max) {}
  double distance(const ob::State* a, const ob::State* b) const override {
    return neighbour_distance_m(waypoint_of(*a->as<StateType>()), waypoint_of(*b->as<StateType>()),
                                climb_cotangent_);
  }

 private:
  double climb_cotangent_;
};

class DubinsFrame final : public Frame {
 public:
  DubinsFrame(const FlightEnvelope& envelope, const GlobalOptions& options, double radius_m)
      : envelope_(&envelope),
        cost_step_m_(options.check_step_m),
        route_step_m_(options.final_check_step_m),
        radius_m_(radius_m),
        slopes_(envelope.slopes()) {
    if (!(radius_m > 0.0)) {
      throw std::invalid_argument("Dubins curves need a radius above 0, not " +
                                  std::to_string(radius_m));
    }
  }

  [[nodiscard]] Waypoint waypoint(const ob::State* state) const override {
    return waypoint_of(*state->as<ob::CompoundState>()->as<Vector3>(0));
  }
  void assign_state(ob::State* state, const Waypoint& waypoint,
                    double heading_math_rad) const override {
    auto* parts = state->as<ob::CompoundState>();
    assign(*parts->as<Vector3>(0), waypoint);
    parts->as<ob::SO2StateSpace::StateType>(1)->value = wrap_to_pi(heading_math_rad);
  }
  [[nodiscard]] double heading_math_rad(const ob::State* state) const {
    return state->as<ob::CompoundState>()->as<ob::SO2StateSpace::StateType>(1)->value;
  }

  [[nodiscard]] DubinsPath path(const ob::State* from, const ob::State* to) const {
    return shortest_dubins_path(pose(from), pose(to), radius_m_);
  }

  // Midpoint rule along each part; on arcs the heading is turned from sample to sample.
  [[nodiscard]] double cost_m(const ob::State* from, const ob::State* to) const override {
    const DubinsPath curve = path(from, to);
    const double plan_m = curve.length_m();
    const Waypoint a = waypoint(from);
    const double dz_m = waypoint(to).altitude_m - a.altitude_m;
    const SlopeLimits::Tangents limit =
        slopes_.at_most(std::max(a.altitude_m, a.altitude_m + dz_m));
    constexpr double kShare = 1.0 - kChordSpare;
    if (!(plan_m > 0.0) || dz_m > limit.up * kShare * plan_m ||
        -dz_m > limit.down * kShare * plan_m) {
      return kInfinity;
    }
    const double slope = dz_m / plan_m;
    Waypoint at = a;
    const double heading_rad = heading_math_rad(from);
    double cosine = elementary::cos(heading_rad);
    double sine = elementary::sin(heading_rad);
    double begin_m = 0.0;
    double sum_m = 0.0;
    double wires_m = 0.0;
    geo::MapPoint before = a.point();
    for (int part = 0; part < 3; ++part) {
      const double part_m = curve.parts_m[static_cast<std::size_t>(part)];
      if (!(part_m > 0.0)) {
        continue;
      }
      const int turn = turn_of(curve.word, part);
      const int steps = std::max(1, static_cast<int>(std::ceil(part_m / cost_step_m_)));
      const double step_m = part_m / steps;
      double densities = 0.0;
      const auto add = [&](double x_m, double y_m, int k) {
        densities += envelope_->density_at(
            {x_m, y_m, a.altitude_m + slope * (begin_m + (k + 0.5) * step_m)}, cosine, sine);
        wires_m += wire_cost_m(before, {x_m, y_m});
        before = {x_m, y_m};
        return densities < kInfinity;
      };
      if (turn == 0) {
        for (int k = 0; k < steps; ++k) {
          const double along_m = (k + 0.5) * step_m;
          if (!add(at.x_m + along_m * cosine, at.y_m + along_m * sine, k)) {
            return kInfinity;
          }
        }
        at.x_m += part_m * cosine;
        at.y_m += part_m * sine;
      } else {
        const double signed_m = turn * radius_m_;
        const double centre_x_m = at.x_m - signed_m * sine;
        const double centre_y_m = at.y_m + signed_m * cosine;
        const double half_rad = 0.5 * step_m / signed_m;
        const double half_cosine = elementary::cos(half_rad);
        const double half_sine = elementary::sin(half_rad);
        const auto turn_on = [&] {
          const double turned = cosine * half_cosine - sine * half_sine;
          sine = sine * half_cosine + cosine * half_sine;
          cosine = turned;
        };
        for (int k = 0; k < steps; ++k) {
          turn_on();
          if (!add(centre_x_m + signed_m * sine, centre_y_m - signed_m * cosine, k)) {
            return kInfinity;
          }
          turn_on();
        }
        at.x_m = centre_x_m + signed_m * sine;
        at.y_m = centre_y_m - signed_m * cosine;
      }
      sum_m += densities * step_m;
      begin_m += part_m;
    }
    wires_m += wire_cost_m(before, waypoint(to).point());
    return sum_m * std::sqrt(1.0 + slope * slope) + wires_m;
  }

  void append(const ob::State* from, const ob::State* to,
              std::vector<Waypoint>& route) const override {
    const DubinsPath curve = path(from, to);
    const double plan_m = curve.length_m();
    const Waypoint a = waypoint(from);
    const Waypoint b = waypoint(to);
    const int steps = std::max(1, static_cast<int>(std::ceil(plan_m / route_step_m_)));
    const DubinsPose begin = pose(from);
    for (int k = 1; k < steps; ++k) {
      const double share = static_cast<double>(k) / steps;
      const DubinsPose here = pose_at(curve, begin, share * plan_m);
      route.push_back({here.x_m, here.y_m, a.altitude_m + share * (b.altitude_m - a.altitude_m)});
    }
    route.push_back(b);
  }

 private:
  // Between samples, which are near enough to take the way as straight.
  [[nodiscard]] double wire_cost_m(const geo::MapPoint& a, const geo::MapPoint& b) const {
    const risk::CostModel& costs = envelope_->costs();
    return costs.has_wires() ? costs.wire_cost_m(a, b) : 0.0;
  }
  [[nodiscard]] DubinsPose pose(const ob::State* state) const {
    const Waypoint place = waypoint(state);
    return {place.x_m, place.y_m, heading_math_rad(state)};
  }

  const FlightEnvelope* envelope_;
  double cost_step_m_;
  double route_step_m_;
  double radius_m_;
  SlopeLimits slopes_;
};

/// Position and heading. The length of the curve between two poses is no metric, so that all pairs
/// would have to be solved to find neighbours; the turn that headings differ by is counted instead.
class DubinsSpace final : public ob::CompoundStateSpace {
 public:
  DubinsSpace(const ob::RealVectorBounds& bounds, const DubinsFrame& frame,
              double climb_tangent_max, double radius_m)
      : frame_(&frame), climb_cotangent_(1.0 / climb_tangent_max), radius_m_(radius_m) {
    auto places = std::make_shared<ob::RealVectorStateSpace>(3);
    places->setBounds(bounds);
    addSubspace(places, 1.0);
    addSubspace(std::make_shared<ob::SO2StateSpace>(), 1.0);
    lock();
  }
  [[nodiscard]] bool hasSymmetricInterpolate() const override { return false; }
  double distance(const ob::State* a, const ob::State* b) const override {
    return neighbour_distance_m(frame_->waypoint(a), frame_->waypoint(b), climb_cotangent_) +
           radius_m_ *
               std::fabs(wrap_to_pi(frame_->heading_math_rad(a) - frame_->heading_math_rad(b)));
  }
  void interpolate(const ob::State* from, const ob::State* to, double share,
                   ob::State* state) const override {
    const DubinsPath curve = frame_->path(from, to);
    const Waypoint a = frame_->waypoint(from);
    const Waypoint b = frame_->waypoint(to);
    const DubinsPose here =
        pose_at(curve, {a.x_m, a.y_m, frame_->heading_math_rad(from)}, share * curve.length_m());
    frame_->assign_state(state,
                         {here.x_m, here.y_m, a.altitude_m + share * (b.altitude_m - a.altitude_m)},
                         here.heading_math_rad);
  }

 private:
  const DubinsFrame* frame_;
  double climb_cotangent_;
  double radius_m_;
};

class Validity final : public ob::StateValidityChecker {
 public:
  Validity(ob::SpaceInformation* space, const FlightEnvelope& envelope, const Frame& frame)
      : ob::StateValidityChecker(space), envelope_(&envelope), frame_(&frame) {}
  bool isValid(const ob::State* state) const override {
    return envelope_->contains(frame_->waypoint(state));
  }

 private:
  const FlightEnvelope* envelope_;
  const Frame* frame_;
};

class Motion final : public ob::MotionValidator {
 public:
  Motion(ob::SpaceInformation* space, const FlightEnvelope& envelope, const Frame& frame)
      : ob::MotionValidator(space), envelope_(&envelope), frame_(&frame) {}
  bool checkMotion(const ob::State* from, const ob::State* to) const override {
    if (!(frame_->cost_m(from, to) < kInfinity)) {
      return false;
    }
    std::vector<Waypoint> way = {frame_->waypoint(from)};
    frame_->append(from, to, way);
    return is_clear(*envelope_, way);
  }
  bool checkMotion(const ob::State* from, const ob::State* to,
                   std::pair<ob::State*, double>& last_valid) const override {
    if (last_valid.first != nullptr) {
      si_->copyState(last_valid.first, from);
    }
    last_valid.second = 0.0;
    return checkMotion(from, to);
  }

 private:
  const FlightEnvelope* envelope_;
  const Frame* frame_;
};

/// Draws places in the height band.
class BandDrawing {
 public:
  BandDrawing(const FlightEnvelope& envelope, const Frame& frame)
      : envelope_(&envelope), frame_(&frame) {}

  /// Uniform in plan view over what `draw_point` gives, then uniform in height.
  template <typename DrawPoint>
  bool draw(ob::State* state, ompl::RNG& random, int draws_max, const DrawPoint& draw_point) const {
    for (int i = 0; i < draws_max; ++i) {
      const geo::MapPoint point = draw_point();
      const AltitudeBand band = envelope_->band_at(point);
      if (band.is_flyable()) {
        frame_->assign_state(state,
                             {point.x_m, point.y_m, random.uniformReal(band.low_m, band.high_m)},
                             random.uniformReal(-std::numbers::pi, std::numbers::pi));
        return true;
      }
    }
    return false;
  }

  [[nodiscard]] geo::MapPoint point_of_map(ompl::RNG& random) const {
    const raster::GridGeometry& map = envelope_->geometry();
    return {random.uniformReal(map.west_m, map.east_m()),
            random.uniformReal(map.south_m, map.north_m())};
  }
  [[nodiscard]] const FlightEnvelope& envelope() const { return *envelope_; }
  [[nodiscard]] const Frame& frame() const { return *frame_; }

 private:
  const FlightEnvelope* envelope_;
  const Frame* frame_;
};

class BandSampler final : public ob::StateSampler {
 public:
  BandSampler(const ob::StateSpace* space, const BandDrawing& drawing)
      : ob::StateSampler(space), drawing_(drawing) {}
  void sampleUniform(ob::State* state) override {
    sample(state, [&] { return drawing_.point_of_map(rng_); });
  }
  void sampleUniformNear(ob::State* state, const ob::State* near, double distance_m) override {
    const Waypoint place = drawing_.frame().waypoint(near);
    sample(state, [&] {
      return geo::MapPoint{rng_.uniformReal(place.x_m - distance_m, place.x_m + distance_m),
                           rng_.uniformReal(place.y_m - distance_m, place.y_m + distance_m)};
    });
  }
  void sampleGaussian(ob::State* state, const ob::State* mean, double deviation_m) override {
    const Waypoint place = drawing_.frame().waypoint(mean);
    sample(state, [&] {
      return geo::MapPoint{rng_.gaussian(place.x_m, deviation_m),
                           rng_.gaussian(place.y_m, deviation_m)};
    });
  }

 private:
  template <typename DrawPoint>
  void sample(ob::State* state, const DrawPoint& draw_point) {
    if (!drawing_.draw(state, rng_, kDrawsMax, draw_point)) {
      drawing_.frame().assign_state(state, drawing_.envelope().start(), 0.0);
    }
  }

  BandDrawing drawing_;
};

/// The ellipse in plan view whose ends are start and goal, times the height band.
class EllipseSampler final : public ob::InformedSampler {
 public:
  EllipseSampler(const ob::ProblemDefinitionPtr& problem, unsigned draws_max,
                 const BandDrawing& drawing)
      : ob::InformedSampler(problem, draws_max), drawing_(drawing) {
    const Waypoint& start = drawing_.envelope().start();
    const Waypoint& goal = drawing_.envelope().goal();
    const double dx_m = goal.x_m - start.x_m;
    const double dy_m = goal.y_m - start.y_m;
    plan_m_ = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    axis_x_ = plan_m_ > 0.0 ? dx_m / plan_m_ : 1.0;
    axis_y_ = plan_m_ > 0.0 ? dy_m / plan_m_ : 0.0;
  }

  bool sampleUniform(ob::State* state, const ob::Cost& cost_max) override {
    return sampleUniform(state, ob::Cost(0.0), cost_max);
  }

  bool sampleUniform(ob::State* state, const ob::Cost& cost_min,
                     const ob::Cost& cost_max) override {
    if (!(cost_max.value() >
          flight::length_m({drawing_.envelope().start(), drawing_.envelope().goal()}))) {
      return false;  // nothing is left to improve
    }
    const raster::GridGeometry& map = drawing_.envelope().geometry();
    const bool is_map_smaller = !(ellipse_m2(cost_max.value()) < area_m2(map));
    const double half_major_m = 0.5 * cost_max.value();
    const double half_minor_m =
        0.5 * std::sqrt(std::max(cost_max.value() * cost_max.value() - plan_m_ * plan_m_, 0.0));
    const Waypoint& start = drawing_.envelope().start();
    const Waypoint& goal = drawing_.envelope().goal();
    const auto point = [&]() -> geo::MapPoint {
      if (is_map_smaller) {
        return drawing_.point_of_map(random_);
      }
      double u = 0.0;
      double v = 0.0;
      do {
        u = random_.uniformReal(-1.0, 1.0);
        v = random_.uniformReal(-1.0, 1.0);
      } while (u * u + v * v > 1.0);
      const double along_m = u * half_major_m;
      const double across_m = v * half_minor_m;
      return {0.5 * (start.x_m + goal.x_m) + along_m * axis_x_ - across_m * axis_y_,
              0.5 * (start.y_m + goal.y_m) + along_m * axis_y_ + across_m * axis_x_};
    };
    for (unsigned i = 0; i < numIters_; ++i) {
      if (!drawing_.draw(state, random_, 1, point)) {
        continue;
      }
      const Waypoint place = drawing_.frame().waypoint(state);
      const double least_m = distance_m(start, place) + distance_m(place, goal);
      if (least_m < cost_max.value() && least_m >= cost_min.value()) {
        return true;
      }
    }
    return false;
  }

  [[nodiscard]] bool hasInformedMeasure() const override { return true; }
  [[nodiscard]] double getInformedMeasure(const ob::Cost& cost) const override {
    const double share = ellipse_m2(cost.value()) / area_m2(drawing_.envelope().geometry());
    return space_->getMeasure() * (share < 1.0 ? share : 1.0);
  }

 private:
  static double area_m2(const raster::GridGeometry& map) {
    return (map.east_m() - map.west_m) * (map.north_m() - map.south_m);
  }
  [[nodiscard]] double ellipse_m2(double major_m) const {
    return 0.25 * std::numbers::pi * major_m *
           std::sqrt(std::max(major_m * major_m - plan_m_ * plan_m_, 0.0));
  }

  BandDrawing drawing_;
  ompl::RNG random_;
  double plan_m_ = 0.0;
  double axis_x_ = 1.0;
  double axis_y_ = 0.0;
};

/// Eq. (1); the straight length is the heuristic.
class Objective final : public ob::PathLengthOptimizationObjective {
 public:
  Objective(const ob::SpaceInformationPtr& space, const BandDrawing& drawing)
      : ob::PathLengthOptimizationObjective(space), drawing_(drawing) {
    description_ = "eq. (1)";
  }
  ob::Cost motionCost(const ob::State* from, const ob::State* to) const override {
    evaluations_.fetch_add(1, std::memory_order_relaxed);
    return ob::Cost(drawing_.frame().cost_m(from, to));
  }
  ob::Cost motionCostHeuristic(const ob::State* from, const ob::State* to) const override {
    return ob::Cost(kHeuristicShare *
                    distance_m(drawing_.frame().waypoint(from), drawing_.frame().waypoint(to)));
  }
  ob::InformedSamplerPtr allocInformedStateSampler(const ob::ProblemDefinitionPtr& problem,
                                                   unsigned draws_max) const override {
    return std::make_shared<EllipseSampler>(problem, draws_max, drawing_);
  }
  [[nodiscard]] std::int64_t evaluations() const { return evaluations_.load(); }

 private:
  BandDrawing drawing_;
  mutable std::atomic<std::int64_t> evaluations_{0};
};

ob::PlannerPtr make_planner(StockMethod method, const ob::SpaceInformationPtr& space) {
  switch (method) {
    case StockMethod::kBitStar:
    case StockMethod::kDubins:
      return std::make_shared<og::BITstar>(space);
    case StockMethod::kAbitStar:
      return std::make_shared<og::ABITstar>(space);
    case StockMethod::kAitStar:
      return std::make_shared<og::AITstar>(space);
    case StockMethod::kRrtStar:
      return std::make_shared<og::RRTstar>(space);
    case StockMethod::kInformedRrtStar:
      return std::make_shared<og::InformedRRTstar>(space);
    case StockMethod::kPrmStar:
      return std::make_shared<og::PRMstar>(space);
  }
  throw std::invalid_argument("no such planner");
}

}  // namespace

std::string_view name_of(StockMethod method) {
  constexpr std::array<std::string_view, kStockMethods.size()> kNames = {
      "ompl_bitstar",          "ompl_abitstar", "ompl_aitstar", "ompl_rrtstar",
      "ompl_informed_rrtstar", "ompl_prmstar",  "dubins"};
  return kNames[static_cast<std::size_t>(method)];
}

class StockPlanner::Search {
 public:
  Search(const FlightEnvelope& envelope, const GlobalOptions& options, StockMethod method,
         double turn_radius_m, std::uint64_t seed, const EndHeadings& headings) {
    ompl::msg::noOutputHandler();
    ompl::RNG::setSeed(static_cast<std::uint_fast32_t>(seed % 0xFFFFFFFFU) + 1U);
    const ob::SpaceInformationPtr straight = make_space_information(envelope, options.check_step_m);
    ob::StateSpacePtr states = straight->getStateSpace();
    if (method == StockMethod::kDubins) {
      auto frame = std::make_unique<DubinsFrame>(envelope, options, turn_radius_m);
      states =
          std::make_shared<DubinsSpace>(states->as<ob::RealVectorStateSpace>()->getBounds(), *frame,
                                        envelope.slopes().greatest().up, turn_radius_m);
      frame_ = std::move(frame);
    } else {
      frame_ = std::make_unique<StraightFrame>(envelope);
      auto places = std::make_shared<ClimbSpace>(envelope.slopes().greatest().up);
      places->setBounds(states->as<ob::RealVectorStateSpace>()->getBounds());
      states = places;
    }
    const BandDrawing drawing(envelope, *frame_);
    states->setStateSamplerAllocator([drawing](const ob::StateSpace* space) {
      return std::make_shared<BandSampler>(space, drawing);
    });
    space_ = std::make_shared<ob::SpaceInformation>(states);
    space_->setStateValidityChecker(std::make_shared<Validity>(space_.get(), envelope, *frame_));
    space_->setMotionValidator(std::make_shared<Motion>(space_.get(), envelope, *frame_));
    space_->setStateValidityCheckingResolution(
        std::min(options.check_step_m / states->getMaximumExtent(), 1.0));
    space_->setup();

    problem_ = std::make_shared<ob::ProblemDefinition>(space_);
    const Waypoint& from = envelope.start();
    const Waypoint& to = envelope.goal();
    const double straight_rad = elementary::atan2(to.y_m - from.y_m, to.x_m - from.x_m);
    start_ = space_->allocState();
    goal_ = space_->allocState();
    frame_->assign_state(start_, from, headings.start_math_rad.value_or(straight_rad));
    frame_->assign_state(goal_, to, headings.goal_math_rad.value_or(straight_rad));
    ob::ScopedState<> start(space_);
    ob::ScopedState<> goal(space_);
    start = start_;
    goal = goal_;
    problem_->setStartAndGoalStates(start, goal);
    objective_ = std::make_shared<Objective>(space_, drawing);
    problem_->setOptimizationObjective(objective_);
    planner_ = make_planner(method, space_);
    planner_->setProblemDefinition(problem_);
    planner_->setup();
  }
  ~Search() {
    space_->freeState(start_);
    space_->freeState(goal_);
  }
  Search(const Search&) = delete;
  Search& operator=(const Search&) = delete;

  void run(const std::function<bool()>& should_stop, const OnRoute& on_route) {
    problem_->setIntermediateSolutionCallback([&](const ob::Planner*,
                                                  const std::vector<const ob::State*>& states,
                                                  ob::Cost) { report(states, on_route); });
    planner_->solve(ob::PlannerTerminationCondition(should_stop));
    for (const ob::PlannerSolution& solution : problem_->getSolutions()) {
      auto* path = dynamic_cast<og::PathGeometric*>(solution.path_.get());
      if (path != nullptr && !solution.approximate_) {
        report({path->getStates().begin(), path->getStates().end()}, on_route);
      }
    }
    problem_->setIntermediateSolutionCallback({});
  }

  [[nodiscard]] std::int64_t edge_evaluations() const { return objective_->evaluations(); }

 private:
  // Planners report states from either end, with or without start and goal.
  void report(std::vector<const ob::State*> states, const OnRoute& on_route) {
    std::erase_if(states, [&](const ob::State* state) {
      return space_->equalStates(state, start_) || space_->equalStates(state, goal_);
    });
    std::vector<const ob::State*> best;
    double best_m = best_m_;
    for (int turn = 0; turn < 2; ++turn) {
      std::vector<const ob::State*> way = {start_};
      way.insert(way.end(), states.begin(), states.end());
      way.push_back(goal_);
      double cost_m = 0.0;
      for (std::size_t i = 1; i < way.size() && cost_m < best_m; ++i) {
        cost_m += frame_->cost_m(way[i - 1], way[i]);
      }
      if (cost_m < best_m) {
        best_m = cost_m;
        best = way;
      }
      std::reverse(states.begin(), states.end());
    }
    if (best.empty()) {
      return;
    }
    best_m_ = best_m;
    std::vector<Waypoint> route = {frame_->waypoint(start_)};
    for (std::size_t i = 1; i < best.size(); ++i) {
      frame_->append(best[i - 1], best[i], route);
    }
    on_route(route);
  }

  std::unique_ptr<Frame> frame_;
  ob::SpaceInformationPtr space_;
  ob::ProblemDefinitionPtr problem_;
  std::shared_ptr<Objective> objective_;
  ob::PlannerPtr planner_;
  ob::State* start_ = nullptr;
  ob::State* goal_ = nullptr;
  double best_m_ = kInfinity;
};

StockPlanner::StockPlanner(const FlightEnvelope& envelope, const GlobalOptions& options,
                           StockMethod method, double turn_radius_m, std::uint64_t seed,
                           const EndHeadings& headings)
    : search_(std::make_unique<Search>(envelope, options, method, turn_radius_m, seed, headings)) {}

StockPlanner::~StockPlanner() = default;

void StockPlanner::run(const std::function<bool()>& should_stop, const OnRoute& on_route) {
  search_->run(should_stop, on_route);
}

std::int64_t StockPlanner::edge_evaluations() const { return search_->edge_evaluations(); }

}  // namespace hedgehop::global_planning
