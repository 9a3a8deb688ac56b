#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "base/config_reader.hpp"
#include "base/time.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "bus/service.hpp"
#include "command_model/command_model.hpp"
#include "command_model/path_flight.hpp"
#include "flight/plan.hpp"
#include "flight_reaction.hpp"
#include "flight_replanner.hpp"
#include "messages/plan_messages.hpp"
#include "messages/vehicle_messages.hpp"

namespace hedgehop::services {

/// config/command_model.yaml
struct CommandModelOptions {
  double tick_period_s = 0.0;
  double target_age_max_s = 0.0;  // a real-time target is held this long, then the flight ends
  int catch_up_steps_max = 0;     // steps in one tick when the process was held up
  double replan_lead_s = 0.0;     // see FlightReplanner
  planning::ReactionOptions reaction;
  enum class Plant : std::uint8_t { kReplay, kClosedLoop, kRotor };
  Plant plant = Plant::kReplay;
  bool has_feed_forward = false;
  command_model::Wind wind;  // beside the one that was planned for, but for kReplay
  command_model::TurbulenceOptions turbulence;  // likewise
  command_model::FollowerOptions path_following;
};
CommandModelOptions read_command_model_options(ConfigReader reader);

/// The shipped rotor_plant.yaml.
std::shared_ptr<const command_model::RotorPlant> shipped_rotor();

/// The simulated helicopter.
///
/// It flies the newest TRAJECTORY in real time: the command model is stepped with the commands that
/// the trajectory states (feed-forward), one VEHICLE_STATE a step, and the status tells how far it
/// strays. With another plant than kReplay path-following controllers keep it on the trajectory, in
/// a wind, with the planner's model or a rotor whose power is reckoned. A real-time VEHICLE_TARGET
/// takes over with its own command. A lockstep VEHICLE_TARGET is answered by one step from the
/// state that it brings, however often it is asked.
///
/// A trajectory that begins on the path still ahead takes over where it begins; any other one at
/// once. So a flight whose map has changed is planned again from a place ahead, see
/// FlightReplanner, and flown on without a stop. Until then it reacts to what has appeared by
/// itself from the next step on, see FlightReaction.
/// In a reaction, and where another trajectory takes over in flight, the
/// commanded heading changes no faster than heading_rate_max_radps.
///
/// Which vehicle it is says the config of the request, which comes with the route.
class CommandModelService {
 public:
  /// @param rotor  of kRotor
  CommandModelService(const CommandModelOptions& options, bus::Bus& bus,
                      bus::BlobExchange& exchange, bus::ServiceLoop& loop,
                      std::shared_ptr<const command_model::RotorPlant> rotor = nullptr);
  ~CommandModelService();

  void tick(Time now);

 private:
  struct Flight;
  using Model = std::shared_ptr<const command_model::CommandModel>;
  using Config = std::shared_ptr<const planning::PlanningConfig>;

  void receive(const messages::VehicleTarget& target);
  void remember_route(const Hash128& request_id, const messages::BlobRef& route);
  /// The vehicle of a request; nullptr while its route has not arrived.
  [[nodiscard]] Model model_of(const Hash128& request_id);
  void take_off_if_ready(Time now);
  void prepare_path(Flight& flight) const;
  void begin(std::unique_ptr<Flight> flight, Time start);
  void join_if_there();
  void react_to_news(Time now);
  [[nodiscard]] std::optional<FlightUnderWay> newest_flight() const;
  void answer_lockstep();
  void take_over_if_targeted(Time now);
  void fly(Time now);
  void end_flight(const std::string& text);
  void publish_state(const Flight& flight);

  CommandModelOptions options_;
  std::shared_ptr<const command_model::RotorPlant> rotor_;
  bus::Bus& bus_;
  bus::BlobExchange& exchange_;
  bus::ServiceLoop& loop_;
  std::map<Hash128, messages::BlobRef> routes_;
  std::deque<Hash128> route_order_;  // oldest first
  std::map<Hash128, Model> models_;
  std::deque<Hash128> model_order_;  // oldest first
  std::optional<messages::TrajectoryHeader> next_trajectory_;
  Hash128 flown_plan_;  // blob of the newest trajectory that was started
  std::deque<messages::VehicleTarget> lockstep_targets_;
  std::optional<messages::VehicleTarget> target_;
  std::unique_ptr<Flight> flight_;
  std::unique_ptr<Flight> next_flight_;  // takes over where it begins on the path of flight_
  std::size_t next_flight_step_ = 0;     // of flight_
  FlightReplanner replanner_;
  FlightReaction reaction_;
};

}  // namespace hedgehop::services
