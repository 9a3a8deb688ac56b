#include "evaluate_bus.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sys/wait.h>
#include <unistd.h>

#include "bus/map_exchange.hpp"
#include "bus/private_url.hpp"
#include "evaluation/flight_evaluation.hpp"
#include "evaluation/paired_statistics.hpp"
#include "evaluation_arguments.hpp"
#include "geo/map_projection.hpp"
#include "map/map_bundle.hpp"
#include "messages/map_tiles.hpp"
#include "output/plan_bundle.hpp"
#include "plan_over_bus.hpp"
#include "planning/planning.hpp"
#include "service_children.hpp"
#include "synthetic_map.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

using nlohmann::ordered_json;
using SteadyTime = std::chrono::steady_clock::time_point;

struct Arguments {
  std::string map;
  std::int64_t plans = -1;  // negative: as configured
  std::int64_t lockstep_steps = 0;
  std::vector<double> loss_percents;
  bool is_without_loss = false;
  SeedArgument seed;
  PlanningArguments planning;
  double distance_m = 0.0;           // 0: as configured
  double trial_loss_percent = -1.0;  // not negative: one row of the loss table, inside its network
};

double seconds_since(SteadyTime time) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - time).count();
}

// A folder for logs of the services, gone with the object.
class Scratch {
 public:
  Scratch() {
    std::string name = (std::filesystem::temp_directory_path() / "hedgehop-bus-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) {
      throw SystemFailure("no temporary folder can be made: " + std::string(std::strerror(errno)));
    }
    path_ = name;
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// Drawn places, each a flight that verifies or at least has a plan in one process.
struct Problem {
  flight::PlanRequest request;
  std::string trajectory;  // what one process makes of it
  double in_process_s = 0.0;
};

std::optional<Problem> try_problem(const map::Map& map, const geo::MapProjection& projection,
                                   const planning::PlanningConfig& config,
                                   const evaluation::DrawnProblem& drawn, std::uint64_t seed,
                                   Observer& observer) {
  Problem problem;
  problem.request.start.position = projection.to_geodetic(drawn.start);
  problem.request.goal.position = projection.to_geodetic(drawn.goal);
  problem.request.seed = seed;
  const auto begin = std::chrono::steady_clock::now();
  const auto result = planning::plan(map, problem.request, config, {}, observer);
  problem.in_process_s = seconds_since(begin);
  const auto* plan = std::get_if<flight::Plan>(&result);
  if (plan == nullptr) {
    return std::nullopt;
  }
  problem.trajectory = output::trajectory_csv(*plan);
  return problem;
}

// The services on a bus of their own, and this process as their user.
class Chain {
 public:
  Chain(const Console& console, const std::string& map, const std::string& url, Observer& observer)
      : observer_(observer),
        setup_{.bus = {url, {}}, .map = map, .log = scratch_.path() / "log"},
        bus_(setup_.bus),
        exchange_({}, bus_),
        planner_(bus_, exchange_) {
    setup_.threads = console.threads;
    bus_.subscribe<messages::MapIndex>(messages::kMapIndexChannel,
                                       [this](const messages::MapIndex&, const messages::Stamp&) {
                                         if (!first_index_) {
                                           first_index_ = std::chrono::steady_clock::now();
                                         }
                                       });
    bus_.subscribe<messages::VehicleState>(
        messages::kVehicleStateChannel,
        [this](const messages::VehicleState& state, const messages::Stamp&) {
          if (state.is_lockstep && state.step_number == asked_step_) {
            answer_ = state.state;
          }
        });
    children_ = std::make_unique<ServiceChildren>(console, bus_, setup_);
  }

  /// The plan of the services.
  flight::Plan plan(const Problem& problem, const std::string& config_text, double timeout_s) {
    auto result = planner_.plan(problem.request, config_text, timeout_s, observer_);
    children_->watch();
    auto* plan = std::get_if<flight::Plan>(&result);
    if (plan == nullptr) {
      throw DataError("the services found no plan where one process finds one: " +
                          std::get<flight::NoPlan>(result).explanation,
                      "versions of programs differ?");
    }
    return std::move(*plan);
  }
  void compare(const flight::Plan& plan, const Problem& problem) {
    is_same_ = is_same_ && output::trajectory_csv(plan) == problem.trajectory;
  }
  [[nodiscard]] bool is_same() const { return is_same_; }
  [[nodiscard]] SteadyTime first_index() const { return *first_index_; }

  /// Steps of the model of the service in a second, question and answer.
  double lockstep_steps_per_s(const flight::Plan& plan, std::int64_t steps, double timeout_s) {
    messages::VehicleTarget target;
    target.request_id = plan.route_plan.request_id;
    target.is_lockstep = true;
    target.step_s = 0.05;
    const flight::FlightState& first = plan.trajectory.states.front();
    target.state =
        command_model::trimmed_state(first.x_m, first.y_m, first.altitude_m, 40.0, 0.0, 0.0);
    target.command = {40.0, 0.5, 1.0};
    const auto begin = std::chrono::steady_clock::now();
    for (std::int64_t step = 1; step <= steps; ++step) {
      target.step_number = asked_step_ = 1'000'000'000 + step;  // of no plan's own question
      answer_.reset();
      const auto asked = std::chrono::steady_clock::now();
      while (!answer_) {
        bus_.publish(messages::kVehicleTargetChannel, target, bus_.message_time());
        bus_.poll(0.02);
        while (!answer_ && bus_.poll(0.0) > 0) {
        }
        if (seconds_since(asked) > timeout_s) {
          throw BusError("command_model does not answer VEHICLE_TARGET", "");
        }
      }
      target.state = *answer_;
      if (step % 256 == 0) {
        observer_.check_stop();
      }
    }
    return static_cast<double>(steps) / seconds_since(begin);
  }

  struct Transfer {
    double seconds = 0.0;
    double raster_mb = 0.0;
    double packed_mb = 0.0;
  };
  /// The map's way from the running map_tiler to somebody who has heard nothing yet.
  Transfer transfer(double timeout_s) {
    bus::Bus bus(setup_.bus);
    bus::BlobExchange exchange({}, bus);
    bus::MapAssembly assembly(exchange);
    std::optional<SteadyTime> begin;
    bus.subscribe<messages::MapIndex>(
        messages::kMapIndexChannel,
        [&](const messages::MapIndex& index, const messages::Stamp& stamp) {
          if (!begin) {
            begin = std::chrono::steady_clock::now();
          }
          assembly.receive(index, stamp.sender_id);
        });
    const auto asked = std::chrono::steady_clock::now();
    while (assembly.map() == nullptr) {
      bus.poll(std::min(0.05, exchange.next_tick_s(bus.now())));
      exchange.tick(bus.now());
      assembly.tick();
      if (!assembly.refusal().empty() || seconds_since(asked) > 10.0 * timeout_s) {
        throw BusError("the map does not come: " + assembly.missing(), "");
      }
      observer_.check_stop();
    }
    Transfer transfer;
    transfer.seconds = seconds_since(*begin);
    transfer.raster_mb =
        1e-6 * static_cast<double>(messages::raster_bytes(
                   assembly.map()->geometry, assembly.map()->further_visibility.size()));
    transfer.packed_mb = 1e-6 * static_cast<double>(assembly.packed_bytes());
    return transfer;
  }

  void stop() {
    if (children_->stop() != 0) {
      throw SystemFailure("a service did not end properly", "its own message stands above");
    }
  }

 private:
  Scratch scratch_;
  Observer& observer_;
  ServiceSetup setup_;
  bus::Bus bus_;
  bus::BlobExchange exchange_;
  BusPlanner planner_;
  std::unique_ptr<ServiceChildren> children_;
  std::optional<SteadyTime> first_index_;
  bool is_same_ = true;
  std::int64_t asked_step_ = 0;
  std::optional<command_model::ModelState> answer_;
};

struct Output {
  int code = -1;
  std::string text;
};

// What a program prints on stdout.
Output output_of(const std::vector<std::string>& command) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) {
    throw SystemFailure("no pipe: " + std::string(std::strerror(errno)));
  }
  std::vector<char*> arguments;
  for (const std::string& argument : command) {
    arguments.push_back(const_cast<char*>(argument.c_str()));
  }
  arguments.push_back(nullptr);
  const pid_t child = ::fork();
  if (child < 0) {
    throw SystemFailure("cannot start " + command[0] + ": " + std::strerror(errno));
  }
  if (child == 0) {
    ::dup2(ends[1], STDOUT_FILENO);
    ::execvp(arguments[0], arguments.data());
    ::_exit(127);
  }
  ::close(ends[1]);
  Output output;
  char buffer[4096];
  for (ssize_t size = 0; (size = ::read(ends[0], buffer, sizeof buffer)) > 0 || errno == EINTR;) {
    if (size > 0) {
      output.text.append(buffer, static_cast<std::size_t>(size));
    }
    errno = 0;
  }
  ::close(ends[0]);
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  output.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return output;
}

// A network of its own in which each packet is lost with some probability, before it is heard.
constexpr char kLossyNetwork[] =
    "ip link set lo up && ip route add 224.0.0.0/4 dev lo && nft add table ip loss && "
    "nft 'add chain ip loss input { type filter hook input priority 0; }' && "
    "{ [ \"$1\" = 0 ] || nft add rule ip loss input meta l4proto udp numgen random mod 1000 '<' "
    "\"$1\" drop; } || exit 77; shift; exec \"$@\"";

std::vector<std::string> in_lossy_network(double percent, const std::vector<std::string>& command) {
  std::vector<std::string> all = {"unshare",
                                  "-rn",
                                  "sh",
                                  "-c",
                                  kLossyNetwork,
                                  "sh",
                                  std::to_string(std::lround(10.0 * percent))};
  all.insert(all.end(), command.begin(), command.end());
  return all;
}

// Why no lossy network can be made here; empty if it can.
std::string reason_against_loss() {
  const Output output = output_of(in_lossy_network(50.0, {"true"}));
  if (output.code == 0) {
    return {};
  }
  return "no network with packet loss can be made here: that needs unshare, ip and nft (Debian: "
         "util-linux, iproute2, nftables) and the right to make namespaces";
}

evaluation::BusOptions options_of(const Arguments& arguments) {
  ConfigReader reader = shipped_evaluation();
  ConfigReader bus = reader.required_section("bus");
  evaluation::BusOptions options = evaluation::read_bus_options(bus);
  if (arguments.distance_m > 0.0) {
    options.drawing.distance_min_m = arguments.distance_m;
  }
  return options;
}

std::vector<Problem> draw_problems(const map::Map& map, const planning::PlanningConfig& config,
                                   const evaluation::BusOptions& options, std::int64_t count,
                                   std::uint64_t seed, Observer& observer) {
  const geo::MapProjection projection(map.crs_wkt);
  const auto drawn = evaluation::draw_problems(map, options.drawing, 3 * count, seed).problems;
  std::vector<Problem> problems;
  for (const evaluation::DrawnProblem& one : drawn) {
    if (static_cast<std::int64_t>(problems.size()) == count) {
      break;
    }
    if (auto problem = try_problem(map, projection, config, one, seed, observer)) {
      problems.push_back(std::move(*problem));
    }
  }
  if (static_cast<std::int64_t>(problems.size()) < count) {
    throw DataError("of " + std::to_string(drawn.size()) + " drawn flights only " +
                        std::to_string(problems.size()) + " have a plan",
                    "another --seed, or a larger map");
  }
  return problems;
}

// One row of the loss table, run inside a lossy network.
ExitCode run_trial(const Console& console, const Arguments& arguments) {
  const evaluation::BusOptions options = options_of(arguments);
  const planning::PlanningConfig config = arguments.planning.config();
  const map::Map map = map::read_map_bundle(arguments.map);
  const auto observer = console.observer();
  const auto problems =
      draw_problems(map, config, options, 2, arguments.seed.value(console), *observer);
  Chain chain(console, arguments.map, bus::kDefaultUrl, *observer);
  ordered_json row = {{"loss_percent", arguments.trial_loss_percent}};
  const flight::Plan first = chain.plan(problems[0], config.text, options.timeout_s);
  row["first_plan_s"] = seconds_since(chain.first_index());
  chain.compare(first, problems[0]);
  const auto begin = std::chrono::steady_clock::now();
  const flight::Plan second = chain.plan(problems[1], config.text, options.timeout_s);
  row["second_plan_s"] = seconds_since(begin);
  chain.compare(second, problems[1]);
  row["first_in_process_s"] = problems[0].in_process_s;
  row["second_in_process_s"] = problems[1].in_process_s;
  row["is_same"] = chain.is_same();
  chain.stop();
  std::printf("%s\n", row.dump().c_str());
  return ExitCode::kOk;
}

ExitCode run(const Console& console, Arguments arguments) {
  if (arguments.trial_loss_percent >= 0.0) {
    return run_trial(console, arguments);
  }
  evaluation::BusOptions options = options_of(arguments);
  if (arguments.plans >= 0) {
    options.plans = arguments.plans;
  }
  if (arguments.lockstep_steps > 0) {
    options.lockstep_steps = arguments.lockstep_steps;
  }
  if (!arguments.loss_percents.empty()) {
    options.loss_percents = arguments.loss_percents;
  }
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.config();
  const auto observer = console.observer();
  std::optional<Scratch> made;
  if (arguments.map.empty()) {
    made.emplace();
    console.say("making a map of the synthetic region");
    const auto region = map_sources::write_synthetic_region(made->path(), {});
    arguments.map = (made->path() / "map").string();
    prepare_synthetic_map(region, arguments.map, options.cell_m, console.threads, *observer);
  }
  const map::Map map = map::read_map_bundle(arguments.map);
  const auto problems = draw_problems(map, config, options, options.plans + 1, seed, *observer);

  Chain chain(console, arguments.map, bus::private_url(), *observer);
  flight::Plan newest = chain.plan(problems[0], config.text, options.timeout_s);
  const double first_s = seconds_since(chain.first_index());
  chain.compare(newest, problems[0]);
  std::vector<double> overheads_s;
  ordered_json plans = ordered_json::array();
  for (std::size_t i = 1; i < problems.size(); ++i) {
    // Beside each other, so that whatever else the machine does weighs on both; and the quickest of
    // several, because one plan of a second varies by more than what the bus adds to it. Another
    // seed makes another request, which no service has an answer for.
    double in_process_s = std::numeric_limits<double>::infinity();
    double over_bus_s = std::numeric_limits<double>::infinity();
    for (std::int64_t repeat = 0; repeat < options.repeats; ++repeat) {
      Problem problem = problems[i];
      problem.request.seed = seed + static_cast<std::uint64_t>(repeat);
      SilentObserver silent;
      auto begin = std::chrono::steady_clock::now();
      const auto wanted = planning::plan(map, problem.request, config, {}, silent);
      const double took_s = seconds_since(begin);
      const auto* wanted_plan = std::get_if<flight::Plan>(&wanted);
      if (wanted_plan == nullptr) {
        continue;  // with that seed no way is found
      }
      in_process_s = std::min(in_process_s, took_s);
      problem.trajectory = output::trajectory_csv(*wanted_plan);
      begin = std::chrono::steady_clock::now();
      newest = chain.plan(problem, config.text, options.timeout_s);
      over_bus_s = std::min(over_bus_s, seconds_since(begin));
      chain.compare(newest, problem);
    }
    overheads_s.push_back(over_bus_s - in_process_s);
    plans.push_back({{"in_process_s", in_process_s}, {"over_bus_s", over_bus_s}});
  }
  const double steps_per_s =
      chain.lockstep_steps_per_s(newest, options.lockstep_steps, options.timeout_s);
  const Chain::Transfer transfer = chain.transfer(options.timeout_s);
  chain.stop();

  ordered_json json = {{"schema", "hedgehop evaluate bus"},
                       {"schema_version", 1},
                       {"seed", seed},
                       {"map",
                        {{"columns", map.geometry.columns},
                         {"rows", map.geometry.rows},
                         {"layers", 4 + map.further_visibility.size()},
                         {"raster_mb", transfer.raster_mb},
                         {"packed_mb", transfer.packed_mb}}},
                       {"lockstep_steps", options.lockstep_steps},
                       {"lockstep_steps_per_s", steps_per_s},
                       {"map_transfer_s", transfer.seconds},
                       {"tile_mb_per_s", transfer.raster_mb / transfer.seconds},
                       {"first_plan_in_process_s", problems[0].in_process_s},
                       {"first_plan_over_bus_s", first_s},
                       {"first_plan_overhead_s", first_s - problems[0].in_process_s},
                       {"plan_overhead_s", nullptr},
                       {"plan_overhead_quartiles_s", nullptr},
                       {"repeats", options.repeats},
                       {"plans", plans},
                       {"is_same", chain.is_same()}};

  if (!overheads_s.empty()) {
    json["plan_overhead_s"] = evaluation::median_of(overheads_s);
    json["plan_overhead_quartiles_s"] = {evaluation::quantile_of(overheads_s, 0.25),
                                         evaluation::quantile_of(overheads_s, 0.75)};
  }

  std::string reason;
  if (arguments.is_without_loss) {
    reason = "not asked for (--without-loss)";
  } else {
    reason = reason_against_loss();
  }
  bool is_all_same = chain.is_same();
  if (reason.empty()) {
    json["loss_table"] = ordered_json::array();
    const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
    for (const double percent : options.loss_percents) {
      observer->check_stop();
      observer->progress("packet loss", static_cast<double>(json["loss_table"].size()),
                         static_cast<double>(options.loss_percents.size()));
      std::vector<std::string> command = {
          self,     "evaluate",           "bus",     "--map",        arguments.map,
          "--seed", std::to_string(seed), "--quiet", "--loss-trial", std::to_string(percent)};
      if (arguments.distance_m > 0.0) {
        command.insert(command.end(), {"--distance", std::to_string(arguments.distance_m)});
      }
      if (!arguments.planning.config_file.empty()) {
        command.insert(command.end(), {"--config", arguments.planning.config_file});
      }
      for (const std::string& setting : arguments.planning.settings) {
        command.insert(command.end(), {"--set", setting});
      }
      const Output output = output_of(in_lossy_network(percent, command));
      ordered_json row = ordered_json::parse(output.text, nullptr, false);
      if (output.code != 0 || row.is_discarded()) {
        row = {{"loss_percent", percent},
               {"first_plan_s", nullptr},
               {"failure", "ended with exit code " + std::to_string(output.code)},
               {"is_same", false}};
      }
      is_all_same = is_all_same && row["is_same"].get<bool>();
      json["loss_table"].push_back(std::move(row));
    }
  } else {
    json["loss_table"] = nullptr;
    json["loss_table_reason"] = reason;
  }
  if (console.is_json) {
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    std::printf("map              %d x %d cells, %.1f MB, %.1f MB packed\n", map.geometry.columns,
                map.geometry.rows, transfer.raster_mb, transfer.packed_mb);
    std::printf("map transfer     %.2f s, %.1f MB/s of cells\n", transfer.seconds,
                transfer.raster_mb / transfer.seconds);
    std::printf("lockstep         %.0f steps/s\n", steps_per_s);
    std::printf("first plan       %.2f s, %.2f s in process: %+.2f s for the bus and the map\n",
                first_s, problems[0].in_process_s, first_s - problems[0].in_process_s);
    if (!overheads_s.empty()) {
      std::printf(
          "later plans      %+.3f s for the bus (median of %zu; half are from %+.3f to %+.3f)\n",
          evaluation::median_of(overheads_s), overheads_s.size(),
          evaluation::quantile_of(overheads_s, 0.25), evaluation::quantile_of(overheads_s, 0.75));
    }
    if (!reason.empty()) {
      std::printf("packet loss      %s\n", reason.c_str());
    } else {
      for (const auto& row : json["loss_table"]) {
        if (row["first_plan_s"].is_null()) {
          std::printf("loss %4.1f %%      %s\n", row["loss_percent"].get<double>(),
                      row["failure"].get<std::string>().c_str());
        } else {
          std::printf("loss %4.1f %%      first plan %.2f s, second %.2f s\n",
                      row["loss_percent"].get<double>(), row["first_plan_s"].get<double>(),
                      row["second_plan_s"].get<double>());
        }
      }
    }
    std::printf("trajectories     %s\n",
                is_all_same ? "the same as in one process" : "DIFFER from those of one process");
  }
  return is_all_same ? ExitCode::kOk : ExitCode::kFailure;
}

}  // namespace

void add_bus_evaluation_verb(CLI::App& evaluate, Console& console) {
  auto* verb =
      evaluate.add_subcommand("bus", "Time what the bus costs, and plans under packet loss");
  verb->footer(
      "Starts the five services on a bus of their own and plans drawn flights over it and in this\n"
      "process; the trajectories must be the same, byte for byte. The first plan counts from the\n"
      "first MAP_INDEX, so that the map's way to the planners is in it. tile_mb_per_s counts the\n"
      "bytes of the map's cells, which travel packed. A later plan is made several times on\n"
      "either side, and the quickest are compared. The loss table is made in network namespaces;\n"
      "where these cannot be made it is null and loss_table_reason says why.\n"
      "Examples:\n"
      "  hedgehop evaluate bus --json\n"
      "  hedgehop evaluate bus --map map --without-loss");
  auto arguments = std::make_shared<Arguments>();
  verb->add_option(
      "--map", arguments->map,
      "Map bundle (default: one of 1000 x 1000 cells is made, of the synthetic region)");
  verb->add_option("--plans", arguments->plans,
                   "Plans after the first one (default: evaluation.yaml)")
      ->check(CLI::Range(0, 1000));
  verb->add_option("--lockstep-steps", arguments->lockstep_steps,
                   "Questions to command_model (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000000));
  verb->add_option("--loss", arguments->loss_percents,
                   "Packet loss in per cent, with commas (default: evaluation.yaml)")
      ->delimiter(',')
      ->check(CLI::Range(0.0, 90.0));
  verb->add_option("--distance", arguments->distance_m,
                   "Least distance between start and goal [m] (default: evaluation.yaml)")
      ->check(CLI::Range(100.0, 1e6));
  verb->add_flag("--without-loss", arguments->is_without_loss, "Leave the loss table out");
  verb->add_option("--loss-trial", arguments->trial_loss_percent)->group("");
  arguments->seed.add_to(*verb, "the drawing");
  arguments->planning.add_to(*verb);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
