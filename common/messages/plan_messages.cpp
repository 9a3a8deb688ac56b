#include "messages/plan_messages.hpp"

#include "messages/plan_fields.hpp"
#include "messages/wire.hpp"

#include "hedgehop/plan_cancel_t.hpp"
#include "hedgehop/plan_request_t.hpp"
#include "hedgehop/plan_status_t.hpp"
#include "hedgehop/route_t.hpp"
#include "hedgehop/trajectory_t.hpp"

namespace hedgehop::messages {
namespace {

constexpr std::size_t kProvenanceBytesMax = 120;

static_assert(kMaxVia == plan_request_t::MAX_VIA);
static_assert(static_cast<int>(flight::NoPlanCause::kStartOutsideMap) ==
              plan_status_t::CAUSE_START_OUTSIDE_MAP);
static_assert(static_cast<int>(flight::NoPlanCause::kStartBelowEnvelope) ==
              plan_status_t::CAUSE_START_BELOW_ENVELOPE);
static_assert(static_cast<int>(flight::NoPlanCause::kReferenceHeightMismatch) ==
              plan_status_t::CAUSE_REFERENCE_HEIGHT_MISMATCH);
static_assert(static_cast<int>(flight::NoPlanCause::kStopped) == plan_status_t::CAUSE_STOPPED);
static_assert(static_cast<int>(flight::NoPlanCause::kClimbLimit) ==
              plan_status_t::CAUSE_CLIMB_LIMIT);
static_assert(static_cast<int>(flight::NoPlanCause::kGoalInsideArea) ==
              plan_status_t::CAUSE_GOAL_INSIDE_AREA);

}  // namespace

Bytes to_message(const PlanRequestMessage& request, const Stamp& stamp) {
  plan_request_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.request_id, request.request_id);
  wire::put(message.map_hash, request.map_hash);
  wire::put_ref(message.config, request.config);
  wire::put_point(message.start, request.request.start);
  wire::put_point(message.goal, request.request.goal);
  message.start_heading_true_rad = wire::value_or_nan(request.request.start_heading_true_rad);
  message.speed_mps = wire::value_or_nan(request.request.speed_mps);
  message.seed = static_cast<std::int64_t>(request.request.seed);
  message.work_budget = request.request.work_budget;
  message.num_via = static_cast<std::int32_t>(request.request.via.size());
  for (const flight::RequestPoint& point : request.request.via) {
    wire::put_point(message.via.emplace_back(), point);
  }
  return wire::published<PlanRequestMessage>(message);
}

template <>
PlanRequestMessage from_message<PlanRequestMessage>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<plan_request_t>(bytes, stamp);
  const wire::Check check(plan_request_t::getTypeName());
  PlanRequestMessage request;
  request.request_id = wire::hash_in(message.request_id);
  request.map_hash = wire::hash_in(message.map_hash);
  request.config = wire::ref_in(check, "config", message.config);
  request.request.start = wire::point_in(check, "start", message.start);
  request.request.goal = wire::point_in(check, "goal", message.goal);
  wire::read_options(check, message, request.request);
  for (const request_point_t& point : message.via) {
    request.request.via.push_back(wire::point_in(check, "via", point));
  }
  return request;
}

Bytes to_message(const PlanCancel& cancel, const Stamp& stamp) {
  plan_cancel_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.request_id, cancel.request_id);
  return wire::published<PlanCancel>(message);
}

template <>
PlanCancel from_message<PlanCancel>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<plan_cancel_t>(bytes, stamp);
  return {wire::hash_in(message.request_id)};
}

Bytes to_message(const PlanStatus& status, const Stamp& stamp) {
  plan_status_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.request_id, status.request_id);
  message.stage = static_cast<std::int8_t>(status.stage);
  message.state = static_cast<std::int8_t>(status.state);
  message.work_units = status.work_units;
  message.work_budget = status.work_budget;
  message.best_cost_m = wire::value_or_nan(status.best_cost_m);
  message.lower_bound_m = status.lower_bound_m;
  message.cause = plan_status_t::CAUSE_NONE;
  std::optional<double> cause_x_m;
  std::optional<double> cause_y_m;
  std::string_view text = status.text;
  if (status.no_plan) {
    message.cause = static_cast<std::int8_t>(status.no_plan->cause);
    if (status.no_plan->place) {
      cause_x_m = status.no_plan->place->x_m;
      cause_y_m = status.no_plan->place->y_m;
    }
    text = status.no_plan->explanation;
  }
  message.cause_x_m = wire::value_or_nan(cause_x_m);
  message.cause_y_m = wire::value_or_nan(cause_y_m);
  message.text = wire::cut_text(text, kMaxStatusTextBytes);
  return wire::published<PlanStatus>(message);
}

template <>
PlanStatus from_message<PlanStatus>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<plan_status_t>(bytes, stamp);
  const wire::Check check(plan_status_t::getTypeName());
  PlanStatus status;
  status.request_id = wire::hash_in(message.request_id);
  status.stage = static_cast<PlanStage>(check.within<std::int8_t>(
      "stage", message.stage, plan_status_t::STAGE_GLOBAL, plan_status_t::STAGE_LOCAL));
  status.state = static_cast<PlanState>(check.within<std::int8_t>(
      "state", message.state, plan_status_t::STATE_WAITING, plan_status_t::STATE_REFUSED));
  status.work_units = check.count("work_units", message.work_units);
  status.work_budget = check.count("work_budget", message.work_budget);
  status.best_cost_m = check.optional(
      message.best_cost_m, [&](double value) { return check.not_negative("best_cost_m", value); });
  status.lower_bound_m = check.not_negative("lower_bound_m", message.lower_bound_m);
  status.text = check.text("text", message.text, kMaxStatusTextBytes);
  const bool is_no_plan = status.state == PlanState::kNoPlan;
  check.within<std::int8_t>(
      "cause", message.cause,
      is_no_plan ? plan_status_t::CAUSE_START_OUTSIDE_MAP : plan_status_t::CAUSE_NONE,
      is_no_plan ? plan_status_t::CAUSE_GOAL_INSIDE_AREA : plan_status_t::CAUSE_NONE);
  if (is_no_plan) {
    flight::NoPlan& no_plan = status.no_plan.emplace();
    no_plan.cause = static_cast<flight::NoPlanCause>(message.cause);
    no_plan.explanation = status.text;
    if (!std::isnan(message.cause_x_m) || !std::isnan(message.cause_y_m)) {
      no_plan.place = geo::MapPoint{check.finite("cause_x_m", message.cause_x_m),
                                    check.finite("cause_y_m", message.cause_y_m)};
    }
  }
  return status;
}

Bytes to_message(const RouteHeader& header, const Stamp& stamp) {
  route_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.request_id, header.request_id);
  wire::put(message.map_hash, header.map_hash);
  message.patch_number = header.patch_number;
  wire::put_ref(message.plan, header.plan);
  message.cost_m = header.cost_m;
  message.lower_bound_m = header.lower_bound_m;
  message.length_m = header.length_m;
  message.work_units = header.work_units;
  message.seed = static_cast<std::int64_t>(header.seed);
  message.provenance = wire::cut_text(header.provenance, kProvenanceBytesMax);
  return wire::published<RouteHeader>(message);
}

template <>
RouteHeader from_message<RouteHeader>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<route_t>(bytes, stamp);
  const wire::Check check(route_t::getTypeName());
  RouteHeader header;
  header.request_id = wire::hash_in(message.request_id);
  header.map_hash = wire::hash_in(message.map_hash);
  header.patch_number = check.count("patch_number", message.patch_number);
  header.plan = wire::ref_in(check, "plan", message.plan);
  header.cost_m = check.not_negative("cost_m", message.cost_m);
  header.lower_bound_m = check.not_negative("lower_bound_m", message.lower_bound_m);
  header.length_m = check.not_negative("length_m", message.length_m);
  header.work_units = check.count("work_units", message.work_units);
  header.seed = static_cast<std::uint64_t>(message.seed);
  header.provenance = check.text("provenance", message.provenance, kProvenanceBytesMax);
  return header;
}

Bytes to_message(const TrajectoryHeader& header, const Stamp& stamp) {
  trajectory_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.request_id, header.request_id);
  wire::put(message.map_hash, header.map_hash);
  message.patch_number = header.patch_number;
  wire::put_ref(message.route, header.route);
  wire::put_ref(message.plan, header.plan);
  message.duration_s = header.duration_s;
  message.length_m = header.length_m;
  message.clearance_min_m = header.clearance_min_m;
  message.is_verified = header.is_verified ? 1 : 0;
  message.violation_count = header.violation_count;
  message.provenance = wire::cut_text(header.provenance, kProvenanceBytesMax);
  return wire::published<TrajectoryHeader>(message);
}

template <>
TrajectoryHeader from_message<TrajectoryHeader>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<trajectory_t>(bytes, stamp);
  const wire::Check check(trajectory_t::getTypeName());
  TrajectoryHeader header;
  header.request_id = wire::hash_in(message.request_id);
  header.map_hash = wire::hash_in(message.map_hash);
  header.patch_number = check.count("patch_number", message.patch_number);
  header.route = wire::ref_in(check, "route", message.route);
  header.plan = wire::ref_in(check, "plan", message.plan);
  header.duration_s = check.not_negative("duration_s", message.duration_s);
  header.length_m = check.not_negative("length_m", message.length_m);
  header.clearance_min_m = message.clearance_min_m;  // a finding, whatever it is
  header.is_verified = check.boolean("is_verified", message.is_verified);
  header.violation_count = check.count("violation_count", message.violation_count);
  header.provenance = check.text("provenance", message.provenance, kProvenanceBytesMax);
  return header;
}

}  // namespace hedgehop::messages
