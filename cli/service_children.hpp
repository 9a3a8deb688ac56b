#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "bus/bus.hpp"
#include "console.hpp"

namespace hedgehop::cli {

/// What the five services are started with.
struct ServiceSetup {
  bus::BusOptions bus;
  std::filesystem::path map;
  std::filesystem::path log;
  int threads = 0;           // of the planners; 0: all cores
  bool is_lockstep = false;  // local_planner flies the model of command_model
};

/// The five services as children of this process: started, watched, started again when they crash,
/// ended.
///
/// Children get process groups of their own, so that Ctrl-C reaches them through this process
/// alone, and end by themselves should this process die.
class ServiceChildren {
 public:
  /// Starts the flight logger, waits until it is on the bus, then starts the others and waits for
  /// them. `bus` hears their SERVICE_STATUS and must not be polled once
  /// this object is gone. Throws UserError with the exit code of a service that
  /// ends meanwhile, BusError if one stays silent, Interrupted on Ctrl-C.
  ServiceChildren(const Console& console, bus::Bus& bus, const ServiceSetup& setup);
  /// Ends them.
  ~ServiceChildren();
  ServiceChildren(const ServiceChildren&) = delete;
  ServiceChildren& operator=(const ServiceChildren&) = delete;

  /// Reports children that have ended and starts them again after a pause of 1, 2, then 4 s; a
  /// minute without a crash makes good for those before. A logger goes on in another file,
  /// "flight-2.lcmlog". Call it a few times a second. Throws UserError when one cannot go on.
  void watch();

  /// SIGTERM to all, the logger last; SIGKILL to those that have not ended after 5 s. Returns the
  /// number of services that did not end with exit code 0.
  int stop();

 private:
  struct Child {
    std::string name;
    std::vector<std::string> command;
    int process_id = 0;  // 0: not running
    int starts = 0;
    int crashes = 0;  // without a quiet minute between them
    bool is_heard = false;
    std::chrono::steady_clock::time_point started;
    std::chrono::steady_clock::time_point start_again;
  };

  void start(Child& child);
  void wait_until_heard(std::size_t first, std::size_t last);
  int stop(std::size_t first, std::size_t last);

  const Console& console_;
  bus::Bus& bus_;
  std::filesystem::path log_;
  std::vector<Child> children_;  // the logger first
};

}  // namespace hedgehop::cli
