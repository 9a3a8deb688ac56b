#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "base/hash.hpp"

namespace hedgehop {

/// Reads a whole file. Throws DataError if it is missing, a folder or unreadable.
std::string read_file(const std::filesystem::path& path);

/// Writes to a temporary name beside `path`, flushes to disk, then renames. Throws SystemFailure,
/// and leaves neither a half-written file nor the temporary one, when the disk is full.
void write_file_atomically(const std::filesystem::path& path, ByteView bytes);
inline void write_file_atomically(const std::filesystem::path& path, std::string_view text) {
  write_file_atomically(path, bytes_of(text));
}

/// A folder that appears under its name only when it is complete.
///
/// Files are written below path(), a hidden sibling of the target. commit() renames it to the
/// target; without commit() the destructor removes it with all it holds.
class StagedFolder {
 public:
  /// Throws UsageError if `target` exists and `overwrite` is false, if it exists and is not a
  /// folder that hedgehop wrote (`marker_file` is missing in it), or if its parent does not exist.
  StagedFolder(std::filesystem::path target, std::string_view marker_file, bool overwrite);
  ~StagedFolder();
  StagedFolder(const StagedFolder&) = delete;
  StagedFolder& operator=(const StagedFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return staging_; }
  /// Throws SystemFailure if a file below could not be brought to disk or the rename fails.
  void commit();

 private:
  std::filesystem::path target_;
  std::filesystem::path staging_;
  bool is_committed_ = false;
};

}  // namespace hedgehop
