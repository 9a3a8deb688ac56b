#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "bus/log_tools.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

using nlohmann::ordered_json;

struct CopyArguments {
  std::vector<std::string> logs;
  std::string out;
  bool is_overwriting = false;
  double from_s = -1.0;  // negative: not given
  double to_s = -1.0;
  bus::LogSelection selection;
};

void print(const ordered_json& json) {
  std::printf("%s\n", json.dump(2, ' ', false, ordered_json::error_handler_t::replace).c_str());
}

long long number(std::int64_t value) { return static_cast<long long>(value); }

ordered_json damage_json(const bus::LogSummary& summary) {
  ordered_json json = {{"damage_count", summary.damage_count},
                       {"skipped_bytes", summary.skipped_bytes}};
  json["damages"] = ordered_json::array();
  for (const auto& damage : summary.damages) {
    json["damages"].push_back({{"offset_bytes", damage.offset},
                               {"bytes", damage.bytes},
                               {"is_at_end", damage.is_at_end}});
  }
  return json;
}

ExitCode show(const Console& console, const std::string& file) {
  const bus::LogSummary summary = bus::summarize_log(file, *console.observer());
  const double duration_s = seconds_between(summary.begin, summary.end);
  if (console.is_json) {
    ordered_json json = {{"schema", "hedgehop log info"},
                         {"schema_version", 1},
                         {"log", file},
                         {"events", summary.events},
                         {"duration_s", duration_s}};
    json.update(damage_json(summary));
    for (const auto& [channel, count] : summary.channels) {
      json["channels"][channel] = {{"events", count.events}, {"bytes", count.bytes}};
    }
    json["requests"] = ordered_json::array();
    for (const auto& [id, request] : summary.requests) {
      json["requests"].push_back({{"request_id", id},
                                  {"has_route", request.has_route},
                                  {"has_trajectory", request.has_trajectory}});
    }
    print(json);
  } else {
    std::printf("log           %s\n", file.c_str());
    std::printf("events        %lld in %.1f s\n", number(summary.events), duration_s);
    for (const auto& [channel, count] : summary.channels) {
      std::printf("  %-20s %8lld events %10lld bytes\n", channel.c_str(), number(count.events),
                  number(count.bytes));
    }
    for (const auto& [id, request] : summary.requests) {
      std::printf("request       %s: %s, %s\n", id.c_str(),
                  request.has_route ? "route" : "no route",
                  request.has_trajectory ? "trajectory" : "no trajectory");
    }
    if (summary.damage_count > 0) {
      std::printf("damage        %lld places, %lld bytes skipped (hedgehop log check)\n",
                  number(summary.damage_count), number(summary.skipped_bytes));
    }
  }
  return summary.damage_count == 0 ? ExitCode::kOk : ExitCode::kBadData;
}

ExitCode check(const Console& console, const std::string& file) {
  const bus::LogSummary summary = bus::summarize_log(file, *console.observer());
  if (console.is_json) {
    ordered_json json = {{"schema", "hedgehop log check"},
                         {"schema_version", 1},
                         {"log", file},
                         {"events", summary.events}};
    json.update(damage_json(summary));
    json["backward_times"] = summary.backward_times;
    json["missing"] = ordered_json::array();
    for (const auto& [sender_id, missing] : summary.missing_by_sender) {
      json["missing"].push_back({{"sender_id", sender_id}, {"messages", missing}});
    }
    print(json);
  } else {
    std::printf("log           %s\nevents        %lld\n", file.c_str(), number(summary.events));
    for (const auto& damage : summary.damages) {
      std::printf("damage        %lld bytes from byte %lld on: %s\n", number(damage.bytes),
                  number(damage.offset),
                  damage.is_at_end
                      ? "the end is cut off; lcm-logplayer plays what comes before"
                      : "lcm-logplayer stops here without a word, or crashes; mend it with "
                        "hedgehop log repair");
    }
    if (summary.backward_times > 0) {
      std::printf("order         %lld events were received before the one before them\n",
                  number(summary.backward_times));
    }
    for (const auto& [sender_id, missing] : summary.missing_by_sender) {
      std::printf("missed        %lld messages of sender %lld\n", number(missing),
                  number(sender_id));
    }
    std::printf("%s\n",
                summary.damage_count == 0 ? "whole: every byte belongs to an event" : "damaged");
  }
  return summary.damage_count == 0 ? ExitCode::kOk : ExitCode::kBadData;
}

ExitCode copy(const Console& console, const CopyArguments& arguments) {
  bus::LogSelection selection = arguments.selection;
  if (arguments.from_s >= 0.0) {
    selection.from_s = arguments.from_s;
  }
  if (arguments.to_s >= 0.0) {
    selection.to_s = arguments.to_s;
  }
  const std::vector<std::filesystem::path> logs(arguments.logs.begin(), arguments.logs.end());
  const bus::LogCopy done =
      bus::copy_logs(logs, selection, arguments.out, arguments.is_overwriting, *console.observer());
  if (console.is_json) {
    print({{"schema", "hedgehop log written"},
           {"schema_version", 1},
           {"out", arguments.out},
           {"events_read", done.events_read},
           {"events_written", done.events_written},
           {"damage_count", done.damage_count},
           {"skipped_bytes", done.skipped_bytes}});
  } else {
    std::printf("log           %s\nevents        %lld of %lld\n", arguments.out.c_str(),
                number(done.events_written), number(done.events_read));
    if (done.damage_count > 0) {
      std::printf("left out      %lld damaged places, %lld bytes\n", number(done.damage_count),
                  number(done.skipped_bytes));
    }
  }
  return ExitCode::kOk;
}

void add_out(CLI::App& verb, CopyArguments& arguments) {
  verb.add_option("--out", arguments.out, "The new log")->required();
  verb.add_flag("--overwrite", arguments.is_overwriting, "Replace an existing file");
}

}  // namespace

void add_log_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("log", "Look into LCM logs, mend and cut them");
  verb->require_subcommand(1);
  verb->footer(
      "Examples:\n"
      "  hedgehop log info flight.lcmlog\n"
      "  hedgehop log check flight.lcmlog\n"
      "  hedgehop log repair flight.lcmlog --out whole.lcmlog\n"
      "  hedgehop log cut flight.lcmlog --from 10 --to 25 --with-blobs --out short.lcmlog");
  const auto file = std::make_shared<std::string>();
  const char* const log_help = "LCM log, as flight_logger and lcm-logger write it";

  auto* info = verb->add_subcommand("info", "Channels, duration, requests and damage of a log");
  info->footer(
      "Exit code 5 if parts of the log are no events; the rest is shown all the same.\n"
      "Example:\n"
      "  hedgehop log info flight.lcmlog --json");
  info->add_option("log", *file, log_help)->required();
  add_common_options(*info, console);
  info->callback(
      [&console, file] { console.action = [&console, file] { return show(console, *file); }; });

  auto* check_verb = verb->add_subcommand(
      "check", "Damage of a log, place by place, and what its recorder missed");
  check_verb->footer(
      "Exit code 5 if parts of the log are no events: lcm-logplayer would stop or crash there.\n"
      "What a sender's numbers leave out was lost on the way to the recorder; that is no damage.\n"
      "Example:\n"
      "  hedgehop log check flight.lcmlog");
  check_verb->add_option("log", *file, log_help)->required();
  add_common_options(*check_verb, console);
  check_verb->callback(
      [&console, file] { console.action = [&console, file] { return check(console, *file); }; });

  const auto arguments = std::make_shared<CopyArguments>();
  const auto run = [&console, arguments] {
    console.action = [&console, arguments] { return copy(console, *arguments); };
  };
  auto* repair = verb->add_subcommand("repair", "Copy all that can be read of a damaged log");
  repair->footer("Example:\n  hedgehop log repair flight.lcmlog --out whole.lcmlog");
  repair->add_option("log", arguments->logs, log_help)->required()->expected(1);
  add_out(*repair, *arguments);
  add_common_options(*repair, console);
  repair->callback(run);

  auto* cut = verb->add_subcommand("cut", "Copy a part of a log, or join the parts of one");
  cut->footer(
      "Several logs become one, in the order of receive times. A stage can be replayed from a cut\n"
      "log only if it holds the map and the other blobs: --with-blobs keeps them.\n"
      "Examples:\n"
      "  hedgehop log cut flight.lcmlog --from 10 --to 25 --with-blobs --out short.lcmlog\n"
      "  hedgehop log cut flight.lcmlog --channel ROUTE --channel 'PLAN_*' --out plans.lcmlog\n"
      "  hedgehop log cut flight.lcmlog flight.001.lcmlog --out whole.lcmlog");
  cut->add_option("logs", arguments->logs, "LCM logs")->required();
  add_out(*cut, *arguments);
  cut->add_option("--from", arguments->from_s,
                  "First second to keep, from the log's first event on")
      ->check(CLI::NonNegativeNumber);
  cut->add_option("--to", arguments->to_s, "Last second to keep")->check(CLI::NonNegativeNumber);
  cut->add_option("--channel", arguments->selection.channels,
                  "Channel to keep, or its beginning and *; may be repeated (default: all)")
      ->allow_extra_args(false);
  cut->add_flag("--with-blobs", arguments->selection.with_blobs,
                "Keep MAP_INDEX, CHUNK and CHUNK_REQUEST whatever their time and channel");
  add_common_options(*cut, console);
  cut->callback(run);
}

}  // namespace hedgehop::cli
