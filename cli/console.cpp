#include "console.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
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

bool is_terminal() { return ::isatty(STDERR_FILENO) == 1; }

/// Colours are for terminals; a NO_COLOR that is not empty, or a dumb terminal, asks for none.
bool has_colors() {
  const char* no_color = std::getenv("NO_COLOR");
  const char* terminal = std::getenv("TERM");
  return is_terminal() && (no_color == nullptr || *no_color == '\0') && terminal != nullptr &&
         std::strcmp(terminal, "dumb") != 0;
}

/// "error" in red, say; the code is one of ECMA-48.
std::string colored(const char* text, const char* code) {
  return has_colors() ? std::string("\033[") + code + "m" + text + "\033[0m" : text;
}

class ConsoleObserver final : public Observer {
 public:
  ConsoleObserver(bool is_quiet, int verbosity, int stops)
      : is_quiet_(is_quiet), verbosity_(verbosity), stops_(stops), is_terminal_(is_terminal()) {}
  ~ConsoleObserver() override { end_stage(); }

  void progress(std::string_view stage, double done, double total) override {
    if (is_quiet_) {
      return;
    }
    const std::lock_guard lock(mutex_);
    const int percent =
        total > 0.0 ? static_cast<int>(std::clamp(100.0 * done / total, 0.0, 100.0)) : 0;
    const auto now = std::chrono::steady_clock::now();
    if (stage != stage_) {
      end_stage();
      stage_ = stage;
      percent_ = -1;
      stage_began_ = now;
    }
    last_progress_ = now;
    const int shown = is_terminal_ ? percent : percent / 10 * 10;
    if (shown <= percent_) {
      return;
    }
    percent_ = shown;
    if (is_terminal_) {
      constexpr int kWidth = 30;
      const int filled = shown * kWidth / 100;
      std::fprintf(stderr, "\r%-28.28s [%s%s] %3d %%%-20s", stage_.c_str(),
                   std::string(static_cast<std::size_t>(filled), '#').c_str(),
                   std::string(static_cast<std::size_t>(kWidth - filled), '.').c_str(), shown,
                   time_to_go(done, total, now).c_str());
      is_line_open_ = true;
    } else {
      std::fprintf(stderr, "%s: %d %%%s\n", stage_.c_str(), shown,
                   time_to_go(done, total, now).c_str());
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

  [[nodiscard]] bool stop_requested() const override { return is_stop_requested(stops_); }

 private:
  using Instant = std::chrono::steady_clock::time_point;

  /// ", 0:42 to go", once there is something to reckon with.
  [[nodiscard]] std::string time_to_go(double done, double total, Instant now) const {
    const double elapsed_s = std::chrono::duration<double>(now - stage_began_).count();
    if (!(elapsed_s >= 1.0) || !(done > 0.0) || !(total > done)) {
      return "";
    }
    return ", " + duration_text(elapsed_s * (total - done) / done) + " to go";
  }

  void end_stage() {
    end_line();
    if (verbosity_ > 0 && !stage_.empty()) {
      std::fprintf(stderr, "%s: took %.2f s\n", stage_.c_str(),
                   std::chrono::duration<double>(last_progress_ - stage_began_).count());
    }
    stage_.clear();
  }

  void end_line() {
    if (is_line_open_) {
      std::fputc('\n', stderr);
      is_line_open_ = false;
    }
  }

  bool is_quiet_;
  int verbosity_;
  int stops_;
  bool is_terminal_;
  bool is_line_open_ = false;
  int percent_ = -1;
  std::string stage_;
  Instant stage_began_;
  Instant last_progress_;
  std::mutex mutex_;
};

}  // namespace

std::unique_ptr<Observer> Console::observer(int stops) const {
  return std::make_unique<ConsoleObserver>(is_quiet, verbosity, stops);
}

void Console::say(const std::string& text) const {
  if (!is_quiet) {
    std::fprintf(stderr, "%s\n", text.c_str());
  }
}

void add_common_options(CLI::App& verb, Console& console) {
  verb.add_flag("--json", console.is_json, "Print the result as one JSON object on stdout");
  verb.add_flag("-q,--quiet", console.is_quiet, "No progress and no remarks on stderr");
  verb.add_flag("-v,--verbose", console.verbosity, "Say on stderr how long each stage takes");
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

bool is_stop_requested(int stops) { return stop_signals.load(std::memory_order_relaxed) >= stops; }

std::string duration_text(double seconds) {
  const long whole = std::lround(std::clamp(seconds, 0.0, 1e8));
  char text[64];
  if (whole >= 3600) {
    std::snprintf(text, sizeof text, "%ld:%02ld:%02ld", whole / 3600, whole / 60 % 60, whole % 60);
  } else {
    std::snprintf(text, sizeof text, "%ld:%02ld", whole / 60, whole % 60);
  }
  return text;
}

ExitCode report_error(const Console& console, ExitCode code, const std::string& what,
                      const std::string& hint) {
  std::fprintf(stderr, "%s: %s\n", colored("error", "1;31").c_str(), what.c_str());
  if (!hint.empty()) {
    std::fprintf(stderr, "%s: %s\n", colored("hint", "36").c_str(), hint.c_str());
  }
  if (console.is_json) {
    nlohmann::ordered_json json;
    json["schema"] = "hedgehop error";
    json["schema_version"] = 1;
    json["error"] = {{"exit_code", static_cast<int>(code)}, {"what", what}, {"hint", hint}};
    std::printf("%s\n", json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
  }
  return code;
}

}  // namespace hedgehop::cli
