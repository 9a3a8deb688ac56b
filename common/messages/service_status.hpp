#pragma once

#include <cstdint>
#include <string>

#include "messages/message.hpp"

namespace hedgehop::messages {

enum class ServiceState : std::int8_t {
  kStarting = 0,
  kReady = 1,
  kWorking = 2,
  kDegraded = 3,  // `text` says what is wrong
  kStopping = 4,
};
const char* name_of(ServiceState state);

/// Channel SERVICE_STATUS.
struct ServiceStatus {
  std::string name;  // at most 60 bytes
  std::string host;  // at most 60 bytes, cut when sent
  std::int32_t process_id = 0;
  std::string program_version;  // at most 60 bytes
  Hash128 config_hash;          // zero: no config
  Hash128 types_hash;
  ServiceState state = ServiceState::kStarting;
  double uptime_s = 0.0;
  std::int64_t published_count = 0;
  std::int64_t received_count = 0;
  std::int64_t rejected_count = 0;
  std::int64_t gap_count = 0;
  std::int64_t drop_count = 0;
  std::int64_t sent_chunk_count = 0;
  std::int64_t missing_chunk_count = 0;
  std::string text;  // cut to 600 bytes when sent
};
Bytes to_message(const ServiceStatus& status, const Stamp& stamp);
template <>
ServiceStatus from_message<ServiceStatus>(ByteView bytes, Stamp& stamp);

}  // namespace hedgehop::messages
