#include <CLI/CLI.hpp>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "bus/event_log.hpp"
#include "messages/channels.hpp"
#include "messages/message_error.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct ChannelCount {
  std::int64_t events = 0;
  std::int64_t bytes = 0;
};

// What went on, as far as it can be told without the blobs.
struct LogSummary {
  std::int64_t events = 0;
  Time begin;
  Time end;
  std::map<std::string, ChannelCount> channels;
  std::map<std::string, int> requests;      // by id
  std::map<std::string, int> routes;        // by id of the request
  std::map<std::string, int> trajectories;  // by id of the request
  std::int64_t damage_count = 0;
  std::int64_t skipped_bytes = 0;
};

template <typename T>
void note_request(const bus::LogEvent& event, const messages::Channel<T>& channel,
                  std::map<std::string, int>& ids) {
  if (!event.channel.ends_with(channel.name)) {
    return;
  }
  try {
    messages::Stamp stamp;
    ++ids[messages::from_message<T>(event.bytes, stamp).request_id.hex()];
  } catch (const messages::MessageError&) {  // counted as an event all the same
  }
}

LogSummary summary_of(const std::string& file) {
  LogSummary summary;
  bus::EventLogReader reader(file);
  while (const auto event = reader.next()) {
    if (summary.events++ == 0) {
      summary.begin = event->receive_time;
    }
    summary.end = std::max(summary.end, event->receive_time);
    ChannelCount& count = summary.channels[event->channel];
    ++count.events;
    count.bytes += static_cast<std::int64_t>(event->bytes.size());
    note_request(*event, messages::kPlanRequestChannel, summary.requests);
    note_request(*event, messages::kRouteChannel, summary.routes);
    note_request(*event, messages::kTrajectoryChannel, summary.trajectories);
    if (is_stop_requested()) {
      throw Interrupted();
    }
  }
  summary.damage_count = reader.damage_count();
  summary.skipped_bytes = reader.skipped_bytes();
  return summary;
}

ExitCode show(const Console& console, const std::string& file) {
  const LogSummary summary = summary_of(file);
  const double duration_s = seconds_between(summary.begin, summary.end);
  if (console.is_json) {
    nlohmann::ordered_json json = {{"schema_version", 1},
                                   {"log", file},
                                   {"events", summary.events},
                                   {"duration_s", duration_s},
                                   {"damage_count", summary.damage_count},
                                   {"skipped_bytes", summary.skipped_bytes}};
    for (const auto& [channel, count] : summary.channels) {
      json["channels"][channel] = {{"events", count.events}, {"bytes", count.bytes}};
    }
    json["requests"] = nlohmann::ordered_json::array();
    for (const auto& [id, count] : summary.requests) {
      json["requests"].push_back({{"request_id", id},
                                  {"has_route", summary.routes.contains(id)},
                                  {"has_trajectory", summary.trajectories.contains(id)}});
    }
    std::printf("%s\n", json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
  } else {
    std::printf("log           %s\n", file.c_str());
    std::printf("events        %lld in %.1f s\n", static_cast<long long>(summary.events),
                duration_s);
    for (const auto& [channel, count] : summary.channels) {
      std::printf("  %-20s %8lld events %10lld bytes\n", channel.c_str(),
                  static_cast<long long>(count.events), static_cast<long long>(count.bytes));
    }
    for (const auto& [id, count] : summary.requests) {
      std::printf("request       %s: %s, %s\n", id.c_str(),
                  summary.routes.contains(id) ? "route" : "no route",
                  summary.trajectories.contains(id) ? "trajectory" : "no trajectory");
    }
    if (summary.damage_count > 0) {
      std::printf("damage        %lld places, %lld bytes skipped\n",
                  static_cast<long long>(summary.damage_count),
                  static_cast<long long>(summary.skipped_bytes));
    }
  }
  return summary.damage_count == 0 ? ExitCode::kOk : ExitCode::kBadData;
}

}  // namespace

void add_log_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("log", "Look into LCM logs");
  verb->require_subcommand(1);
  verb->footer("Example:\n  hedgehop log info flight.lcmlog");
  auto* info = verb->add_subcommand("info", "Channels, duration, requests and damage of a log");
  info->footer(
      "Exit code 5 if parts of the log are no events; the rest is shown all the same.\n"
      "Example:\n"
      "  hedgehop log info flight.lcmlog --json");
  auto file = std::make_shared<std::string>();
  info->add_option("log", *file, "LCM log, as flight_logger and lcm-logger write it")->required();
  add_common_options(*info, console);
  info->callback(
      [&console, file] { console.action = [&console, file] { return show(console, *file); }; });
}

}  // namespace hedgehop::cli
