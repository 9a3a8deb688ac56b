#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "flight/plan_request.hpp"
#include "messages/blob.hpp"
#include "messages/message.hpp"

namespace hedgehop::messages {

inline constexpr std::size_t kMaxVia = 40;
inline constexpr std::size_t kMaxStatusTextBytes = 700;

/// Channel PLAN_REQUEST. `request_id` is flight::plan_request_id() of all the rest.
struct PlanRequestMessage {
  Hash128 request_id;
  Hash128 map_hash;
  BlobRef config;               // decode_planning_config()
  flight::PlanRequest request;  // at most kMaxVia places between
};
Bytes to_message(const PlanRequestMessage& request, const Stamp& stamp);
template <>
PlanRequestMessage from_message<PlanRequestMessage>(ByteView bytes, Stamp& stamp);

/// Channel PLAN_CANCEL.
struct PlanCancel {
  Hash128 request_id;
};
Bytes to_message(const PlanCancel& cancel, const Stamp& stamp);
template <>
PlanCancel from_message<PlanCancel>(ByteView bytes, Stamp& stamp);

enum class PlanStage : std::int8_t { kGlobal = 0, kLocal = 1 };
enum class PlanState : std::int8_t {
  kWaiting = 0,  // for a map, a config, a route or another request: `text` says for what
  kWorking = 1,
  kDone = 2,    // ROUTE or TRAJECTORY is out
  kNoPlan = 3,  // `no_plan` says why
  kCancelled = 4,
  kRefused = 5,  // the request cannot be served: `text` says why
};

/// Channel PLAN_STATUS.
struct PlanStatus {
  Hash128 request_id;
  PlanStage stage = PlanStage::kGlobal;
  PlanState state = PlanState::kWaiting;
  std::int64_t work_units = 0;
  std::int64_t work_budget = 0;           // 0: the stage does not count
  std::optional<double> best_cost_m;      // none yet
  double lower_bound_m = 0.0;             // 0: not known
  std::optional<flight::NoPlan> no_plan;  // with kNoPlan, and only then
  std::string text;                       // cut to kMaxStatusTextBytes when sent
};
Bytes to_message(const PlanStatus& status, const Stamp& stamp);
template <>
PlanStatus from_message<PlanStatus>(ByteView bytes, Stamp& stamp);

/// Channel ROUTE: a route is there; its content is the blob `plan`.
struct RouteHeader {
  Hash128 request_id;
  Hash128 map_hash;
  std::int64_t patch_number = 0;
  BlobRef plan;  // decode_route_plan()
  double cost_m = 0.0;
  double lower_bound_m = 0.0;
  double length_m = 0.0;
  std::int64_t work_units = 0;
  std::uint64_t seed = 0;
  std::string provenance;  // at most 120 bytes
};
Bytes to_message(const RouteHeader& header, const Stamp& stamp);
template <>
RouteHeader from_message<RouteHeader>(ByteView bytes, Stamp& stamp);

/// Channel TRAJECTORY: a flight is there; route blob and plan blob together are the whole plan.
struct TrajectoryHeader {
  Hash128 request_id;
  Hash128 map_hash;
  std::int64_t patch_number = 0;
  BlobRef route;  // decode_route_plan()
  BlobRef plan;   // decode_flight_plan()
  double duration_s = 0.0;
  double length_m = 0.0;
  double clearance_min_m = 0.0;
  bool is_verified = false;
  std::int64_t violation_count = 0;
  std::string provenance;  // at most 120 bytes
};
Bytes to_message(const TrajectoryHeader& header, const Stamp& stamp);
template <>
TrajectoryHeader from_message<TrajectoryHeader>(ByteView bytes, Stamp& stamp);

}  // namespace hedgehop::messages
