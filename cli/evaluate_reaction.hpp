#pragma once

namespace CLI {
class App;
}

namespace hedgehop::cli {

struct Console;

/// Adds `evaluate reaction`.
void add_reaction_verb(CLI::App& evaluate, Console& console);

}  // namespace hedgehop::cli
