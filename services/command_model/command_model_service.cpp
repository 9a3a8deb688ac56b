#include "command_model_service.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "command_model/planned_state.hpp"
#include "messages/message_error.hpp"
#include "messages/plan_blobs.hpp"
#include "planning/planning.hpp"

namespace hedgehop::services {
namespace {

using messages::ServiceState;
using messages::Stamp;

constexpr std::size_t kKnownRoutes = 1024;
constexpr std::size_t kKeptModels = 16;
constexpr std::size_t kLockstepTargetsMax = 1000;
constexpr double kJoining_m = 0.5;  // a state is 2 m from the next one at 40 m/s

}  // namespace

CommandModelOptions read_command_model_options(ConfigReader reader) {
  CommandModelOptions options;
  options.tick_period_s = reader.required_double("tick_period_s");
  options.target_age_max_s = reader.required_double("target_age_max_s");
  options.catch_up_steps_max = static_cast<int>(reader.required_integer("catch_up_steps_max"));
  const std::string plant = reader.required_string("plant");
  reader.require(plant == "replay" || plant == "closed_loop" || plant == "rotor", "plant",
                 "must be replay, closed_loop or rotor");
  options.plant = plant == "rotor"         ? CommandModelOptions::Plant::kRotor
                  : plant == "closed_loop" ? CommandModelOptions::Plant::kClosedLoop
                                           : CommandModelOptions::Plant::kReplay;
  options.has_feed_forward = reader.required_bool("feed_forward");
  options.replan_lead_s = reader.required_double("replan_lead_s");
  reader.require(options.replan_lead_s >= 0.0 && options.replan_lead_s <= 120.0, "replan_lead_s",
                 "must lie between 0 and 120");
  options.reaction.horizon_s = reader.required_double("reaction_horizon_s");
  reader.require(options.reaction.horizon_s == 0.0 ||
                     (options.reaction.horizon_s >= 20.0 && options.reaction.horizon_s <= 300.0),
                 "reaction_horizon_s", "must be 0 or lie between 20 and 300");
  options.reaction.heading_rate_max_radps =
      radians_from_degrees(reader.required_double("heading_rate_max_degps"));
  reader.require(options.reaction.heading_rate_max_radps >= kDegree_rad &&
                     options.reaction.heading_rate_max_radps <= 180.0 * kDegree_rad,
                 "heading_rate_max_degps", "must lie between 1 and 180");
  const double wind_mps = reader.required_double("wind_mps");
  reader.require(wind_mps >= 0.0 && wind_mps <= 30.0, "wind_mps", "must lie between 0 and 30");
  const double wind_from_rad = reader.required_angle("wind_from_deg");
  options.wind = {-wind_mps * elementary::sin(wind_from_rad),
                  -wind_mps * elementary::cos(wind_from_rad)};
  ConfigReader follower = reader.required_section("path_following");
  options.path_following = command_model::read_follower_options(follower);
  ConfigReader turbulence = reader.required_section("turbulence");
  options.turbulence = command_model::read_turbulence_options(turbulence);
  reader.finish();
  reader.require(options.tick_period_s >= 0.001 && options.tick_period_s <= 0.05, "tick_period_s",
                 "must lie between 0.001 and 0.05");
  reader.require(options.target_age_max_s >= 0.05 && options.target_age_max_s <= 60.0,
                 "target_age_max_s", "must lie between 0.05 and 60");
  reader.require(options.catch_up_steps_max >= 1 && options.catch_up_steps_max <= 100000,
                 "catch_up_steps_max", "must lie between 1 and 100000");
  return options;
}

namespace {

// In the wind that the route was planned for.
planning::PlanningConfig config_of(const flight::RoutePlan& route) {
  return planning::in_wind(planning::read_planning_config(route.config_text, "config of the route"),
                           route.map.crs_wkt, route.start.point());
}

}  // namespace

std::shared_ptr<const command_model::RotorPlant> shipped_rotor() {
  ConfigReader reader =
      ConfigReader::from_text(shipped_config("rotor_plant.yaml"), "config/rotor_plant.yaml");
  return std::make_shared<const command_model::RotorPlant>(
      command_model::read_rotor_parameters(reader));
}

struct CommandModelService::Flight {
  Hash128 request_id;
  Hash128 plan_id;  // blob of the trajectory, or of the one that a reaction left
  Hash128 map_hash;
  std::int64_t patch_number = 0;
  flight::RoutePlan route;
  Config config;
  Model model;
  std::optional<flight::Trajectory> trajectory;     // none: flown by targets
  std::unique_ptr<command_model::PathFlight> path;  // along the trajectory; none: by its commands
  double rotor_power_max_w = 0.0;                   // 0: no rotor
  command_model::ModelState state;
  command_model::Command command;
  double step_s = 0.0;
  std::int64_t step_number = 0;
  std::int64_t steps_before = 0;  // of the same plan, before it was left for a reaction
  bool is_heading_limited = false;
  std::string reaction_text;     // empty: it is as planned
  std::size_t way_out_step = 0;  // of a reaction
  double via_radius_m = 0.0;     // likewise
  Time start;
  Time newest_target;
  double horizontal_deviation_max_m = 0.0;
  double vertical_deviation_max_m = 0.0;

  // Where on its trajectory it is.
  [[nodiscard]] std::size_t place() const {
    const auto step = path ? static_cast<std::size_t>(path->plan_time_s() / step_s)
                           : static_cast<std::size_t>(step_number);
    return std::min(step, trajectory->states.size() - 1);
  }
  [[nodiscard]] bool is_on_way_out() const {
    return !reaction_text.empty() && way_out_step < trajectory->states.size();
  }
  // The vehicle is what it is, whatever state the new trajectory begins with.
  void continue_from(const Flight& before, double heading_rate_max_radps) {
    state = before.state;
    command.heading_math_rad = limited_from(before, heading_rate_max_radps);
    is_heading_limited = true;
    if (before.path) {
      path->take_over(*before.path);
      path->limit_heading_rate(heading_rate_max_radps);
    }
  }
  [[nodiscard]] double limited_from(const Flight& before, double heading_rate_max_radps) const {
    return command_model::limited_heading_rad(
        before.command.heading_math_rad, command.heading_math_rad, heading_rate_max_radps * step_s);
  }
  // Through the air of the wind that is planned for, and over the ground.
  [[nodiscard]] command_model::ModelState air_state() const {
    return path ? command_model::through_air(state, model->vehicle().wind) : state;
  }
  [[nodiscard]] command_model::ModelState ground_state() const {
    return path ? state : command_model::over_ground(state, model->vehicle().wind);
  }
  // Where on the path still ahead another trajectory begins, if it does.
  [[nodiscard]] std::optional<std::size_t> step_at(const flight::FlightState& first) const {
    if (!trajectory) {
      return std::nullopt;
    }
    const auto& states = trajectory->states;
    for (std::size_t step = place() + 1; step < states.size(); ++step) {
      const double dx_m = states[step].x_m - first.x_m;
      const double dy_m = states[step].y_m - first.y_m;
      if (dx_m * dx_m + dy_m * dy_m < kJoining_m * kJoining_m) {
        return step;
      }
    }
    return std::nullopt;
  }
  [[nodiscard]] Time time_of(std::int64_t step) const {
    return start + static_cast<double>(step) * step_s;
  }
  void note_deviation() {
    const flight::FlightState& wanted = trajectory->states[static_cast<std::size_t>(step_number)];
    const double dx_m = state.x_m - wanted.x_m;
    const double dy_m = state.y_m - wanted.y_m;
    horizontal_deviation_max_m =
        std::max(horizontal_deviation_max_m, std::sqrt(dx_m * dx_m + dy_m * dy_m));
    vertical_deviation_max_m =
        std::max(vertical_deviation_max_m, std::fabs(state.altitude_m - wanted.altitude_m));
  }
  [[nodiscard]] std::string text() const {
    return flown_text() + (patch_number > 0 ? ", on patch " + std::to_string(patch_number) : "") +
           reaction_text;
  }
  [[nodiscard]] std::string flown_text() const {
    char text[300];
    if (path) {
      const command_model::PathRecord& record = path->record();
      int length = std::snprintf(
          text, sizeof text,
          "flight of request %.8s, %.0f s; beside its path by at most %.3g m, below %.3g m, above "
          "%.3g m",
          request_id.hex().c_str(), static_cast<double>(step_number) * step_s,
          record.horizontal_max_m, record.below_max_m, record.above_max_m);
      if (rotor_power_max_w > 0.0) {
        std::snprintf(text + length, sizeof text - static_cast<std::size_t>(length),
                      "; torque margin %.0f %%",
                      100.0 * (1.0 - record.power_max_w / rotor_power_max_w));
      }
      return text;
    }
    std::snprintf(text, sizeof text,
                  "flight of request %.8s, %.0f s; strayed from the trajectory by at most %.3g m, "
                  "in altitude %.3g m",
                  request_id.hex().c_str(), static_cast<double>(step_number) * step_s,
                  horizontal_deviation_max_m, vertical_deviation_max_m);
    return text;
  }
};

CommandModelService::CommandModelService(const CommandModelOptions& options, bus::Bus& bus,
                                         bus::BlobExchange& exchange, bus::ServiceLoop& loop,
                                         std::shared_ptr<const command_model::RotorPlant> rotor)
    : options_(options),
      rotor_(std::move(rotor)),
      bus_(bus),
      exchange_(exchange),
      loop_(loop),
      replanner_(options.replan_lead_s, bus, exchange),
      reaction_(options.reaction, bus, exchange) {
  HEDGEHOP_ASSERT(options.plant != CommandModelOptions::Plant::kRotor || rotor_);
  bus.subscribe<messages::RouteHeader>(messages::kRouteChannel,
                                       [this](const messages::RouteHeader& route, const Stamp&) {
                                         reaction_.need(route.map_hash);
                                         remember_route(route.request_id, route.plan);
                                       });
  bus.subscribe<messages::TrajectoryHeader>(
      messages::kTrajectoryChannel,
      [this](const messages::TrajectoryHeader& trajectory, const Stamp&) {
        if (trajectory.plan.id != flown_plan_ &&
            (!next_flight_ || trajectory.plan.id != next_flight_->plan_id)) {
          reaction_.need(trajectory.map_hash);
          next_trajectory_ = trajectory;
        }
      });
  bus.subscribe<messages::VehicleTarget>(
      messages::kVehicleTargetChannel,
      [this](const messages::VehicleTarget& target, const Stamp&) { receive(target); });
}

CommandModelService::~CommandModelService() = default;

void CommandModelService::receive(const messages::VehicleTarget& target) {
  if (!target.is_lockstep) {
    target_ = target;
  } else {
    if (lockstep_targets_.size() == kLockstepTargetsMax) {
      lockstep_targets_.pop_front();  // its sender repeats it, if it still waits
    }
    lockstep_targets_.push_back(target);
  }
}

void CommandModelService::remember_route(const Hash128& request_id,
                                         const messages::BlobRef& route) {
  if (!routes_.insert_or_assign(request_id, route).second) {
    return;
  }
  route_order_.push_back(request_id);
  if (route_order_.size() > kKnownRoutes) {
    const Hash128 oldest = route_order_.front();
    route_order_.pop_front();
    exchange_.forget(routes_.at(oldest).id);
    routes_.erase(oldest);
  }
}

CommandModelService::Model CommandModelService::model_of(const Hash128& request_id) {
  const auto known = models_.find(request_id);
  if (known != models_.end()) {
    return known->second;
  }
  const auto route = routes_.find(request_id);
  if (route == routes_.end()) {
    return nullptr;
  }
  exchange_.want(route->second, "route of request " + request_id.hex());
  const Bytes* content = exchange_.content(route->second.id);
  if (content == nullptr) {
    return nullptr;
  }
  const planning::PlanningConfig config = config_of(messages::decode_route_plan(*content));
  if (model_order_.size() == kKeptModels) {
    const Hash128 oldest = model_order_.front();
    model_order_.pop_front();
    models_.erase(oldest);
    const auto its_route = routes_.find(oldest);
    if (its_route != routes_.end()) {
      exchange_.forget(its_route->second.id);  // asked for again if it is needed again
    }
  }
  model_order_.push_back(request_id);
  return models_.emplace(request_id, std::make_shared<command_model::CommandModel>(config.vehicle))
      .first->second;
}

void CommandModelService::tick(Time now) {
  try {
    reaction_.tick(flight_ != nullptr);
    take_off_if_ready(now);
    answer_lockstep();
    take_over_if_targeted(now);
    react_to_news(now);
  } catch (const std::exception& error) {  // what came over the bus is of no use
    next_trajectory_.reset();
    lockstep_targets_.clear();
    target_.reset();
    std::fprintf(stderr, "refused: %s\n", error.what());
    loop_.set_state(ServiceState::kDegraded, error.what());
  }
  if (flight_) {
    fly(now);
  }
  replanner_.tick(newest_flight(), now);
}

std::optional<FlightUnderWay> CommandModelService::newest_flight() const {
  const Flight* flight = next_flight_ ? next_flight_.get() : flight_.get();
  if (flight == nullptr || !flight->trajectory) {
    return std::nullopt;
  }
  const std::size_t step = next_flight_ ? 0 : flight->place();
  return FlightUnderWay{&flight->route,
                        &*flight->trajectory,
                        step,
                        flight->map_hash,
                        flight->config->weights.threats > 0.0,
                        flight->via_radius_m};
}

void CommandModelService::take_off_if_ready(Time now) {
  if (!next_trajectory_) {
    return;
  }
  const messages::TrajectoryHeader header = *next_trajectory_;
  remember_route(header.request_id, header.route);
  const Model model = model_of(header.request_id);
  exchange_.want(header.plan, "trajectory of request " + header.request_id.hex());
  exchange_.want(header.route, "route of request " + header.request_id.hex());
  const Bytes* content = exchange_.content(header.plan.id);
  const Bytes* route = exchange_.content(header.route.id);
  if (!model || content == nullptr || route == nullptr) {
    return;
  }
  next_trajectory_.reset();
  auto next = std::make_unique<Flight>();
  next->route = messages::decode_route_plan(*route);
  flight::Plan plan = messages::decode_flight_plan(*content, next->route, header.route.id);
  exchange_.forget(header.plan.id);
  if (plan.trajectory.states.size() < 2 || plan.trajectory.step_s > 0.2) {
    throw messages::MessageError("the trajectory has too few states or too long a step");
  }
  next->request_id = header.request_id;
  next->plan_id = header.plan.id;
  next->map_hash = header.map_hash;
  next->patch_number = header.patch_number;
  next->config = std::make_shared<const planning::PlanningConfig>(config_of(next->route));
  next->model = model;
  next->step_s = plan.trajectory.step_s;
  next->state =
      command_model::model_state_of(plan.trajectory.states.front(), next->config->vehicle.wind);
  next->command = command_model::command_of(plan.trajectory.states.front());
  next->trajectory = std::move(plan.trajectory);
  prepare_path(*next);
  target_.reset();
  const auto joining_step =
      flight_ ? flight_->step_at(next->trajectory->states.front()) : std::nullopt;
  if (joining_step) {
    next_flight_ = std::move(next);
    next_flight_step_ = *joining_step;
  } else if (flight_ && replanner_.has_asked(next->request_id)) {
    flown_plan_ = next->plan_id;  // too late: its beginning has been passed
  } else {
    begin(std::move(next), now);
  }
}

void CommandModelService::prepare_path(Flight& flight) const {
  if (options_.plant == CommandModelOptions::Plant::kReplay) {
    return;
  }
  const bool is_rotor = options_.plant == CommandModelOptions::Plant::kRotor;
  const flight::Wind& planned = flight.config->vehicle.wind;
  flight.path = std::make_unique<command_model::PathFlight>(
      *flight.trajectory,
      is_rotor ? command_model::Plant(rotor_) : command_model::Plant(flight.model),
      options_.path_following, options_.has_feed_forward,
      flight::Wind{planned.east_mps + options_.wind.east_mps,
                   planned.north_mps + options_.wind.north_mps},
      planned);
  if (options_.turbulence.wind_6m_mps > 0.0) {
    flight.path->add_turbulence(options_.turbulence);
  }
  flight.rotor_power_max_w = is_rotor ? rotor_->power_max_w() : 0.0;
}

void CommandModelService::begin(std::unique_ptr<Flight> flight, Time start) {
  next_flight_.reset();
  flight_ = std::move(flight);
  flight_->start = start;
  reaction_.begin_flight(flight_->patch_number);
  flown_plan_ = flight_->plan_id;
  loop_.set_state(ServiceState::kWorking, flight_->text());
  publish_state(*flight_);
}

void CommandModelService::join_if_there() {
  if (!next_flight_ || flight_->place() < next_flight_step_) {
    return;
  }
  next_flight_->continue_from(*flight_, options_.reaction.heading_rate_max_radps);
  begin(std::move(next_flight_), flight_->time_of(flight_->step_number));
}

void CommandModelService::react_to_news(Time now) {
  if (!flight_ || !flight_->trajectory || !reaction_.has_news(now)) {
    return;
  }
  const planning::FlightUnderPlan under_plan{&*flight_->trajectory, flight_->place(),
                                             flight_->air_state(),
                                             flight_->command.heading_math_rad};
  auto answer = reaction_.answer(now, flight_->route.map.crs_wkt, *flight_->config, under_plan);
  if (!answer || answer->reaction.kind == planning::ReactionKind::kNone) {
    return;
  }
  planning::Reaction& reaction = answer->reaction;
  auto next = std::make_unique<Flight>();
  next->request_id = flight_->request_id;
  next->plan_id = flight_->plan_id;
  next->map_hash = flight_->map_hash;
  next->patch_number = flight_->patch_number;
  next->route = flight_->route;
  next->route.request.via = via_ahead({&flight_->route, &*flight_->trajectory, flight_->place(),
                                       flight_->map_hash, false, flight_->via_radius_m},
                                      flight_->place());
  next->config = flight_->config;
  next->model = flight_->model;
  next->step_s = flight_->step_s;
  next->trajectory = std::move(reaction.trajectory);
  next->way_out_step = reaction.way_out_step;
  next->via_radius_m = flight_->config->demands.via_radius_m;
  next->steps_before = flight_->steps_before + flight_->step_number;
  next->reaction_text = "; " + answer->to_what + " has appeared: ";
  switch (reaction.kind) {
    case planning::ReactionKind::kAround:
      next->reaction_text += "flies around";
      break;
    case planning::ReactionKind::kWayOut:
      next->reaction_text += "climbs out";
      break;
    default:
      next->reaction_text += "climbs out, nearer to the ground than is required";
      break;
  }
  prepare_path(*next);
  next->command = command_model::command_of(next->trajectory->states.front());
  next->continue_from(*flight_, options_.reaction.heading_rate_max_radps);
  // What was published for this step stands, so that nobody sees two turns in one.
  next->command.heading_math_rad = flight_->command.heading_math_rad;
  next->start = flight_->time_of(flight_->step_number);
  next_flight_.reset();  // planned without what has appeared
  flight_ = std::move(next);
  std::fprintf(stderr, "flight of request %.8s%s\n", flight_->request_id.hex().c_str(),
               flight_->reaction_text.c_str());
  loop_.set_state(ServiceState::kWorking, flight_->text());
}

void CommandModelService::answer_lockstep() {
  for (auto target = lockstep_targets_.begin(); target != lockstep_targets_.end();) {
    const Model model = model_of(target->request_id);
    if (!model) {
      ++target;
      continue;
    }
    messages::VehicleState answer;
    answer.request_id = target->request_id;
    answer.step_number = target->step_number;
    answer.is_lockstep = true;
    answer.flight_time_s = static_cast<double>(target->step_number) * target->step_s;
    answer.state = model->step(target->state, target->command, target->step_s);
    answer.command = target->command;
    bus_.publish(messages::kVehicleStateChannel, answer, bus_.message_time());
    target = lockstep_targets_.erase(target);
  }
}

void CommandModelService::take_over_if_targeted(Time now) {
  if (!target_) {
    return;
  }
  const Model model = model_of(target_->request_id);
  if (!model) {
    return;
  }
  if (!flight_ || flight_->request_id != target_->request_id || flight_->trajectory) {
    auto taken = std::make_unique<Flight>();
    taken->request_id = target_->request_id;
    taken->model = model;
    taken->state = flight_ && flight_->request_id == target_->request_id ? flight_->air_state()
                                                                         : target_->state;
    taken->step_s = std::min(target_->step_s, 0.05);
    taken->start = now;
    next_flight_.reset();
    flight_ = std::move(taken);
    loop_.set_state(ServiceState::kWorking, "flown by VEHICLE_TARGET");
  }
  flight_->command = target_->command;
  flight_->newest_target = now;
  target_.reset();
}

void CommandModelService::fly(Time now) {
  for (int steps = 0; steps < options_.catch_up_steps_max; ++steps) {
    join_if_there();
    Flight& flight = *flight_;
    if (flight.time_of(flight.step_number + 1) > now) {
      return;
    }
    if (!flight.trajectory &&
        seconds_between(flight.newest_target, now) > options_.target_age_max_s) {
      end_flight("no VEHICLE_TARGET any more");
      return;
    }
    if (flight.path) {
      flight.path->step();
      ++flight.step_number;
      flight.state = flight.path->state();
      flight.command = flight.path->command();
      publish_state(flight);
      if (flight.path->is_over()) {
        end_flight((flight.is_on_way_out()       ? "nobody planned again: "
                    : flight.path->has_arrived() ? "arrived: "
                                                 : "did not arrive: ") +
                   flight.text());
        return;
      }
      if (flight.step_number % 20 == 0) {
        loop_.set_state(ServiceState::kWorking, flight.text() + replanner_.text());
      }
      continue;
    }
    flight.state = flight.model->step(flight.state, flight.command, flight.step_s);
    ++flight.step_number;
    if (flight.trajectory) {
      flight.note_deviation();
      const double before_rad = flight.command.heading_math_rad;
      flight.command = command_model::command_of(
          flight.trajectory->states[static_cast<std::size_t>(flight.step_number)]);
      if (flight.is_heading_limited) {
        flight.command.heading_math_rad = command_model::limited_heading_rad(
            before_rad, flight.command.heading_math_rad,
            options_.reaction.heading_rate_max_radps * flight.step_s);
      }
    }
    publish_state(flight);
    if (flight.trajectory &&
        flight.step_number + 1 == static_cast<std::int64_t>(flight.trajectory->states.size())) {
      end_flight((flight.is_on_way_out() ? "nobody planned again: " : "arrived: ") + flight.text());
      return;
    }
    if (flight.trajectory && flight.step_number % 20 == 0) {
      loop_.set_state(ServiceState::kWorking, flight.text() + replanner_.text());
    }
  }
}

void CommandModelService::end_flight(const std::string& text) {
  flight_.reset();
  next_flight_.reset();
  loop_.set_state(ServiceState::kReady, text);
}

void CommandModelService::publish_state(const Flight& flight) {
  messages::VehicleState message;
  message.request_id = flight.request_id;
  message.step_number = flight.steps_before + flight.step_number;
  message.flight_time_s = static_cast<double>(message.step_number) * flight.step_s;
  message.state = flight.ground_state();
  message.command = flight.command;
  if (flight.trajectory) {
    message.heading_true_rad =
        true_from_grid_azimuth_rad(azimuth_from_math_angle_rad(message.state.heading_math_rad),
                                   flight.trajectory->states[flight.place()].convergence_rad);
  }
  bus_.publish(messages::kVehicleStateChannel, message, flight.time_of(flight.step_number));
}

}  // namespace hedgehop::services
