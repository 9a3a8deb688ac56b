#include <filesystem>
#include <fstream>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <map>
#include <set>

#include "bus/event_log.hpp"
#include "messages/channels.hpp"
#include "messages/map_tiles.hpp"
#include "messages/plan_blobs.hpp"

namespace hedgehop {
namespace {

namespace fs = std::filesystem;

const fs::path& folder() {
  static const fs::path path = HEDGEHOP_GOLDEN_FOLDER;
  return path;
}

std::vector<fs::path> files(const std::string& extension) {
  std::vector<fs::path> result;
  for (const auto& entry : fs::directory_iterator(folder())) {
    if (entry.path().extension() == extension &&
        entry.path().filename().string().starts_with("types-")) {
      result.push_back(entry.path());
    }
  }
  return result;
}

std::int64_t fingerprint_of(const Bytes& bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    value = (value << 8) | std::to_integer<std::uint64_t>(bytes.at(i));
  }
  return static_cast<std::int64_t>(value);
}

std::map<std::int64_t, std::string> types() {
  std::map<std::int64_t, std::string> result;
  for (const messages::TypeFingerprint& type : messages::type_fingerprints()) {
    result[type.fingerprint] = type.type;
  }
  return result;
}

/// Decodes, and encodes again.
template <typename T>
Bytes again(const Bytes& bytes) {
  messages::Stamp stamp;
  const T content = messages::from_message<T>(bytes, stamp);
  return messages::to_message(content, stamp);
}

const std::map<std::string, std::function<Bytes(const Bytes&)>>& decoders() {
  using namespace messages;
  static const std::map<std::string, std::function<Bytes(const Bytes&)>> kDecoders = {
      {"map_index_v2_t", again<MapIndex>},
      {"map_patch_v2_t", again<MapPatch>},
      {"map_patch_state_t", again<MapPatchState>},
      {"chunk_t", again<Chunk>},
      {"chunk_request_t", again<ChunkRequest>},
      {"plan_request_t", again<PlanRequestMessage>},
      {"plan_cancel_t", again<PlanCancel>},
      {"plan_status_t", again<PlanStatus>},
      {"route_t", again<RouteHeader>},
      {"trajectory_t", again<TrajectoryHeader>},
      {"vehicle_target_t", again<VehicleTarget>},
      {"vehicle_state_t", again<VehicleState>},
      {"local_histogram_t", again<LocalHistogram>},
      {"service_status_t", again<ServiceStatus>},
      // Read, but sent in their second forms.
      {"map_index_t",
       [](const Bytes& bytes) {
         Stamp stamp;
         const auto index = from_message<MapIndex>(bytes, stamp);
         EXPECT_EQ(index.map_hash.hex(), "0123456789abcdeffedcba9876543210");
         EXPECT_EQ(index.geometry.rows, 890);
         EXPECT_EQ(index.label, "SYNTHETIC REGION");
         EXPECT_FALSE(index.threats.has_value());
         return bytes;
       }},
      {"map_patch_t",
       [](const Bytes& bytes) {
         Stamp stamp;
         const auto patch = from_message<MapPatch>(bytes, stamp);
         EXPECT_EQ(patch.patch.id, 77);
         EXPECT_EQ(patch.patch.outline.size(), 3U);
         EXPECT_EQ(patch.patch.label, "crane");
         return bytes;
       }},
      {"planning_config_t",
       [](const Bytes& bytes) { return encode_planning_config(decode_planning_config(bytes)); }},
      {"route_plan_t",
       [](const Bytes& bytes) { return encode_route_plan(decode_route_plan(bytes)); }},
      {"route_plan_v2_t",
       [](const Bytes& bytes) {
         const flight::RoutePlan plan = decode_route_plan(bytes);
         EXPECT_EQ(plan.route.cost.wire_crossings_m, 12.5);
         return encode_route_plan(plan);
       }},
      {"map_tile_t",
       [](const Bytes& bytes) {
         MapIndex index;
         index.geometry = {0.0, 0.0, 10.0, 20, 17};
         index.tile_cells = 16;
         map::Map map = begin_map(index);
         const TileAddress address{MapLayer::kTerrain, 1, 0};
         decode_map_tile(bytes, tiling_of(index), address, map);
         EXPECT_EQ(map.terrain_m.at(16, 0), 165.0F - 5.0F);
         return encode_map_tile(map, 16, address);
       }},
  };
  return kDecoders;
}

TEST(Golden, NoReleasedTypeHasChanged) {
  const auto known = types();
  const auto lists = files(".txt");
  ASSERT_FALSE(lists.empty());
  for (const fs::path& list : lists) {
    std::ifstream text(list);
    std::string type;
    std::string number;
    int count = 0;
    while (text >> type >> number) {
      ++count;
      const auto fingerprint = static_cast<std::int64_t>(std::stoull(number, nullptr, 16));
      const auto found = known.find(fingerprint);
      ASSERT_NE(found, known.end()) << list << ": " << type << " has been changed or removed";
      EXPECT_EQ(found->second, type) << list;
    }
    EXPECT_GT(count, 20) << list;
  }
}

TEST(Golden, EveryMessageOfEveryReleaseIsReadAndIsTheSameWhenSentAgain) {
  const auto known = types();
  // What the others need to be read: a flight belongs to its route, a table to its map.
  for (const fs::path& file : files(".lcmlog")) {
    bus::EventLogReader log(file);
    std::set<std::string> seen;
    std::vector<Bytes> blobs;
    flight::RoutePlan route;
    while (const auto event = log.next()) {
      const auto type = known.find(fingerprint_of(event->bytes));
      ASSERT_NE(type, known.end()) << file << ": " << event->channel << " is of no known type";
      seen.insert(type->second);
      SCOPED_TRACE(file.string() + ": " + type->second);
      if (type->second == "route_plan_t") {
        route = messages::decode_route_plan(event->bytes);
      }
      if (type->second == "flight_plan_t") {
        const Hash128 id{51, 52};
        EXPECT_EQ(
            messages::encode_flight_plan(messages::decode_flight_plan(event->bytes, route, id), id),
            event->bytes);
      } else if (type->second == "map_features_t" || type->second == "map_tile_table_t" ||
                 type->second == "map_threats_t") {
        // The map's hash stands behind fingerprint and version.
        Hash128 hash;
        for (std::size_t i = 0; i < 16; ++i) {
          std::uint64_t& half = i < 8 ? hash.high : hash.low;
          half = (half << 8) | std::to_integer<std::uint64_t>(event->bytes.at(10 + i));
        }
        if (type->second == "map_features_t") {
          map::Map map;
          messages::decode_map_features(event->bytes, hash, map);
          map.hash = hash;
          ASSERT_EQ(map.obstacles.size(), 1U);
          EXPECT_EQ(map.obstacles[0].name, "mast");
          EXPECT_EQ(messages::encode_map_features(map, map.hash), event->bytes);
        } else if (type->second == "map_threats_t") {
          const messages::Tiling tiling{20, 17, 16, 0};
          const auto threats = messages::decode_map_threats(event->bytes, hash, tiling, 2);
          EXPECT_THAT(threats.names, testing::ElementsAre("tower", "hill"));
          EXPECT_EQ(messages::encode_map_threats(hash, tiling, threats), event->bytes);
        } else {
          const messages::Tiling tiling{20, 17, 16, 0};
          const auto refs = messages::decode_map_tile_table(event->bytes, hash, tiling);
          EXPECT_EQ(messages::encode_map_tile_table(hash, tiling, refs), event->bytes);
        }
      } else {
        const auto decoder = decoders().find(type->second);
        ASSERT_NE(decoder, decoders().end()) << "no decoder in this test";
        EXPECT_EQ(decoder->second(event->bytes), event->bytes);
      }
    }
    EXPECT_EQ(log.damage_count(), 0) << file;
    EXPECT_GT(seen.size(), 15U) << file;
  }
}

// Whoever adds a type adds a log: golden_log writes it.
TEST(Golden, EveryTypeThatTravelsHasAGoldenMessage) {
  std::set<std::string> golden = {// parts of others
                                  "blob_ref_t",    "chunk_range_t",   "flight_state_t",
                                  "model_state_t", "request_point_t", "violation_t",
                                  "waypoint_t"};
  const auto known = types();
  for (const fs::path& file : files(".lcmlog")) {
    bus::EventLogReader log(file);
    while (const auto event = log.next()) {
      golden.insert(known.at(fingerprint_of(event->bytes)));
    }
  }
  for (const auto& [fingerprint, type] : known) {
    EXPECT_TRUE(golden.contains(type)) << type << ": see tests/golden/README.md";
  }
}

}  // namespace
}  // namespace hedgehop
