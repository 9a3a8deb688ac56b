#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <tuple>
#include <utility>

#include "bus/event_log.hpp"
#include "bus/service.hpp"
#include "hedgehop_version.hpp"
#include "messages/message_error.hpp"
#include "services/command_model/command_model_service.hpp"
#include "services/global_planner/global_planner_service.hpp"
#include "services/local_planner/local_planner_service.hpp"
#include "services/shared/service_start.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

using messages::Stamp;

struct ReplayArguments {
  std::string log;
  std::string stage;
  std::string channel_prefix;
};

enum class Outcome { kEqual, kDifferent, kMissing };
const char* name_of(Outcome outcome) {
  return outcome == Outcome::kEqual       ? "equal"
         : outcome == Outcome::kDifferent ? "different"
                                          : "missing";
}

struct Finding {
  std::string subject;  // "route of request 0123..."
  Outcome outcome = Outcome::kMissing;
  std::string text;
};

// What a planner said about a request: an answer, or why there is none.
struct Answers {
  std::map<Hash128, messages::BlobRef> blobs;
  std::map<Hash128, Hash128> maps;  // that they were made on
  std::map<Hash128, flight::NoPlan> no_plans;
  std::map<Hash128, bool> cancelled;
};

template <typename T>
void on_published(const bus::RawMessage& message, const std::string& prefix,
                  const messages::Channel<T>& channel, const std::function<void(const T&)>& use) {
  if (message.channel == prefix + std::string(channel.name)) {
    Stamp stamp;
    use(messages::from_message<T>(message.bytes, stamp));
  }
}

void note_status(Answers& answers, messages::PlanStage stage, const messages::PlanStatus& status) {
  if (status.stage != stage) {
    return;
  }
  if (status.no_plan) {
    answers.no_plans[status.request_id] = *status.no_plan;
  }
  answers.cancelled[status.request_id] = status.state == messages::PlanState::kCancelled;
}

// What may explain a difference: the service that was recorded, and the one that is run now.
class Reasons {
 public:
  Reasons(bus::Bus& bus, const std::string& service, const Hash128& config_hash) {
    bus.subscribe<messages::ServiceStatus>(
        messages::kServiceStatusChannel,
        [this, service, config_hash](const messages::ServiceStatus& status, const Stamp&) {
          if (status.name != service) {
            return;
          }
          if (status.program_version != HEDGEHOP_VERSION) {
            known_.insert("recorded by version " + status.program_version +
                          ", this is " HEDGEHOP_VERSION);
          }
          if (status.types_hash != messages::types_hash()) {
            known_.insert("recorded with other message types");
          }
          if (status.config_hash != config_hash) {
            known_.insert("recorded with another config of the service, " +
                          status.config_hash.hex() + ", this is " + config_hash.hex());
          }
        });
  }
  [[nodiscard]] std::string text() const {
    std::string text;
    for (const std::string& reason : known_) {
      text += "; " + reason;
    }
    return text.empty() ? "; version and config are the same, so the build or the processor is not"
                        : text;
  }

 private:
  std::set<std::string> known_;
};

Finding compare(const Hash128& id, const std::string& what, const Answers& recorded,
                const Answers& replayed, const Reasons& reasons, bus::BlobExchange& exchange) {
  Finding finding{what + " of request " + id.hex(), Outcome::kMissing, {}};
  const auto old_blob = recorded.blobs.find(id);
  const auto new_blob = replayed.blobs.find(id);
  const auto old_cause = recorded.no_plans.find(id);
  const auto new_cause = replayed.no_plans.find(id);
  const bool was_answered =
      old_blob != recorded.blobs.end() || old_cause != recorded.no_plans.end();
  const bool is_answered = new_blob != replayed.blobs.end() || new_cause != replayed.no_plans.end();
  if (!was_answered) {
    finding.text = "the log holds no answer";
  } else if (!is_answered) {
    finding.text = "the log holds the answer, but not all that it was made of";
  } else if (old_blob != recorded.blobs.end() && new_blob != replayed.blobs.end()) {
    const bool is_same_blob = old_blob->second == new_blob->second;
    // Packed by another library version, equal content has another name.
    const Bytes* old_content = is_same_blob ? nullptr : exchange.content(old_blob->second.id);
    const Bytes* new_content = is_same_blob ? nullptr : exchange.content(new_blob->second.id);
    const bool is_equal = is_same_blob || (old_content != nullptr && new_content != nullptr &&
                                           *old_content == *new_content);
    finding.outcome = is_equal ? Outcome::kEqual : Outcome::kDifferent;
    finding.text = "recorded " + old_blob->second.id.hex() + " of " +
                   std::to_string(old_blob->second.content_bytes) + " bytes, replayed " +
                   new_blob->second.id.hex() + " of " +
                   std::to_string(new_blob->second.content_bytes) + " bytes";
  } else if (old_cause != recorded.no_plans.end() && new_cause != replayed.no_plans.end()) {
    const bool is_equal = old_cause->second.cause == new_cause->second.cause &&
                          old_cause->second.explanation == new_cause->second.explanation;
    finding.outcome = is_equal ? Outcome::kEqual : Outcome::kDifferent;
    finding.text = std::string("recorded no plan (") + flight::name_of(old_cause->second.cause) +
                   "), replayed no plan (" + flight::name_of(new_cause->second.cause) + ")";
  } else {
    finding.outcome = Outcome::kDifferent;
    finding.text = old_blob != recorded.blobs.end() ? "recorded an answer, replayed no plan"
                                                    : "recorded no plan, replayed an answer";
  }
  if (finding.outcome == Outcome::kDifferent) {
    const auto old_map = recorded.maps.find(id);
    const auto new_map = replayed.maps.find(id);
    const bool is_other_map = old_map != recorded.maps.end() && new_map != replayed.maps.end() &&
                              old_map->second != new_map->second;
    finding.text += is_other_map ? "; recorded on map " + old_map->second.hex() +
                                       ", replayed on map " + new_map->second.hex()
                                 : reasons.text();
  }
  return finding;
}

// Runs one of the two planner services over the log.
template <typename Service, typename Question, typename Header>
std::vector<Finding> replay_planner(bus::Bus& bus, const std::string& prefix,
                                    const std::string& name, messages::PlanStage stage,
                                    const messages::Channel<Question>& asks,
                                    const messages::Channel<Header>& answers,
                                    const std::string& what) {
  bus::BlobExchange exchange({}, bus);
  Answers recorded;
  Answers replayed;
  std::map<Hash128, bool> asked;
  bus.subscribe<Question>(
      asks, [&](const Question& question, const Stamp&) { asked[question.request_id] = true; });
  bus.subscribe<Header>(answers, [&](const Header& header, const Stamp&) {
    recorded.blobs[header.request_id] = header.plan;
    recorded.maps[header.request_id] = header.map_hash;
    exchange.want(header.plan, "recorded " + what);
  });
  bus.subscribe<messages::PlanStatus>(messages::kPlanStatusChannel,
                                      [&](const messages::PlanStatus& status, const Stamp&) {
                                        note_status(recorded, stage, status);
                                      });
  bus.tap_published([&](const bus::RawMessage& message) {
    on_published<Header>(message, prefix, answers, [&](const Header& header) {
      replayed.blobs[header.request_id] = header.plan;
      replayed.maps[header.request_id] = header.map_hash;
    });
    on_published<messages::PlanStatus>(
        message, prefix, messages::kPlanStatusChannel,
        [&](const messages::PlanStatus& status) { note_status(replayed, stage, status); });
  });

  const auto config = services::load_config("", name + ".yaml");
  const auto options = Service::read_options(config.reader());
  const Reasons reasons(bus, name, config.hash());
  bus::ServiceLoop loop(bus, exchange, name, config.hash());
  Service service(options, bus, exchange, loop);
  loop.run(options.tick_period_s, [&](Time now) { service.tick(now); });
  // Everything has been heard: what is complete is planned now, one question a tick, and a map
  // needs a few ticks to come together.
  for (std::size_t i = 0; i < asked.size() + 8 && !bus::stop_requested(); ++i) {
    service.tick(bus.now());
  }
  if (bus::stop_requested()) {
    throw Interrupted();
  }

  std::vector<Finding> findings;
  for (const auto& [id, blob] : recorded.blobs) {
    asked[id] = asked[id];
  }
  for (const auto& [id, is_asked] : asked) {
    if (recorded.cancelled[id] && !recorded.blobs.contains(id)) {
      continue;
    }
    findings.push_back(compare(id, what, recorded, replayed, reasons, exchange));
    if (!is_asked) {
      findings.back().text = "its " + std::string(asks.name) + " is not in the log";
    }
  }
  const std::string lacks = service.unanswered();
  if (!lacks.empty()) {
    findings.push_back({"input of the " + name, Outcome::kMissing,
                        lacks.substr(0, lacks.find_last_not_of('\n') + 1)});
  }
  return findings;
}

std::vector<Finding> replay_flight(bus::Bus& bus, const std::string& prefix) {
  using Key = std::tuple<Hash128, bool, std::int64_t>;  // request, lockstep, step
  std::map<Key, Bytes> recorded;
  std::map<Key, Bytes> replayed;
  const auto note = [](std::map<Key, Bytes>& states, const messages::VehicleState& state) {
    states.insert_or_assign({state.request_id, state.is_lockstep, state.step_number},
                            messages::to_message(state, Stamp{Time{1}, 1, 1}));
  };
  bus::BlobExchange exchange({}, bus);
  bus.subscribe<messages::VehicleState>(
      messages::kVehicleStateChannel,
      [&](const messages::VehicleState& state, const Stamp&) { note(recorded, state); });
  bus.tap_published([&](const bus::RawMessage& message) {
    on_published<messages::VehicleState>(
        message, prefix, messages::kVehicleStateChannel,
        [&](const messages::VehicleState& state) { note(replayed, state); });
  });
  const auto config = services::load_config("", "command_model.yaml");
  const auto options = services::read_command_model_options(config.reader());
  const Reasons reasons(bus, "command_model", config.hash());
  bus::ServiceLoop loop(bus, exchange, "command_model", config.hash());
  services::CommandModelService service(options, bus, exchange, loop, services::shipped_rotor());
  while (!bus.is_finished() && !bus::stop_requested()) {
    loop.turn(0.0, [&](Time now) { service.tick(now); });
  }
  // The last flight goes on beyond the end of the log, further than it can have been recorded.
  for (std::size_t before = 0; !bus::stop_requested();) {
    service.tick(bus.now() + 1e5);
    if (replayed.size() == std::exchange(before, replayed.size())) {
      break;
    }
  }
  if (bus::stop_requested()) {
    throw Interrupted();
  }

  std::map<Hash128, std::array<std::int64_t, 3>> counts;  // equal, different, not replayed
  for (const auto& [key, state] : recorded) {
    const auto again = replayed.find(key);
    const std::size_t outcome = again == replayed.end() ? 2 : again->second == state ? 0 : 1;
    ++counts[std::get<0>(key)][outcome];
  }
  std::vector<Finding> findings;
  for (const auto& [id, count] : counts) {
    const Outcome outcome = count[1] > 0          ? Outcome::kDifferent
                            : count[2] > count[0] ? Outcome::kMissing
                                                  : Outcome::kEqual;
    findings.push_back({"flight of request " + id.hex(), outcome,
                        std::to_string(count[0]) + " states equal, " + std::to_string(count[1]) +
                            " different, " + std::to_string(count[2]) + " not flown again" +
                            (outcome == Outcome::kDifferent ? reasons.text() : "")});
  }
  const std::string lacks = [&] {
    std::string text;
    for (const bus::MissingChunks& missing : exchange.missing()) {
      text += (text.empty() ? "" : "\n") + bus::to_text(missing);
    }
    return text;
  }();
  if (!lacks.empty()) {
    findings.push_back({"input of the command_model", Outcome::kMissing, lacks});
  }
  return findings;
}

ExitCode report(const Console& console, const ReplayArguments& arguments,
                const std::vector<Finding>& findings) {
  const auto has = [&](Outcome outcome) {
    return std::any_of(findings.begin(), findings.end(),
                       [&](const Finding& finding) { return finding.outcome == outcome; });
  };
  const Outcome whole = has(Outcome::kDifferent)                     ? Outcome::kDifferent
                        : has(Outcome::kMissing) || findings.empty() ? Outcome::kMissing
                                                                     : Outcome::kEqual;
  if (console.is_json) {
    nlohmann::ordered_json json = {
        {"schema", "hedgehop replay"}, {"schema_version", 1},
        {"log", arguments.log},        {"stage", arguments.stage},
        {"result", name_of(whole)},    {"findings", nlohmann::ordered_json::array()}};
    for (const Finding& finding : findings) {
      json["findings"].push_back({{"subject", finding.subject},
                                  {"result", name_of(finding.outcome)},
                                  {"text", finding.text}});
    }
    std::printf("%s\n", json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
  } else {
    for (const Finding& finding : findings) {
      std::printf("%-10s %s: %s\n", name_of(finding.outcome), finding.subject.c_str(),
                  finding.text.c_str());
    }
    if (findings.empty()) {
      std::printf("%-10s the log holds nothing for the stage %s\n", name_of(whole),
                  arguments.stage.c_str());
    }
  }
  return whole == Outcome::kEqual       ? ExitCode::kOk
         : whole == Outcome::kDifferent ? ExitCode::kFailure
                                        : ExitCode::kBadData;
}

ExitCode run(const Console& console, const ReplayArguments& arguments) {
  bus::install_stop_signals();  // the services listen to the bus's
  bus::Bus bus({.url = "file://" + std::filesystem::absolute(arguments.log).string(),
                .channel_prefix = arguments.channel_prefix});
  if (arguments.stage == "flight") {
    return report(console, arguments, replay_flight(bus, arguments.channel_prefix));
  }
  if (arguments.stage == "global") {
    return report(console, arguments,
                  replay_planner<services::GlobalPlannerService>(
                      bus, arguments.channel_prefix, "global_planner", messages::PlanStage::kGlobal,
                      messages::kPlanRequestChannel, messages::kRouteChannel, "route"));
  }
  return report(console, arguments,
                replay_planner<services::LocalPlannerService>(
                    bus, arguments.channel_prefix, "local_planner", messages::PlanStage::kLocal,
                    messages::kRouteChannel, messages::kTrajectoryChannel, "trajectory"));
}

}  // namespace

void add_replay_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("replay",
                                  "Run one stage again over a recorded log and compare its result");
  verb->footer(
      "Needs no bus: the log is read as it is. Prints for each request whether the stage made the "
      "same bytes again, and by name what the log lacks or what explains a difference (version, "
      "message types, config, map). Exit code 0 equal, 1 different, 5 the log "
      "is damaged or incomplete.\n"
      "Examples:\n"
      "  hedgehop replay flight.lcmlog --stage global\n"
      "  hedgehop replay flight.lcmlog --stage local --json");
  auto arguments = std::make_shared<ReplayArguments>();
  verb->add_option("log", arguments->log, "LCM log, as flight_logger writes it")->required();
  verb->add_option(
          "--stage", arguments->stage,
          "global: requests to routes; local: routes to trajectories; flight: trajectories "
          "to vehicle states")
      ->required()
      ->check(CLI::IsMember({"global", "local", "flight"}));
  verb->add_option("--channel-prefix", arguments->channel_prefix,
                   "What stands before every channel name in the log");
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
