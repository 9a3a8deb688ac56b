#pragma once

namespace CLI {
class App;
}

namespace hedgehop::cli {

struct Console;

/// Adds `optimality` to `hedgehop evaluate`.
void add_optimality_verb(CLI::App& verb, Console& console);

}  // namespace hedgehop::cli
