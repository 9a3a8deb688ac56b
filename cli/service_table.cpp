#include "service_table.hpp"

#include <algorithm>
#include <cstdio>
#include <set>

#include "hedgehop_version.hpp"
#include "messages/channels.hpp"
#include "messages/describe.hpp"

namespace hedgehop::cli {
namespace {

constexpr double kSilent_s = 3.5;  // statuses come once a second
constexpr double kForgotten_s = 30.0;
constexpr std::size_t kServicesMax = 1000;
constexpr std::size_t kChannelsMax = 1000;

std::int64_t drops_of(const messages::ServiceStatus& status) {
  return status.drop_count + status.gap_count + status.rejected_count;
}

}  // namespace

ServiceTable::ServiceTable(bus::Bus& bus) : bus_(bus), taken_(bus.now()), now_(taken_) {
  bus.subscribe_raw([this](const bus::RawMessage& message) {
    if (channels_.size() > kChannelsMax) {
      channels_.clear();
    }
    Channel& channel = channels_[std::string(message.channel)];
    ++channel.messages;
    channel.bytes += static_cast<std::int64_t>(message.bytes.size());
    const auto type = messages::type_of(message.bytes);
    for (const messages::ChannelType& known : messages::kChannelTypes) {
      if (message.channel.ends_with(known.channel) && (!type || *type != known.type) &&
          !(type && *type == "map_patch_t")) {
        channel.foreign = type
                              ? "carries " + std::string(*type) + ", not " + std::string(known.type)
                              : "carries a type that this program does not know";
      }
    }
  });
  bus.subscribe<messages::ServiceStatus>(
      messages::kServiceStatusChannel,
      [this](const messages::ServiceStatus& status, const messages::Stamp& stamp) {
        if (services_.size() > kServicesMax) {
          services_.clear();
        }
        const std::string key =
            status.name + ' ' + status.host + ' ' + std::to_string(status.process_id);
        const auto [place, is_new] = services_.try_emplace(key);
        Service& service = place->second;
        const Time now = bus_.now();
        const double offset_s = seconds_between(stamp.time, now);
        // What takes least time on the way tells most about the clock.
        service.clock_offset_s =
            is_new ? offset_s : std::min(offset_s, service.clock_offset_s + 0.001);
        const double passed_s = is_new ? 0.0 : seconds_between(service.said, stamp.time);
        if (passed_s > 0.0) {
          const auto per_second = [&](std::int64_t after, std::int64_t before) {
            return static_cast<double>(std::max<std::int64_t>(after - before, 0)) / passed_s;
          };
          service.received_ps = per_second(status.received_count, service.status.received_count);
          service.published_ps = per_second(status.published_count, service.status.published_count);
          service.new_drops =
              std::max<std::int64_t>(drops_of(status) - drops_of(service.status), 0);
        }
        service.status = status;
        service.said = stamp.time;
        service.heard = now;
      });
  bus.subscribe<messages::MapIndex>(
      messages::kMapIndexChannel,
      [this](const messages::MapIndex& index, const messages::Stamp& stamp) {
        maps_[stamp.sender_id] = {index, bus_.now()};
      });
  bus.subscribe<messages::MapPatchState>(
      messages::kMapPatchStateChannel,
      [this](const messages::MapPatchState& state, const messages::Stamp&) { patches_ = state; });
}

void ServiceTable::take_rates(Time now) {
  const double passed_s = std::max(seconds_between(taken_, now), 1e-3);
  taken_ = now;
  now_ = now;
  for (auto& [name, channel] : channels_) {
    channel.messages_ps =
        static_cast<double>(channel.messages - channel.messages_before) / passed_s;
    channel.bytes_ps = static_cast<double>(channel.bytes - channel.bytes_before) / passed_s;
    channel.messages_before = channel.messages;
    channel.bytes_before = channel.bytes;
  }
  std::erase_if(services_, [&](const auto& entry) {
    return seconds_between(entry.second.heard, now) > kForgotten_s;
  });
  std::erase_if(maps_, [&](const auto& entry) {
    return seconds_between(entry.second.heard, now) > kSilent_s;
  });
}

std::string ServiceTable::name_of(const Service& service) const {
  return service.status.name + " on " + service.status.host + ", process " +
         std::to_string(service.status.process_id);
}

std::vector<std::string> ServiceTable::mismatches() const {
  std::vector<std::string> found;
  for (const auto& [key, service] : services_) {
    if (service.status.program_version != HEDGEHOP_VERSION) {
      found.push_back(name_of(service) + " is version " + service.status.program_version +
                      ", this program " + HEDGEHOP_VERSION);
    }
    if (service.status.types_hash != messages::types_hash()) {
      found.push_back(name_of(service) + " knows other message types");
    }
    if (service.status.state != messages::ServiceState::kStopping &&
        seconds_between(service.heard, now_) > kSilent_s) {
      char text[80];
      std::snprintf(text, sizeof text, " has been silent for %.0f s",
                    seconds_between(service.heard, now_));
      found.push_back(name_of(service) + text);
    }
  }
  std::set<std::string> maps;
  for (const auto& [sender, map] : maps_) {
    maps.insert(map.index.map_hash.hex() + " (patch " + std::to_string(map.index.patch_number) +
                ")");
  }
  if (maps.size() > 1) {
    std::string text = std::to_string(maps.size()) + " maps:";
    for (const std::string& map : maps) {
      text += ' ' + map;
    }
    found.push_back(text);
  }
  for (const auto& [name, channel] : channels_) {
    if (!channel.foreign.empty()) {
      found.push_back(name + ' ' + channel.foreign);
    }
  }
  return found;
}

std::string ServiceTable::text() const {
  std::string text;
  char line[400];
  const auto add = [&](const char* format, auto... values) {
    std::snprintf(line, sizeof line, format, values...);
    text += line;
  };
  add("%-15s %-14s %8s %-9s %8s %7s %7s %7s %7s %8s  %s\n", "service", "host", "process", "state",
      "up s", "in/s", "out/s", "lost", "chunks", "clock ms", "says");
  for (const auto& [key, service] : services_) {
    const messages::ServiceStatus& status = service.status;
    add("%-15s %-14.14s %8d %-9s %8.0f %7.0f %7.0f %7lld %7lld %8.1f  ", status.name.c_str(),
        status.host.c_str(), status.process_id, messages::name_of(status.state), status.uptime_s,
        service.received_ps, service.published_ps, static_cast<long long>(drops_of(status)),
        static_cast<long long>(status.missing_chunk_count), 1e3 * service.clock_offset_s);
    text +=
        status.text +
        (service.new_drops > 0 ? " [loses " + std::to_string(service.new_drops) + " now]" : "") +
        '\n';
  }
  add("\n%-24s %10s %10s %12s\n", "channel", "messages", "msg/s", "bytes/s");
  for (const auto& [name, channel] : channels_) {
    add("%-24s %10lld %10.1f %12.0f\n", name.c_str(), static_cast<long long>(channel.messages),
        channel.messages_ps, channel.bytes_ps);
  }
  if (!maps_.empty() || patches_) {
    text += '\n';
  }
  for (const auto& [sender, map] : maps_) {
    add("map %s, patch %lld, %d x %d cells %s\n", map.index.map_hash.hex().c_str(),
        static_cast<long long>(map.index.patch_number), map.index.geometry.columns,
        map.index.geometry.rows, map.index.label.c_str());
  }
  if (patches_ && patches_->patch_count > 0) {
    add("%d things over base map %s\n", patches_->patch_count,
        patches_->base_map_hash.hex().c_str());
  }
  for (const std::string& mismatch : mismatches()) {
    text += "MISMATCH " + mismatch + '\n';
  }
  return text;
}

nlohmann::ordered_json ServiceTable::json() const {
  nlohmann::ordered_json json;
  json["services"] = nlohmann::ordered_json::array();
  for (const auto& [key, service] : services_) {
    const messages::ServiceStatus& status = service.status;
    json["services"].push_back({{"name", status.name},
                                {"host", status.host},
                                {"process_id", status.process_id},
                                {"state", messages::name_of(status.state)},
                                {"program_version", status.program_version},
                                {"types_hash", status.types_hash.hex()},
                                {"received_per_s", service.received_ps},
                                {"published_per_s", service.published_ps},
                                {"gaps", status.gap_count},
                                {"drops", status.drop_count},
                                {"rejected", status.rejected_count},
                                {"missing_chunks", status.missing_chunk_count},
                                {"clock_offset_s", service.clock_offset_s},
                                {"silent_s", seconds_between(service.heard, now_)}});
  }
  json["channels"] = nlohmann::ordered_json::object();
  for (const auto& [name, channel] : channels_) {
    json["channels"][name] = {{"messages", channel.messages},
                              {"messages_per_s", channel.messages_ps},
                              {"bytes_per_s", channel.bytes_ps}};
  }
  json["maps"] = nlohmann::ordered_json::array();
  for (const auto& [sender, map] : maps_) {
    json["maps"].push_back(
        {{"map_hash", map.index.map_hash.hex()}, {"patch_number", map.index.patch_number}});
  }
  json["mismatches"] = mismatches();
  return json;
}

}  // namespace hedgehop::cli
