#pragma once

namespace CLI {
class App;
}

namespace hedgehop::cli {

struct Console;

/// Adds `verifier` to `hedgehop evaluate`.
void add_verifier_verb(CLI::App& verb, Console& console);

}  // namespace hedgehop::cli
