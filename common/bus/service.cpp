#include "bus/service.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <csignal>
#include <iostream>
#include <unistd.h>

#include "base/config_reader.hpp"
#include "base/errors.hpp"
#include "bus/supervisor.hpp"

namespace hedgehop::bus {
namespace {

std::atomic<bool> g_stop_requested = false;
static_assert(std::atomic<bool>::is_always_lock_free);

void on_signal(int signal) {
  if (signal == SIGINT && g_stop_requested.exchange(true)) {
    ::_exit(static_cast<int>(ExitCode::kInterrupted));
  }
  g_stop_requested = true;
}

constexpr std::string_view kOurs = "hedgehop ";
constexpr double kStatusPeriod_s = 1.0;
/// Longest silence between looks at the stop signal.
constexpr double kStopCheck_s = 0.1;

}  // namespace

void install_stop_signals() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
}

bool stop_requested() { return g_stop_requested; }
void request_stop() { g_stop_requested = true; }

std::string ServiceArguments::value(std::string_view name) const {
  for (const auto& [key, text] : values) {
    if (key == name) {
      return text;
    }
  }
  return {};
}

std::optional<ServiceArguments> parse_service_arguments(int argc, const char* const* argv,
                                                        const std::string& service_name,
                                                        const std::string& purpose,
                                                        const std::vector<ServiceOption>& options) {
  std::vector<ServiceOption> all = options;
  all.push_back({"--config", "FILE", "YAML file over the shipped values", false});
  all.push_back(
      {"--lcm-url", "URL", "bus; default LCM_DEFAULT_URL or " + std::string(kDefaultUrl), false});
  all.push_back({"--channel-prefix", "P", "put before every channel name", false});
  ServiceArguments arguments;
  const std::string hint = "see " + service_name + " --help";
  for (int i = 1; i < argc; ++i) {
    std::string name = argv[i];
    if (name == "--help" || name == "-h") {
      std::cout << service_name << ": " << purpose << "\n\nOptions:\n";
      for (const ServiceOption& option : all) {
        std::cout << "  " << option.name << (option.value_name.empty() ? "" : " ")
                  << option.value_name << "\n      " << option.help
                  << (option.is_required ? " (required)" : "") << '\n';
      }
      std::cout << "  --check\n      load and validate everything, print ok, stop\n"
                   "  --version\n      print the version\n";
      return std::nullopt;
    }
    if (name == "--version") {
      std::cout << service_name << ' ' << HEDGEHOP_VERSION << '\n';
      return std::nullopt;
    }
    if (name == "--check") {
      arguments.is_check = true;
      continue;
    }
    std::optional<std::string> value;
    if (const std::size_t equals = name.find('='); equals != std::string::npos) {
      value = name.substr(equals + 1);
      name.resize(equals);
    }
    const auto known = std::find_if(
        all.begin(), all.end(), [&](const ServiceOption& option) { return option.name == name; });
    if (known == all.end()) {
      std::vector<std::string> names = {"--check", "--help", "--version"};
      for (const ServiceOption& option : all) {
        names.push_back(option.name);
      }
      const std::optional<std::string> nearest = nearest_word(name, names);
      throw UsageError("unknown option '" + name + "'",
                       nearest ? "did you mean " + *nearest + "?" : hint);
    }
    if (known->value_name.empty()) {
      if (value) {
        throw UsageError(name + " takes no value", hint);
      }
      value = "yes";
    }
    if (!value) {
      if (i + 1 >= argc) {
        throw UsageError(name + " needs a value: " + name + ' ' + known->value_name, hint);
      }
      value = argv[++i];
    }
    if (name == "--config") {
      arguments.config_file = *value;
    } else if (name == "--lcm-url") {
      arguments.bus.url = *value;
    } else if (name == "--channel-prefix") {
      arguments.bus.channel_prefix = *value;
    } else {
      arguments.values.emplace_back(name, *value);
    }
  }
  for (const ServiceOption& option : options) {
    if (option.is_required && arguments.value(option.name).empty()) {
      throw UsageError(option.name + " is missing: " + option.name + ' ' + option.value_name, hint);
    }
  }
  return arguments;
}

int run_main(const std::string& service_name, const std::function<int()>& body) {
  try {
    return body();
  } catch (const UserError& error) {
    std::cerr << service_name << ": " << error.what() << '\n';
    if (!error.hint().empty()) {
      std::cerr << "  " << error.hint() << '\n';
    }
    return static_cast<int>(error.code());
  } catch (const std::exception& error) {
    std::cerr << service_name << ": " << error.what() << '\n';
    return static_cast<int>(ExitCode::kFailure);
  }
}

std::string provenance_of(std::string_view service) {
  return std::string(kOurs) + std::string(service) + ' ' + HEDGEHOP_VERSION;
}

std::string reason_against_provenance(std::string_view provenance) {
  if (!provenance.starts_with(kOurs) || provenance.ends_with(" " HEDGEHOP_VERSION)) {
    return {};
  }
  return "it was made by " + std::string(provenance) + ", this is version " HEDGEHOP_VERSION;
}

ServiceLoop::ServiceLoop(Bus& bus, BlobExchange& exchange, std::string name,
                         const Hash128& config_hash)
    : bus_(bus), exchange_(exchange), start_(bus.now()), next_status_(start_) {
  std::array<char, 256> host{};
  ::gethostname(host.data(), host.size() - 1);
  status_.name = std::move(name);
  status_.host = host.data();
  status_.process_id = ::getpid();
  status_.program_version = HEDGEHOP_VERSION;
  status_.config_hash = config_hash;
  status_.types_hash = messages::types_hash();
}

void ServiceLoop::run(double period_s, const std::function<void(Time now)>& tick) {
  tell_supervisor("READY=1");
  while (!is_stopped_ && !bus::stop_requested()) {
    if (bus_.is_finished() && status_.state != messages::ServiceState::kWorking) {
      break;
    }
    const double wait_s = std::min({period_s, kStopCheck_s, exchange_.next_tick_s(bus_.now())});
    turn(wait_s, tick);
  }
  set_state(messages::ServiceState::kStopping, {});
  tell_supervisor("STOPPING=1");
  publish_status();
}

void ServiceLoop::turn(double timeout_s, const std::function<void(Time now)>& tick) {
  bus_.poll(timeout_s);
  tick(bus_.now());
  const Time now = bus_.now();  // a tick may last as long as a plan
  exchange_.tick(now);
  if (now >= next_status_ || next_status_ > now + 2.0 * kStatusPeriod_s) {
    publish_status();
  }
}

void ServiceLoop::stop() { is_stopped_ = true; }

void ServiceLoop::set_state(messages::ServiceState state, std::string text) {
  status_.state = state;
  status_.text = std::move(text);
}

messages::ServiceStatus ServiceLoop::status() const {
  messages::ServiceStatus status = status_;
  status.uptime_s = std::max(0.0, seconds_between(start_, bus_.now()));
  const BusCounters counters = bus_.counters();
  status.published_count = counters.published;
  status.received_count = counters.received;
  status.rejected_count = counters.rejected;
  status.gap_count = counters.gaps;
  status.drop_count = counters.dropped_packets;
  status.sent_chunk_count = exchange_.sent_chunk_count();
  status.missing_chunk_count = exchange_.missing_chunk_count();
  return status;
}

void ServiceLoop::publish_status() {
  const Time now = bus_.now();
  next_status_ = now + kStatusPeriod_s;
  bus_.publish(messages::kServiceStatusChannel, status(), now);
  std::string text = status_.text;  // one line, whatever it holds
  std::replace(text.begin(), text.end(), '\n', ' ');
  tell_supervisor("WATCHDOG=1\nSTATUS=" + text);
}

}  // namespace hedgehop::bus
