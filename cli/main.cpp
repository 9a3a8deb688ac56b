#include <CLI/CLI.hpp>
#include <optional>
#include <tbb/global_control.h>

#include "hedgehop_version.hpp"
#include "verbs.hpp"

int main(int argc, char** argv) {
  using namespace hedgehop;
  using namespace hedgehop::cli;

  CLI::App app{
      "Plans low-altitude (contour) helicopter flights over real terrain: terrain and land-use "
      "files "
      "go in, a concealed, flyable, independently verified trajectory comes out."};
  app.name("hedgehop");
  app.set_version_flag("--version", "hedgehop " HEDGEHOP_VERSION);
  app.require_subcommand(1);
  app.footer(
      "Start with `hedgehop demo`, or with your own region:\n"
      "  hedgehop prepare --dem N49E011.hgt.zip --osm area.osm.pbf --bbox 11.4,49.9,11.6,50.1 "
      "--out map\n"
      "  hedgehop plan --map map --start 49.95,11.45 --goal 50.05,11.58 --out plan\n"
      "  hedgehop report plan --map map\n"
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 no route, 4 not verified, 5 bad data, 6 bus "
      "unreachable, 130 interrupted.");
  Console console;
  add_prepare_verb(app, console);
  add_info_verb(app, console);
  add_plan_verb(app, console);
  add_verify_verb(app, console);
  add_export_verb(app, console);
  add_report_verb(app, console);
  add_evaluate_verb(app, console);
  add_serve_verb(app, console);
  add_request_verb(app, console);
  add_watch_verb(app, console);
  add_log_verb(app, console);
  add_replay_verb(app, console);
  add_config_verb(app, console);
  add_doctor_verb(app, console);
  add_demo_verb(app, console);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error);
    return code == 0 ? 0 : static_cast<int>(ExitCode::kUsage);
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
