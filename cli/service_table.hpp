#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "bus/bus.hpp"
#include "messages/map_messages.hpp"
#include "messages/service_status.hpp"

namespace hedgehop::cli {

/// What is on a bus: services with their rates, drops and clocks, channels with their rates, and
/// what does not fit together. Fed by the handlers that it subscribes.
class ServiceTable {
 public:
  /// The bus must outlive the table, and must not be polled after the table has gone.
  explicit ServiceTable(bus::Bus& bus);

  /// Rates of channels are those since the last call of this, of services those between their last
  /// two statuses.
  void take_rates(Time now);

  /// For a terminal.
  [[nodiscard]] std::string text() const;
  [[nodiscard]] nlohmann::ordered_json json() const;
  /// Different versions or types, two maps, services that are silent, messages of foreign types.
  [[nodiscard]] std::vector<std::string> mismatches() const;

 private:
  struct Service {
    messages::ServiceStatus status;
    Time said;  // by its own clock
    Time heard;
    double clock_offset_s = 0.0;  // its clock behind ours, the way of the message included
    double received_ps = 0.0;
    double published_ps = 0.0;
    std::int64_t new_drops = 0;
  };
  struct Channel {
    std::int64_t messages = 0;
    std::int64_t bytes = 0;
    std::int64_t messages_before = 0;
    std::int64_t bytes_before = 0;
    double messages_ps = 0.0;
    double bytes_ps = 0.0;
    std::string foreign;  // a message that no reader of this version accepts
  };
  struct Map {
    messages::MapIndex index;
    Time heard;
  };

  [[nodiscard]] std::string name_of(const Service& service) const;

  bus::Bus& bus_;
  std::map<std::string, Service> services_;  // by name, host and process
  std::map<std::string, Channel> channels_;
  std::map<std::int64_t, Map> maps_;  // by sender
  std::optional<messages::MapPatchState> patches_;
  Time taken_;
  Time now_;
};

}  // namespace hedgehop::cli
