#pragma once

#include "console.hpp"

/// One function a verb: it adds the verb's options to the command tree and, when the command line
/// names it, sets console.action.
namespace hedgehop::cli {

/// The verbs `completion` and `man`.
void add_completion_verbs(CLI::App& app, Console& console);
void add_config_verb(CLI::App& app, Console& console);
void add_demo_verb(CLI::App& app, Console& console);
void add_doctor_verb(CLI::App& app, Console& console);
void add_evaluate_verb(CLI::App& app, Console& console);
void add_export_verb(CLI::App& app, Console& console);
void add_fetch_verb(CLI::App& app, Console& console);
void add_info_verb(CLI::App& app, Console& console);
void add_log_verb(CLI::App& app, Console& console);
void add_patch_verb(CLI::App& app, Console& console);
void add_plan_verb(CLI::App& app, Console& console);
void add_prepare_verb(CLI::App& app, Console& console);
void add_replay_verb(CLI::App& app, Console& console);
void add_report_verb(CLI::App& app, Console& console);
void add_request_verb(CLI::App& app, Console& console);
void add_roadmap_verb(CLI::App& app, Console& console);
void add_serve_verb(CLI::App& app, Console& console);
void add_tune_verb(CLI::App& app, Console& console);
void add_verify_verb(CLI::App& app, Console& console);
void add_watch_verb(CLI::App& app, Console& console);

}  // namespace hedgehop::cli
