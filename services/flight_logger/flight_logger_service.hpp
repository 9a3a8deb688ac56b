#pragma once

#include <filesystem>
#include <optional>
#include <set>

#include "base/config_reader.hpp"
#include "base/time.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "bus/event_log_parts.hpp"
#include "bus/map_exchange.hpp"
#include "bus/service.hpp"

namespace hedgehop::services {

/// config/flight_logger.yaml
struct FlightLoggerOptions {
  double tick_period_s = 0.0;
  double flush_interval_s = 0.0;    // an event reaches the disk at the latest after this
  std::int64_t part_bytes_max = 0;  // 0: one file
  bool is_completing_blobs = false;
  bool is_overwriting = false;  // an existing file
};
FlightLoggerOptions read_flight_logger_options(ConfigReader reader);

/// Writes everything on the bus into an LCM log.
///
/// A log can be replayed only if it holds every chunk of map, config, route and trajectory. With
/// is_completing_blobs the logger therefore asks for chunks that it has not heard, like any reader
/// does, so that a recorder that came late or lost a packet still leaves a whole log.
///
/// When the disk is full it says so in SERVICE_STATUS, keeps what it has, and goes on in another
/// part once there is room. The status also tells what it has missed of each sender.
class FlightLoggerService {
 public:
  FlightLoggerService(const FlightLoggerOptions& options, const std::filesystem::path& file,
                      bus::Bus& bus, bus::BlobExchange& exchange, bus::ServiceLoop& loop);

  void tick(Time now);

 private:
  void complete(const messages::BlobRef& blob, const char* what);

  FlightLoggerOptions options_;
  bus::Bus& bus_;
  bus::EventLogParts log_;
  bus::BlobExchange& exchange_;
  bus::ServiceLoop& loop_;
  std::optional<bus::MapAssembly> assembly_;
  std::set<Hash128> wanted_;
  Time next_text_;
};

/// The file that the option --out names. Throws UsageError without it.
std::filesystem::path log_file(const bus::ServiceArguments& arguments);

}  // namespace hedgehop::services
