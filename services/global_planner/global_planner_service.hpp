#pragma once

#include <string>
#include <variant>

#include "messages/plan_messages.hpp"
#include "services/shared/planner_desk.hpp"

namespace hedgehop::services {

/// Turns PLAN_REQUEST into ROUTE with planning::plan_route, on the map that is on the bus and under
/// the config that comes with the request.
class GlobalPlannerService {
 public:
  GlobalPlannerService(const PlannerOptions& options, bus::Bus& bus, bus::BlobExchange& exchange,
                       bus::ServiceLoop& loop);

  void tick(Time now) { desk_.tick(now); }
  [[nodiscard]] std::string unanswered() const { return desk_.unanswered(); }

 private:
  std::variant<Answer, flight::NoPlan> plan(const messages::PlanRequestMessage& message, Time asked,
                                            const map::Map& map, const Bytes& config_blob,
                                            Observer& observer);

  bus::Bus& bus_;
  bus::BlobExchange& exchange_;
  PlannerDesk desk_;
};

}  // namespace hedgehop::services
