#pragma once

#include <stdexcept>
#include <string>

namespace hedgehop {

/// Exit codes of every hedgehop program.
enum class ExitCode : int {
  kOk = 0,
  kFailure = 1,
  kUsage = 2,
  kNoRoute = 3,
  kNotVerified = 4,
  kBadData = 5,
  kBusUnreachable = 6,
  kInterrupted = 130,
};

/// An error that a user can act on. what() says what is wrong and where, hint() what to do about
/// it.
class UserError : public std::runtime_error {
 public:
  UserError(ExitCode code, const std::string& what, std::string hint = {})
      : std::runtime_error(what), code_(code), hint_(std::move(hint)) {}

  [[nodiscard]] ExitCode code() const noexcept { return code_; }
  [[nodiscard]] const std::string& hint() const noexcept { return hint_; }

 private:
  ExitCode code_;
  std::string hint_;
};

/// The command line or a request asks for something that cannot be meant (exit code 2).
class UsageError : public UserError {
 public:
  explicit UsageError(const std::string& what, std::string hint = {})
      : UserError(ExitCode::kUsage, what, std::move(hint)) {}
};

/// A configuration file is wrong (exit code 2). what() begins with file:line.
class ConfigError : public UserError {
 public:
  explicit ConfigError(const std::string& what, std::string hint = {})
      : UserError(ExitCode::kUsage, what, std::move(hint)) {}
};

/// An input file is missing, damaged or does not hold what is needed (exit code 5).
class DataError : public UserError {
 public:
  explicit DataError(const std::string& what, std::string hint = {})
      : UserError(ExitCode::kBadData, what, std::move(hint)) {}
};

/// The system refused something, a full disk for example (exit code 1).
class SystemFailure : public UserError {
 public:
  explicit SystemFailure(const std::string& what, std::string hint = {})
      : UserError(ExitCode::kFailure, what, std::move(hint)) {}
};

/// The bus cannot be reached or nobody answers on it (exit code 6).
class BusError : public UserError {
 public:
  explicit BusError(const std::string& what, std::string hint = {})
      : UserError(ExitCode::kBusUnreachable, what, std::move(hint)) {}
};

/// The user asked to stop (exit code 130).
class Interrupted : public UserError {
 public:
  Interrupted() : UserError(ExitCode::kInterrupted, "interrupted; nothing was written") {}
};

namespace base {
[[noreturn]] void assertion_failed(const char* condition, const char* file, int line);
}  // namespace base

}  // namespace hedgehop

/// Checks an invariant of our own code, in every build. Throws std::logic_error.
#define HEDGEHOP_ASSERT(condition)    \
  ((condition) ? static_cast<void>(0) \
               : ::hedgehop::base::assertion_failed(#condition, __FILE__, __LINE__))
