#pragma once

#include <string>
#include <variant>

#include "base/observer.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "flight/plan.hpp"

namespace hedgehop::cli {

/// Asks the planners on the bus for a plan and waits for it: what planning::plan() does, done by
/// the services.
///
/// The request is repeated until it is answered; its id is that of map, request and config, so that
/// asking again costs no second planning. When the map changes meanwhile (MAP_PATCH), the plan
/// under way is cancelled and asked for again on the new one; the plan says which patch it knows.
///
/// @param config_text  effective planning config, canonical.
/// @param timeout_s    longest silence before the first answer of each service; three times as long
///                     afterwards.
/// @throws BusError     nobody answers: says who.
/// @throws UserError    a planner refuses the request, or somebody else cancels it.
/// @throws Interrupted  the observer asked to stop; the planners are told to.
std::variant<flight::Plan, flight::NoPlan> plan_over_bus(bus::Bus& bus, bus::BlobExchange& exchange,
                                                         const flight::PlanRequest& request,
                                                         const std::string& config_text,
                                                         double timeout_s, Observer& observer);

}  // namespace hedgehop::cli
