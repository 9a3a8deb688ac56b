#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "base/config_reader.hpp"
#include "base/hash.hpp"
#include "bus/service.hpp"

namespace hedgehop::services {

/// The config document of a service.
struct ServiceConfig {
  std::string text;
  std::string name;  // what errors call it

  [[nodiscard]] ConfigReader reader() const;
  /// Identity of the document, comments and layout apart.
  [[nodiscard]] Hash128 hash() const;
};

/// The shipped config of that name ("map_tiler.yaml") with what the user's file replaces; `file`
/// may be empty. Throws ConfigError with file:line for a key that does not exist.
ServiceConfig load_config(const std::string& file, std::string_view shipped_name);

/// From now on this process keeps the memory that it frees, for the next plan of the same size:
/// taken from the system anew, the pages of one plan cost a service 10 to 20 ms.
void keep_freed_memory();

/// Option --threads of a planner service.
bus::ServiceOption threads_option();

/// Holds the number of threads of this process to what --threads says; all cores without it. The
/// number never changes a result. Throws UsageError for anything but 1 to 1024.
class ThreadLimit {
 public:
  explicit ThreadLimit(const bus::ServiceArguments& arguments);
  ~ThreadLimit();
  ThreadLimit(const ThreadLimit&) = delete;
  ThreadLimit& operator=(const ThreadLimit&) = delete;

 private:
  struct Control;
  std::unique_ptr<Control> control_;
};

}  // namespace hedgehop::services
