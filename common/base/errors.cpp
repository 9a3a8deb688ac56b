#include "base/errors.hpp"

#include <string_view>

namespace hedgehop::base {

void assertion_failed(const char* condition, const char* file, int line) {
  std::string_view name(file);
  if (const auto slash = name.rfind('/'); slash != std::string_view::npos) {
    name.remove_prefix(slash + 1);
  }
  throw std::logic_error("invariant broken: " + std::string(condition) + " (" + std::string(name) +
                         ":" + std::to_string(line) + "); this is a defect of hedgehop");
}

}  // namespace hedgehop::base
