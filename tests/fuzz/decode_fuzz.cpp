// The first byte chooses a type, the rest is what follows the fingerprint of that type. Whatever is
// accepted must come out the same when it is sent again.
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <vector>

#include "messages/channels.hpp"
#include "messages/map_tiles.hpp"
#include "messages/message_error.hpp"
#include "messages/plan_blobs.hpp"

namespace {

using namespace hedgehop;

template <typename T>
void decode(ByteView bytes) {
  messages::Stamp stamp;
  const T content = messages::from_message<T>(bytes, stamp);
  const Bytes again = messages::to_message(content, stamp);
  messages::Stamp stamp_again;
  if (messages::to_message(messages::from_message<T>(again, stamp_again), stamp_again) != again ||
      stamp_again != stamp) {
    std::abort();
  }
}

struct Target {
  std::string_view type;
  std::function<void(ByteView)> decode;
};

const std::vector<Target>& targets() {
  using namespace messages;
  static const std::vector<Target> kTargets = {
      {"map_index_t", decode<MapIndex>},  // sent in its second form only
      {"map_patch_t",
       [](ByteView bytes) {
         Stamp stamp;
         from_message<MapPatch>(bytes, stamp);  // sent in its second form only
       }},
      {"map_patch_v2_t", decode<MapPatch>},
      {"map_patch_state_t", decode<MapPatchState>},
      {"chunk_t", decode<Chunk>},
      {"chunk_request_t", decode<ChunkRequest>},
      {"plan_request_t", decode<PlanRequestMessage>},
      {"plan_cancel_t", decode<PlanCancel>},
      {"plan_status_t", decode<PlanStatus>},
      {"route_t", decode<RouteHeader>},
      {"trajectory_t", decode<TrajectoryHeader>},
      {"vehicle_target_t", decode<VehicleTarget>},
      {"vehicle_state_t", decode<VehicleState>},
      {"local_histogram_t", decode<LocalHistogram>},
      {"service_status_t", decode<ServiceStatus>},
      {"planning_config_t", [](ByteView bytes) { decode_planning_config(bytes); }},
      {"route_plan_t", [](ByteView bytes) { decode_route_plan(bytes); }},
      {"flight_plan_t",
       [](ByteView bytes) {
         flight::RoutePlan route;
         decode_flight_plan(bytes, route, Hash128{});
       }},
      {"map_features_t",
       [](ByteView bytes) {
         map::Map map;
         decode_map_features(bytes, Hash128{}, map);
       }},
      {"map_tile_table_t",
       [](ByteView bytes) {
         decode_map_tile_table(bytes, Hash128{}, Tiling{40, 40, 32});
       }},
      {"map_tile_t",
       [](ByteView bytes) {
         MapIndex index;
         index.geometry = {0.0, 0.0, 1.0, 20, 17};
         index.tile_cells = 16;
         map::Map map = begin_map(index);
         decode_map_tile(bytes, tiling_of(index), {MapLayer::kTerrain, 1, 1}, map);
       }},
      {"route_plan_v2_t", [](ByteView bytes) { decode_route_plan(bytes); }},
      {"map_index_v2_t", decode<MapIndex>},
      {"map_threats_t",
       [](ByteView bytes) {
         const Tiling tiling{40, 40, 32};
         const MapThreats threats = decode_map_threats(bytes, Hash128{}, tiling, 2);
         if (encode_map_threats(Hash128{}, tiling, threats) != Bytes(bytes.begin(), bytes.end())) {
           std::abort();
         }
       }},
  };
  return kTargets;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) {
    return 0;
  }
  const Target& target = targets()[data[0] % targets().size()];
  Bytes bytes(8);
  for (const messages::TypeFingerprint& type : messages::type_fingerprints()) {
    if (type.type == target.type) {
      for (std::size_t i = 0; i < 8; ++i) {
        bytes[i] =
            static_cast<std::byte>(static_cast<std::uint64_t>(type.fingerprint) >> (56 - 8 * i));
      }
    }
  }
  const auto* rest = reinterpret_cast<const std::byte*>(data);
  bytes.insert(bytes.end(), rest + 1, rest + size);
  try {
    target.decode(bytes);
  } catch (const messages::MessageError&) {
  }
  return 0;
}
