#pragma once

#include <functional>
#include <memory>
#include <string>

#include "base/errors.hpp"
#include "base/observer.hpp"

namespace CLI {
class App;
}

namespace hedgehop::cli {

/// How a verb talks: results on stdout, everything else on stderr.
struct Console {
  bool is_json = false;
  bool is_quiet = false;
  int verbosity = 0;
  int threads = 0;                   // 0: as many as the machine has
  std::function<ExitCode()> action;  // set by the verb that the command line names

  /// Observer that draws a progress bar with the time to go on a terminal, or one line per 10 %;
  /// with --verbose it says how long each stage took. It asks to stop after so many Ctrl-C.
  [[nodiscard]] std::unique_ptr<Observer> observer(int stops = 1) const;
  /// One line on stderr unless quiet.
  void say(const std::string& text) const;
};

/// Options that every verb has: --json, --quiet, --verbose, --threads.
void add_common_options(CLI::App& verb, Console& console);

/// From now on Ctrl-C and SIGTERM ask long work to stop; the third one kills.
void install_stop_signals();
[[nodiscard]] bool is_stop_requested(int stops = 1);

/// "0:07", "12:34", "1:02:03": a duration for people.
std::string duration_text(double seconds);

/// Prints an error in the manner of the console and returns its exit code.
ExitCode report_error(const Console& console, ExitCode code, const std::string& what,
                      const std::string& hint);

}  // namespace hedgehop::cli
