#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "base/time.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "bus/map_exchange.hpp"
#include "messages/map_messages.hpp"
#include "planning/reaction.hpp"

namespace hedgehop::services {

/// Has a flight react at once to what MAP_PATCH says has appeared, numbered by map_tiler or not
/// yet, with planning::reaction_to(). To that end it keeps the map that is on the bus. That map is
/// exchanged on the ground alone: in flight, what has appeared since is put over the part of it
/// that the flight ahead needs. A flight whose named observers have not come reacts without them.
///
/// Things whose centre lies outside that part are left to whoever plans again.
class FlightReaction {
 public:
  /// @param options  horizon_s 0: never reacts
  FlightReaction(const planning::ReactionOptions& options, bus::Bus& bus,
                 bus::BlobExchange& exchange);

  /// The map of a flight to come, which says whether named observers belong to it.
  void need(const Hash128& map_hash) { assembly_.need(map_hash); }

  void tick(bool is_flying);

  /// What has appeared after this patch of the map that a flight was planned on is news to it.
  void begin_flight(std::int64_t patch_number);
  /// What may lie beyond the horizon is looked at again some time later.
  [[nodiscard]] bool has_news(Time now);

  struct Answer {
    planning::Reaction reaction;
    std::string to_what;  // for people
  };
  /// What the flight does about the news, which are none any more after that. None while the map
  /// is not there, or where it is nothing that concerns the flight.
  std::optional<Answer> answer(Time now, const std::string& crs_wkt,
                               const planning::PlanningConfig& config,
                               const planning::FlightUnderPlan& flight);

 private:
  void receive(const messages::MapPatch& message);
  [[nodiscard]] bool is_map_exchanged() const { return !is_flying_ || !assembly_.map(); }

  planning::ReactionOptions options_;
  bus::MapAssembly assembly_;
  bool is_flying_ = false;
  std::optional<Hash128> base_map_hash_;  // as map_tiler says
  std::map<std::int64_t, messages::MapPatch> present_;
  std::set<std::int64_t> news_;
  std::int64_t patch_number_ = 0;  // of the flight
  std::optional<Time> look_again_;
};

}  // namespace hedgehop::services
