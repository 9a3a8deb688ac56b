#pragma once

namespace CLI {
class App;
}

namespace hedgehop::cli {

inline constexpr int kHelpColumns = 100;

/// From now on --help of a command and of everything below it is wrapped at kHelpColumns, and says
/// the kind of an option's value without its range. Call before subcommands are added.
void use_short_help(CLI::App& app);

}  // namespace hedgehop::cli
