#include "messages/service_status.hpp"

#include "base/errors.hpp"
#include "messages/wire.hpp"

#include "hedgehop/service_status_t.hpp"

namespace hedgehop::messages {
namespace {
constexpr std::size_t kNameBytesMax = 60;
constexpr std::size_t kTextBytesMax = 600;
}  // namespace

const char* name_of(ServiceState state) {
  switch (state) {
    case ServiceState::kStarting:
      return "starting";
    case ServiceState::kReady:
      return "ready";
    case ServiceState::kWorking:
      return "working";
    case ServiceState::kDegraded:
      return "degraded";
    case ServiceState::kStopping:
      return "stopping";
  }
  HEDGEHOP_ASSERT(!"a service state without a name");
  return "";
}

Bytes to_message(const ServiceStatus& status, const Stamp& stamp) {
  service_status_t message{};
  wire::put_stamp(message, stamp);
  message.name = wire::cut_text(status.name, kNameBytesMax);
  message.host = wire::cut_text(status.host, kNameBytesMax);
  message.process_id = status.process_id;
  message.program_version = wire::cut_text(status.program_version, kNameBytesMax);
  wire::put(message.config_hash, status.config_hash);
  wire::put(message.types_hash, status.types_hash);
  message.state = static_cast<std::int8_t>(status.state);
  message.uptime_s = status.uptime_s;
  message.published_count = status.published_count;
  message.received_count = status.received_count;
  message.rejected_count = status.rejected_count;
  message.gap_count = status.gap_count;
  message.drop_count = status.drop_count;
  message.sent_chunk_count = status.sent_chunk_count;
  message.missing_chunk_count = status.missing_chunk_count;
  message.text = wire::cut_text(status.text, kTextBytesMax);
  return wire::published<ServiceStatus>(message);
}

template <>
ServiceStatus from_message<ServiceStatus>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<service_status_t>(bytes, stamp);
  const wire::Check check(service_status_t::getTypeName());
  ServiceStatus status;
  status.name = check.text("name", message.name, kNameBytesMax);
  status.host = check.text("host", message.host, kNameBytesMax);
  status.process_id =
      check.within("process_id", message.process_id, 1, std::numeric_limits<std::int32_t>::max());
  status.program_version = check.text("program_version", message.program_version, kNameBytesMax);
  status.config_hash = wire::hash_in(message.config_hash);
  status.types_hash = wire::hash_in(message.types_hash);
  status.state = static_cast<ServiceState>(check.within<std::int8_t>(
      "state", message.state, service_status_t::STATE_STARTING, service_status_t::STATE_STOPPING));
  status.uptime_s = check.not_negative("uptime_s", message.uptime_s);
  status.published_count = check.count("published_count", message.published_count);
  status.received_count = check.count("received_count", message.received_count);
  status.rejected_count = check.count("rejected_count", message.rejected_count);
  status.gap_count = check.count("gap_count", message.gap_count);
  status.drop_count = check.count("drop_count", message.drop_count);
  status.sent_chunk_count = check.count("sent_chunk_count", message.sent_chunk_count);
  status.missing_chunk_count = check.count("missing_chunk_count", message.missing_chunk_count);
  status.text = check.text("text", message.text, kTextBytesMax);
  return status;
}

}  // namespace hedgehop::messages
