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
#include "geo/vertical_datum.hpp"
#include "service_table.hpp"
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
                     : "sysctl -w net.core.rmem_max=33554432, or scripts/net-setup; below " +
                           std::to_string(kWanted_bytes) +
                           " bytes fast senders lose packets, which are then asked for again";
  return check;
}

std::int64_t number_in(const char* file) {
  std::int64_t value = -1;
  std::ifstream(file) >> value;
  return value;
}

std::string output_of(const char* command) {
  std::string text;
  if (FILE* pipe = ::popen(command, "r")) {
    char buffer[512];
    while (std::fgets(buffer, sizeof buffer, pipe) != nullptr) {
      text += buffer;
    }
    ::pclose(pipe);
  }
  return text;
}

// Over which interface multicast leaves, and whether the URL lets it.
Check check_route(const std::string& url) {
  Check check{"multicast route", false, true, {}, {}};
  const std::string route =
      is_on_path("ip") ? output_of("ip -o route get 239.255.76.67 2>/dev/null") : std::string();
  const std::size_t at = route.find(" dev ");
  if (at == std::string::npos) {
    check.is_needed = is_on_path("ip");  // without it nobody knows; the check of the bus tells
    check.text = is_on_path("ip") ? "no route to 239.255.76.67" : "unknown: `ip` is not installed";
    check.remedy = is_on_path("ip") ? "ip route add 224.0.0.0/4 dev lo, or scripts/net-setup"
                                    : "apt-get install iproute2";
    return check;
  }
  const std::string interface = route.substr(at + 5, route.find(' ', at + 5) - at - 5);
  check.is_ok = true;
  check.text = "over " + interface;
  const std::size_t ttl = url.find("ttl=");
  const bool leaves =
      ttl != std::string::npos && url.substr(ttl + 4, 2).find_first_not_of("0&") == 0;
  if (leaves && interface == "lo") {
    check.is_ok = false;
    check.text += ", but ttl says that messages shall leave this machine";
    check.remedy = "scripts/net-setup --lan INTERFACE";
  }
  return check;
}

Check check_ttl(const std::string& url) {
  const std::size_t ttl = url.find("ttl=");
  const std::string value =
      ttl == std::string::npos ? "" : url.substr(ttl + 4, url.find('&', ttl) - ttl - 4);
  const bool stays = value.empty() || value == "0";
  return {"TTL", true, false,
          stays ? "0: messages stay on this machine" : value + ": messages leave this machine",
          stays ? "for several machines: export LCM_DEFAULT_URL='udpm://239.255.76.67:7667?ttl=1'"
                : ""};
}

// Stock LCM programs send long messages in IP fragments; lost ones block the kernel's memory for
// all others.
Check check_fragments() {
  constexpr std::int64_t kWanted_bytes = 32 << 20;
  constexpr std::int64_t kWanted_s = 3;
  const std::int64_t bytes = number_in("/proc/sys/net/ipv4/ipfrag_high_thresh");
  const std::int64_t seconds = number_in("/proc/sys/net/ipv4/ipfrag_time");
  Check check{"IP fragments",
              bytes >= kWanted_bytes && seconds <= kWanted_s,
              false,
              "ipfrag_high_thresh is " + std::to_string(bytes) + ", ipfrag_time " +
                  std::to_string(seconds) + " s",
              {}};
  if (bytes < 0) {
    check.is_ok = true;
    check.text = "the kernel does not tell (a container?)";
  } else if (!check.is_ok) {
    check.remedy =
        "sysctl -w net.ipv4.ipfrag_high_thresh=134217728 net.ipv4.ipfrag_time=1 (only matters for "
        "long messages of other programs on a lossy network; ours fit one packet)";
  }
  return check;
}

Check check_grids() {
  Check check{"PROJ grids", true, false, {}, {}};
  try {
    const auto from = geo::VerticalDatum::parse("EGM2008");
    const auto to = geo::VerticalDatum::parse("EGM96");
    const geo::VerticalShift shift(from, to, {0.19, 0.86, 0.2, 0.88});
    check.text = "EGM96 and EGM2008 are there";
  } catch (const UserError& error) {
    check.is_ok = false;
    check.text = error.what();
    check.remedy = error.hint();
    if (check.remedy.empty()) {
      check.remedy = "apt-get install proj-data";
    }
  }
  return check;
}

Check check_disk() {
  constexpr double kWanted_gb = 2.0;
  std::error_code error;
  const auto space = std::filesystem::space(".", error);
  const double free_gb = error ? 0.0 : 1e-9 * static_cast<double>(space.available);
  char text[120];
  std::snprintf(text, sizeof text, "%.1f GB free in this folder", free_gb);
  return {"disk", !error && free_gb >= kWanted_gb, false, text,
          free_gb >= kWanted_gb ? ""
                                : "logs grow by some megabytes a minute: make room, or write "
                                  "them elsewhere with --log"};
}

// What the services that are there say of themselves.
Check check_versions(const bus::BusOptions& options) {
  Check check{"versions", true, false, "no services on the bus", {}};
  try {
    bus::Bus bus(options);
    ServiceTable table(bus);
    const auto begin = std::chrono::steady_clock::now();
    while (std::chrono::steady_clock::now() - begin < std::chrono::milliseconds(1500)) {
      bus.poll(0.1);
    }
    table.take_rates(bus.now());
    const auto services = table.json()["services"].size();
    const auto found = table.mismatches();
    if (services > 0) {
      check.text = std::to_string(services) + " services, all of this version and these types";
    }
    if (!found.empty()) {
      check.is_ok = false;
      check.text = found.front() +
                   (found.size() > 1 ? "; and " + std::to_string(found.size() - 1) + " more" : "");
      check.remedy = "`hedgehop watch` shows all; install one version everywhere";
    }
  } catch (const UserError& error) {
    check.text = "unknown: " + std::string(error.what());
  }
  return check;
}

Check check_program(const std::string& program, const std::string& use,
                    const std::string& package) {
  const bool is_there = is_on_path(program);
  return {program, is_there, false, is_there ? "found" : "not found: no " + use,
          is_there ? "" : "apt-get install " + package};
}

ExitCode run(const Console& console, const BusArguments& arguments) {
  const char* const from_environment = std::getenv("LCM_DEFAULT_URL");
  const std::string bus_url = !arguments.lcm_url.empty()    ? arguments.lcm_url
                              : from_environment != nullptr ? from_environment
                                                            : bus::kDefaultUrl;
  const std::vector<Check> checks = {
      check_services(),
      check_route(bus_url),
      check_ttl(bus_url),
      check_bus(arguments.options()),
      check_receive_buffer(),
      check_fragments(),
      check_versions(arguments.options()),
      check_grids(),
      check_disk(),
      check_program("gnuplot", "figures", "gnuplot-nox"),
      check_program("lcm-logplayer", "playing of logs over the network", "liblcm-bin"),
      check_program("java", "lcm-spy", "default-jre"),
  };
  bool is_fit = true;
  nlohmann::ordered_json json = {{"schema", "hedgehop doctor"},
                                 {"schema_version", 1},
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
