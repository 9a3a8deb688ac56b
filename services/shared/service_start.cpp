#include "service_start.hpp"

#include <charconv>
#include <limits>
#include <malloc.h>
#include <tbb/global_control.h>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "base/shipped_config.hpp"

namespace hedgehop::services {

ServiceConfig load_config(const std::string& file, std::string_view shipped_name) {
  const std::string shipped_path = "config/" + std::string(shipped_name);
  const std::string_view shipped = shipped_config(shipped_name);
  if (file.empty()) {
    return {std::string(shipped), shipped_path};
  }
  return {overlay_config(shipped, shipped_path, read_file(file), file), "effective configuration"};
}

ConfigReader ServiceConfig::reader() const { return ConfigReader::from_text(text, name); }

Hash128 ServiceConfig::hash() const { return hash128(canonical_config(text, name)); }

struct ThreadLimit::Control {
  explicit Control(std::size_t threads)
      : control(tbb::global_control::max_allowed_parallelism, threads) {}
  tbb::global_control control;
};

void keep_freed_memory() {
  constexpr int kLargestInHeap_bytes = 32 << 20;  // all that the library takes
  mallopt(M_MMAP_THRESHOLD, kLargestInHeap_bytes);
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
}

bus::ServiceOption threads_option() {
  return {"--threads", "N", "Number of threads; never changes a result (default: all cores)"};
}

ThreadLimit::ThreadLimit(const bus::ServiceArguments& arguments) {
  const std::string text = arguments.value("--threads");
  if (text.empty()) {
    return;
  }
  std::size_t threads = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), threads);
  if (error != std::errc() || end != text.data() + text.size() || threads < 1 || threads > 1024) {
    throw UsageError("--threads '" + text + "' is not a number from 1 to 1024");
  }
  control_ = std::make_unique<Control>(threads);
}

ThreadLimit::~ThreadLimit() = default;

}  // namespace hedgehop::services
