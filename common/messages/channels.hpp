#pragma once

#include <array>
#include <optional>
#include <string_view>

#include "messages/blob.hpp"
#include "messages/map_messages.hpp"
#include "messages/plan_messages.hpp"
#include "messages/service_status.hpp"
#include "messages/vehicle_messages.hpp"

/// Every channel, with the type that it carries. lcmtypes/README.md says who writes and who reads.
namespace hedgehop::messages {

template <typename T>
struct Channel {
  std::string_view name;
};

inline constexpr Channel<MapIndex> kMapIndexChannel{"MAP_INDEX"};
inline constexpr Channel<MapPatch> kMapPatchChannel{"MAP_PATCH"};
inline constexpr Channel<MapPatchState> kMapPatchStateChannel{"MAP_PATCH_STATE"};
inline constexpr Channel<Chunk> kChunkChannel{"CHUNK"};
inline constexpr Channel<ChunkRequest> kChunkRequestChannel{"CHUNK_REQUEST"};
inline constexpr Channel<PlanRequestMessage> kPlanRequestChannel{"PLAN_REQUEST"};
inline constexpr Channel<PlanCancel> kPlanCancelChannel{"PLAN_CANCEL"};
inline constexpr Channel<PlanStatus> kPlanStatusChannel{"PLAN_STATUS"};
inline constexpr Channel<RouteHeader> kRouteChannel{"ROUTE"};
inline constexpr Channel<TrajectoryHeader> kTrajectoryChannel{"TRAJECTORY"};
inline constexpr Channel<VehicleTarget> kVehicleTargetChannel{"VEHICLE_TARGET"};
inline constexpr Channel<VehicleState> kVehicleStateChannel{"VEHICLE_STATE"};
inline constexpr Channel<LocalHistogram> kLocalHistogramChannel{"LOCAL_HISTOGRAM"};
inline constexpr Channel<ServiceStatus> kServiceStatusChannel{"SERVICE_STATUS"};

/// Name and generated type of each channel.
struct ChannelType {
  std::string_view channel;
  std::string_view type;
};
inline constexpr std::array<ChannelType, 14> kChannelTypes = {{
    {kMapIndexChannel.name, "map_index_v2_t"},
    {kMapPatchChannel.name, "map_patch_v2_t"},
    {kMapPatchStateChannel.name, "map_patch_state_t"},
    {kChunkChannel.name, "chunk_t"},
    {kChunkRequestChannel.name, "chunk_request_t"},
    {kPlanRequestChannel.name, "plan_request_t"},
    {kPlanCancelChannel.name, "plan_cancel_t"},
    {kPlanStatusChannel.name, "plan_status_t"},
    {kRouteChannel.name, "route_t"},
    {kTrajectoryChannel.name, "trajectory_t"},
    {kVehicleTargetChannel.name, "vehicle_target_t"},
    {kVehicleStateChannel.name, "vehicle_state_t"},
    {kLocalHistogramChannel.name, "local_histogram_t"},
    {kServiceStatusChannel.name, "service_status_t"},
}};

/// Stamp of a message as it came, without looking at the rest of it. None if the message is not of
/// the type of a channel with this name, or with this name after a prefix.
std::optional<Stamp> peek_stamp(std::string_view channel, ByteView bytes);

}  // namespace hedgehop::messages
