#include <chrono>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <sys/resource.h>

#include "messages/map_tiles.hpp"
#include "messages/message_error.hpp"
#include "support/example_messages.hpp"
#include "support/test_map.hpp"

#include "hedgehop/all_types.hpp"

namespace hedgehop::messages {
namespace {

using test::kExampleStamp;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <typename Wire>
Bytes bytes_of_wire(const Wire& wire) {
  Bytes bytes(static_cast<std::size_t>(wire.getEncodedSize()));
  EXPECT_EQ(wire.encode(bytes.data(), 0, static_cast<int>(bytes.size())),
            static_cast<int>(bytes.size()));
  return bytes;
}

/// The example with one thing made wrong must be refused, and the refusal must say which.
template <typename Wire, typename T>
void expect_refused(const T& example, const std::string& field,
                    const std::function<void(Wire&)>& spoil) {
  const Bytes good = to_message(example, kExampleStamp);
  Wire wire{};
  ASSERT_GT(wire.decode(good.data(), 0, static_cast<int>(good.size())), 0);
  Stamp stamp;
  ASSERT_NO_THROW(from_message<T>(bytes_of_wire(wire), stamp));
  spoil(wire);
  try {
    from_message<T>(bytes_of_wire(wire), stamp);
    ADD_FAILURE() << Wire::getTypeName() << ": " << field << " was accepted";
  } catch (const MessageError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr(field));
    EXPECT_THAT(error.what(), testing::HasSubstr(Wire::getTypeName()));
  }
}

TEST(Refusal, AnotherVersionIsRefusedByEveryType) {
  const auto spoil = [](auto& wire) { ++wire.version; };
  expect_refused<map_index_v2_t>(test::example_map_index(), "version", spoil);
  expect_refused<map_patch_v2_t>(test::example_map_patch(), "version", spoil);
  expect_refused<map_patch_state_t>(test::example_map_patch_state(), "version", spoil);
  expect_refused<chunk_t>(test::example_chunk(), "version", spoil);
  expect_refused<chunk_request_t>(test::example_chunk_request(), "version", spoil);
  expect_refused<plan_request_t>(test::example_plan_request(), "version", spoil);
  expect_refused<plan_cancel_t>(PlanCancel{{1, 2}}, "version", spoil);
  expect_refused<plan_status_t>(test::example_plan_status(), "version", spoil);
  expect_refused<route_t>(test::example_route_header(), "version", spoil);
  expect_refused<trajectory_t>(test::example_trajectory_header(), "version", spoil);
  expect_refused<vehicle_target_t>(test::example_vehicle_target(), "version", spoil);
  expect_refused<vehicle_state_t>(test::example_vehicle_state(), "version", spoil);
  expect_refused<local_histogram_t>(test::example_local_histogram(), "version", spoil);
  expect_refused<service_status_t>(test::example_service_status(), "version", spoil);
}

TEST(Refusal, TimesAndNumbersOfSendersMustMakeSense) {
  expect_refused<plan_cancel_t>(PlanCancel{{1, 2}}, "utime", [](auto& w) { w.utime = -1; });
  expect_refused<plan_cancel_t>(PlanCancel{{1, 2}}, "utime", [](auto& w) {
    w.utime = std::numeric_limits<std::int64_t>::max();
  });
  expect_refused<plan_cancel_t>(PlanCancel{{1, 2}}, "seq", [](auto& w) { w.seq = 0; });
}

TEST(Refusal, MapIndexWithoutSenseIsRefused) {
  const MapIndex good = test::example_map_index();
  const auto refuse = [&](const std::string& field,
                          const std::function<void(map_index_v2_t&)>& spoil) {
    expect_refused<map_index_v2_t>(good, field, spoil);
  };
  refuse("west_m", [](auto& w) { w.west_m = kNan; });
  refuse("south_m", [](auto& w) { w.south_m = kInfinity; });
  refuse("cell_m", [](auto& w) { w.cell_m = 0.0; });
  refuse("cell_m", [](auto& w) { w.cell_m = kNan; });
  refuse("column_count", [](auto& w) { w.column_count = 0; });
  refuse("row_count", [](auto& w) { w.row_count = 2'000'000'000; });
  refuse("row_count", [](auto& w) { w.column_count = w.row_count = 30000; });
  refuse("tile_cell_count", [](auto& w) { w.tile_cell_count = 1; });
  refuse("reference_height_m", [](auto& w) { w.reference_height_m = kNan; });
  refuse("num_layers", [](auto& w) { w.num_layers = 3; });
  refuse("layers", [](auto& w) { w.layers[2] = 9; });
  refuse("layers", [](auto& w) { w.layers[4] = 3; });
  refuse("layer_height_m", [](auto& w) { w.layer_height_m[4] = kNan; });
  refuse("layer_height_m", [](auto& w) { w.layer_height_m[5] = w.layer_height_m[4]; });
  // 100 million cells of the four layers are allowed, not with two heights more.
  refuse("row_count", [](auto& w) { w.column_count = w.row_count = 10000; });
  refuse("tile_table.packed_bytes", [](auto& w) { w.tile_table.packed_bytes = -5; });
  refuse("tile_table.content_bytes", [](auto& w) { w.tile_table.content_bytes = 1LL << 40; });
  refuse("features.chunk_count", [](auto& w) { ++w.features.chunk_count; });
  refuse("threat_count", [](auto& w) { w.threat_count = -1; });
  refuse("threat_count", [](auto& w) { w.threat_count = 101; });
  // 70 million cells are allowed with two heights more; 7 observers need 1.96 GB beside them.
  refuse("threat_count", [](auto& w) {
    w.column_count = 7000;
    w.row_count = 10000;
  });
  // 2 million tiles in all.
  refuse("threat_count", [](auto& w) {
    w.column_count = w.row_count = 4000;
    w.tile_cell_count = 16;
  });
  refuse("threats.packed_bytes", [](auto& w) { w.threats.packed_bytes = 0; });
  refuse("threats_map_hash", [](auto& w) {
    w.threats_map_hash[0] = w.map_hash[0];
    w.threats_map_hash[1] = w.map_hash[1];
  });
  refuse("label", [](auto& w) { w.label.assign(200, 'x'); });
  refuse("label", [](auto& w) { w.label = "\x1b[2J"; });
  refuse("patch_number", [](auto& w) { w.patch_number = -1; });
  // A lone continuation byte, an overlong slash, half of a surrogate pair, a cut character, above
  // 10FFFF.
  for (const std::string bad :
       {"a\x80", "\xC0\xAF", "\xED\xA0\x80", "\xE2\x82", "\xF4\x90\x80\x80"}) {
    refuse("label is no UTF-8", [&](auto& w) { w.label = bad; });
  }
}

TEST(Refusal, MapPatchWithoutSenseIsRefused) {
  const auto refuse = [](map::PatchKind kind, const std::string& field,
                         const std::function<void(map_patch_v2_t&)>& spoil) {
    MapPatch good = test::example_map_patch();
    good.patch.kind = kind;
    expect_refused<map_patch_v2_t>(good, field, spoil);
  };
  using enum map::PatchKind;
  refuse(kArea, "patch_id", [](auto& w) { w.patch_id = 0; });
  refuse(kArea, "patch_number", [](auto& w) { w.patch_number = -1; });
  refuse(kArea, "kind", [](auto& w) { w.kind = 3; });
  refuse(kArea, "floor_m", [](auto& w) { w.floor_m = kNan; });
  refuse(kArea, "ceiling_m", [](auto& w) { w.ceiling_m = 1e9; });
  refuse(kArea, "vertex_x_m", [](auto& w) { w.vertex_x_m[1] = kInfinity; });
  refuse(kArea, "num_vertices", [](auto& w) {
    w.num_vertices = 2;
    w.vertex_x_m.pop_back();
    w.vertex_y_m.pop_back();
  });
  refuse(kObstacle, "x_m", [](auto& w) { w.x_m = kNan; });
  refuse(kObstacle, "radius_m", [](auto& w) { w.radius_m = -1.0; });
  refuse(kObstacle, "height_m", [](auto& w) { w.height_m = -0.5; });
  refuse(kObstacle, "top_altitude_m", [](auto& w) { w.top_altitude_m = kInfinity; });
  refuse(kObstacle, "neither height_m nor top_altitude_m",
         [](auto& w) { w.height_m = w.top_altitude_m = kNan; });
  refuse(kThreat, "radius_m", [](auto& w) { w.radius_m = 0.0; });
  refuse(kThreat, "label", [](auto& w) { w.label.assign(61, 'x'); });
}

TEST(Refusal, ChunkThatDoesNotFitItsBlobIsRefused) {
  const Chunk good = test::example_chunk();
  const auto refuse = [&](const std::string& field, const std::function<void(chunk_t&)>& spoil) {
    expect_refused<chunk_t>(good, field, spoil);
  };
  refuse("packed_bytes", [](auto& w) { w.packed_bytes = 0; });
  refuse("packed_bytes", [](auto& w) { w.packed_bytes = kMaxPackedBytes + 1; });
  refuse("chunk_count", [](auto& w) { w.chunk_count = 2; });
  refuse("chunk_number", [](auto& w) { w.chunk_number = 3; });
  refuse("chunk_number", [](auto& w) { w.chunk_number = -1; });
  refuse("num_bytes", [](auto& w) {
    w.piece.push_back(1);
    ++w.num_bytes;
  });
}

TEST(Refusal, PlanMessagesWithoutSenseAreRefused) {
  const auto request = test::example_plan_request();
  expect_refused<plan_request_t>(request, "start.latitude_rad",
                                 [](auto& w) { w.start.latitude_rad = 2.0; });
  expect_refused<plan_request_t>(request, "goal.longitude_rad",
                                 [](auto& w) { w.goal.longitude_rad = kNan; });
  expect_refused<plan_request_t>(request, "start.height_m",
                                 [](auto& w) { w.start.height_m = kInfinity; });
  expect_refused<plan_request_t>(request, "via.latitude_rad",
                                 [](auto& w) { w.via[1].latitude_rad = -9.0; });
  expect_refused<plan_request_t>(request, "speed_mps", [](auto& w) { w.speed_mps = -1.0; });
  expect_refused<plan_request_t>(request, "work_budget", [](auto& w) { w.work_budget = -1; });
  expect_refused<plan_request_t>(request, "start_heading_true_rad",
                                 [](auto& w) { w.start_heading_true_rad = 7.0; });
  const auto status = test::example_plan_status();
  expect_refused<plan_status_t>(status, "state", [](auto& w) { w.state = 99; });
  expect_refused<plan_status_t>(status, "stage", [](auto& w) { w.stage = -1; });
  expect_refused<plan_status_t>(status, "cause", [](auto& w) {
    w.cause = static_cast<std::int8_t>(plan_status_t::CAUSE_GOAL_INSIDE_AREA + 1);
  });
  expect_refused<plan_status_t>(status, "cause",
                                [](auto& w) { w.state = plan_status_t::STATE_DONE; });
  expect_refused<plan_status_t>(status, "cause_y_m", [](auto& w) { w.cause_y_m = kNan; });
  expect_refused<plan_status_t>(status, "best_cost_m", [](auto& w) { w.best_cost_m = -1.0; });
  expect_refused<route_t>(test::example_route_header(), "cost_m", [](auto& w) { w.cost_m = kNan; });
  expect_refused<trajectory_t>(test::example_trajectory_header(), "duration_s",
                               [](auto& w) { w.duration_s = kInfinity; });
  expect_refused<trajectory_t>(test::example_trajectory_header(), "is_verified",
                               [](auto& w) { w.is_verified = 2; });
}

TEST(Refusal, EveryNumberOfAVehicleStateMustBeFinite) {
  double model_state_t::*const fields[] = {&model_state_t::x_m,
                                           &model_state_t::y_m,
                                           &model_state_t::altitude_m,
                                           &model_state_t::speed_mps,
                                           &model_state_t::heading_math_rad,
                                           &model_state_t::bank_left_rad,
                                           &model_state_t::roll_rate_left_radps,
                                           &model_state_t::pitch_rad,
                                           &model_state_t::pitch_rate_radps,
                                           &model_state_t::climb_rate_mps,
                                           &model_state_t::vertical_acceleration_mps2,
                                           &model_state_t::climb_integral_mps};
  for (double model_state_t::*const field : fields) {
    for (const double bad : {kNan, kInfinity, -kInfinity}) {
      expect_refused<vehicle_state_t>(test::example_vehicle_state(), "state.",
                                      [&](auto& w) { w.state.*field = bad; });
      expect_refused<vehicle_target_t>(test::example_vehicle_target(), "state.",
                                       [&](auto& w) { w.state.*field = bad; });
    }
  }
  expect_refused<vehicle_target_t>(test::example_vehicle_target(), "step_s",
                                   [](auto& w) { w.step_s = 0.0; });
  expect_refused<vehicle_target_t>(test::example_vehicle_target(), "step_s",
                                   [](auto& w) { w.step_s = 1.5; });
  expect_refused<vehicle_target_t>(test::example_vehicle_target(), "commanded_speed_mps",
                                   [](auto& w) { w.commanded_speed_mps = kNan; });
  expect_refused<local_histogram_t>(test::example_local_histogram(), "chosen_sector",
                                    [](auto& w) { w.chosen_sector = 4; });
  expect_refused<local_histogram_t>(test::example_local_histogram(), "mask",
                                    [](auto& w) { w.mask[0] = 4; });
}

TEST(Refusal, EveryNumberOfAFlownStateMustBeFiniteButTheHeightsOfUnknownGround) {
  const flight::Plan plan = test::example_plan();
  const Bytes good = encode_flight_plan(plan, {7, 8});
  double flight::FlightState::*const fields[] = {
      &flight::FlightState::time_s, &flight::FlightState::x_m, &flight::FlightState::altitude_m,
      &flight::FlightState::bank_rad, &flight::FlightState::commanded_speed_mps};
  for (double flight::FlightState::*const field : fields) {
    flight::Plan bad = plan;
    bad.trajectory.states[1].*field = kNan;
    EXPECT_THROW(encode_flight_plan(bad, {7, 8}), std::invalid_argument);
  }
  flight::Plan unknown = plan;
  unknown.trajectory.states[1].surface_m = kNan;
  const Bytes bytes = encode_flight_plan(unknown, {7, 8});
  EXPECT_TRUE(std::isnan(
      decode_flight_plan(bytes, plan.route_plan, {7, 8}).trajectory.states[1].surface_m));
}

TEST(Refusal, TheRefusalNamesFieldAndValue) {
  Bytes bytes = to_message(test::example_plan_request(), kExampleStamp);
  plan_request_t wire{};
  wire.decode(bytes.data(), 0, static_cast<int>(bytes.size()));
  wire.speed_mps = -3.5;
  Stamp stamp;
  try {
    from_message<PlanRequestMessage>(bytes_of_wire(wire), stamp);
    FAIL();
  } catch (const MessageError& error) {
    EXPECT_STREQ(error.what(), "plan_request_t: speed_mps is -3.5, must be finite and above 0");
  }
}

TEST(Refusal, AnotherTypesBytesAreRefusedByTheirFingerprint) {
  const auto examples = test::example_of_each_channel();
  Stamp stamp;
  int refused = 0;
  for (const auto& [channel, bytes] : examples) {
    if (channel == kRouteChannel.name) {
      continue;
    }
    try {
      from_message<RouteHeader>(bytes, stamp);
      ADD_FAILURE() << channel;
    } catch (const MessageError& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("fingerprint"));
      ++refused;
    }
  }
  EXPECT_EQ(refused, static_cast<int>(examples.size()) - 1);
}

template <typename T>
void expect_cuts_refused(const Bytes& whole) {
  Stamp stamp;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_THROW(from_message<T>(ByteView(whole).first(size), stamp), MessageError) << size;
  }
  Bytes longer = whole;
  longer.push_back(std::byte{0});
  EXPECT_THROW(from_message<T>(longer, stamp), MessageError);
}

TEST(Refusal, EveryTruncationAndAnyExtraByteIsRefused) {
  expect_cuts_refused<MapIndex>(to_message(test::example_map_index(), kExampleStamp));
  expect_cuts_refused<MapPatch>(to_message(test::example_map_patch(), kExampleStamp));
  expect_cuts_refused<MapPatchState>(to_message(test::example_map_patch_state(), kExampleStamp));
  expect_cuts_refused<Chunk>(to_message(test::example_chunk(), kExampleStamp));
  expect_cuts_refused<ChunkRequest>(to_message(test::example_chunk_request(), kExampleStamp));
  expect_cuts_refused<PlanRequestMessage>(to_message(test::example_plan_request(), kExampleStamp));
  expect_cuts_refused<PlanStatus>(to_message(test::example_plan_status(), kExampleStamp));
  expect_cuts_refused<LocalHistogram>(to_message(test::example_local_histogram(), kExampleStamp));
  expect_cuts_refused<ServiceStatus>(to_message(test::example_service_status(), kExampleStamp));
}

// ----------------------------------------------------------------------------------------------
// Counts and lengths that cost memory or the process with decoders as lcm-gen writes them.

std::int64_t peak_memory_kib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}

void put_u32(Bytes& bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) {
    bytes.at(at + i) = static_cast<std::byte>(value >> (24 - 8 * i));
  }
}

/// Place of a big-endian number in an encoded message, which must be unique.
std::size_t place_of_u32(const Bytes& bytes, std::uint32_t value) {
  std::vector<std::size_t> places;
  for (std::size_t at = 8; at + 4 <= bytes.size(); ++at) {
    Bytes wanted(4);
    put_u32(wanted, 0, value);
    if (std::equal(wanted.begin(), wanted.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at))) {
      places.push_back(at);
    }
  }
  EXPECT_EQ(places.size(), 1U);
  return places.empty() ? 8 : places.front();
}

constexpr std::uint32_t kHostileCounts[] = {
    0xFFFFFFFFU, 0x80000000U, 0x7FFFFFFFU, 2'000'000'000U, 500'000'000U, 100'000'000U,
    0x20000000U,  // times 8 overflows 32 bits
    0x40000000U, 0x10000000U, 70'000U,
};

TEST(HostileCounts, AreRefusedAtOnceAndWithoutMemory) {
  // The counts in the examples are numbers that occur once in their bytes.
  const std::int64_t memory_before_kib = peak_memory_kib();
  const auto begin = std::chrono::steady_clock::now();
  Stamp stamp;
  int refused = 0;
  for (const std::uint32_t count : kHostileCounts) {
    ChunkRequest ranges;
    ranges.ranges.assign(37, {{1, 2}, 3, 4});
    Bytes request = to_message(ranges, kExampleStamp);
    put_u32(request, place_of_u32(request, 37), count);
    EXPECT_THROW(from_message<ChunkRequest>(request, stamp), MessageError) << count;

    Bytes chunk = to_message(test::example_chunk(), kExampleStamp);
    put_u32(chunk, chunk.size() - 3 - 4, count);  // num_bytes stands before the 3 bytes
    EXPECT_THROW(from_message<Chunk>(chunk, stamp), MessageError) << count;

    LocalHistogram sectors = test::example_local_histogram();
    sectors.sectors.resize(53);
    Bytes histogram = to_message(sectors, kExampleStamp);
    put_u32(histogram, place_of_u32(histogram, 53), count);
    EXPECT_THROW(from_message<LocalHistogram>(histogram, stamp), MessageError) << count;

    ServiceStatus status = test::example_service_status();
    status.text.assign(82, 't');  // length on the wire: 83
    Bytes text = to_message(status, kExampleStamp);
    put_u32(text, place_of_u32(text, 83), count);
    EXPECT_THROW(from_message<ServiceStatus>(text, stamp), MessageError) << count;

    flight::Plan plan = test::example_plan();
    plan.trajectory.states.assign(113, test::example_flight_state(0.0));
    Bytes flown = encode_flight_plan(plan, {7, 8});
    put_u32(flown, place_of_u32(flown, 113), count);
    EXPECT_THROW(decode_flight_plan(flown, plan.route_plan, {7, 8}), MessageError) << count;

    flight::RoutePlan route = test::example_route_plan();
    route.map.attributions.assign(91, "line");
    Bytes routed = encode_route_plan(route);
    put_u32(routed, place_of_u32(routed, 91), count);
    EXPECT_THROW(decode_route_plan(routed), MessageError) << count;
    refused += 6;
  }
  EXPECT_EQ(refused, 60);
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  EXPECT_LT(seconds, 5.0);
  EXPECT_LT(peak_memory_kib() - memory_before_kib, 64 * 1024);
}

TEST(HostileCounts, TextsOfNoLengthOrWithAZeroInsideAreRefused) {
  ServiceStatus status = test::example_service_status();
  status.text.assign(82, 't');
  const Bytes good = to_message(status, kExampleStamp);
  const std::size_t at = place_of_u32(good, 83);
  Stamp stamp;
  Bytes zero_inside = good;
  zero_inside.at(at + 4 + 10) = std::byte{0};
  EXPECT_THROW(from_message<ServiceStatus>(zero_inside, stamp), MessageError);
  Bytes zero_missing = good;
  zero_missing.back() = std::byte{'t'};
  EXPECT_THROW(from_message<ServiceStatus>(zero_missing, stamp), MessageError);
  Bytes no_length = good;
  put_u32(no_length, at, 0);
  EXPECT_THROW(from_message<ServiceStatus>(no_length, stamp), MessageError);
}

TEST(Sending, ATextWithAZeroInsideCannotBeSent) {
  EXPECT_THROW(encode_planning_config(std::string("a\0b", 3)), std::invalid_argument);
}

TEST(Sending, StatusTextIsMadeFitToBeRead) {
  ServiceStatus status = test::example_service_status();
  status.text = "f\xFC\x1b[2Jr \xC3\xBC \xE2\x82";
  Stamp stamp;
  EXPECT_EQ(from_message<ServiceStatus>(to_message(status, kExampleStamp), stamp).text,
            "f? [2Jr \xC3\xBC ??");
}

TEST(Sending, WhatNoReaderAcceptsCannotBeSent) {
  VehicleTarget target = test::example_vehicle_target();
  target.state.x_m = kNan;
  EXPECT_THROW(to_message(target, kExampleStamp), std::invalid_argument);
}

// ----------------------------------------------------------------------------------------------
// Map tiles

TEST(MapTiles, TileOfAnotherPlaceOrLayerIsRefusedAndNamed) {
  map::Map map = test::make_map(100, 70, 10.0, [](double x, double y) { return x * 0.1 + y; });
  const Tiling tiling{100, 70, 32};
  const Bytes tile = encode_map_tile(map, 32, {MapLayer::kSurface, 3, 1});
  map::Map copy = map;
  EXPECT_NO_THROW(decode_map_tile(tile, tiling, {MapLayer::kSurface, 3, 1}, copy));
  try {
    decode_map_tile(tile, tiling, {MapLayer::kSurface, 2, 1}, copy);
    FAIL();
  } catch (const MessageError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("layer surface, tile column 2, tile row 1"));
  }
  EXPECT_THROW(decode_map_tile(tile, tiling, {MapLayer::kTerrain, 3, 1}, copy), MessageError);
  EXPECT_THROW(decode_map_tile(tile, {100, 70, 64}, {MapLayer::kSurface, 1, 1}, copy),
               MessageError);
}

TEST(MapTiles, TableIndexAndAddressAreInverse) {
  const Tiling tiling{100, 70, 32};
  EXPECT_EQ(tiling.tile_columns(), 4);
  EXPECT_EQ(tiling.tile_rows(), 3);
  for (std::size_t i = 0; i < 48; ++i) {
    EXPECT_EQ(tile_index(tiling, tile_address(tiling, i)), i);
  }
  EXPECT_EQ(tile_address(tiling, 47), (TileAddress{MapLayer::kVisibility, 3, 2}));
}

TEST(MapTiles, TableOfAnotherMapOrSizeIsRefused) {
  const Tiling tiling{40, 40, 32};
  std::vector<BlobRef> tiles(16, BlobRef{{1, 2}, 100, 200});
  const Bytes table = encode_map_tile_table({5, 6}, tiling, tiles);
  EXPECT_EQ(decode_map_tile_table(table, {5, 6}, tiling), tiles);
  EXPECT_THROW(decode_map_tile_table(table, {5, 7}, tiling), MessageError);
  EXPECT_THROW(decode_map_tile_table(table, {5, 6}, {40, 40, 16}), MessageError);
  tiles.pop_back();
  EXPECT_THROW(encode_map_tile_table({5, 6}, tiling, tiles), std::invalid_argument);
}

TEST(MapTiles, ATileOfAnObserverIsThatOfNoOther) {
  map::Map map = test::make_map(40, 40, 10.0, [](double x, double) { return x; });
  map.threats = {{"a", raster::Grid<float>(map.geometry, 3.5F)},
                 {"b", raster::Grid<float>(map.geometry, 3.5F)}};
  const Tiling tiling{40, 40, 32};
  const TileAddress second = threat_tile_address(tiling, 7);
  EXPECT_EQ(name_of(second), "layer observer 2, tile column 1, tile row 1");
  const Bytes tile = encode_map_tile(map, 32, second);
  map::Map copy = map;
  for (map::HeightLayer& threat : copy.threats) {
    std::fill(threat.height_m.values().begin(), threat.height_m.values().end(), 0.0F);
  }
  decode_map_tile(tile, tiling, second, copy);
  EXPECT_EQ(copy.threats[1].height_m.at(39, 39), 3.5F);
  EXPECT_EQ(copy.threats[1].height_m.at(31, 39), 0.0F);
  EXPECT_EQ(copy.threats[0].height_m.at(39, 39), 0.0F);
  EXPECT_THROW(decode_map_tile(tile, tiling, threat_tile_address(tiling, 3), copy), MessageError);
}

TEST(MapTiles, NamedObserversWithoutSenseAreRefused) {
  const Tiling tiling{40, 40, 32};
  const MapThreats threats{{"tower", ""}, std::vector<BlobRef>(8, BlobRef{{1, 2}, 100, 200})};
  const Bytes good = encode_map_threats({5, 6}, tiling, threats);
  const MapThreats back = decode_map_threats(good, {5, 6}, tiling, 2);
  EXPECT_EQ(back.names, threats.names);
  EXPECT_EQ(back.tiles, threats.tiles);

  const auto refusal_of = [&](const std::function<void(map_threats_t&)>& spoil) -> std::string {
    map_threats_t wire{};
    EXPECT_GT(wire.decode(good.data(), 0, static_cast<int>(good.size())), 0);
    spoil(wire);
    try {
      decode_map_threats(bytes_of_wire(wire), {5, 6}, tiling, 2);
    } catch (const MessageError& error) {
      return error.what();
    }
    return "accepted";
  };
  using testing::HasSubstr;
  EXPECT_EQ(refusal_of([](auto&) {}), "accepted");
  EXPECT_THAT(refusal_of([](auto& w) { ++w.version; }), HasSubstr("version"));
  EXPECT_THAT(refusal_of([](auto& w) { ++w.map_hash[1]; }), HasSubstr("map_hash"));
  EXPECT_THAT(refusal_of([](auto& w) { w.names[0].assign(201, 'x'); }), HasSubstr("names"));
  EXPECT_THAT(refusal_of([](auto& w) { w.names[1] = "\x1b[2J"; }), HasSubstr("names"));
  EXPECT_THAT(refusal_of([](auto& w) { w.names[1] = "\xC3"; }), HasSubstr("names is no UTF-8"));
  EXPECT_THAT(refusal_of([](auto& w) { w.tile_column_count = 3; }), HasSubstr("tile_column_count"));
  EXPECT_THAT(refusal_of([](auto& w) { w.tile_row_count = 1; }), HasSubstr("tile_row_count"));
  EXPECT_THAT(refusal_of([](auto& w) { w.tiles[3].packed_bytes = -1; }),
              HasSubstr("tiles.packed_bytes"));
  EXPECT_THAT(refusal_of([](auto& w) { w.tiles[3].content_bytes = 1LL << 30; }),
              HasSubstr("tiles.content_bytes"));
  EXPECT_THAT(refusal_of([](auto& w) {
                w.num_threats = 1;
                w.names.pop_back();
              }),
              HasSubstr("num_threats"));
  EXPECT_THAT(refusal_of([](auto& w) {
                w.num_tiles = 7;
                w.tiles.pop_back();
              }),
              HasSubstr("num_tiles"));
  Bytes endless = good;
  endless[8 + 2 + 16] = std::byte{0x7f};  // num_threats, two billion names
  EXPECT_THROW(decode_map_threats(endless, {5, 6}, tiling, 2), MessageError);
  EXPECT_THROW(decode_map_threats(good, {5, 6}, tiling, 3), MessageError);
  EXPECT_THROW(encode_map_threats({5, 6}, tiling, {{std::string(201, 'x')}, threats.tiles}),
               std::invalid_argument);
}

TEST(MapTiles, SupportsOfOverheadLinesMustAddUp) {
  map::Map map = test::make_map(20, 20, 10.0, [](double, double) { return 0.0; });
  map.overhead_lines = {{9, {{{1.0, 2.0}, 30.0}, {{3.0, 4.0}, 31.0}}}};
  test::finish_map(map);
  const Bytes good = encode_map_features(map, map.hash);
  map_features_t wire{};
  wire.decode(good.data(), 0, static_cast<int>(good.size()));
  wire.overhead_line_support_count[0] = 3;
  map::Map copy;
  EXPECT_THROW(decode_map_features(bytes_of_wire(wire), map.hash, copy), MessageError);
  wire.overhead_line_support_count[0] = 1;
  EXPECT_THROW(decode_map_features(bytes_of_wire(wire), map.hash, copy), MessageError);
  wire.overhead_line_support_count[0] = 2;
  wire.support_x_m[1] = kNan;
  EXPECT_THROW(decode_map_features(bytes_of_wire(wire), map.hash, copy), MessageError);
}

map::Map map_with_features() {
  map::Map map = test::make_map(20, 20, 10.0, [](double, double) { return 0.0; });
  map.overhead_lines = {
      {9, {{{1.0, 2.0}, 30.0}, {{3.0, 4.0}, 31.0, false}}, map::LineKind::kAerialway}};
  map.obstacles = {{7, map::ObstacleKind::kChimney, "one", {5.0, 6.0}, 7.0, 8.0, kNan},
                   {-8, map::ObstacleKind::kMast, "", {9.0, 10.0}, 11.0, 12.0, 13.0}};
  using Reference = map::AreaLimit::Reference;
  map.areas = {{"a",
                "R",
                true,
                {-kInfinity, Reference::kAboveGround},
                {100.0, Reference::kAmsl},
                {{{{1, 1}, {2, 1}, {2, 2}, {1, 1}}, {{{3, 3}, {4, 3}, {4, 4}, {3, 3}}}},
                 {{{5, 5}, {6, 5}, {6, 6}, {5, 6}, {5, 5}}, {}}}},
               {"b",
                "Q",
                false,
                {20.0, Reference::kAboveGround},
                {kInfinity, Reference::kAmsl},
                {{{{7, 7}, {8, 7}, {8, 8}, {7, 7}}, {}}}}};
  test::finish_map(map);
  return map;
}

TEST(MapTiles, FeaturesArriveAsTheyWere) {
  const map::Map map = map_with_features();
  map::Map copy = map;
  copy.overhead_lines.clear();
  copy.obstacles.clear();
  copy.areas.clear();
  EXPECT_NE(map::map_hash(copy), map.hash);
  decode_map_features(encode_map_features(map, map.hash), map.hash, copy);
  EXPECT_EQ(map::map_hash(copy), map.hash);
}

TEST(MapTiles, EveryPartOfAFeatureIsPartOfTheMapsIdentity) {
  const map::Map map = map_with_features();
  const auto differs = [&](const auto& change) {
    map::Map other = map;
    change(other);
    return map::map_hash(other) != map.hash;
  };
  EXPECT_TRUE(differs([](map::Map& m) { m.overhead_lines[0].kind = map::LineKind::kPowerLine; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.overhead_lines[0].supports[1].is_pole = true; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.obstacles[0].kind = map::ObstacleKind::kMast; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.obstacles[0].name = "two"; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.obstacles[0].point.y_m += 1.0; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.obstacles[0].radius_m += 1.0; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.obstacles[1].height_m += 1.0; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.obstacles[1].top_m += 1.0; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.areas[0].name = "c"; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.areas[0].kind = "P"; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.areas[0].is_hard = false; }));
  EXPECT_TRUE(
      differs([](map::Map& m) { m.areas[1].floor.reference = map::AreaLimit::Reference::kAmsl; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.areas[0].ceiling.value_m += 1.0; }));
  EXPECT_TRUE(differs([](map::Map& m) { m.areas[0].polygons[0].holes.clear(); }));
  EXPECT_TRUE(differs([](map::Map& m) { m.areas[0].polygons[1].outer[1].x_m += 1.0; }));
}

TEST(MapTiles, FeaturesThatDoNotAddUpAreRefused) {
  const map::Map map = map_with_features();
  const Bytes good = encode_map_features(map, map.hash);
  const auto refuses = [&](const auto& change) {
    map_features_t wire{};
    wire.decode(good.data(), 0, static_cast<int>(good.size()));
    change(wire);
    map::Map copy;
    try {
      decode_map_features(bytes_of_wire(wire), map.hash, copy);
    } catch (const MessageError&) {
      return true;
    }
    return false;
  };
  EXPECT_FALSE(refuses([](map_features_t&) {}));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.overhead_line_kind[0] = 3; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.support_is_pole[0] = 2; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.obstacle_kind[0] = -1; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.obstacle_radius_m[0] = -1.0; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.obstacle_height_m[0] = kNan; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.obstacle_name[0] = "a\x01"; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.area_floor_m[0] = kNan; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.area_ring_count[0] = 2; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.area_ring_count[1] = 2; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.ring_is_hole[0] = 1; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.ring_corner_count[0] = 3; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.ring_corner_count[3] = 5; }));
  EXPECT_TRUE(refuses([](map_features_t& w) { w.corner_x_m[3] = kNan; }));
}

}  // namespace
}  // namespace hedgehop::messages
