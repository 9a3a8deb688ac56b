#include "service_children.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "base/errors.hpp"
#include "messages/channels.hpp"

namespace hedgehop::cli {
namespace {

using std::chrono::steady_clock;

constexpr char kLogger[] = "flight_logger";
constexpr int kRestartsMax = 3;
constexpr double kQuiet_s = 60.0;  // without a crash, those before are forgotten
constexpr double kHeardTimeout_s = 15.0;
constexpr double kStopTimeout_s = 5.0;

std::chrono::duration<double> seconds(double value) { return std::chrono::duration<double>(value); }

// Service programs stand beside this one.
std::string program_of(const std::string& service) {
  std::string name = "hedgehop-" + service;
  std::replace(name.begin(), name.end(), '_', '-');
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  const auto program = self.parent_path() / name;
  if (error || ::access(program.c_str(), X_OK) != 0) {
    throw SystemFailure("service program " + program.string() + " is missing",
                        "the services stand beside `hedgehop`; build or install all of them");
  }
  return program.string();
}

std::string end_text(int status) {
  if (WIFSIGNALED(status)) {
    return std::string("was ended by signal ") + ::strsignal(WTERMSIG(status));
  }
  return "ended with exit code " + std::to_string(WEXITSTATUS(status));
}

// Codes that say that another start would end the same way.
bool is_final(int status) {
  if (!WIFEXITED(status)) {
    return false;
  }
  const auto code = static_cast<ExitCode>(WEXITSTATUS(status));
  return code == ExitCode::kUsage || code == ExitCode::kBadData ||
         code == ExitCode::kBusUnreachable;
}

}  // namespace

ServiceChildren::ServiceChildren(const Console& console, bus::Bus& bus, const ServiceSetup& setup)
    : console_(console), bus_(bus), log_(setup.log) {
  const auto add = [&](const std::string& name, const std::vector<std::string>& options) {
    Child child;
    child.name = name;
    child.command = {program_of(name), "--lcm-url", bus.url()};
    if (!setup.bus.channel_prefix.empty()) {
      child.command.insert(child.command.end(), {"--channel-prefix", setup.bus.channel_prefix});
    }
    child.command.insert(child.command.end(), options.begin(), options.end());
    children_.push_back(std::move(child));
  };
  const std::vector<std::string> threads =
      setup.threads > 0 ? std::vector<std::string>{"--threads", std::to_string(setup.threads)}
                        : std::vector<std::string>{};
  add(kLogger, {"--out", setup.log.string()});
  std::filesystem::path patches = setup.log;
  patches.replace_filename(setup.log.stem().string() + "-patches" + setup.log.extension().string());
  add("map_tiler", {"--map", setup.map.string(), "--patches", patches.string()});
  add("global_planner", threads);
  std::vector<std::string> local_options = threads;
  if (setup.is_lockstep) {
    local_options.emplace_back("--lockstep");
  }
  add("local_planner", local_options);
  add("command_model", {});

  bus.subscribe<messages::ServiceStatus>(
      messages::kServiceStatusChannel,
      [this](const messages::ServiceStatus& status, const messages::Stamp&) {
        for (Child& child : children_) {
          if (!child.is_heard && child.process_id != 0 && status.name == child.name &&
              status.process_id == child.process_id) {
            child.is_heard = true;
            std::fprintf(stderr, "%-16s ready, process %d\n", child.name.c_str(), child.process_id);
          }
        }
      });
  try {
    start(children_.front());
    wait_until_heard(0, 1);
    for (std::size_t i = 1; i < children_.size(); ++i) {
      start(children_[i]);
    }
    wait_until_heard(0, children_.size());
  } catch (...) {
    stop();
    throw;
  }
}

ServiceChildren::~ServiceChildren() { stop(); }

void ServiceChildren::start(Child& child) {
  if (child.name == kLogger && child.starts > 0) {  // what it recorded so far is kept
    std::filesystem::path next = log_;
    next.replace_filename(log_.stem().string() + "-" + std::to_string(child.starts + 1) +
                          log_.extension().string());
    child.command.back() = next.string();
  }
  std::vector<char*> arguments;
  for (std::string& argument : child.command) {
    arguments.push_back(argument.data());
  }
  arguments.push_back(nullptr);
  const pid_t parent = ::getpid();
  const pid_t process_id = ::fork();
  if (process_id < 0) {
    throw SystemFailure("cannot start " + child.name + ": " + std::strerror(errno));
  }
  if (process_id == 0) {  // only async-signal-safe calls from here on
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (::getppid() != parent) {
      ::_exit(1);
    }
    ::execv(arguments[0], arguments.data());
    ::_exit(127);
  }
  child.process_id = process_id;
  child.is_heard = false;
  child.started = steady_clock::now();
  ++child.starts;
}

void ServiceChildren::wait_until_heard(std::size_t first, std::size_t last) {
  const auto begin = steady_clock::now();
  while (true) {
    bus_.poll(0.05);
    watch();
    if (is_stop_requested()) {
      throw Interrupted();
    }
    std::string silent;
    for (std::size_t i = first; i < last; ++i) {
      if (!children_[i].is_heard) {
        silent += (silent.empty() ? "" : ", ") + children_[i].name;
      }
    }
    if (silent.empty()) {
      return;
    }
    if (steady_clock::now() - begin > seconds(kHeardTimeout_s)) {
      throw BusError("started, but not heard on " + bus_.url() + ": " + silent,
                     "multicast does not come back on this machine: run scripts/net-setup, or use "
                     "scripts/in-own-network; `hedgehop doctor` says what is wrong");
    }
  }
}

void ServiceChildren::watch() {
  const auto now = steady_clock::now();
  for (Child& child : children_) {
    if (child.process_id == 0) {
      if (child.starts > 0 && now >= child.start_again) {
        console_.say(child.name + " starts again");
        start(child);
      }
      continue;
    }
    int status = 0;
    if (::waitpid(child.process_id, &status, WNOHANG) != child.process_id) {
      continue;
    }
    child.process_id = 0;
    const std::string what = child.name + " " + end_text(status);
    if (is_final(status)) {
      throw UserError(static_cast<ExitCode>(WEXITSTATUS(status)), what,
                      "its own message stands above");
    }
    if (now - child.started > seconds(kQuiet_s)) {
      child.crashes = 0;
    }
    if (++child.crashes > kRestartsMax) {
      throw UserError(ExitCode::kFailure,
                      what + ", for the " + std::to_string(child.crashes) + "th time in a row",
                      "its own messages stand above");
    }
    const double pause_s = static_cast<double>(1 << (child.crashes - 1));
    child.start_again = now + std::chrono::duration_cast<steady_clock::duration>(seconds(pause_s));
    std::fprintf(stderr, "warning: %s; it starts again in %.0f s\n", what.c_str(), pause_s);
  }
}

int ServiceChildren::stop() {
  // The logger outlives the others, so that it hears their last words.
  return stop(1, children_.size()) + stop(0, 1);
}

int ServiceChildren::stop(std::size_t first, std::size_t last) {
  int failures = 0;
  for (std::size_t i = first; i < last; ++i) {
    if (children_[i].process_id != 0) {
      ::kill(children_[i].process_id, SIGTERM);
    }
  }
  const auto begin = steady_clock::now();
  bool is_killed = false;
  while (true) {
    bool is_running = false;
    for (std::size_t i = first; i < last; ++i) {
      Child& child = children_[i];
      if (child.process_id == 0) {
        continue;
      }
      int status = 0;
      if (::waitpid(child.process_id, &status, WNOHANG) != child.process_id) {
        is_running = true;
        continue;
      }
      child.process_id = 0;
      // Before it listens to signals, SIGTERM ends a child without a word.
      const bool is_unborn = !child.is_heard && WIFSIGNALED(status) && WTERMSIG(status) == SIGTERM;
      if (!is_unborn && (!WIFEXITED(status) || WEXITSTATUS(status) != 0)) {
        std::fprintf(stderr, "warning: %s %s\n", child.name.c_str(), end_text(status).c_str());
        ++failures;
      }
    }
    if (!is_running) {
      break;
    }
    if (!is_killed && steady_clock::now() - begin > seconds(kStopTimeout_s)) {
      is_killed = true;
      for (std::size_t i = first; i < last; ++i) {
        if (children_[i].process_id != 0) {
          ::kill(children_[i].process_id, SIGKILL);
        }
      }
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  for (std::size_t i = first; i < last; ++i) {
    children_[i].starts = 0;  // none starts again
  }
  return failures;
}

}  // namespace hedgehop::cli
