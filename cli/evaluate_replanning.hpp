#pragma once

namespace CLI {
class App;
}

namespace hedgehop::cli {

struct Console;

/// Adds `evaluate replanning`.
void add_replanning_verb(CLI::App& evaluate, Console& console);

}  // namespace hedgehop::cli
