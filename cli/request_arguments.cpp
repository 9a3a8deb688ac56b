#include "request_arguments.hpp"

#include <CLI/CLI.hpp>
#include <charconv>
#include <cmath>

#include "base/angles.hpp"
#include "base/errors.hpp"

namespace hedgehop::cli {

flight::RequestPoint parse_request_point(const std::string& text, const std::string& option) {
  const auto refuse = [&](const std::string& why) {
    throw UsageError(option + " '" + text + "' " + why,
                     "write latitude,longitude[,height above the surface in metres], for example "
                     "49.987,11.542 or 49.987,11.542,30");
  };
  std::vector<double> numbers;
  const char* cursor = text.data();
  const char* const end = text.data() + text.size();
  while (true) {
    double number = 0.0;
    const auto [next, error] = std::from_chars(cursor, end, number);
    if (error != std::errc() || !std::isfinite(number)) {
      refuse("is not a list of numbers");
    }
    numbers.push_back(number);
    if (next == end) {
      break;
    }
    if (*next != ',') {
      refuse("is not a list of numbers");
    }
    cursor = next + 1;
  }
  if (numbers.size() < 2 || numbers.size() > 3) {
    refuse("has " + std::to_string(numbers.size()) + " numbers, 2 or 3 are needed");
  }
  if (std::fabs(numbers[0]) > 90.0) {
    refuse("has a latitude beyond 90 degrees");
  }
  if (std::fabs(numbers[1]) > 180.0) {
    refuse("has a longitude beyond 180 degrees");
  }
  flight::RequestPoint point;
  point.position = {radians_from_degrees(numbers[0]), radians_from_degrees(numbers[1])};
  if (numbers.size() == 3) {
    point.height_m = numbers[2];
  }
  return point;
}

void RequestArguments::add_to(CLI::App& verb) {
  verb.add_option(
          "--start", start,
          "Where the flight begins: LAT,LON[,HEIGHT_M], height above the surface; without it "
          "the reference height above the highest surface nearby")
      ->required();
  verb.add_option("--goal", goal, "Where it ends: LAT,LON[,HEIGHT_M]")->required();
  verb.add_option("--via", via, "A place to pass: LAT,LON[,HEIGHT_M]; may be given several times")
      ->allow_extra_args(false);
  verb.add_option_function<double>(
          "--start-heading-deg",
          [this](double value) {
            start_heading_deg = value;
            has_start_heading = true;
          },
          "Heading at the start, from true north, clockwise (default: towards the first waypoint)")
      ->check(CLI::Range(-360.0, 360.0));
  verb.add_option("--speed-mps", speed_mps, "Ground speed (default: speed_mps of the config)")
      ->check(CLI::PositiveNumber);
  verb.add_option("--seed", seed, "Seed of the global planner (default 1)");
  verb.add_option("--work", work,
                  "Work budget of the global planner in legs evaluated (default: config)")
      ->check(CLI::PositiveNumber);
  verb.add_option("--config", config_file,
                  "YAML file whose keys replace those of the shipped planning.yaml");
  verb.add_option("--set", settings,
                  "One setting, key=value, for example weights.visibility=10; may be repeated")
      ->allow_extra_args(false);
}

flight::PlanRequest RequestArguments::plan_request() const {
  flight::PlanRequest request;
  request.start = parse_request_point(start, "--start");
  request.goal = parse_request_point(goal, "--goal");
  for (const std::string& point : via) {
    request.via.push_back(parse_request_point(point, "--via"));
  }
  if (has_start_heading) {
    request.start_heading_true_rad = wrap_to_two_pi(radians_from_degrees(start_heading_deg));
  }
  if (speed_mps > 0.0) {
    request.speed_mps = speed_mps;
  }
  request.seed = seed;
  request.work_budget = work;
  return request;
}

}  // namespace hedgehop::cli
