// Plans on a map and tells the result over a bus, with the installed libraries.
//   plan_and_publish MAP START_LAT_DEG START_LON_DEG GOAL_LAT_DEG GOAL_LON_DEG WORK OUT
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "base/angles.hpp"
#include "bus/bus.hpp"
#include "map/map_bundle.hpp"
#include "output/plan_bundle.hpp"
#include "planning/planning.hpp"

int main(int argc, char** argv) {
  if (argc != 8) {
    return 2;
  }
  using namespace hedgehop;
  const auto angle = [&](int i) { return radians_from_degrees(std::atof(argv[i])); };
  const map::Map map = map::read_map_bundle(argv[1]);
  flight::PlanRequest request;
  request.start.position = {angle(2), angle(3)};
  request.goal.position = {angle(4), angle(5)};
  request.work_budget = std::atoll(argv[6]);
  const auto config = planning::read_planning_config(planning::effective_planning_config("", {}),
                                                     "effective configuration");
  SilentObserver observer;
  const auto answer = planning::plan(map, request, config, {}, observer);
  const auto* plan = std::get_if<flight::Plan>(&answer);
  if (plan == nullptr) {
    std::fprintf(stderr, "no plan: %s\n", std::get<flight::NoPlan>(answer).explanation.c_str());
    return 3;
  }
  std::filesystem::create_directory(argv[7]);
  output::write_plan_bundle(*plan, argv[7]);

  bus::Bus speaker({.url = "memq://outside", .channel_prefix = "alpha_"});
  bus::Bus listener({.url = "memq://outside", .channel_prefix = "alpha_"});
  messages::PlanStatus heard;
  listener.subscribe<messages::PlanStatus>(
      messages::kPlanStatusChannel,
      [&](const messages::PlanStatus& status, const messages::Stamp&) { heard = status; });
  messages::PlanStatus done;
  done.request_id = plan->route_plan.request_id;
  done.state = messages::PlanState::kDone;
  done.best_cost_m = plan->route_plan.route.cost.total_m();
  speaker.publish(messages::kPlanStatusChannel, done, Time{1});
  listener.poll(5.0);
  const bool is_same = heard.request_id == done.request_id && heard.best_cost_m == done.best_cost_m;
  std::printf("%s %s\n", is_same ? "heard" : "lost", heard.request_id.hex().c_str());
  return is_same ? 0 : 1;
}
