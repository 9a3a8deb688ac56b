#include "base/files.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <sstream>
#include <unistd.h>

#include "base/errors.hpp"

namespace hedgehop {
namespace fs = std::filesystem;
namespace {

std::string reason() { return std::strerror(errno); }

const char* hint_for_errno() {
  return errno == ENOSPC || errno == EDQUOT ? "free some space, or choose another folder" : "";
}

void flush_to_disk(const fs::path& path) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) {
    throw SystemFailure(path.string() + ": cannot be opened: " + reason());
  }
  const int result = ::fsync(descriptor);
  const int error = errno;
  ::close(descriptor);
  if (result != 0 && error != EINVAL) {
    errno = error;
    throw SystemFailure(path.string() + ": cannot be written to disk: " + reason(),
                        hint_for_errno());
  }
}

fs::path without_trailing_slash(fs::path path) {
  return path.has_filename() ? path : path.parent_path();
}

}  // namespace

std::string read_file(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error)) {
    throw DataError(path.string() + ": no such file");
  }
  if (fs::is_directory(path, error)) {
    throw DataError(path.string() + ": is a folder, a file is needed");
  }
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file || file.bad()) {
    throw DataError(path.string() + ": cannot be read");
  }
  return std::move(text).str();
}

void write_file_atomically(const fs::path& path, ByteView bytes) {
  const fs::path temporary =
      path.parent_path() / ("." + path.filename().string() + ".part-" + std::to_string(::getpid()));
  const auto fail = [&](const std::string& what) {
    const std::string text = path.string() + ": " + what + ": " + reason();
    const std::string hint = hint_for_errno();
    ::unlink(temporary.c_str());
    throw SystemFailure(text, hint);
  };
  const int descriptor = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (descriptor < 0) {
    fail("cannot be created");
  }
  const char* data = reinterpret_cast<const char*>(bytes.data());
  std::size_t left = bytes.size();
  while (left > 0) {
    const ssize_t written = ::write(descriptor, data, left);
    if (written < 0 && errno == EINTR) {
      continue;
    }
    if (written < 0) {
      const int error = errno;
      ::close(descriptor);
      errno = error;
      fail("cannot be written");
    }
    data += written;
    left -= static_cast<std::size_t>(written);
  }
  const bool is_flushed = ::fsync(descriptor) == 0 || errno == EINVAL;
  const int flush_error = errno;
  if (::close(descriptor) != 0 || !is_flushed) {
    if (!is_flushed) {
      errno = flush_error;
    }
    fail("cannot be written to disk");
  }
  if (::rename(temporary.c_str(), path.c_str()) != 0) {
    fail("cannot be renamed into place");
  }
}

StagedFolder::StagedFolder(fs::path target, std::string_view marker_file, bool overwrite)
    : target_(without_trailing_slash(fs::absolute(target).lexically_normal())) {
  std::error_code error;
  if (fs::exists(target_, error)) {
    if (!overwrite) {
      throw UsageError("output folder " + target_.string() + " exists already",
                       "choose another name, or add --overwrite to replace it");
    }
    if (!fs::is_directory(target_, error) || !fs::exists(target_ / marker_file, error)) {
      throw UsageError(target_.string() + " exists and holds no '" + std::string(marker_file) +
                           "', so hedgehop did not write it and will not replace it",
                       "choose another name");
    }
  }
  if (!fs::is_directory(target_.parent_path(), error)) {
    throw UsageError("the folder " + target_.parent_path().string() + " does not exist",
                     "create it first, or choose another place");
  }
  staging_ = target_.parent_path() /
             ("." + target_.filename().string() + ".part-" + std::to_string(::getpid()));
  fs::remove_all(staging_, error);
  if (!fs::create_directory(staging_, error) || error) {
    throw SystemFailure(staging_.string() + ": cannot be created: " + error.message());
  }
}

StagedFolder::~StagedFolder() {
  if (!is_committed_) {
    std::error_code ignored;
    fs::remove_all(staging_, ignored);
  }
}

void StagedFolder::commit() {
  for (const auto& entry : fs::recursive_directory_iterator(staging_)) {
    if (entry.is_regular_file()) {
      flush_to_disk(entry.path());
    }
  }
  const fs::path old = staging_.string() + ".old";
  std::error_code error;
  const bool had_old = fs::exists(target_, error);
  if (had_old) {
    fs::rename(target_, old, error);
    if (error) {
      throw SystemFailure(target_.string() + ": cannot be replaced: " + error.message());
    }
  }
  fs::rename(staging_, target_, error);
  if (error) {
    const std::string why = error.message();
    if (had_old) {
      fs::rename(old, target_, error);
    }
    throw SystemFailure(target_.string() + ": cannot be renamed into place: " + why);
  }
  is_committed_ = true;
  if (had_old) {
    fs::remove_all(old, error);
  }
}

}  // namespace hedgehop
