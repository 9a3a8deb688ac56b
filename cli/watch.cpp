#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <unistd.h>
#include <vector>

#include "bus_arguments.hpp"
#include "messages/describe.hpp"
#include "messages/message_error.hpp"
#include "service_table.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

using messages::Stamp;

struct WatchArguments {
  BusArguments bus;
  double duration_s = 0.0;
  bool has_messages = false;
  std::vector<std::string> echoed;
};

const char* text_of(messages::PlanState state) {
  switch (state) {
    case messages::PlanState::kWaiting:
      return "waiting";
    case messages::PlanState::kWorking:
      return "working";
    case messages::PlanState::kDone:
      return "done";
    case messages::PlanState::kNoPlan:
      return "no plan";
    case messages::PlanState::kCancelled:
      return "cancelled";
    case messages::PlanState::kRefused:
      return "refused";
  }
  return "unknown";
}

// One line of text or one JSON object a message, written as it comes.
class Printer {
 public:
  explicit Printer(bool is_json) : is_json_(is_json) {}

  void print(const char* channel, const std::string& text, nlohmann::ordered_json json) {
    ++count_;
    if (is_json_) {
      nlohmann::ordered_json line = {
          {"schema", "hedgehop watch"}, {"schema_version", 1}, {"channel", channel}};
      line.update(json);
      std::printf("%s\n",
                  line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    } else {
      std::printf("%-14s %s\n", channel, text.c_str());
    }
    std::fflush(stdout);
  }
  [[nodiscard]] std::int64_t count() const { return count_; }

 private:
  bool is_json_;
  std::int64_t count_ = 0;
};

void subscribe(bus::Bus& bus, Printer& printer) {
  bus.subscribe<messages::ServiceStatus>(
      messages::kServiceStatusChannel,
      [&printer](const messages::ServiceStatus& status, const Stamp&) {
        char text[1200];
        std::snprintf(
            text, sizeof text,
            "%-14s %-8s up %.0f s, process %d on %s, received %lld, refused %lld, gaps "
            "%lld, drops %lld, missing chunks %lld%s%s",
            status.name.c_str(), name_of(status.state), status.uptime_s, status.process_id,
            status.host.c_str(), static_cast<long long>(status.received_count),
            static_cast<long long>(status.rejected_count), static_cast<long long>(status.gap_count),
            static_cast<long long>(status.drop_count),
            static_cast<long long>(status.missing_chunk_count), status.text.empty() ? "" : ": ",
            status.text.c_str());
        printer.print("SERVICE_STATUS", text,
                      {{"name", status.name},
                       {"state", name_of(status.state)},
                       {"host", status.host},
                       {"process_id", status.process_id},
                       {"program_version", status.program_version},
                       {"config_hash", status.config_hash.hex()},
                       {"types_hash", status.types_hash.hex()},
                       {"uptime_s", status.uptime_s},
                       {"published", status.published_count},
                       {"received", status.received_count},
                       {"rejected", status.rejected_count},
                       {"gaps", status.gap_count},
                       {"drops", status.drop_count},
                       {"missing_chunks", status.missing_chunk_count},
                       {"text", status.text}});
      });
  bus.subscribe<messages::PlanStatus>(
      messages::kPlanStatusChannel, [&printer](const messages::PlanStatus& status, const Stamp&) {
        const char* stage = status.stage == messages::PlanStage::kGlobal ? "global" : "local";
        const double percent = status.work_budget > 0
                                   ? 100.0 * static_cast<double>(status.work_units) /
                                         static_cast<double>(status.work_budget)
                                   : 0.0;
        char text[1000];
        std::snprintf(text, sizeof text, "%.8s %s %s %.0f %%%s%s", status.request_id.hex().c_str(),
                      stage, text_of(status.state), percent, status.text.empty() ? "" : ": ",
                      status.text.c_str());
        nlohmann::ordered_json json = {{"request_id", status.request_id.hex()},
                                       {"stage", stage},
                                       {"state", text_of(status.state)},
                                       {"work_units", status.work_units},
                                       {"work_budget", status.work_budget},
                                       {"lower_bound_m", status.lower_bound_m},
                                       {"text", status.text}};
        if (status.best_cost_m) {
          json["best_cost_m"] = *status.best_cost_m;
        }
        if (status.no_plan) {
          json["cause"] = flight::name_of(status.no_plan->cause);
        }
        printer.print("PLAN_STATUS", text, std::move(json));
      });
  bus.subscribe<messages::TrajectoryHeader>(
      messages::kTrajectoryChannel,
      [&printer](const messages::TrajectoryHeader& trajectory, const Stamp&) {
        char text[200];
        std::snprintf(text, sizeof text, "%.8s %.2f km in %.0f s, %s",
                      trajectory.request_id.hex().c_str(), 1e-3 * trajectory.length_m,
                      trajectory.duration_s, trajectory.is_verified ? "verified" : "NOT verified");
        printer.print("TRAJECTORY", text,
                      {{"request_id", trajectory.request_id.hex()},
                       {"length_m", trajectory.length_m},
                       {"duration_s", trajectory.duration_s},
                       {"is_verified", trajectory.is_verified}});
      });
}

// Each message of the channels, as it was sent.
void echo(bus::Bus& bus, Printer& printer, const std::vector<std::string>& channels,
          const std::string& prefix, bool is_json) {
  bus.subscribe_raw([&printer, channels, prefix, is_json](const bus::RawMessage& message) {
    const bool is_wanted =
        std::any_of(channels.begin(), channels.end(), [&](const std::string& channel) {
          return message.channel == prefix + channel ||
                 (channel.ends_with('*') &&
                  message.channel.starts_with(prefix + channel.substr(0, channel.size() - 1)));
        });
    if (!is_wanted) {
      return;
    }
    const std::string channel(message.channel);
    try {
      const std::string text = messages::describe(message.bytes);
      printer.print(channel.c_str(), text,
                    is_json
                        ? nlohmann::ordered_json{{"receive_utime", message.receive_time.utime_us},
                                                 {"message", nlohmann::ordered_json::parse(text)}}
                        : nlohmann::ordered_json());
    } catch (const messages::MessageError& error) {
      printer.print(channel.c_str(), std::string("cannot be decoded: ") + error.what(),
                    {{"error", error.what()}});
    }
  });
}

ExitCode run(const Console& console, const WatchArguments& arguments) {
  bus::Bus bus(arguments.bus.options());
  Printer printer(console.is_json);
  const bool is_echo = !arguments.echoed.empty();
  const bool has_messages = !is_echo && (console.is_json || arguments.has_messages);
  const bool has_table = !is_echo && !arguments.has_messages;
  std::optional<ServiceTable> table;
  if (is_echo) {
    echo(bus, printer, arguments.echoed, arguments.bus.channel_prefix, console.is_json);
  }
  if (has_messages) {
    subscribe(bus, printer);
  }
  std::int64_t heard = 0;
  if (has_table) {
    table.emplace(bus);
    bus.subscribe_raw([&heard](const bus::RawMessage&) { ++heard; });
  }
  const auto show = [&] {
    table->take_rates(bus.now());
    if (console.is_json) {
      printer.print("TABLE", {}, table->json());
    } else {
      // A terminal shows the newest table at its top; elsewhere they follow each other.
      std::printf("%s%s\n", ::isatty(STDOUT_FILENO) != 0 ? "\033[H\033[2J" : "",
                  table->text().c_str());
      std::fflush(stdout);
    }
  };
  auto shown = std::chrono::steady_clock::now();
  console.say("watching " + bus.url() + ", Ctrl-C ends it");
  const auto begin = std::chrono::steady_clock::now();
  while (!is_stop_requested()) {
    bus.poll(0.1);
    const double watched_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (has_table && std::chrono::steady_clock::now() - shown > std::chrono::seconds(1)) {
      shown = std::chrono::steady_clock::now();
      show();
    }
    if (arguments.duration_s > 0.0 && watched_s > arguments.duration_s) {
      break;
    }
  }
  const std::int64_t count = has_table ? heard : printer.count();
  if (count > 0 && has_table) {
    show();
  }
  if (count == 0) {
    throw BusError(
        "nothing was heard on " + bus.url(),
        "start the services with `hedgehop serve --map MAP`, with the same --lcm-url and "
        "--channel-prefix");
  }
  return ExitCode::kOk;
}

}  // namespace

void add_watch_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("watch", "Show what the services on the bus say");
  verb->footer(
      "A table of all services on all hosts, once a second: messages in and out, what they have\n"
      "lost, by how much their clocks are behind this one, the channels, the map, and what does "
      "not\n"
      "fit together: versions, message types, maps, silence. With --messages one line a message\n"
      "instead, with --echo each message of a channel with all its fields. With --json one object "
      "a\n"
      "line, messages and tables (channel TABLE).\n"
      "Examples:\n"
      "  hedgehop watch --duration-s 10\n"
      "  hedgehop watch --echo VEHICLE_STATE --echo 'MAP_*'");
  auto arguments = std::make_shared<WatchArguments>();
  arguments->bus.add_to(*verb);
  verb->add_option("--duration-s", arguments->duration_s, "End after this time (default: Ctrl-C)")
      ->check(CLI::Range(0.1, 1e9));
  verb->add_flag("--messages", arguments->has_messages, "One line a message, no table");
  verb->add_option("--echo", arguments->echoed,
                   "Show this channel's messages, decoded; a beginning and * for several; may be "
                   "repeated")
      ->allow_extra_args(false);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
