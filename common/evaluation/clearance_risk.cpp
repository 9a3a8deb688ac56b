#include "evaluation/clearance_risk.hpp"

#include <algorithm>
#include <boost/math/distributions/binomial.hpp>
#include <cmath>
#include <limits>
#include <oneapi/tbb/parallel_for.h>
#include <random>
#include <stdexcept>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "verification/surface_sweep.hpp"

namespace hedgehop::evaluation {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

struct Node {
  geo::MapPoint point;
  double altitude_m = 0.0;
  double time_s = 0.0;
  double lower_m = 0.0;  // by how much the path comes lower up to the next node, not negative
  // Shares of the error before that stay, and of the fresh one that comes in.
  double dem_kept = 0.0, dem_fresh = 1.0;
  double navigation_kept = 0.0, navigation_fresh = 1.0;
};

// Pairs of independent standard normal numbers, by the method of Box and Muller.
class Normals {
 public:
  explicit Normals(std::uint64_t seed) : random_(seed) {}
  double next() {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    const double u = static_cast<double>((random_() >> 11U) + 1U) * 0x1p-53;  // in (0, 1]
    const double angle_rad = kTwoPi * static_cast<double>(random_() >> 11U) * 0x1p-53;
    const double radius = std::sqrt(-2.0 * elementary::log(u));
    const elementary::SineCosine turn = elementary::sine_cosine(angle_rad);
    spare_ = radius * turn.sine;
    has_spare_ = true;
    return radius * turn.cosine;
  }

 private:
  std::mt19937_64 random_;
  double spare_ = 0.0;
  bool has_spare_ = false;
};

verification::PathPoint path_point(const flight::FlightState& state) {
  return {state.x_m, state.y_m, state.altitude_m};
}

std::vector<Node> nodes_of(const map::Map& map, const flight::Trajectory& trajectory,
                           const UncertaintyOptions& options) {
  const auto& states = trajectory.states;
  std::vector<Node> nodes;
  double since_m = std::numeric_limits<double>::infinity();
  double here_m = 0.0;  // clearance at the last node
  for (std::size_t i = 0; i < states.size(); ++i) {
    const flight::FlightState& state = states[i];
    if (i > 0) {
      const double step_m =
          std::hypot(state.x_m - states[i - 1].x_m, state.y_m - states[i - 1].y_m);
      const verification::Sweep sweep = verification::sweep_surface(
          map.surface_m, path_point(states[i - 1]), path_point(state), 0.0);
      nodes.back().lower_m = std::fmax(nodes.back().lower_m, here_m - sweep.clearance_min_m);
      since_m += step_m;
    }
    if (since_m < options.node_m) {
      continue;
    }
    Node node;
    node.point = state.point();
    node.altitude_m = state.altitude_m;
    node.time_s = state.time_s;
    if (!nodes.empty()) {
      const auto kept = [](double gap, double length) { return elementary::exp(-gap / length); };
      const auto fresh = [](double share) { return std::sqrt(1.0 - share * share); };
      node.dem_kept = kept(since_m, options.dem_correlation_m);
      node.dem_fresh = fresh(node.dem_kept);
      node.navigation_kept =
          kept(node.time_s - nodes.back().time_s, options.navigation_correlation_s);
      node.navigation_fresh = fresh(node.navigation_kept);
    }
    here_m = state.altitude_m - verification::interpolated_height_m(map.surface_m, state.point());
    nodes.push_back(node);
    since_m = 0.0;
  }
  return nodes;
}

struct Draw {
  double least_m = std::numeric_limits<double>::infinity();
  std::size_t node = 0;
};

Draw drawn(const map::Map& map, const std::vector<Node>& nodes, const ErrorSizes& errors,
           std::uint64_t seed) {
  Normals normals(seed);
  Draw draw;
  double dem = 0.0;
  double east = 0.0;
  double north = 0.0;
  double up = 0.0;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const Node& node = nodes[i];
    dem = node.dem_kept * dem + node.dem_fresh * normals.next();
    east = node.navigation_kept * east + node.navigation_fresh * normals.next();
    north = node.navigation_kept * north + node.navigation_fresh * normals.next();
    up = node.navigation_kept * up + node.navigation_fresh * normals.next();
    const geo::MapPoint place{node.point.x_m + errors.navigation_m * east,
                              node.point.y_m + errors.navigation_m * north};
    const double clearance_m = node.altitude_m + errors.navigation_m * up -
                               verification::interpolated_height_m(map.surface_m, place) -
                               errors.dem_m * dem - node.lower_m;
    if (!(clearance_m >= draw.least_m)) {
      draw = {std::isnan(clearance_m) ? -std::numeric_limits<double>::infinity() : clearance_m, i};
    }
  }
  return draw;
}

}  // namespace

UncertaintyOptions read_uncertainty_options(ConfigReader& reader) {
  UncertaintyOptions options;
  options.draws = reader.required_integer("draws");
  options.node_m = reader.required_double("node_m");
  options.dem_correlation_m = reader.required_double("dem_correlation_m");
  options.navigation_correlation_s = reader.required_double("navigation_correlation_s");
  options.confidence = reader.required_double("confidence");
  reader.require(options.draws >= 1 && options.draws <= 10'000'000, "draws",
                 "must lie between 1 and 10000000");
  reader.require(options.node_m > 0.0, "node_m", "must be above 0");
  reader.require(options.dem_correlation_m > 0.0, "dem_correlation_m", "must be above 0");
  reader.require(options.navigation_correlation_s > 0.0, "navigation_correlation_s",
                 "must be above 0");
  reader.require(options.confidence > 0.0 && options.confidence < 1.0, "confidence",
                 "must lie between 0 and 1");
  reader.finish();
  return options;
}

ClearanceRisk clearance_risk(const map::Map& map, const flight::Trajectory& trajectory,
                             const ErrorSizes& errors, double clearance_m,
                             const UncertaintyOptions& options, std::uint64_t seed) {
  const auto& states = trajectory.states;
  if (states.size() < 2 || !std::all_of(states.begin(), states.end(), [](const auto& state) {
        return std::isfinite(state.x_m + state.y_m + state.altitude_m + state.time_s);
      })) {
    throw std::invalid_argument("errors can only be drawn along a flight of finite states");
  }
  if (!(errors.dem_m >= 0.0 && errors.navigation_m >= 0.0 &&
        std::isfinite(errors.dem_m + errors.navigation_m))) {
    throw std::invalid_argument("standard deviations of errors must be finite and not negative");
  }
  const std::vector<Node> nodes = nodes_of(map, trajectory, options);
  const auto count = static_cast<std::size_t>(options.draws);
  std::vector<Draw> draws(count);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    draws[i] = drawn(map, nodes, errors, seed + 0x9e3779b97f4a7c15U * (i + 1));
  });

  ClearanceRisk risk;
  risk.errors = errors;
  risk.seed = seed;
  risk.clearance_m = clearance_m;
  risk.nodes = static_cast<std::int64_t>(nodes.size());
  risk.draws = options.draws;
  risk.confidence = options.confidence;
  risk.worst_place = {kNan, kNan};
  risk.worst_time_s = kNan;
  std::vector<std::int64_t> violated_at(nodes.size(), 0);
  for (const Draw& draw : draws) {
    risk.least_clearances_m.push_back(draw.least_m);
    if (!(draw.least_m >= clearance_m)) {
      ++risk.violations;
      ++violated_at[draw.node];
    }
  }
  std::sort(risk.least_clearances_m.begin(), risk.least_clearances_m.end());
  const auto quantile = [&](double share) {
    const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(count)));
    return risk.least_clearances_m[std::max<std::size_t>(rank, 1) - 1];
  };
  risk.clearance_p01_m = quantile(0.01);
  risk.clearance_p05_m = quantile(0.05);
  risk.clearance_median_m = quantile(0.5);
  risk.probability = static_cast<double>(risk.violations) / static_cast<double>(risk.draws);
  const double tail = 0.5 * (1.0 - options.confidence);
  using Binomial = boost::math::binomial_distribution<double>;
  const auto trials = static_cast<double>(risk.draws);
  const auto successes = static_cast<double>(risk.violations);
  risk.low = risk.violations == 0 ? 0.0 : Binomial::find_lower_bound_on_p(trials, successes, tail);
  risk.high = risk.violations == risk.draws
                  ? 1.0
                  : Binomial::find_upper_bound_on_p(trials, successes, tail);
  if (risk.violations > 0) {
    const auto worst = std::max_element(violated_at.begin(), violated_at.end());
    const Node& node = nodes[static_cast<std::size_t>(worst - violated_at.begin())];
    risk.worst_place = node.point;
    risk.worst_time_s = node.time_s;
  }
  return risk;
}

}  // namespace hedgehop::evaluation
