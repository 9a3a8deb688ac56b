#include "global_planning/detour.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace hedgehop::global_planning {
namespace {

constexpr double kSample_m = 100.0;  // between the places of the route that are judged
constexpr double kNear_m = 700.0;    // the way comes to the route where it is within this
constexpr double kAside = 3.0;  // such a metre beside it counts so often: it misleads the search
constexpr double kCostStep_m = 4.0;
// So much worse may a place be that is later to leave or earlier to join.
constexpr double kLeaveTolerance = 0.006;
constexpr double kJoinTolerance = 0.03;
constexpr double kGainMin = 0.02;  // of a way where nothing on the route has changed

struct Place {
  double along_m;
  flight::Waypoint at;
  double rest_m;  // what the route costs from here to its end
};

std::vector<Place> places_of(const FlightEnvelope& envelope, const RouteLine& route,
                             double from_m) {
  std::vector<Place> places = {{from_m, route.at(from_m), 0.0}};
  while (places.back().along_m < route.length_m()) {
    const double along_m = std::min(places.back().along_m + kSample_m, route.length_m());
    places.push_back({along_m, route.at(along_m), 0.0});
  }
  for (std::size_t i = places.size() - 1; i-- > 0;) {
    places[i].rest_m =
        places[i + 1].rest_m +
        envelope.route_cost_m(route.part(places[i].along_m, places[i + 1].along_m), kCostStep_m);
  }
  return places;
}

// How far the line up to `until_m` lies beside the box around two places.
double beside_m(const RouteLine& line, double until_m, const geo::MapPoint& a,
                const geo::MapPoint& b) {
  double beside = 0.0;
  for (std::size_t i = 0; i < line.points().size() && line.along_m()[i] <= until_m; ++i) {
    const flight::Waypoint& at = line.points()[i];
    beside = std::max({beside, std::min(a.x_m, b.x_m) - at.x_m, at.x_m - std::max(a.x_m, b.x_m),
                       std::min(a.y_m, b.y_m) - at.y_m, at.y_m - std::max(a.y_m, b.y_m)});
  }
  return beside;
}

}  // namespace

std::optional<Detour> find_detour(const FlightEnvelope& envelope, const CostField& field,
                                  const RouteLine& route, const DetourQuestion& question) {
  const std::vector<Place> places = places_of(envelope, route, question.from_m);
  const std::size_t last = places.size() - 1;
  const auto is_changed = [&](const Place& place) { return question.is_changed(place.at.point()); };
  const auto field_m = [&](const geo::MapPoint& at) {
    return question.cost_per_field * field.cost_m(at);
  };
  const auto first_changed = static_cast<std::size_t>(
      std::find_if(places.begin(), places.end(), is_changed) - places.begin());
  // The last place, after which nothing has changed, if anything has.
  std::size_t unchanged_from = 0;
  for (std::size_t i = 0; i <= last; ++i) {
    unchanged_from = is_changed(places[i]) ? i + 1 : unchanged_from;
  }

  std::size_t leave = 0;
  if (question.is_on_route) {
    const std::size_t end = std::clamp<std::size_t>(first_changed, 1, last);
    const auto through_m = [&](std::size_t i) {
      return places.front().rest_m - places[i].rest_m + field_m(places[i].at.point());
    };
    double least_m = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < end; ++i) {
      least_m = std::min(least_m, through_m(i));
    }
    if (first_changed > last && !(least_m < places.front().rest_m * (1.0 - kGainMin))) {
      return std::nullopt;
    }
    for (std::size_t i = 0; i < end; ++i) {
      leave = through_m(i) <= least_m * (1.0 + kLeaveTolerance) ? i : leave;
    }
  }
  const geo::MapPoint from = places[leave].at.point();
  std::vector<flight::Waypoint> centres;
  for (const geo::MapPoint& centre : field.way_from(from)) {
    centres.push_back({centre.x_m, centre.y_m, 0.0});
  }
  Detour detour{places[leave].along_m, route.length_m(), 0.0};
  if (centres.size() < 2) {
    return detour;
  }
  const RouteLine way(std::move(centres));
  const double all_m = field_m(from);
  const double mean_density = all_m / std::max(way.length_m(), 1.0);
  struct Candidate {
    double along_m, way_m, cost_m;
  };
  std::vector<Candidate> candidates = {{route.length_m(), way.length_m(), all_m}};
  for (std::size_t i = std::max(unchanged_from, leave + 1); i < last; ++i) {
    const RouteLine::Nearest near = way.nearest(places[i].at.point());
    if (near.distance_m <= kNear_m) {
      candidates.push_back({places[i].along_m, near.along_m,
                            all_m - field_m(way.at(near.along_m).point()) +
                                kAside * near.distance_m * mean_density + places[i].rest_m});
    }
  }
  double least_m = std::numeric_limits<double>::infinity();
  for (const Candidate& candidate : candidates) {
    least_m = std::min(least_m, candidate.cost_m);
  }
  double until_m = way.length_m();
  for (const Candidate& candidate : candidates) {
    if (candidate.cost_m <= least_m * (1.0 + kJoinTolerance) && candidate.along_m < detour.join_m) {
      detour.join_m = candidate.along_m;
      until_m = candidate.way_m;
    }
  }
  detour.aside_m = beside_m(way, until_m, from, route.at(detour.join_m).point());
  return detour;
}

}  // namespace hedgehop::global_planning
