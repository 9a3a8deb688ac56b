// Any file: read to its end, or refused.
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <unistd.h>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "bus/event_log.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::filesystem::path kPath =
      std::filesystem::temp_directory_path() / ("hedgehop_fuzz_" + std::to_string(::getpid()));
  {
    std::FILE* file = std::fopen(kPath.c_str(), "wb");
    if (file == nullptr || std::fwrite(data, 1, size, file) != size || std::fclose(file) != 0) {
      std::abort();
    }
  }
  std::size_t read = 0;
  try {
    hedgehop::bus::EventLogReader reader(kPath);
    while (const auto event = reader.next()) {
      read += 28 + event->channel.size() + event->bytes.size();
    }
    if (read + static_cast<std::size_t>(reader.skipped_bytes()) > size) {
      std::abort();
    }
  } catch (const hedgehop::DataError&) {
  }
  return 0;
}
