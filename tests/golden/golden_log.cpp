// Writes a log with one message of each type that travels, blobs as events on the channel BLOB, and
// prints "type fingerprint" of every type: golden_log FILE. See README.md beside it.
#include <cstdio>
#include <vector>

#include "bus/event_log.hpp"
#include "bus/service.hpp"
#include "messages/map_tiles.hpp"
#include "messages/message.hpp"
#include "support/example_messages.hpp"
#include "support/test_map.hpp"

#include "hedgehop/map_patch_t.hpp"

namespace {

using namespace hedgehop;

// Nobody sends this form any more.
Bytes patch_of_first_form() {
  hedgehop::map_patch_t wire{};
  wire.utime = test::kExampleStamp.time.utime_us;
  wire.sender_id = test::kExampleStamp.sender_id;
  wire.seq = test::kExampleStamp.seq;
  wire.version = hedgehop::map_patch_t::VERSION;
  wire.map_hash[0] = 1;
  wire.map_hash[1] = 2;
  wire.patch_number = 5;
  wire.patch_id = 77;
  wire.kind = hedgehop::map_patch_t::KIND_AREA;
  wire.is_present = 1;
  wire.top_altitude_m = 640.0;
  wire.num_vertices = 3;
  wire.vertex_x_m = {1.0, 3.0, 5.0};
  wire.vertex_y_m = {2.0, 4.0, 6.5};
  wire.label = "crane";
  Bytes bytes(static_cast<std::size_t>(wire.getEncodedSize()));
  wire.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

map::Map small_map() {
  map::Map map = test::make_map(20, 17, 10.0, [](double x_m, double y_m) { return x_m - y_m; });
  map.crs_wkt = "PROJCS[\"UTM\"]";
  map.label = "SYNTHETIC";
  map.attributions = {"one line"};
  map.overhead_lines = {{7, {{{1.0, 2.0}, 30.0}, {{3.0, 4.0}, 31.0}}}};
  map.obstacles = {{8, map::ObstacleKind::kMast, "mast", {5.0, 6.0}, 7.0, 80.0, 90.0}};
  map::Area area;
  area.name = "area";
  area.kind = "P";
  area.floor = {100.0, map::AreaLimit::Reference::kAboveGround};
  area.ceiling = {900.0, map::AreaLimit::Reference::kAmsl};
  area.polygons = {{{{0, 0}, {10, 0}, {0, 10}, {0, 0}}, {}}};
  map.areas = {area};
  test::finish_map(map);
  return map;
}

}  // namespace

int main(int argc, char** argv) {
  return bus::run_main("golden_log", [&] {
    if (argc != 2) {
      throw UsageError("usage: golden_log FILE");
    }
    bus::EventLogWriter writer(argv[1], false, 1.0);
    const Time time = test::kExampleStamp.time;
    for (const auto& [channel, bytes] : test::example_of_each_channel()) {
      writer.write(time, channel, bytes);
    }
    writer.write(time, "MAP_PATCH", patch_of_first_form());
    const map::Map map = small_map();
    const messages::Tiling tiling = messages::tiling_of(map, 16);
    std::vector<messages::BlobRef> refs;
    for (std::size_t i = 0; i < static_cast<std::size_t>(4 * tiling.tile_count()); ++i) {
      refs.push_back(test::example_ref(i + 1));
    }
    const messages::MapThreats threats{{"tower", "hill"},
                                       {refs.begin(), refs.begin() + 2 * tiling.tile_count()}};
    flight::RoutePlan dearer = test::example_route_plan();
    dearer.route.cost.wire_crossings_m = 12.5;
    for (const Bytes& blob :
         {messages::encode_planning_config("speed_mps: 40.0\n"),
          messages::encode_route_plan(test::example_route_plan()),
          messages::encode_route_plan(dearer),
          messages::encode_flight_plan(test::example_plan(), {51, 52}),
          messages::encode_map_features(map, map.hash),
          messages::encode_map_tile(map, 16, {messages::MapLayer::kTerrain, 1, 0}),
          messages::encode_map_tile_table(map.hash, tiling, refs),
          messages::encode_map_threats(map.hash, tiling, threats)}) {
      writer.write(time, "BLOB", blob);
    }
    for (const messages::TypeFingerprint& type : messages::type_fingerprints()) {
      std::printf("%.*s %016llx\n", static_cast<int>(type.type.size()), type.type.data(),
                  static_cast<unsigned long long>(type.fingerprint));
    }
    return 0;
  });
}
