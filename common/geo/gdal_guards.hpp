#pragma once

#include <memory>
#include <optional>
#include <string>

#include "base/hash.hpp"

class GDALDataset;

/// Scopes around calls of GDAL, for every room that reads or writes through it. Each belongs to the
/// thread that made it; they end in the reverse order of their beginning.
namespace hedgehop::geo {

struct DatasetCloser {
  void operator()(GDALDataset* dataset) const;
};
using DatasetPointer = std::unique_ptr<GDALDataset, DatasetCloser>;

/// Collects GDAL's errors of this thread instead of printing them; warnings are dropped.
class GdalErrors {
 public:
  GdalErrors();
  ~GdalErrors();
  GdalErrors(const GdalErrors&) = delete;
  GdalErrors& operator=(const GdalErrors&) = delete;

  /// The first error's text; empty without one.
  [[nodiscard]] const std::string& first() const { return first_; }
  void note(const char* text);

 private:
  std::string first_;
};

/// A configuration value of this thread, put back at the end. `key` must outlive it.
class GdalSetting {
 public:
  GdalSetting(const char* key, const char* value);
  ~GdalSetting();
  GdalSetting(const GdalSetting&) = delete;
  GdalSetting& operator=(const GdalSetting&) = delete;

 private:
  const char* key_;
  std::optional<std::string> before_;
};

/// A file in memory for GDAL to write, so that the disk is met by write_file_atomically alone,
/// which reports when it is full. Removed at the end.
class MemoryFile {
 public:
  explicit MemoryFile(const std::string& name);
  ~MemoryFile();
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  [[nodiscard]] const char* path() const { return path_.c_str(); }
  /// What was written and closed. Valid until the end of this object.
  [[nodiscard]] ByteView bytes() const;

 private:
  std::string folder_;
  std::string path_;
};

}  // namespace hedgehop::geo
