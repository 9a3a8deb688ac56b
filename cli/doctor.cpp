#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "bus_arguments.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct Check {
  std::string name;
  bool is_ok = false;
  bool is_needed = false;  // without it something essential does not work
  std::string text;
  std::string remedy;
};

bool is_on_path(const std::string& program) {
  const char* path = std::getenv("PATH");
  std::string folders = path == nullptr ? "" : path;
  for (std::size_t begin = 0; begin <= folders.size();) {
    const std::size_t end = std::min(folders.find(':', begin), folders.size());
    const auto candidate = std::filesystem::path(folders.substr(begin, end - begin)) / program;
    if (::access(candidate.c_str(), X_OK) == 0) {
      return true;
    }
    begin = end + 1;
  }
  return false;
}

Check check_services() {
  Check check{"service programs", true, true, "all five beside hedgehop", {}};
  std::error_code error;
  const auto folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  for (const char* name :
       {"hedgehop-map-tiler", "hedgehop-global-planner", "hedgehop-local-planner",
        "hedgehop-command-model", "hedgehop-flight-logger"}) {
    if (::access((folder / name).c_str(), X_OK) != 0) {
      check.is_ok = false;
      check.text = (folder / name).string() + " is missing";
      check.remedy = "build or install all programs: cmake --build --preset release";
    }
  }
  return check;
}

// Says something on the bus and listens for it.
Check check_bus(const bus::BusOptions& options) {
  Check check{"bus", false, true, {}, {}};
  try {
    bus::Bus bus(options);
    bool is_heard = false;
    bus.subscribe<messages::PlanCancel>(
        messages::kPlanCancelChannel,
        [&](const messages::PlanCancel& cancel, const messages::Stamp& stamp) {
          is_heard =
              is_heard || (stamp.sender_id == bus.sender_id() && cancel.request_id.is_zero());
        });
    const auto begin = std::chrono::steady_clock::now();
    while (!is_heard && std::chrono::steady_clock::now() - begin < std::chrono::seconds(3)) {
      bus.publish(messages::kPlanCancelChannel, messages::PlanCancel{}, bus.now());
      bus.poll(0.1);
    }
    check.is_ok = is_heard;
    check.text =
        bus.url() + (is_heard ? " answers" : " does not answer: what is sent is not heard");
    check.remedy = is_heard ? "" : "run scripts/net-setup, or use scripts/in-own-network";
  } catch (const UserError& error) {
    check.text = error.what();
    check.remedy = error.hint();
  }
  return check;
}

Check check_receive_buffer() {
  constexpr std::int64_t kWanted_bytes = 4 << 20;
  Check check{"receive buffer", false, false, {}, {}};
  std::int64_t bytes = 0;
  std::ifstream("/proc/sys/net/core/rmem_max") >> bytes;
  check.is_ok = bytes >= kWanted_bytes;
  check.text = "net.core.rmem_max is " + std::to_string(bytes);
  check.remedy = check.is_ok
                     ? ""
                     : "scripts/net-setup raises it; below " + std::to_string(kWanted_bytes) +
                           " bytes fast senders lose packets, which are then asked for again";
  return check;
}

Check check_program(const std::string& program, const std::string& use,
                    const std::string& package) {
  const bool is_there = is_on_path(program);
  return {program, is_there, false, is_there ? "found" : "not found: no " + use,
          is_there ? "" : "apt-get install " + package};
}

ExitCode run(const Console& console, const BusArguments& arguments) {
  const std::vector<Check> checks = {
      check_services(),
      check_bus(arguments.options()),
      check_receive_buffer(),
      check_program("gnuplot", "figures", "gnuplot-nox"),
      check_program("lcm-logplayer", "playing of logs over the network", "liblcm-bin"),
      check_program("java", "lcm-spy", "default-jre"),
  };
  bool is_fit = true;
  nlohmann::ordered_json json = {{"schema_version", 1},
                                 {"types_hash", messages::types_hash().hex()}};
  for (const Check& check : checks) {
    is_fit = is_fit && (check.is_ok || !check.is_needed);
    json["checks"].push_back({{"name", check.name},
                              {"is_ok", check.is_ok},
                              {"is_needed", check.is_needed},
                              {"text", check.text},
                              {"remedy", check.remedy}});
    if (!console.is_json) {
      std::printf("%-7s %-18s %s\n",
                  check.is_ok       ? "ok"
                  : check.is_needed ? "MISSING"
                                    : "note",
                  check.name.c_str(), check.text.c_str());
      if (!check.remedy.empty()) {
        std::printf("%-26s %s\n", "", check.remedy.c_str());
      }
    }
  }
  if (console.is_json) {
    json["is_fit"] = is_fit;
    std::printf("%s\n", json.dump(2).c_str());
  }
  return is_fit ? ExitCode::kOk : ExitCode::kFailure;
}

}  // namespace

void add_doctor_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("doctor", "Check that this machine has what hedgehop needs");
  verb->footer(
      "Exit code 1 if something essential is missing, with what to do about it.\n"
      "Example:\n"
      "  hedgehop doctor");
  auto arguments = std::make_shared<BusArguments>();
  arguments->add_to(*verb);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
