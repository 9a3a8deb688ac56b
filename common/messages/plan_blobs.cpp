#include "messages/plan_blobs.hpp"

#include <algorithm>

#include "messages/plan_fields.hpp"
#include "messages/plan_messages.hpp"
#include "messages/wire.hpp"

#include "hedgehop/flight_plan_t.hpp"
#include "hedgehop/planning_config_t.hpp"
#include "hedgehop/route_plan_t.hpp"
#include "hedgehop/route_plan_v2_t.hpp"

namespace hedgehop::messages {
namespace {

constexpr std::size_t kBlobBytesMax = static_cast<std::size_t>(kMaxContentBytes);
constexpr std::size_t kWktBytesMax = 1U << 16;
constexpr std::size_t kLineBytesMax = 4096;

static_assert(kMaxVia == route_plan_t::MAX_VIA);

waypoint_t waypoint(const flight::Waypoint& point) {
  waypoint_t field{};
  field.x_m = point.x_m;
  field.y_m = point.y_m;
  field.altitude_m = point.altitude_m;
  return field;
}

flight::Waypoint waypoint_in(const wire::Check& check, const std::string& name,
                             const waypoint_t& field) {
  return {check.finite(name + ".x_m", field.x_m), check.finite(name + ".y_m", field.y_m),
          check.finite(name + ".altitude_m", field.altitude_m)};
}

std::int32_t count_of(std::size_t size, std::int64_t count_max, const char* what) {
  if (size > static_cast<std::size_t>(count_max)) {
    throw std::invalid_argument("cannot be sent: " + std::to_string(size) + " " + what +
                                ", at most " + std::to_string(count_max) + " fit");
  }
  return static_cast<std::int32_t>(size);
}

void put_state(flight_state_t& field, const flight::FlightState& state) {
  field.time_s = state.time_s;
  field.x_m = state.x_m;
  field.y_m = state.y_m;
  field.altitude_m = state.altitude_m;
  field.speed_mps = state.speed_mps;
  field.heading_true_rad = state.heading_true_rad;
  field.convergence_rad = state.convergence_rad;
  field.bank_rad = state.bank_rad;
  field.roll_rate_radps = state.roll_rate_radps;
  field.pitch_rad = state.pitch_rad;
  field.pitch_rate_radps = state.pitch_rate_radps;
  field.climb_rate_mps = state.climb_rate_mps;
  field.vertical_acceleration_mps2 = state.vertical_acceleration_mps2;
  field.target_heading_true_rad = state.target_heading_true_rad;
  field.commanded_heading_true_rad = state.commanded_heading_true_rad;
  field.commanded_climb_angle_rad = state.commanded_climb_angle_rad;
  field.commanded_speed_mps = state.commanded_speed_mps;
  field.surface_m = state.surface_m;
  field.terrain_m = state.terrain_m;
}

flight::FlightState state_in(const wire::Check& check, const flight_state_t& field) {
  flight::FlightState state;
  state.time_s = check.not_negative("states.time_s", field.time_s);
  state.x_m = check.finite("states.x_m", field.x_m);
  state.y_m = check.finite("states.y_m", field.y_m);
  state.altitude_m = check.finite("states.altitude_m", field.altitude_m);
  state.speed_mps = check.finite("states.speed_mps", field.speed_mps);
  state.heading_true_rad = check.finite("states.heading_true_rad", field.heading_true_rad);
  state.convergence_rad = check.finite("states.convergence_rad", field.convergence_rad);
  state.bank_rad = check.finite("states.bank_rad", field.bank_rad);
  state.roll_rate_radps = check.finite("states.roll_rate_radps", field.roll_rate_radps);
  state.pitch_rad = check.finite("states.pitch_rad", field.pitch_rad);
  state.pitch_rate_radps = check.finite("states.pitch_rate_radps", field.pitch_rate_radps);
  state.climb_rate_mps = check.finite("states.climb_rate_mps", field.climb_rate_mps);
  state.vertical_acceleration_mps2 =
      check.finite("states.vertical_acceleration_mps2", field.vertical_acceleration_mps2);
  state.target_heading_true_rad =
      check.finite("states.target_heading_true_rad", field.target_heading_true_rad);
  state.commanded_heading_true_rad =
      check.finite("states.commanded_heading_true_rad", field.commanded_heading_true_rad);
  state.commanded_climb_angle_rad =
      check.finite("states.commanded_climb_angle_rad", field.commanded_climb_angle_rad);
  state.commanded_speed_mps = check.finite("states.commanded_speed_mps", field.commanded_speed_mps);
  state.surface_m = check.finite_or_nan("states.surface_m", field.surface_m);
  state.terrain_m = check.finite_or_nan("states.terrain_m", field.terrain_m);
  return state;
}

/// A reader must accept what leaves here.
template <typename Decode>
Bytes checked(Bytes bytes, const Decode& decode) {
  try {
    decode(ByteView(bytes));
  } catch (const MessageError& error) {
    throw std::invalid_argument(std::string("cannot be sent: ") + error.what());
  }
  return bytes;
}

}  // namespace

Bytes encode_planning_config(const std::string& config_text) {
  planning_config_t message{};
  message.version = planning_config_t::VERSION;
  message.config_text = config_text;
  return checked(wire::encoded(message), decode_planning_config);
}

std::string decode_planning_config(ByteView bytes) {
  const auto message = wire::decoded<planning_config_t>(bytes, kMaxConfigBytes + 64);
  return wire::Check(planning_config_t::getTypeName())
      .text("config_text", message.config_text, kMaxConfigBytes);
}

namespace {

route_plan_t message_of(const flight::RoutePlan& plan) {
  route_plan_t message{};
  message.version = route_plan_t::VERSION;
  wire::put(message.request_id, plan.request_id);
  wire::put(message.map_hash, plan.map.hash);
  message.crs_wkt = plan.map.crs_wkt;
  message.vertical_datum = plan.map.vertical_datum;
  message.label = plan.map.label;
  message.num_attributions =
      count_of(plan.map.attributions.size(), route_plan_t::MAX_ATTRIBUTIONS, "attributions");
  message.attributions = plan.map.attributions;
  message.config_text = plan.config_text;
  const flight::PlanRequest& request = plan.request;
  wire::put_point(message.requested_start, request.start);
  wire::put_point(message.requested_goal, request.goal);
  message.num_via = count_of(request.via.size(), route_plan_t::MAX_VIA, "places between");
  for (const flight::RequestPoint& point : request.via) {
    wire::put_point(message.requested_via.emplace_back(), point);
  }
  message.start_heading_true_rad = wire::value_or_nan(request.start_heading_true_rad);
  message.speed_mps = wire::value_or_nan(request.speed_mps);
  message.seed = static_cast<std::int64_t>(request.seed);
  message.work_budget = request.work_budget;
  message.start = waypoint(plan.start);
  message.goal = waypoint(plan.goal);
  const flight::Route& route = plan.route;
  message.cost_length_m = route.cost.length_m;
  message.cost_visibility_m = route.cost.visibility_m;
  message.cost_semantics_m = route.cost.semantics_m;
  message.cost_height_m = route.cost.height_m;
  message.lower_bound_m = route.lower_bound_m;
  message.work_units = route.work_units;
  message.sample_count = route.samples;
  message.batch_count = route.batches;
  message.num_waypoints =
      count_of(route.waypoints.size(), route_plan_t::MAX_WAYPOINTS, "waypoints");
  for (const flight::Waypoint& point : route.waypoints) {
    message.waypoints.push_back(waypoint(point));
  }
  message.guide_spacing_m = route.guide_spacing_m;
  message.num_guide = count_of(route.guide.size(), route_plan_t::MAX_GUIDE, "guide points");
  for (const flight::Waypoint& point : route.guide) {
    message.guide.push_back(waypoint(point));
  }
  return message;
}

flight::RoutePlan plan_in(const route_plan_t& message) {
  const wire::Check check(route_plan_t::getTypeName());
  flight::RoutePlan plan;
  plan.request_id = wire::hash_in(message.request_id);
  plan.map.hash = wire::hash_in(message.map_hash);
  plan.map.crs_wkt = check.text("crs_wkt", message.crs_wkt, kWktBytesMax);
  plan.map.vertical_datum = check.text("vertical_datum", message.vertical_datum, kLineBytesMax);
  plan.map.label = check.text("label", message.label, kLineBytesMax);
  for (const std::string& line : message.attributions) {
    plan.map.attributions.push_back(check.text("attributions", line, kLineBytesMax));
  }
  plan.config_text = check.text("config_text", message.config_text, kMaxConfigBytes);
  flight::PlanRequest& request = plan.request;
  request.start = wire::point_in(check, "requested_start", message.requested_start);
  request.goal = wire::point_in(check, "requested_goal", message.requested_goal);
  for (const request_point_t& point : message.requested_via) {
    request.via.push_back(wire::point_in(check, "requested_via", point));
  }
  wire::read_options(check, message, request);
  plan.start = waypoint_in(check, "start", message.start);
  plan.goal = waypoint_in(check, "goal", message.goal);
  flight::Route& route = plan.route;
  route.cost.length_m = check.not_negative("cost_length_m", message.cost_length_m);
  route.cost.visibility_m = check.not_negative("cost_visibility_m", message.cost_visibility_m);
  route.cost.semantics_m = check.not_negative("cost_semantics_m", message.cost_semantics_m);
  route.cost.height_m = check.not_negative("cost_height_m", message.cost_height_m);
  route.lower_bound_m = check.not_negative("lower_bound_m", message.lower_bound_m);
  route.work_units = check.count("work_units", message.work_units);
  route.samples = check.count("sample_count", message.sample_count);
  route.batches = check.count("batch_count", message.batch_count);
  check.within<std::int32_t>("num_waypoints", message.num_waypoints, 2,
                             route_plan_t::MAX_WAYPOINTS);
  for (const waypoint_t& point : message.waypoints) {
    route.waypoints.push_back(waypoint_in(check, "waypoints", point));
  }
  route.guide_spacing_m = check.not_negative("guide_spacing_m", message.guide_spacing_m);
  for (const waypoint_t& point : message.guide) {
    route.guide.push_back(waypoint_in(check, "guide", point));
  }
  const Hash128 id = flight::plan_request_id(request, plan.map.hash, plan.config_text);
  if (id != plan.request_id) {
    check.refuse("request_id", plan.request_id.hex(),
                 "be " + id.hex() + ", the identity of its map, request and config");
  }
  return plan;
}

}  // namespace

Bytes encode_route_plan(const flight::RoutePlan& plan) {
  const flight::RouteCost& cost = plan.route.cost;
  const bool is_beyond =
      std::any_of(flight::kCostTerms.begin() + flight::kPaperCostTerms, flight::kCostTerms.end(),
                  [&cost](const flight::CostTerm& term) { return cost.*term.value_m != 0.0; });
  if (!is_beyond) {
    return checked(wire::encoded(message_of(plan)), decode_route_plan);
  }
  route_plan_v2_t message{};
  message.version = route_plan_v2_t::VERSION;
  message.route_plan = message_of(plan);
  message.cost_soft_ceiling_m = cost.soft_ceiling_m;
  message.cost_threats_m = cost.threats_m;
  message.cost_wire_crossings_m = cost.wire_crossings_m;
  message.cost_slope_m = cost.slope_m;
  return checked(wire::encoded(message), decode_route_plan);
}

flight::RoutePlan decode_route_plan(ByteView bytes) {
  if (!wire::is_of_type<route_plan_v2_t>(bytes)) {
    return plan_in(wire::decoded<route_plan_t>(bytes, kBlobBytesMax));
  }
  const auto message = wire::decoded<route_plan_v2_t>(bytes, kBlobBytesMax);
  const wire::Check check(route_plan_v2_t::getTypeName());
  check.within<int>("route_plan.version", message.route_plan.version, route_plan_t::VERSION,
                    route_plan_t::VERSION);
  flight::RoutePlan plan = plan_in(message.route_plan);
  flight::RouteCost& cost = plan.route.cost;
  cost.soft_ceiling_m = check.not_negative("cost_soft_ceiling_m", message.cost_soft_ceiling_m);
  cost.threats_m = check.not_negative("cost_threats_m", message.cost_threats_m);
  cost.wire_crossings_m =
      check.not_negative("cost_wire_crossings_m", message.cost_wire_crossings_m);
  cost.slope_m = check.not_negative("cost_slope_m", message.cost_slope_m);
  return plan;
}

Bytes encode_flight_plan(const flight::Plan& plan, const Hash128& route_blob_id) {
  flight_plan_t message{};
  message.version = flight_plan_t::VERSION;
  wire::put(message.request_id, plan.route_plan.request_id);
  wire::put(message.route_blob_id, route_blob_id);
  message.step_s = plan.trajectory.step_s;
  const flight::PathMeasures& measures = plan.measures;
  message.length_m = measures.length_m;
  message.duration_s = measures.duration_s;
  message.visibility_m = measures.visibility_m;
  message.semantics_m = measures.semantics_m;
  message.bank_rad_m = measures.bank_rad_m;
  message.mean_height_m = measures.mean_height_m;
  message.max_height_m = measures.max_height_m;
  message.share_under_ceiling = measures.share_under_ceiling;
  message.decision_count = plan.decisions;
  message.infeasible_decision_count = plan.infeasible_decisions;
  const flight::Verdict& verdict = plan.verdict;
  message.is_verified = verdict.is_verified ? 1 : 0;
  message.violation_count = verdict.violation_count;
  message.clearance_min_m = verdict.clearance_min_m;
  message.clearance_min_x_m = verdict.clearance_min_place.x_m;
  message.clearance_min_y_m = verdict.clearance_min_place.y_m;
  message.bank_max_rad = verdict.bank_max_rad;
  message.roll_rate_max_radps = verdict.roll_rate_max_radps;
  message.climb_rate_max_mps = verdict.climb_rate_max_mps;
  message.descent_rate_max_mps = verdict.descent_rate_max_mps;
  message.speed_min_mps = verdict.speed_min_mps;
  message.speed_max_mps = verdict.speed_max_mps;
  message.verdict_share_under_ceiling = verdict.share_under_ceiling;
  message.goal_distance_m = verdict.goal_distance_m;
  message.num_violations =
      count_of(verdict.violations.size(), flight_plan_t::MAX_VIOLATIONS, "violations");
  for (const flight::Violation& violation : verdict.violations) {
    violation_t& field = message.violations.emplace_back();
    field.time_s = violation.time_s;
    field.x_m = violation.place.x_m;
    field.y_m = violation.place.y_m;
    field.found = violation.value;
    field.demanded = violation.limit;
    message.violation_rules.push_back(violation.rule);
  }
  message.num_warnings = count_of(plan.warnings.size(), flight_plan_t::MAX_WARNINGS, "warnings");
  message.warnings = plan.warnings;
  message.num_states =
      count_of(plan.trajectory.states.size(), flight_plan_t::MAX_STATES, "flight states");
  message.states.resize(plan.trajectory.states.size());
  for (std::size_t i = 0; i < message.states.size(); ++i) {
    put_state(message.states[i], plan.trajectory.states[i]);
  }
  return checked(wire::encoded(message), [&](ByteView bytes) {
    return decode_flight_plan(bytes, plan.route_plan, route_blob_id);
  });
}

flight::Plan decode_flight_plan(ByteView bytes, const flight::RoutePlan& route_plan,
                                const Hash128& route_blob_id) {
  const auto message = wire::decoded<flight_plan_t>(bytes, kBlobBytesMax);
  const wire::Check check(flight_plan_t::getTypeName());
  if (wire::hash_in(message.request_id) != route_plan.request_id) {
    check.refuse("request_id", wire::hash_in(message.request_id).hex(),
                 "be that of the route, " + route_plan.request_id.hex());
  }
  if (wire::hash_in(message.route_blob_id) != route_blob_id) {
    check.refuse("route_blob_id", wire::hash_in(message.route_blob_id).hex(),
                 "be " + route_blob_id.hex());
  }
  flight::Plan plan;
  plan.route_plan = route_plan;
  plan.trajectory.step_s = check.positive("step_s", message.step_s);
  flight::PathMeasures& measures = plan.measures;
  measures.length_m = check.not_negative("length_m", message.length_m);
  measures.duration_s = check.not_negative("duration_s", message.duration_s);
  // What the measures and the verdict found is reported as it is.
  measures.visibility_m = message.visibility_m;
  measures.semantics_m = message.semantics_m;
  measures.bank_rad_m = message.bank_rad_m;
  measures.mean_height_m = message.mean_height_m;
  measures.max_height_m = message.max_height_m;
  measures.share_under_ceiling = message.share_under_ceiling;
  plan.decisions = check.count("decision_count", message.decision_count);
  plan.infeasible_decisions =
      check.count("infeasible_decision_count", message.infeasible_decision_count);
  flight::Verdict& verdict = plan.verdict;
  verdict.is_verified = check.boolean("is_verified", message.is_verified);
  verdict.violation_count = check.count("violation_count", message.violation_count);
  if (verdict.is_verified && (verdict.violation_count != 0 || message.num_violations != 0)) {
    check.refuse("violation_count", verdict.violation_count, "be 0 when is_verified is true");
  }
  verdict.clearance_min_m = message.clearance_min_m;
  verdict.clearance_min_place = {message.clearance_min_x_m, message.clearance_min_y_m};
  verdict.bank_max_rad = message.bank_max_rad;
  verdict.roll_rate_max_radps = message.roll_rate_max_radps;
  verdict.climb_rate_max_mps = message.climb_rate_max_mps;
  verdict.descent_rate_max_mps = message.descent_rate_max_mps;
  verdict.speed_min_mps = message.speed_min_mps;
  verdict.speed_max_mps = message.speed_max_mps;
  verdict.share_under_ceiling = message.verdict_share_under_ceiling;
  verdict.goal_distance_m = message.goal_distance_m;
  for (std::size_t i = 0; i < message.violations.size(); ++i) {
    const violation_t& field = message.violations[i];
    flight::Violation violation;
    violation.rule = check.text("violation_rules", message.violation_rules[i], kLineBytesMax);
    violation.time_s = field.time_s;
    violation.place = {field.x_m, field.y_m};
    violation.value = field.found;
    violation.limit = field.demanded;
    verdict.violations.push_back(std::move(violation));
  }
  for (const std::string& line : message.warnings) {
    plan.warnings.push_back(check.text("warnings", line, kLineBytesMax));
  }
  check.within<std::int32_t>("num_states", message.num_states, 1, flight_plan_t::MAX_STATES);
  plan.trajectory.states.reserve(message.states.size());
  for (const flight_state_t& field : message.states) {
    plan.trajectory.states.push_back(state_in(check, field));
  }
  return plan;
}

}  // namespace hedgehop::messages
