#include "flight_reaction.hpp"

#include <utility>
#include <vector>

#include "preparation/map_patches.hpp"

namespace hedgehop::services {
namespace {

using messages::Stamp;

constexpr double kLookAgain_s = 5.0;
constexpr std::size_t kPresentMax = 400;  // twice what map_tiler keeps

}  // namespace

FlightReaction::FlightReaction(const planning::ReactionOptions& options, bus::Bus& bus,
                               bus::BlobExchange& exchange)
    : options_(options), assembly_(exchange) {
  if (options.horizon_s <= 0.0 || bus.is_replay()) {  // of a log, what was flown is in it
    options_.horizon_s = 0.0;
    return;
  }
  bus.subscribe<messages::MapIndex>(messages::kMapIndexChannel,
                                    [this](const messages::MapIndex& index, const Stamp& stamp) {
                                      if (is_map_exchanged()) {
                                        assembly_.receive(index, stamp.sender_id);
                                      }
                                    });
  bus.subscribe<messages::MapPatchState>(
      messages::kMapPatchStateChannel, [this](const messages::MapPatchState& state, const Stamp&) {
        base_map_hash_ = state.base_map_hash;
      });
  bus.subscribe<messages::MapPatch>(
      messages::kMapPatchChannel,
      [this](const messages::MapPatch& message, const Stamp&) { receive(message); });
}

void FlightReaction::receive(const messages::MapPatch& message) {
  const auto map = assembly_.map();
  const bool is_of_map =
      message.base_map_hash == base_map_hash_ || (map && map->hash == message.base_map_hash);
  if (!is_of_map) {
    return;
  }
  const auto known = present_.find(message.patch.id);
  if (!message.is_present) {
    if (message.patch_number > 0 && known != present_.end()) {
      present_.erase(known);
      news_.erase(message.patch.id);
    }
    return;
  }
  if (known != present_.end() && known->second.patch == message.patch) {
    known->second.patch_number = message.patch_number;
    return;
  }
  if (known == present_.end() && present_.size() >= kPresentMax) {
    return;
  }
  present_[message.patch.id] = message;
  news_.insert(message.patch.id);
}

void FlightReaction::tick(bool is_flying) {
  is_flying_ = is_flying;
  if (options_.horizon_s > 0.0 && (is_map_exchanged() || assembly_.lacks_only_threats())) {
    assembly_.tick();
  }
}

void FlightReaction::begin_flight(std::int64_t patch_number) {
  patch_number_ = patch_number;
  look_again_.reset();
  news_.clear();
  for (const auto& [id, message] : present_) {
    if (message.patch_number == 0 || message.patch_number > patch_number) {
      news_.insert(id);
    }
  }
}

bool FlightReaction::has_news(Time now) {
  if (look_again_ && now >= *look_again_) {
    begin_flight(patch_number_);
  }
  return !news_.empty();
}

std::optional<FlightReaction::Answer> FlightReaction::answer(
    Time now, const std::string& crs_wkt, const planning::PlanningConfig& planned_config,
    const planning::FlightUnderPlan& flight) {
  const std::set<std::int64_t> news = std::exchange(news_, {});
  look_again_ = now + kLookAgain_s;
  planning::PlanningConfig config = planned_config;
  auto map = assembly_.map();
  if (config.weights.threats > 0.0) {
    if (const auto with_threats = assembly_.map_with_threats()) {
      map = with_threats;
    } else {
      config.weights.threats = 0.0;
    }
  }
  if (!map || map->crs_wkt != crs_wkt ||
      !map->geometry.contains(geo::MapPoint{flight.state.x_m, flight.state.y_m}) ||
      !map::covers_height(*map, config.reference_height_m)) {
    return std::nullopt;
  }
  const map::Map part =
      planning::map_part(*map, planning::window_of_reaction(map->geometry, options_, flight));
  std::vector<map::Patch> patches;
  std::string to_what;
  bool is_seen_from = false;
  for (const auto& [id, message] : present_) {
    const bool is_in_map =
        message.patch_number > 0 && message.patch_number <= assembly_.patch_number();
    if (is_in_map || !preparation::reason_against(part, message.patch).empty()) {
      continue;
    }
    patches.push_back(message.patch);
    if (news.contains(id)) {
      const bool is_soft = message.patch.kind == map::PatchKind::kThreat ||
                           (message.patch.kind == map::PatchKind::kArea && !message.patch.is_hard);
      is_seen_from = is_seen_from || is_soft;
      to_what += (to_what.empty() ? "" : ", ") + std::string(map::name_of(message.patch.kind)) +
                 (message.patch.label.empty() ? "" : " '" + message.patch.label + "'");
    }
  }
  if (to_what.empty()) {
    return std::nullopt;
  }
  // Over so short a way the earth is flat; an observer sees a little more so.
  SilentObserver observer;
  const map::Map ground = preparation::patched_map(part, patches, {0.0, 1}, observer);
  Answer answer{planning::reaction_to(ground, config, options_, flight, is_seen_from), to_what};
  if (answer.reaction.kind != planning::ReactionKind::kNone) {
    look_again_.reset();  // what is flown now holds to its end
  }
  return answer;
}

}  // namespace hedgehop::services
