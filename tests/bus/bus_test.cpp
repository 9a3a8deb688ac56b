#include "bus/bus.hpp"

#include <filesystem>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <iostream>
#include <random>
#include <thread>
#include <unistd.h>

#include "base/errors.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/event_log.hpp"
#include "bus/map_exchange.hpp"
#include "bus/service.hpp"
#include "messages/map_tiles.hpp"
#include "messages/plan_blobs.hpp"
#include "support/example_messages.hpp"
#include "support/test_map.hpp"

namespace hedgehop::bus {
namespace {

namespace fs = std::filesystem;
using namespace messages;

BusOptions memory(const std::string& name, std::int64_t sender_id = 0,
                  const std::string& prefix = "") {
  return {"memq://" + name, prefix, sender_id};
}

TEST(Bus, HandlersGetWhatWasPublishedInOrderOnlyInsidePoll) {
  Bus a(memory("order", 10));
  Bus b(memory("order", 20));
  std::vector<std::int64_t> steps;
  b.subscribe<VehicleTarget>(kVehicleTargetChannel,
                             [&](const VehicleTarget& target, const Stamp& stamp) {
                               steps.push_back(target.step_number);
                               EXPECT_EQ(stamp.sender_id, 10);
                               EXPECT_EQ(stamp.seq, static_cast<std::int64_t>(steps.size()));
                               EXPECT_EQ(stamp.time, Time{123});
                             });
  VehicleTarget target = test::example_vehicle_target();
  for (std::int64_t i = 0; i < 1000; ++i) {
    target.step_number = i;
    a.publish(kVehicleTargetChannel, target, Time{123});
  }
  EXPECT_TRUE(steps.empty());
  while (b.poll(0.0) > 0) {
  }
  ASSERT_EQ(steps.size(), 1000U);
  EXPECT_TRUE(std::is_sorted(steps.begin(), steps.end()));
  EXPECT_EQ(b.counters().received, 1000);
  EXPECT_EQ(b.counters().gaps, 0);
  EXPECT_EQ(b.message_time(), Time{123});
  EXPECT_EQ(a.counters().published, 1000);
}

TEST(Bus, PrefixesKeepTwoAircraftApart) {
  Bus a(memory("prefix", 1, "H1_"));
  Bus b(memory("prefix", 2, "H2_"));
  Bus c(memory("prefix", 3, "H1_"));
  int heard_b = 0;
  int heard_c = 0;
  b.subscribe<PlanCancel>(kPlanCancelChannel, [&](const auto&, const Stamp&) { ++heard_b; });
  c.subscribe<PlanCancel>(kPlanCancelChannel, [&](const auto&, const Stamp&) { ++heard_c; });
  a.publish(kPlanCancelChannel, PlanCancel{{1, 2}}, Time{1});
  b.poll(0.0);
  c.poll(0.0);
  EXPECT_EQ(heard_b, 0);
  EXPECT_EQ(heard_c, 1);
  EXPECT_THROW(Bus(memory("prefix", 1, "no good")), UsageError);
  EXPECT_THROW(Bus(memory("prefix", 1, std::string(60, 'P'))), UsageError);
}

/// A log is the way to put any bytes on a Bus.
class BusOnLog : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "hedgehop_bus_XXXXXX").string();
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string url_of(const std::vector<std::pair<std::string, Bytes>>& events) {
    const fs::path path = folder_ / "log";
    EventLogWriter writer(path, true, 1.0);
    std::int64_t time = 5'000'000;
    for (const auto& [channel, bytes] : events) {
      writer.write(Time{time += 1000}, channel, bytes);
    }
    return "file://" + path.string() + "?speed=0";
  }

  fs::path folder_;
};

TEST_F(BusOnLog, BadMessagesAreCountedByChannelAndDoNotReachHandlers) {
  const Bytes good = to_message(PlanCancel{{1, 2}}, Stamp{Time{1}, 5, 1});
  const Bytes cut(good.begin(), good.end() - 1);
  Bytes foreign = good;
  foreign[0] ^= std::byte{1};
  Bus bus({url_of({{"PLAN_CANCEL", cut},
                   {"PLAN_CANCEL", foreign},
                   {"PLAN_CANCEL", Bytes()},
                   {"PLAN_CANCEL", Bytes(5000)},
                   {"PLAN_CANCEL", good},
                   {"ELSEWHERE", cut}}),
           "", 0});
  int heard = 0;
  bus.subscribe<PlanCancel>(kPlanCancelChannel, [&](const auto&, const Stamp&) { ++heard; });
  while (!bus.is_finished()) {
    bus.poll(0.0);
  }
  EXPECT_EQ(heard, 1);
  const BusCounters counters = bus.counters();
  EXPECT_EQ(counters.received, 1);
  EXPECT_EQ(counters.rejected, 4);
  EXPECT_EQ(counters.rejected_by_channel.at("PLAN_CANCEL"), 4);
  EXPECT_THAT(counters.last_rejection, testing::HasSubstr("PLAN_CANCEL: plan_cancel_t: has 5000"));
}

TEST_F(BusOnLog, GapsAreCountedPerSenderAndLateMessagesAreNoGaps) {
  std::vector<std::pair<std::string, Bytes>> events;
  const auto add = [&](std::int64_t sender, std::int64_t seq) {
    events.emplace_back("PLAN_CANCEL", to_message(PlanCancel{{1, 2}}, Stamp{Time{1}, sender, seq}));
  };
  add(1, 100);  // joined late: no gap
  add(1, 101);
  add(2, 7);
  add(1, 104);  // 102 and 103 are missing
  add(2, 8);
  add(1, 103);  // late
  add(1, 105);
  add(2, 10);  // 9 is missing
  Bus bus({url_of(events), "", 0});
  bus.subscribe<PlanCancel>(kPlanCancelChannel, [](const auto&, const Stamp&) {});
  while (!bus.is_finished()) {
    bus.poll(0.0);
  }
  EXPECT_EQ(bus.counters().gaps, 2);
}

TEST_F(BusOnLog, ALogGivesOneMessageAPollAndItsOwnTime) {
  const Bytes good = to_message(PlanCancel{{1, 2}}, Stamp{Time{1}, 5, 1});
  Bus bus({url_of({{"PLAN_CANCEL", good}, {"PLAN_CANCEL", good}}), "", 0});
  int heard = 0;
  bus.subscribe<PlanCancel>(kPlanCancelChannel, [&](const auto&, const Stamp&) { ++heard; });
  EXPECT_TRUE(bus.is_replay());
  EXPECT_EQ(bus.poll(0.0), 1);
  EXPECT_EQ(heard, 1);
  EXPECT_EQ(bus.now(), Time{5'001'000});
  EXPECT_EQ(bus.poll(0.0), 1);
  EXPECT_EQ(bus.now(), Time{5'002'000});
  EXPECT_FALSE(bus.is_finished());
  EXPECT_EQ(bus.poll(0.0), 0);
  EXPECT_TRUE(bus.is_finished());
}

/// Everything that crosses the bus while a map goes from a tiler to a reader.
std::vector<std::pair<std::string, Bytes>> recorded_map_transfer(const map::Map& map) {
  std::vector<std::pair<std::string, Bytes>> events;
  Bus tiler_bus(memory("recorded", 1));
  Bus reader_bus(memory("recorded", 2));
  BlobExchange tiler({}, tiler_bus);
  BlobExchange reader({}, reader_bus);
  MapAssembly assembly(reader);
  reader_bus.subscribe_raw([&](const RawMessage& raw) {
    events.emplace_back(raw.channel, Bytes(raw.bytes.begin(), raw.bytes.end()));
  });
  reader_bus.subscribe<MapIndex>(
      kMapIndexChannel, [&](const MapIndex& index, const Stamp&) { assembly.receive(index); });
  const MapIndex index = offer_map(map, 32, tiler);
  Time now{1'700'000'000'000'000};
  for (int i = 0; i < 2000 && !assembly.map(); ++i) {
    now = now + 0.005;
    if (i % 50 == 0) {
      tiler_bus.publish(kMapIndexChannel, index, now);
    }
    tiler_bus.poll(0.0);
    tiler.tick(now);
    reader_bus.poll(0.0);
    assembly.tick();
    reader.tick(now);
  }
  EXPECT_NE(assembly.map(), nullptr);
  return events;
}

map::Map small_map() {
  map::Map map =
      test::make_map(100, 80, 30.0, [](double x, double y) { return 0.01 * x + 0.02 * y; });
  test::finish_map(map);
  return map;
}

TEST_F(BusOnLog, ARecordedMapComesOutOfItsLogInAnyOrderWithNobodyThere) {
  const map::Map map = small_map();
  std::vector<std::pair<std::string, Bytes>> events = recorded_map_transfer(map);
  const unsigned seed = std::random_device{}();
  std::cout << "seed " << seed << '\n';
  std::mt19937 random(seed);
  for (int round = 0; round < 5; ++round) {
    Bus bus({url_of(events), "", 9});
    BlobExchange exchange({}, bus);
    MapAssembly assembly(exchange);
    bus.subscribe<MapIndex>(kMapIndexChannel,
                            [&](const MapIndex& index, const Stamp&) { assembly.receive(index); });
    while (!bus.is_finished()) {
      bus.poll(0.0);
      assembly.tick();
      exchange.tick(bus.now());
    }
    ASSERT_NE(assembly.map(), nullptr) << assembly.missing();
    EXPECT_EQ(assembly.map()->hash, map.hash);
    std::shuffle(events.begin(), events.end(), random);
  }
}

TEST_F(BusOnLog, AChunkMissingInALogIsNamed) {
  const map::Map map = small_map();
  std::vector<std::pair<std::string, Bytes>> events = recorded_map_transfer(map);
  // GIVEN a log without the one chunk of the tile of the visibility layer in the north-east
  BlobExchange tiler(
      {}, 1, [](const Chunk&) {}, [](const ChunkRequest&) {});
  const BlobRef lost = tiler.offer(encode_map_tile(map, 32, {MapLayer::kVisibility, 3, 2}), false);
  const std::size_t removed = std::erase_if(events, [&](const auto& event) {
    Stamp stamp;
    return event.first == kChunkChannel.name &&
           from_message<Chunk>(event.second, stamp).blob_id == lost.id;
  });
  ASSERT_EQ(removed, 1U);
  Bus bus({url_of(events), "", 9});
  BlobExchange exchange({}, bus);
  MapAssembly assembly(exchange);
  bus.subscribe<MapIndex>(kMapIndexChannel,
                          [&](const MapIndex& index, const Stamp&) { assembly.receive(index); });
  while (!bus.is_finished()) {
    bus.poll(0.0);
    assembly.tick();
    exchange.tick(bus.now());
  }
  EXPECT_EQ(assembly.map(), nullptr);
  EXPECT_THAT(assembly.missing(),
              testing::AllOf(testing::HasSubstr("layer visibility, tile column 3, tile row 2"),
                             testing::HasSubstr("1 of 1 chunks missing: 0")));
}

TEST_F(BusOnLog, WhatAReplayMakesComesOutAtOnceThoughItsTimeStandsStill) {
  Bus bus({url_of({{"PLAN_CANCEL", to_message(PlanCancel{{1, 2}}, Stamp{Time{1}, 5, 1})}}), "", 9});
  BlobExchange exchange({}, bus);
  int chunks = 0;
  bus.tap_published([&](const RawMessage& raw) { chunks += raw.channel == "CHUNK" ? 1 : 0; });
  while (!bus.is_finished()) {
    bus.poll(0.0);
  }
  std::mt19937_64 random(1);
  Bytes content(1'000'000);
  for (std::byte& byte : content) {
    byte = static_cast<std::byte>(random());
  }
  const BlobRef ref = exchange.offer(content, true);
  exchange.tick(bus.now());
  EXPECT_EQ(chunks, ref.chunk_count());
}

TEST(Bus, ARecorderHearsEverythingAndATapWhatIsPublished) {
  Bus a(memory("recorder", 1));
  Bus b(memory("recorder", 2));
  std::vector<std::string> recorded;
  std::vector<std::string> tapped;
  b.subscribe_raw([&](const RawMessage& raw) { recorded.emplace_back(raw.channel); });
  a.tap_published([&](const RawMessage& raw) { tapped.emplace_back(raw.channel); });
  a.publish(kPlanCancelChannel, PlanCancel{{1, 2}}, Time{1});
  a.publish(kMapIndexChannel, test::example_map_index(), Time{1});
  b.poll(0.0);
  EXPECT_THAT(recorded, testing::ElementsAre("PLAN_CANCEL", "MAP_INDEX"));
  EXPECT_EQ(tapped, recorded);
}

TEST(Bus, ExceptionsOfHandlersPassThrough) {
  Bus a(memory("throwing", 1));
  a.subscribe<PlanCancel>(kPlanCancelChannel,
                          [](const auto&, const Stamp&) { throw DataError("from a handler"); });
  a.publish(kPlanCancelChannel, PlanCancel{{1, 2}}, Time{1});
  EXPECT_THROW(a.poll(0.0), DataError);
  EXPECT_EQ(a.counters().rejected, 0);
}

TEST(Bus, UrlsThatMeanNothingAreRefusedWithAHint) {
  for (const std::string url :
       {"tcpq://x", "nonsense", "udpm://10.0.0.1:7667", "udpm://239.1.1.1:0",
        "udpm://239.1.1.1:7667?tlt=1", "udpm://239.1.1.1:99999"}) {
    try {
      Bus bus({url, "", 0});
      ADD_FAILURE() << url;
    } catch (const UsageError& error) {
      EXPECT_FALSE(error.hint().empty()) << url;
    }
  }
  EXPECT_THROW(Bus({"file:///no/such/log", "", 0}), DataError);
}

TEST(Bus, MapAndPlanTravelBetweenThreeProcessesInMemory) {
  // GIVEN a tiler, a planner and a user, each with a Bus of its own in its own thread
  map::Map map =
      test::make_map(200, 150, 30.0, [](double x, double y) { return 0.01 * x + 0.02 * y; });
  map.label = "SYNTHETIC";
  test::finish_map(map);
  std::atomic<bool> is_done = false;
  std::thread tiler([&] {
    Bus bus(memory("chain", 1));
    BlobExchange exchange({}, bus);
    ServiceLoop loop(bus, exchange, "map_tiler", {});
    const MapIndex index = offer_map(map, 64, exchange);
    Time next;
    while (!is_done) {
      loop.turn(std::min(0.01, exchange.next_tick_s(bus.now())), [&](Time now) {
        if (now >= next) {
          next = now + 0.05;
          bus.publish(kMapIndexChannel, index, now);
        }
      });
    }
  });
  flight::RoutePlan route_plan = test::example_route_plan();
  std::thread planner([&] {
    Bus bus(memory("chain", 2));
    BlobExchange exchange({}, bus);
    ServiceLoop loop(bus, exchange, "global_planner", {});
    MapAssembly assembly(exchange);
    std::optional<PlanRequestMessage> request;
    bus.subscribe<MapIndex>(kMapIndexChannel,
                            [&](const MapIndex& index, const Stamp&) { assembly.receive(index); });
    bus.subscribe<PlanRequestMessage>(kPlanRequestChannel,
                                      [&](const PlanRequestMessage& r, const Stamp&) {
                                        request = r;
                                        exchange.want(r.config, "planning config");
                                      });
    std::optional<RouteHeader> answer;
    while (!is_done) {
      loop.turn(std::min(0.01, exchange.next_tick_s(bus.now())), [&](Time now) {
        assembly.tick();
        if (request && assembly.map() && exchange.content(request->config.id) != nullptr) {
          if (!answer) {
            EXPECT_EQ(assembly.map()->hash, request->map_hash);
            route_plan.request = request->request;
            route_plan.map.hash = request->map_hash;
            route_plan.config_text = decode_planning_config(*exchange.content(request->config.id));
            route_plan.request_id = request->request_id;
            answer = test::example_route_header();
            answer->request_id = request->request_id;
            answer->plan = exchange.offer(encode_route_plan(route_plan), true);
          }
          bus.publish(kRouteChannel, *answer, now);
          request.reset();
        }
      });
    }
  });

  // WHEN the user asks, and asks again until there is an answer
  Bus bus(memory("chain", 3));
  BlobExchange exchange({}, bus);
  std::optional<MapIndex> index;
  std::optional<RouteHeader> route;
  std::map<std::string, int> statuses;
  bus.subscribe<MapIndex>(kMapIndexChannel, [&](const MapIndex& i, const Stamp&) { index = i; });
  bus.subscribe<RouteHeader>(kRouteChannel, [&](const RouteHeader& header, const Stamp&) {
    route = header;
    exchange.want(header.plan, "route");
  });
  bus.subscribe<ServiceStatus>(
      kServiceStatusChannel,
      [&](const ServiceStatus& status, const Stamp&) { ++statuses[status.name]; });
  PlanRequestMessage request;
  request.request = test::example_request();
  const std::string config_text = "speed_mps: 40.0\n";
  request.config = exchange.offer(encode_planning_config(config_text), false);
  const Time begin = bus.now();
  Time next = begin;
  while (seconds_between(begin, bus.now()) < 20.0 &&
         !(route && exchange.content(route->plan.id) != nullptr)) {
    bus.poll(0.005);
    if (index && bus.now() >= next) {
      next = bus.now() + 0.1;
      request.map_hash = index->map_hash;
      request.request_id = flight::plan_request_id(request.request, index->map_hash, config_text);
      bus.publish(kPlanRequestChannel, request, bus.now());
    }
    exchange.tick(bus.now());
  }
  is_done = true;
  tiler.join();
  planner.join();

  // THEN the route comes back whole
  ASSERT_TRUE(route);
  ASSERT_NE(exchange.content(route->plan.id), nullptr);
  const flight::RoutePlan back = decode_route_plan(*exchange.content(route->plan.id));
  EXPECT_EQ(back.config_text, config_text);
  EXPECT_EQ(back.request_id, request.request_id);
  EXPECT_EQ(back.route.waypoints, route_plan.route.waypoints);
  EXPECT_EQ(bus.counters().rejected, 0);
  EXPECT_GE(statuses["map_tiler"], 1);
  EXPECT_GE(statuses["global_planner"], 1);
}

TEST(ServiceLoop, StatusesComeOncePerSecondAndSayStoppingAtLast) {
  Bus bus(memory("status", 1));
  Bus ear(memory("status", 2));
  std::vector<ServiceStatus> statuses;
  ear.subscribe<ServiceStatus>(
      kServiceStatusChannel, [&](const ServiceStatus& s, const Stamp&) { statuses.push_back(s); });
  BlobExchange exchange({}, bus);
  ServiceLoop loop(bus, exchange, "a_service", Hash128{3, 4});
  loop.set_state(ServiceState::kReady, "all well");
  const Time begin = bus.now();
  int ticks = 0;
  loop.run(0.02, [&](Time now) {
    ++ticks;
    if (seconds_between(begin, now) > 1.2) {
      loop.stop();
    }
  });
  ear.poll(0.0);
  ASSERT_EQ(statuses.size(), 3U);  // at 0 s, at 1 s, at the end
  EXPECT_EQ(statuses[0].state, ServiceState::kReady);
  EXPECT_EQ(statuses[0].text, "all well");
  EXPECT_EQ(statuses[0].name, "a_service");
  EXPECT_EQ(statuses[0].process_id, ::getpid());
  EXPECT_EQ(statuses[0].config_hash, (Hash128{3, 4}));
  EXPECT_EQ(statuses[0].types_hash, types_hash());
  EXPECT_EQ(statuses[2].state, ServiceState::kStopping);
  EXPECT_GE(ticks, 20);
}

TEST(ServiceArguments, AreReadAndMistakesNamed) {
  const std::vector<ServiceOption> options = {{"--map", "FOLDER", "map bundle", true}};
  const auto parse = [&](std::vector<const char*> words) {
    words.insert(words.begin(), "map_tiler");
    return parse_service_arguments(static_cast<int>(words.size()), words.data(), "map_tiler",
                                   "serves a map", options);
  };
  const auto arguments = parse({"--map", "M", "--lcm-url=memq://x", "--channel-prefix", "H1_",
                                "--check", "--config", "c.yaml"});
  ASSERT_TRUE(arguments);
  EXPECT_EQ(arguments->value("--map"), "M");
  EXPECT_EQ(arguments->bus.url, "memq://x");
  EXPECT_EQ(arguments->bus.channel_prefix, "H1_");
  EXPECT_EQ(arguments->config_file, "c.yaml");
  EXPECT_TRUE(arguments->is_check);
  EXPECT_THROW(parse({}), UsageError);
  EXPECT_THROW(parse({"--map"}), UsageError);
  try {
    parse({"--map", "M", "--lcm-ulr", "x"});
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_THAT(error.hint(), testing::HasSubstr("--lcm-url"));
  }
}

TEST(RunMain, TurnsErrorsIntoExitCodes) {
  EXPECT_EQ(run_main("x", [] { return 0; }), 0);
  EXPECT_EQ(run_main("x", []() -> int { throw BusError("no bus"); }), 6);
  EXPECT_EQ(run_main("x", []() -> int { throw UsageError("no"); }), 2);
  EXPECT_EQ(run_main("x", []() -> int { throw std::runtime_error("other"); }), 1);
}

}  // namespace
}  // namespace hedgehop::bus
