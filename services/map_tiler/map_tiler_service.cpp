#include "map_tiler_service.hpp"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "base/errors.hpp"
#include "bus/event_log.hpp"
#include "map/map_bundle.hpp"
#include "messages/channels.hpp"
#include "messages/message_error.hpp"
#include "planning/map_for_plan.hpp"
#include "preparation/visibility.hpp"

namespace hedgehop::services {
namespace {

// Things over one map; all of them are repeated each second.
constexpr std::int64_t kPatchesMax = 200;

}  // namespace

MapTilerOptions read_map_tiler_options(ConfigReader reader) {
  MapTilerOptions options;
  options.index_period_s = reader.required_double("index_period_s");
  options.tile_cells = static_cast<int>(reader.required_integer("tile_cells"));
  options.send_rate_bytesps = reader.required_double("send_rate_bytesps");
  preparation::VisibilityOptions earth;
  earth.is_earth_curved = reader.required_bool("earth_curvature");
  earth.refraction = reader.required_double("refraction");
  options.patches.drop_1pm = preparation::drop_per_square_1pm(earth);
  reader.finish();
  reader.require(earth.refraction >= 0.0 && earth.refraction < 1.0, "refraction",
                 "must lie in [0, 1)");
  reader.require(options.index_period_s >= 0.05 && options.index_period_s <= 10.0, "index_period_s",
                 "must lie between 0.05 and 10");
  reader.require(options.tile_cells >= 16 && options.tile_cells <= 1024, "tile_cells",
                 "must lie between 16 and 1024");
  reader.require(options.send_rate_bytesps >= 1e4 && options.send_rate_bytesps <= 1e9,
                 "send_rate_bytesps", "must lie between 1e4 and 1e9");
  return options;
}

map::Map read_map(const bus::ServiceArguments& arguments) {
  const std::string folder = arguments.value("--map");
  if (folder.empty()) {
    throw UsageError("no map given", "--map MAP, a folder made by `hedgehop prepare`");
  }
  return planning::with_threats(map::read_map_bundle(folder), folder);
}

MapTilerService::MapTilerService(const MapTilerOptions& options, map::Map map, bus::Bus& bus,
                                 bus::BlobExchange& exchange, std::filesystem::path journal)
    : options_(options),
      bus_(bus),
      journal_(std::move(journal)),
      base_(std::make_shared<const map::Map>(std::move(map))),
      base_hash_(map::map_hash_without_threats(*base_)),
      offer_(options.tile_cells, exchange) {
  state_.base_map_hash = base_hash_;
  read_journal();
  apply();
  repeated_.clear();
  bus.subscribe<messages::MapPatch>(
      messages::kMapPatchChannel,
      [this](const messages::MapPatch& message, const messages::Stamp& stamp) {
        receive(message, stamp);
      });
}

void MapTilerService::refuse(const messages::MapPatch& message, std::int64_t sender_id,
                             const std::string& why) {
  state_.refused_sender_id = sender_id;
  state_.refused_patch_id = message.patch.id;
  state_.refusal = "patch " + std::to_string(message.patch.id) + ": " + why;
  is_state_due_ = true;
  std::fprintf(stderr, "refused: %s\n", state_.refusal.c_str());
}

std::string MapTilerService::reason_against(const map::Patch& patch) const {
  if (patch.kind == map::PatchKind::kThreat && !base_->threats.empty()) {
    const auto others = std::count_if(patches_.begin(), patches_.end(), [&](const auto& entry) {
      return entry.first != patch.id && entry.second.is_present &&
             entry.second.patch.kind == map::PatchKind::kThreat;
    });
    const int threats_max = messages::threats_max(base_->geometry, options_.tile_cells);
    if (static_cast<std::ptrdiff_t>(base_->threats.size()) + others >= threats_max) {
      return std::to_string(threats_max) +
             " named observers are there already, and the bus carries no more over so many cells";
    }
  }
  return preparation::reason_against(*base_, patch);
}

void MapTilerService::receive(const messages::MapPatch& message, const messages::Stamp& stamp) {
  if (message.patch_number != 0) {
    return;  // of this or another map_tiler
  }
  if (message.base_map_hash != base_hash_) {
    refuse(message, stamp.sender_id,
           "it is for the base map " + message.base_map_hash.hex() + ", this one is " +
               base_hash_.hex());
    return;
  }
  const auto known = patches_.find(message.patch.id);
  if (known != patches_.end() && known->second.is_present == message.is_present &&
      (!message.is_present || known->second.patch == message.patch)) {
    repeated_.push_back(known->second);
    return;
  }
  if (!message.is_present) {
    if (known == patches_.end()) {
      refuse(message, stamp.sender_id, "nothing of this id is there");
      return;
    }
  } else {
    const auto present = std::count_if(patches_.begin(), patches_.end(),
                                       [](const auto& entry) { return entry.second.is_present; });
    if (present >= kPatchesMax) {
      refuse(message, stamp.sender_id,
             std::to_string(kPatchesMax) +
                 " things are there already; remove some, or prepare the "
                 "map again with them in it");
      return;
    }
    if (const std::string why = reason_against(message.patch); !why.empty()) {
      refuse(message, stamp.sender_id, why);
      return;
    }
  }
  messages::MapPatch numbered = message;
  numbered.patch_number = static_cast<std::int64_t>(history_.size()) + 1;
  accept(numbered);
}

void MapTilerService::accept(const messages::MapPatch& message) {
  patches_[message.patch.id] = message;
  history_.push_back(message);
}

void MapTilerService::read_journal() {
  if (journal_.empty() || !std::filesystem::exists(journal_)) {
    return;
  }
  const auto refuse = [&](const std::string& why) {
    throw DataError(journal_.string() + ": " + why,
                    "move it away to begin without patches, or name another file with --patches");
  };
  bus::EventLogReader log(journal_);
  while (const auto event = log.next()) {
    messages::MapPatch message;
    try {
      messages::Stamp stamp;
      message = messages::from_message<messages::MapPatch>(event->bytes, stamp);
    } catch (const messages::MessageError& error) {
      refuse(error.what());
    }
    if (message.base_map_hash != base_hash_) {
      refuse("holds patches for the base map " + message.base_map_hash.hex() + ", this one is " +
             base_hash_.hex());
    }
    if (message.patch_number != static_cast<std::int64_t>(history_.size()) + 1) {
      refuse("patch " + std::to_string(history_.size() + 1) + " is missing");
    }
    if (message.is_present) {
      if (const std::string why = reason_against(message.patch); !why.empty()) {
        refuse("patch " + std::to_string(message.patch_number) + ": " + why);
      }
    }
    accept(message);
  }
  if (log.damage_count() > 0) {
    refuse("is damaged");
  }
}

void MapTilerService::write_journal() const {
  if (journal_.empty()) {
    return;
  }
  std::filesystem::path unfinished = journal_;
  unfinished += ".unfinished";
  {
    bus::EventLogWriter log(unfinished, true, 1.0);
    for (const messages::MapPatch& message : history_) {
      const Time now = bus_.now();
      log.write(now, std::string(messages::kMapPatchChannel.name),
                messages::to_message(message, {now, bus_.sender_id(), message.patch_number}));
    }
    log.flush();
  }
  std::filesystem::rename(unfinished, journal_);
}

void MapTilerService::apply() {
  std::vector<map::Patch> present;
  for (const auto& [id, message] : patches_) {
    if (message.is_present) {
      present.push_back(message.patch);
    }
  }
  bus::StopObserver observer;
  const auto map = present.empty() ? base_
                                   : std::make_shared<const map::Map>(preparation::patched_map(
                                         *base_, present, options_.patches, observer));
  index_ = offer_.offer(map);
  index_.patch_number = static_cast<std::int64_t>(history_.size());
  state_.map_hash = index_.map_hash;
  state_.patch_number = index_.patch_number;
  state_.patch_count = static_cast<std::int32_t>(present.size());
  for (; applied_ < history_.size(); ++applied_) {
    repeated_.push_back(history_[applied_]);
  }
}

void MapTilerService::announce(Time now) {
  next_index_ = now + options_.index_period_s;
  bus_.publish(messages::kMapIndexChannel, index_, now);
  is_state_due_ = true;
  repeated_.clear();
  // Things that are there, and what has just gone.
  for (const auto& [id, message] : patches_) {
    if (message.is_present || message.patch_number == state_.patch_number) {
      bus_.publish(messages::kMapPatchChannel, message, now);
    }
  }
}

void MapTilerService::tick(Time now) {
  if (applied_ < history_.size()) {
    write_journal();
    apply();
    bus_.publish(messages::kMapIndexChannel, index_, now);
    is_state_due_ = true;
  }
  for (const messages::MapPatch& message : repeated_) {
    bus_.publish(messages::kMapPatchChannel, message, now);
  }
  repeated_.clear();
  if (now >= next_index_) {
    announce(now);
  }
  if (is_state_due_) {
    is_state_due_ = false;
    bus_.publish(messages::kMapPatchStateChannel, state_, now);
  }
}

}  // namespace hedgehop::services
