#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/hash.hpp"
#include "base/observer.hpp"
#include "base/time.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "messages/service_status.hpp"

namespace hedgehop::bus {

/// SIGINT and SIGTERM ask this process to stop; a second SIGINT ends it at once. Call it first in
/// main().
void install_stop_signals();
/// True once a signal has come or request_stop() was called. Safe from any thread.
bool stop_requested();
void request_stop();

/// Silent observer that stops when the process is asked to.
class StopObserver : public Observer {
 public:
  void progress(std::string_view, double, double) override {}
  void note(std::string_view) override {}
  [[nodiscard]] bool stop_requested() const override { return bus::stop_requested(); }
};

/// An option of one service besides the common ones.
struct ServiceOption {
  std::string name;        // "--map"
  std::string value_name;  // empty: a flag, whose value is "yes" when it is given
  std::string help;
  bool is_required = false;
};

/// Command line of a service: --config FILE, --lcm-url URL, --channel-prefix P, --check, --help,
/// --version.
struct ServiceArguments {
  std::string config_file;  // empty: shipped config
  BusOptions bus;
  bool is_check = false;                                    // load, validate, print "ok", stop
  std::vector<std::pair<std::string, std::string>> values;  // of the service's own options

  /// Value of one of the service's own options; empty if it was not given.
  [[nodiscard]] std::string value(std::string_view name) const;
};
/// Throws UsageError with the nearest known option; none after printing --help or --version.
std::optional<ServiceArguments> parse_service_arguments(int argc, const char* const* argv,
                                                        const std::string& service_name,
                                                        const std::string& purpose,
                                                        const std::vector<ServiceOption>& options);

/// Runs `body` and turns what it throws into one line on stderr (and one for the hint) and an exit
/// code.
int run_main(const std::string& service_name, const std::function<int()>& body);

/// Who makes ROUTE or TRAJECTORY, for their provenance: "hedgehop global_planner 0.1.0".
std::string provenance_of(std::string_view service);
/// Why an answer of that provenance must not be used, with both versions: it comes from another
/// version of hedgehop. Empty if it does not; programs of others are taken as they are.
std::string reason_against_provenance(std::string_view provenance);

/// Drives one process on the bus: hands messages over, paces chunks, ticks, publishes
/// SERVICE_STATUS, and tells the supervisor of the process with each of these that it is alive.
class ServiceLoop {
 public:
  ServiceLoop(Bus& bus, BlobExchange& exchange, std::string name, const Hash128& config_hash);

  /// Until stop_requested() or stop(): messages, then tick(now), at least every `period_s`. The end
  /// of a log ends it too, once the state is not kWorking. A last status says kStopping.
  void run(double period_s, const std::function<void(Time now)>& tick);

  /// One turn of run(), for tests and for work that wants to stay on the bus meanwhile.
  void turn(double timeout_s, const std::function<void(Time now)>& tick);

  void stop();
  void set_state(messages::ServiceState state, std::string text);
  [[nodiscard]] messages::ServiceStatus status() const;
  void publish_status();

 private:
  Bus& bus_;
  BlobExchange& exchange_;
  messages::ServiceStatus status_;
  Time start_;
  Time next_status_;
  bool is_stopped_ = false;
};

}  // namespace hedgehop::bus
