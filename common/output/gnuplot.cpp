#include "output/gnuplot.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <system_error>
#include <unistd.h>

#include "base/errors.hpp"

extern char** environ;

namespace hedgehop::output {
namespace {

constexpr char kInstall[] =
    "install gnuplot (Debian: apt-get install gnuplot-nox fonts-dejavu-core), or plan without "
    "figures";
constexpr std::size_t kComplaintBytesMax = 4096;

class FileDescriptor {
 public:
  explicit FileDescriptor(int number) : number_(number) {}
  ~FileDescriptor() { close(); }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  [[nodiscard]] int number() const { return number_; }
  void close() {
    if (number_ >= 0) {
      ::close(number_);
    }
    number_ = -1;
  }

 private:
  int number_;
};

struct FileActions {
  posix_spawn_file_actions_t value{};
  FileActions() { posix_spawn_file_actions_init(&value); }
  ~FileActions() { posix_spawn_file_actions_destroy(&value); }
  FileActions(const FileActions&) = delete;
  FileActions& operator=(const FileActions&) = delete;
};

[[noreturn]] void fail(const std::string& what, int error) {
  throw SystemFailure("figures: " + what + ": " + std::generic_category().message(error), kInstall);
}

}  // namespace

void run_gnuplot(const std::filesystem::path& folder, const std::string& script,
                 const std::string& first) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) {
    fail("no pipe to gnuplot", errno);
  }
  FileDescriptor read_end(ends[0]);
  FileDescriptor write_end(ends[1]);
  FileActions actions;
  posix_spawn_file_actions_addchdir_np(&actions.value, folder.c_str());
  posix_spawn_file_actions_addopen(&actions.value, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions.value, write_end.number(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions.value, write_end.number(), STDERR_FILENO);

  std::string program = "gnuplot";
  std::string defaults = "-d";
  std::string option = "-e";
  std::string command = first;
  std::string file = script;
  std::array<char*, 6> arguments = {program.data(), defaults.data(), option.data(),
                                    command.data(), file.data(),     nullptr};
  pid_t child = 0;
  const int error =
      ::posix_spawnp(&child, program.c_str(), &actions.value, nullptr, arguments.data(), environ);
  if (error == ENOENT) {
    throw SystemFailure("figures: the program gnuplot was not found", kInstall);
  }
  if (error != 0) {
    fail("gnuplot cannot be started", error);
  }
  write_end.close();
  std::string complaint;
  for (;;) {
    std::array<char, 1024> buffer{};
    const ssize_t count = ::read(read_end.number(), buffer.data(), buffer.size());
    if (count > 0) {
      if (complaint.size() < kComplaintBytesMax) {
        complaint.append(buffer.data(), static_cast<std::size_t>(count));
      }
    } else if (count == 0 || errno != EINTR) {
      break;
    }
  }
  int status = 0;
  while (::waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) {
      fail("gnuplot was lost", errno);
    }
  }
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    if (WIFEXITED(status) && WEXITSTATUS(status) == 127) {
      throw SystemFailure("figures: the program gnuplot was not found", kInstall);
    }
    throw SystemFailure("figures: gnuplot failed on " + (folder / script).string() + ": " +
                            (complaint.empty() ? "it says nothing" : complaint),
                        "look at the script; is the disk full?");
  }
}

std::string gnuplot_quoted(const std::string& text, std::size_t characters_max) {
  std::string quoted = "'";
  std::size_t characters = 0;
  for (std::size_t i = 0; i < text.size(); ++characters) {
    if (characters == characters_max) {
      quoted += "...";
      break;
    }
    const auto byte = static_cast<unsigned char>(text[i]);
    std::size_t length = 1;
    if (byte >= 0xc2 && byte < 0xe0) {
      length = 2;
    } else if (byte >= 0xe0 && byte < 0xf0) {
      length = 3;
    } else if (byte >= 0xf0 && byte < 0xf5) {
      length = 4;
    } else if (byte >= 0x80) {
      length = 0;
    }
    bool is_valid = length > 0 && i + length <= text.size();
    for (std::size_t k = 1; is_valid && k < length; ++k) {
      is_valid = (static_cast<unsigned char>(text[i + k]) & 0xc0U) == 0x80;
    }
    if (!is_valid) {
      quoted += '?';
      i += 1;
    } else if (length == 1 && (byte < 0x20 || byte == 0x7f)) {
      quoted += ' ';
      i += 1;
    } else {
      // gnuplot 5.4 mistakes a doubled quote at the start for an empty string, so none is left.
      quoted += byte == '\'' ? "\xe2\x80\x99" : text.substr(i, length);
      i += length;
    }
  }
  return quoted + "'";
}

}  // namespace hedgehop::output
