#include "console.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <nlohmann/json.hpp>
#include <signal.h>
#include <unistd.h>

namespace hedgehop::cli {
namespace {

std::atomic<int> stop_signals{0};

void on_stop_signal(int signal) {
  if (stop_signals.fetch_add(1) >= 2) {
    ::signal(signal, SIG_DFL);
    ::raise(signal);
  }
}

class ConsoleObserver final : public Observer {
 public:
  ConsoleObserver(bool is_quiet, bool is_terminal)
      : is_quiet_(is_quiet), is_terminal_(is_terminal) {}
  ~ConsoleObserver() override { end_line(); }

  void progress(std::string_view stage, double done, double total) override {
    if (is_quiet_) {
      return;
    }
    const std::lock_guard lock(mutex_);
    const int percent =
        total > 0.0 ? static_cast<int>(std::clamp(100.0 * done / total, 0.0, 100.0)) : 0;
    if (stage != stage_) {
      end_line();
      stage_ = stage;
      percent_ = -1;
    }
    const int shown = is_terminal_ ? percent : percent / 10 * 10;
    if (shown <= percent_) {
      return;
    }
    percent_ = shown;
    if (is_terminal_) {
      constexpr int kWidth = 30;
      const int filled = shown * kWidth / 100;
      std::fprintf(stderr, "\r%-28.28s [%s%s] %3d %%", stage_.c_str(),
                   std::string(static_cast<std::size_t>(filled), '#').c_str(),
                   std::string(static_cast<std::size_t>(kWidth - filled), '.').c_str(), shown);
      is_line_open_ = true;
    } else {
      std::fprintf(stderr, "%s: %d %%\n", stage_.c_str(), shown);
    }
    std::fflush(stderr);
  }

  void note(std::string_view text) override {
    if (is_quiet_) {
      return;
    }
    const std::lock_guard lock(mutex_);
    end_line();
    std::fprintf(stderr, "note: %.*s\n", static_cast<int>(text.size()), text.data());
  }

  [[nodiscard]] bool stop_requested() const override { return is_stop_requested(); }

 private:
  void end_line() {
    if (is_line_open_) {
      std::fputc('\n', stderr);
      is_line_open_ = false;
    }
  }

  bool is_quiet_;
  bool is_terminal_;
  bool is_line_open_ = false;
  int percent_ = -1;
  std::string stage_;
  std::mutex mutex_;
};

}  // namespace

std::unique_ptr<Observer> Console::observer() const {
  return std::make_unique<ConsoleObserver>(is_quiet, ::isatty(STDERR_FILENO) == 1);
}

void Console::say(const std::string& text) const {
  if (!is_quiet) {
    std::fprintf(stderr, "%s\n", text.c_str());
  }
}

void add_common_options(CLI::App& verb, Console& console) {
  verb.add_flag("--json", console.is_json, "Print the result as one JSON object on stdout");
  verb.add_flag("-q,--quiet", console.is_quiet, "No progress and no remarks on stderr");
  verb.add_flag("-v,--verbose", console.verbosity, "Say more on stderr");
  verb.add_option("--threads", console.threads,
                  "Number of threads; never changes a result (default: all cores)")
      ->check(CLI::Range(1, 1024));
}

void install_stop_signals() {
  struct sigaction action = {};
  action.sa_handler = on_stop_signal;
  sigemptyset(&action.sa_mask);
  action.sa_flags = SA_RESTART;
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
}

bool is_stop_requested() { return stop_signals.load(std::memory_order_relaxed) > 0; }

ExitCode report_error(const Console& console, ExitCode code, const std::string& what,
                      const std::string& hint) {
  std::fprintf(stderr, "error: %s\n", what.c_str());
  if (!hint.empty()) {
    std::fprintf(stderr, "hint: %s\n", hint.c_str());
  }
  if (console.is_json) {
    nlohmann::ordered_json json;
    json["schema_version"] = 1;
    json["error"] = {{"exit_code", static_cast<int>(code)}, {"what", what}, {"hint", hint}};
    std::printf("%s\n", json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
  }
  return code;
}

}  // namespace hedgehop::cli
