#include <CLI/CLI.hpp>
#include <algorithm>
#include <optional>
#include <string_view>
#include <tbb/global_control.h>

#include "base/config_reader.hpp"
#include "hedgehop_version.hpp"
#include "help_text.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

std::string full_name(const CLI::App& app) {
  return app.get_parent() == nullptr ? app.get_name()
                                     : full_name(*app.get_parent()) + " " + app.get_name();
}

struct Complaint {
  std::string what;
  std::string hint;
};

// What is wrong with a command line that could not be parsed: a verb or an option that does not
// exist, with the nearest one, before anything that follows from it.
Complaint complaint_about(const CLI::App& app, const CLI::ParseError& error, int argc,
                          char** argv) {
  const CLI::App* verb = &app;
  const auto unknown = [&](const std::string& kind, const std::string& word,
                           const std::vector<std::string>& known) {
    const auto nearest = nearest_word(word, known);
    return Complaint{"unknown " + kind + " '" + word + "'",
                     (nearest ? "did you mean '" + *nearest + "'? " : "") + full_name(*verb) +
                         " --help lists all"};
  };
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word.starts_with("--") && word.size() > 2) {
      const std::string name = word.substr(0, word.find('='));
      if (verb->get_option_no_throw(name) == nullptr) {
        std::vector<std::string> known;
        for (const CLI::Option* option : verb->get_options()) {
          for (const std::string& long_name : option->get_lnames()) {
            known.push_back("--" + long_name);
          }
        }
        return unknown("option", name, known);
      }
    } else if (!word.starts_with("-")) {
      const auto below = verb->get_subcommands([](const CLI::App*) { return true; });
      const auto found = std::find_if(below.begin(), below.end(), [&](const CLI::App* candidate) {
        return candidate->check_name(word);
      });
      if (found != below.end()) {
        verb = *found;
      } else if (!below.empty()) {
        std::vector<std::string> known;
        for (const CLI::App* candidate : below) {
          known.push_back(candidate->get_name());
        }
        return unknown("verb", word, known);
      }
    }
  }
  std::string what = error.what();
  if (what == "A subcommand is required") {
    what = "a verb is missing after '" + full_name(*verb) + "'";
  }
  // The largest number of all says nothing.
  if (const std::size_t range = what.find(" not in range 0.000000 to 179769");
      range != std::string::npos) {
    what = what.substr(0, range) + " is too small";
  }
  std::erase_if(what, [](unsigned char c) { return c < 0x20; });  // CLI11 prints enumerators so
  return {what, "see " + full_name(*verb) + " --help"};
}

bool is_json_wanted(int argc, char** argv) {
  return std::any_of(argv + 1, argv + argc,
                     [](const char* word) { return std::string_view(word) == "--json"; });
}

}  // namespace
}  // namespace hedgehop::cli

int main(int argc, char** argv) {
  using namespace hedgehop;
  using namespace hedgehop::cli;

  CLI::App app{
      "Plans low-altitude (contour) helicopter flights over real terrain: terrain and land-use "
      "files "
      "go in, a concealed, flyable, independently verified trajectory comes out."};
  app.name("hedgehop");
  use_short_help(app);
  app.set_version_flag("--version", "hedgehop " HEDGEHOP_VERSION);
  app.require_subcommand(1);
  app.footer(
      "Start with `hedgehop demo`, or with your own region:\n"
      "  hedgehop prepare --dem N49E011.hgt.zip --osm area.osm.pbf --bbox 11.4,49.9,11.6,50.1 "
      "--out map\n"
      "  hedgehop plan --map map --start 49.95,11.45 --goal 50.05,11.58 --out plan\n"
      "  hedgehop report plan --map map\n"
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 no route, 4 not verified, 5 bad data, 6 bus "
      "unreachable, 7 not fetched, 130 interrupted.");
  Console console;
  add_fetch_verb(app, console);
  add_prepare_verb(app, console);
  add_info_verb(app, console);
  add_roadmap_verb(app, console);
  add_plan_verb(app, console);
  add_verify_verb(app, console);
  add_export_verb(app, console);
  add_report_verb(app, console);
  add_evaluate_verb(app, console);
  add_tune_verb(app, console);
  add_serve_verb(app, console);
  add_request_verb(app, console);
  add_patch_verb(app, console);
  add_watch_verb(app, console);
  add_log_verb(app, console);
  add_replay_verb(app, console);
  add_config_verb(app, console);
  add_doctor_verb(app, console);
  add_demo_verb(app, console);
  add_completion_verbs(app, console);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      return app.exit(error);  // help, version
    }
    console.is_json = is_json_wanted(argc, argv);
    const Complaint complaint = complaint_about(app, error, argc, argv);
    return static_cast<int>(
        report_error(console, ExitCode::kUsage, complaint.what, complaint.hint));
  }
  install_stop_signals();
  std::optional<tbb::global_control> threads;
  if (console.threads > 0) {
    threads.emplace(tbb::global_control::max_allowed_parallelism,
                    static_cast<std::size_t>(console.threads));
  }
  try {
    return static_cast<int>(console.action());
  } catch (const UserError& error) {
    return static_cast<int>(report_error(console, error.code(), error.what(), error.hint()));
  } catch (const std::bad_alloc&) {
    return static_cast<int>(report_error(console, ExitCode::kFailure, "out of memory",
                                         "a smaller area or larger cells need less"));
  } catch (const std::exception& error) {
    return static_cast<int>(report_error(console, ExitCode::kFailure, error.what(), ""));
  }
}
