#include "evaluation/child_run.hpp"

#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <fcntl.h>
#include <optional>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/errors.hpp"

namespace hedgehop::evaluation {
namespace {

constexpr std::uint32_t kMessageMax = 16U << 20U;
constexpr int kPollInterval_ms = 100;
// Message kinds on the pipe; after each stand the length and the bytes.
constexpr char kFromWork = 'm';
constexpr char kFailed = 'f';
constexpr char kDone = 'd';

class Pipe {
 public:
  Pipe() {
    if (::pipe2(ends_, O_CLOEXEC) != 0) {
      throw SystemFailure(std::string("no pipe to a child process: ") + std::strerror(errno));
    }
  }
  ~Pipe() {
    close_end(0);
    close_end(1);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  [[nodiscard]] int end(int which) const { return ends_[which]; }
  void close_end(int which) {
    if (ends_[which] >= 0) {
      ::close(ends_[which]);
      ends_[which] = -1;
    }
  }

 private:
  int ends_[2] = {-1, -1};
};

// Ends the child when this scope ends, however that happens.
class Child {
 public:
  explicit Child(pid_t pid) : pid_(pid) {}
  ~Child() {
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      wait();
    }
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  int wait() {
    int status = 0;
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = 0;
    return status;
  }

 private:
  pid_t pid_;
};

void write_all(int file, const char* bytes, std::size_t count) {
  while (count > 0) {
    const ssize_t written = ::write(file, bytes, count);
    if (written < 0 && errno == EINTR) {
      continue;
    }
    if (written <= 0) {
      ::_exit(1);  // the parent is gone
    }
    bytes += written;
    count -= static_cast<std::size_t>(written);
  }
}

void write_message(int file, char kind, std::string_view message) {
  if (message.size() > kMessageMax) {
    throw std::length_error("a message of a child process is too long");
  }
  char header[1 + sizeof(std::uint32_t)];
  const auto length = static_cast<std::uint32_t>(message.size());
  header[0] = kind;
  std::memcpy(header + 1, &length, sizeof length);
  write_all(file, header, sizeof header);
  write_all(file, message.data(), message.size());
}

[[noreturn]] void be_child(const std::function<void(const SendMessage&)>& work, int file,
                           pid_t parent, double cpu_s_max) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) {
    ::_exit(1);
  }
  for (const int number : {SIGINT, SIGTERM, SIGABRT, SIGSEGV, SIGXCPU, SIGPIPE}) {
    ::signal(number, SIG_DFL);
  }
  const rlimit no_core{0, 0};
  ::setrlimit(RLIMIT_CORE, &no_core);
  const auto seconds = static_cast<rlim_t>(std::max(std::ceil(cpu_s_max), 1.0));
  const rlimit cpu{seconds, seconds + 1};
  ::setrlimit(RLIMIT_CPU, &cpu);
  if (const int nowhere = ::open("/dev/null", O_WRONLY); nowhere >= 0) {
    ::dup2(nowhere, STDERR_FILENO);
    ::close(nowhere);
  }
  try {
    work([file](std::string_view message) { write_message(file, kFromWork, message); });
    write_message(file, kDone, {});
  } catch (const std::exception& error) {
    write_message(file, kFailed, std::string_view(error.what()).substr(0, 1000));
  } catch (...) {
    write_message(file, kFailed, "an exception that says nothing");
  }
  ::_exit(0);
}

}  // namespace

std::string run_in_child(const std::function<void(const SendMessage&)>& work,
                         const std::function<void(std::string_view)>& on_message, double cpu_s_max,
                         const Observer& observer) {
  Pipe pipe;
  std::fflush(nullptr);  // what waits in buffers would be written twice
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid < 0) {
    throw SystemFailure(std::string("no child process: ") + std::strerror(errno));
  }
  if (pid == 0) {
    be_child(work, pipe.end(1), parent, cpu_s_max);
  }
  Child child(pid);
  pipe.close_end(1);

  std::string received;
  std::optional<std::string> ending;
  while (true) {
    observer.check_stop();
    pollfd waiting{pipe.end(0), POLLIN, 0};
    if (::poll(&waiting, 1, kPollInterval_ms) <= 0) {
      continue;
    }
    char bytes[1U << 16U];
    const ssize_t count = ::read(pipe.end(0), bytes, sizeof bytes);
    if (count < 0 && errno == EINTR) {
      continue;
    }
    if (count <= 0) {
      break;
    }
    received.append(bytes, static_cast<std::size_t>(count));
    constexpr std::size_t kHeader = 1 + sizeof(std::uint32_t);
    std::size_t at = 0;
    while (received.size() - at >= kHeader) {
      std::uint32_t length = 0;
      std::memcpy(&length, received.data() + at + 1, sizeof length);
      HEDGEHOP_ASSERT(length <= kMessageMax);
      if (received.size() - at < kHeader + length) {
        break;
      }
      const std::string_view message(received.data() + at + kHeader, length);
      const char kind = received[at];
      if (kind == kFromWork) {
        on_message(message);
      } else {
        ending = kind == kDone ? std::string() : "failed: " + std::string(message);
      }
      at += kHeader + length;
    }
    received.erase(0, at);
  }
  const int status = child.wait();
  if (ending) {
    return *ending;
  }
  if (WIFSIGNALED(status)) {
    const int number = WTERMSIG(status);
    return number == SIGXCPU ? std::string("did not stop and was ended")
                             : "aborted: " + std::string(::strsignal(number));
  }
  return "ended without a word";
}

}  // namespace hedgehop::evaluation
