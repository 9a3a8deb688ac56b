#pragma once

#include <cstddef>
#include <string>

#include "base/hash.hpp"
#include "flight/plan.hpp"
#include "messages/blob.hpp"

/// Contents of the blobs that plans travel in. Doubles keep every bit.
namespace hedgehop::messages {

/// Longest config text that travels [bytes].
inline constexpr std::size_t kMaxConfigBytes = 1U << 20;

Bytes encode_planning_config(const std::string& config_text);
/// Throws MessageError.
std::string decode_planning_config(ByteView bytes);

/// Throws std::invalid_argument if the plan cannot be sent (a number is not finite, too many
/// points).
Bytes encode_route_plan(const flight::RoutePlan& plan);
/// Throws MessageError; also when the request id is not that of map, request and config.
flight::RoutePlan decode_route_plan(ByteView bytes);

/// Bytes of one state; an encoded flight plan ends in its states.
inline constexpr std::size_t kFlightStateBytes = 19 * sizeof(double);

/// The plan without its route plan, which is the blob `route_blob_id`.
Bytes encode_flight_plan(const flight::Plan& plan, const Hash128& route_blob_id);
/// The whole plan again. Throws MessageError; also when the bytes belong to another route.
flight::Plan decode_flight_plan(ByteView bytes, const flight::RoutePlan& route_plan,
                                const Hash128& route_blob_id);

}  // namespace hedgehop::messages
