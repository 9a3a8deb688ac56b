#include "evaluation/drawn_routes.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <nlohmann/json.hpp>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <optional>

#include "base/errors.hpp"
#include "evaluation/crowd_observer.hpp"
#include "evaluation/kept_answers.hpp"

namespace hedgehop::evaluation {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::int64_t kTriesPerRoute = 3;

// What became of one problem: a route, or none.
struct Answer {
  std::optional<DrawnRoute> route;
  bool is_from_cache = false;
};

Json waypoint_json(const flight::Waypoint& waypoint) {
  return {waypoint.x_m, waypoint.y_m, waypoint.altitude_m};
}

double number_of(const Json& json) {
  const auto value = json.get<double>();
  if (!std::isfinite(value)) {
    throw DataError("a number of a kept route is not finite");
  }
  return value;
}

flight::Waypoint waypoint_of(const Json& json) {
  return {number_of(json.at(0)), number_of(json.at(1)), number_of(json.at(2))};
}

Json json_of(const Answer& answer) {
  Json json;
  json["is_found"] = answer.route.has_value();
  if (answer.route) {
    json["start"] = waypoint_json(answer.route->start);
    json["goal"] = waypoint_json(answer.route->goal);
    json["cost_m"] = answer.route->cost_m;
    json["guide"] = Json::array();
    for (const flight::Waypoint& waypoint : answer.route->guide) {
      json["guide"].push_back(waypoint_json(waypoint));
    }
  }
  return json;
}

// Nothing if it is damaged.
std::optional<Answer> answer_of(const Json& json, std::int64_t problem) {
  try {
    Answer answer;
    answer.is_from_cache = true;
    if (json.at("is_found").get<bool>()) {
      DrawnRoute route;
      route.problem = problem;
      route.start = waypoint_of(json.at("start"));
      route.goal = waypoint_of(json.at("goal"));
      route.cost_m = number_of(json.at("cost_m"));
      for (const Json& point : json.at("guide")) {
        route.guide.push_back(waypoint_of(point));
      }
      if (route.guide.size() < 2) {
        return std::nullopt;
      }
      answer.route = std::move(route);
    }
    return answer;
  } catch (const Json::exception&) {
    return std::nullopt;
  } catch (const DataError&) {
    return std::nullopt;
  }
}

}  // namespace

DrawingRules read_route_rules(ConfigReader& reader) {
  const DrawingRules rules = read_drawing_rules(reader);
  reader.finish();
  return rules;
}

DrawnRoutes draw_routes(const map::Map& map, const planning::PlanningConfig& config,
                        const DrawingRules& rules, std::int64_t count, std::uint64_t seed,
                        const std::filesystem::path& cache_folder, const RouteFunction& plan,
                        Observer& observer) {
  Json identity;
  identity["map"] = map.hash.hex();
  identity["config"] = without_config_key(config.text, "planning config", "local");
  identity["margin_m"] = rules.margin_m;
  identity["distance_min_m"] = rules.distance_min_m;
  identity["seed"] = seed;
  const KeptAnswers kept_answers(cache_folder, identity);

  const geo::MapProjection projection(map.crs_wkt);
  const std::int64_t tries = kTriesPerRoute * count;
  DrawnRoutes result;
  std::atomic<std::int64_t> found{0};
  while (static_cast<std::int64_t>(result.routes.size()) < count && result.problems < tries) {
    const std::int64_t first = result.problems;
    const std::int64_t next =
        std::min(tries, first + count - static_cast<std::int64_t>(result.routes.size()));
    const DrawnProblems drawn = draw_problems(map, rules, next, seed);
    std::vector<Answer> answers(static_cast<std::size_t>(next - first));
    oneapi::tbb::parallel_for(std::size_t{0}, answers.size(), [&](std::size_t at) {
      observer.check_stop();
      const std::int64_t problem = first + static_cast<std::int64_t>(at);
      const DrawnProblem& ends = drawn.problems[static_cast<std::size_t>(problem)];
      std::optional<Answer> kept;
      if (const auto json = kept_answers.find(problem)) {
        kept = answer_of(*json, problem);
      }
      if (kept) {
        answers[at] = std::move(*kept);
      } else {
        flight::PlanRequest request;
        request.start.position = projection.to_geodetic(ends.start);
        request.goal.position = projection.to_geodetic(ends.goal);
        request.seed = seed + static_cast<std::uint64_t>(problem);
        CrowdObserver crowd(observer);
        // Without isolation a thread that waits inside one plan would begin another one on its
        // stack.
        auto planned = oneapi::tbb::this_task_arena::isolate(
            [&] { return plan(map, request, config, crowd); });
        if (auto* route = std::get_if<flight::RoutePlan>(&planned)) {
          answers[at].route =
              DrawnRoute{problem, route->start, route->goal, std::move(route->route.guide),
                         route->route.cost.total_m()};
        } else if (std::get<flight::NoPlan>(planned).cause == flight::NoPlanCause::kStopped) {
          throw Interrupted();
        }
        kept_answers.keep(problem, json_of(answers[at]));
      }
      found += answers[at].route ? 1 : 0;
      observer.progress("global routes", static_cast<double>(std::min(found.load(), count)),
                        static_cast<double>(count));
    });
    observer.check_stop();
    for (Answer& answer : answers) {
      result.from_cache += answer.is_from_cache ? 1 : 0;
      if (answer.route) {
        result.routes.push_back(std::move(*answer.route));
      }
    }
    result.problems = next;
  }
  if (static_cast<std::int64_t>(result.routes.size()) < count) {
    throw DataError("only " + std::to_string(result.routes.size()) + " of " +
                        std::to_string(result.problems) + " drawn problems have a global route, " +
                        std::to_string(count) + " were asked for",
                    "ask for fewer, or see with hedgehop evaluate random why");
  }
  return result;
}

}  // namespace hedgehop::evaluation
