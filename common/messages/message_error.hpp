#pragma once

#include <stdexcept>
#include <string>

namespace hedgehop::messages {

/// Bytes from the bus or from a blob that are not what their type promises. what() names the type,
/// the field and the value: "plan_request_t: speed_mps is nan, must be above 0". The bus counts it
/// and goes on; nothing of the message is used.
class MessageError : public std::runtime_error {
 public:
  explicit MessageError(const std::string& what) : std::runtime_error(what) {}
};

}  // namespace hedgehop::messages
