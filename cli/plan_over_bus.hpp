#pragma once

#include <memory>
#include <string>
#include <variant>

#include "base/observer.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "flight/plan.hpp"

namespace hedgehop::cli {

/// Asks the planners on the bus for plans and waits for each: what planning::plan() does, done by
/// the services.
///
/// A request is repeated until it is answered; its id is that of map, request and config, so that
/// asking again costs no second planning. When the map changes meanwhile (MAP_PATCH), the plan
/// under way is cancelled and asked for again on the new one; the plan says which patch it knows.
class BusPlanner {
 public:
  /// Subscribes; both must outlive the last plan().
  BusPlanner(bus::Bus& bus, bus::BlobExchange& exchange);

  /// The map is the one that a map_tiler has announced within the last seconds, else the next one.
  ///
  /// @param config_text  effective planning config, canonical.
  /// @param timeout_s    longest silence before the first answer of each service; three times as
  ///                     long afterwards.
  /// @throws BusError     nobody answers: says who.
  /// @throws UserError    a planner refuses the request, or somebody else cancels it.
  /// @throws Interrupted  the observer asked to stop; the planners are told to.
  std::variant<flight::Plan, flight::NoPlan> plan(const flight::PlanRequest& request,
                                                  const std::string& config_text, double timeout_s,
                                                  Observer& observer);

  struct Heard;

 private:
  bus::Bus& bus_;
  bus::BlobExchange& exchange_;
  std::shared_ptr<Heard> heard_;
};

}  // namespace hedgehop::cli
