#include "help_text.hpp"

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

namespace hedgehop::cli {
namespace {

constexpr std::size_t kDescriptionColumn = 30;  // where CLI11 puts what an option is for

// One line as several; those that follow begin at the column of the text.
std::string wrapped(const std::string& line) {
  if (line.size() <= kHelpColumns) {
    return line;
  }
  const bool is_example = line.starts_with("  hedgehop ");
  const bool is_option = line.starts_with("  ") && !is_example;
  const std::string indent(is_example ? 6 : is_option ? kDescriptionColumn : 0, ' ');
  const std::size_t room = is_example ? kHelpColumns - 2 : kHelpColumns;
  std::string text;
  std::string rest = line;
  while (rest.size() > room) {
    const std::size_t space = rest.rfind(' ', room);
    if (space == std::string::npos || space <= indent.size()) {
      break;
    }
    text += rest.substr(0, space) + (is_example ? " \\\n" : "\n");
    rest = indent + rest.substr(space + 1);
  }
  return text + rest;
}

class ShortHelp final : public CLI::Formatter {
 public:
  ShortHelp() { column_width(kDescriptionColumn); }

  std::string make_help(const CLI::App* app, std::string name,
                        CLI::AppFormatMode mode) const override {
    const std::string whole = CLI::Formatter::make_help(app, name, mode);
    std::string text;
    for (std::size_t at = 0; at < whole.size();) {
      const std::size_t end = std::min(whole.find('\n', at), whole.size());
      text += wrapped(whole.substr(at, end - at)) + "\n";
      at = end + 1;
    }
    return text;
  }

  // "FLOAT:FLOAT in [0 - 1000]" is "FLOAT": who leaves the range is told it.
  std::string make_option_opts(const CLI::Option* option) const override {
    std::string text = CLI::Formatter::make_option_opts(option);
    const std::size_t range = text.find(" in [");
    const std::size_t colon = range == std::string::npos ? range : text.rfind(':', range);
    if (colon != std::string::npos) {
      const std::size_t end = text.find(']', range);
      text.erase(colon, end == std::string::npos ? end : end + 1 - colon);
    }
    return text;
  }
};

}  // namespace

void use_short_help(CLI::App& app) { app.formatter(std::make_shared<ShortHelp>()); }

}  // namespace hedgehop::cli
