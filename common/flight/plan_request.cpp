#include "flight/plan_request.hpp"

#include <algorithm>
#include <cmath>

#include "base/errors.hpp"
#include "flight/plan.hpp"

namespace hedgehop::flight {
namespace {

template <typename T>
void update(Hasher128& hasher, const T& value) {
  hasher.update(std::as_bytes(std::span<const T, 1>(&value, 1)));
}

void update(Hasher128& hasher, const std::optional<double>& value) {
  update(hasher, static_cast<std::uint8_t>(value.has_value()));
  update(hasher, value.value_or(0.0));
}

void update(Hasher128& hasher, const RequestPoint& point) {
  update(hasher, point.position.latitude_rad);
  update(hasher, point.position.longitude_rad);
  update(hasher, point.height_m);
}

}  // namespace

const char* name_of(NoPlanCause cause) {
  switch (cause) {
    case NoPlanCause::kStartOutsideMap:
      return "start_outside_map";
    case NoPlanCause::kGoalOutsideMap:
      return "goal_outside_map";
    case NoPlanCause::kStartUnknownTerrain:
      return "start_unknown_terrain";
    case NoPlanCause::kGoalUnknownTerrain:
      return "goal_unknown_terrain";
    case NoPlanCause::kStartBelowEnvelope:
      return "start_below_envelope";
    case NoPlanCause::kGoalBelowEnvelope:
      return "goal_below_envelope";
    case NoPlanCause::kStartAboveEnvelope:
      return "start_above_envelope";
    case NoPlanCause::kGoalAboveEnvelope:
      return "goal_above_envelope";
    case NoPlanCause::kGoalEqualsStart:
      return "goal_equals_start";
    case NoPlanCause::kReferenceHeightMismatch:
      return "reference_height_mismatch";
    case NoPlanCause::kSearchSpaceDisconnected:
      return "search_space_disconnected";
    case NoPlanCause::kBudgetExhausted:
      return "budget_exhausted";
    case NoPlanCause::kLocalPlannerStuck:
      return "local_planner_stuck";
    case NoPlanCause::kStopped:
      return "stopped";
    case NoPlanCause::kClimbLimit:
      return "climb_limit";
    case NoPlanCause::kStartInsideArea:
      return "start_inside_area";
    case NoPlanCause::kGoalInsideArea:
      return "goal_inside_area";
  }
  HEDGEHOP_ASSERT(!"a cause without a name");
  return "";
}

bool is_named_cause(NoPlanCause cause) {
  return cause != NoPlanCause::kBudgetExhausted && cause != NoPlanCause::kLocalPlannerStuck &&
         cause != NoPlanCause::kStopped;
}

Hash128 plan_request_id(const PlanRequest& request, const Hash128& map_hash,
                        const std::string& config_text) {
  Hasher128 hasher;
  update(hasher, map_hash.high);
  update(hasher, map_hash.low);
  update(hasher, static_cast<std::uint64_t>(config_text.size()));
  hasher.update(config_text);
  update(hasher, request.start);
  update(hasher, request.goal);
  update(hasher, static_cast<std::uint64_t>(request.via.size()));
  for (const RequestPoint& point : request.via) {
    update(hasher, point);
  }
  update(hasher, request.start_heading_true_rad);
  update(hasher, request.speed_mps);
  update(hasher, request.seed);
  update(hasher, request.work_budget);
  return hasher.digest();
}

double Timetable::greatest_error_s() const {
  double greatest_s = 0.0;
  for (const Entry& entry : entries) {
    if (entry.wanted) {
      greatest_s = std::max(greatest_s, std::fabs(seconds_between(*entry.wanted, entry.expected)));
    }
  }
  return greatest_s;
}

}  // namespace hedgehop::flight
