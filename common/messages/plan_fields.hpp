#pragma once

// Internal: fields that plan messages and plan blobs share.

#include <numbers>
#include <string>

#include "flight/plan_request.hpp"
#include "messages/wire.hpp"

namespace hedgehop::messages::wire {

/// T is request_point_t.
template <typename T>
void put_point(T& field, const flight::RequestPoint& point) {
  field.latitude_rad = point.position.latitude_rad;
  field.longitude_rad = point.position.longitude_rad;
  field.height_m = value_or_nan(point.height_m);
}

template <typename T>
flight::RequestPoint point_in(const Check& check, const std::string& name, const T& field) {
  constexpr double kPi = std::numbers::pi;
  flight::RequestPoint point;
  point.position.latitude_rad =
      check.within(name + ".latitude_rad", field.latitude_rad, -0.5 * kPi, 0.5 * kPi);
  point.position.longitude_rad =
      check.within(name + ".longitude_rad", field.longitude_rad, -kPi, kPi);
  point.height_m = check.optional(
      field.height_m, [&](double value) { return check.finite(name + ".height_m", value); });
  return point;
}

/// Heading, speed, seed and budget; T is plan_request_t or route_plan_t.
template <typename T>
void read_options(const Check& check, const T& message, flight::PlanRequest& request) {
  request.start_heading_true_rad =
      check.optional(message.start_heading_true_rad, [&](double value) {
        return check.within("start_heading_true_rad", value, 0.0, 2.0 * std::numbers::pi);
      });
  request.speed_mps = check.optional(
      message.speed_mps, [&](double value) { return check.positive("speed_mps", value); });
  request.seed = static_cast<std::uint64_t>(message.seed);
  request.work_budget = check.count("work_budget", message.work_budget);
}

}  // namespace hedgehop::messages::wire
