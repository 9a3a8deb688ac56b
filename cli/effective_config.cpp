#include "effective_config.hpp"

#include "base/files.hpp"
#include "base/shipped_config.hpp"

namespace hedgehop::cli {

ConfigReader effective_config(const std::string& shipped_file, const std::string& config_file,
                              const std::vector<std::string>& settings) {
  const std::string shipped_name = "config/" + shipped_file;
  std::string text(shipped_config(shipped_file));
  if (!config_file.empty()) {
    text = overlay_config(text, shipped_name, read_file(config_file), config_file);
  }
  for (const std::string& setting : settings) {
    text = set_config_value(text, setting);
  }
  return ConfigReader::from_text(text,
                                 config_file.empty() ? shipped_name : "effective configuration");
}

}  // namespace hedgehop::cli
