#include <cstring>
#include <filesystem>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <random>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "bus/event_log.hpp"
#include "bus/map_exchange.hpp"
#include "bus/service.hpp"
#include "support/example_messages.hpp"
#include "support/test_map.hpp"

// Real multicast; run through scripts/in-own-network, so that nothing gets out and nothing else
// gets in.

namespace hedgehop::bus {
namespace {

namespace fs = std::filesystem;
using namespace messages;

constexpr char kUrl[] = "udpm://239.255.76.67:7667?ttl=0";

/// Polls until `is_done` or the time is over.
bool poll_until(Bus& bus, double limit_s, const std::function<bool()>& is_done) {
  const Time begin = bus.now();
  while (!is_done()) {
    if (seconds_between(begin, bus.now()) > limit_s) {
      return false;
    }
    bus.poll(0.01);
  }
  return true;
}

void send_raw(ByteView packet) {
  const int file = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(7667);
  to.sin_addr.s_addr = htonl(0xEFFF4C43);
  EXPECT_EQ(::sendto(file, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                     sizeof to),
            static_cast<ssize_t>(packet.size()));
  ::close(file);
}

/// A program of LCM's own, stopped at the end.
class Program {
 public:
  explicit Program(std::vector<std::string> words) {
    pid_ = ::fork();
    if (pid_ == 0) {
      std::vector<char*> arguments;
      for (std::string& word : words) {
        arguments.push_back(word.data());
      }
      arguments.push_back(nullptr);
      ::execvp(arguments[0], arguments.data());
      ::_exit(127);
    }
  }
  ~Program() { stop(); }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  int stop() {
    if (pid_ <= 0) {
      return status_;
    }
    ::kill(pid_, SIGTERM);
    return wait();
  }
  int wait() {
    if (pid_ > 0) {
      ::waitpid(pid_, &status_, 0);
      pid_ = -1;
    }
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : -1;
  }

 private:
  pid_t pid_ = -1;
  int status_ = 0;
};

bool has_program(const std::string& name) {
  return std::system(("command -v " + name + " >/dev/null").c_str()) == 0;
}

TEST(Network, MessagesCrossAndComeBackToTheSender) {
  Bus a({kUrl, "", 1});
  Bus b({kUrl, "", 2});
  int heard_a = 0;
  int heard_b = 0;
  a.subscribe<PlanCancel>(kPlanCancelChannel, [&](const auto&, const Stamp&) { ++heard_a; });
  b.subscribe<PlanCancel>(kPlanCancelChannel, [&](const auto&, const Stamp&) { ++heard_b; });
  for (int i = 0; i < 100; ++i) {
    a.publish(kPlanCancelChannel, PlanCancel{{1, 2}}, a.now());
  }
  EXPECT_TRUE(poll_until(a, 5.0, [&] { return heard_a == 100; }));
  EXPECT_TRUE(poll_until(b, 5.0, [&] { return heard_b == 100; }));
}

TEST(Network, AnotherGroupOnTheSamePortIsNotHeard) {
  Bus a({"udpm://239.255.76.68:7667?ttl=0", "", 1});
  Bus b({kUrl, "", 2});
  int heard = 0;
  b.subscribe<PlanCancel>(kPlanCancelChannel, [&](const auto&, const Stamp&) { ++heard; });
  a.publish(kPlanCancelChannel, PlanCancel{{1, 2}}, a.now());
  EXPECT_FALSE(poll_until(b, 0.2, [&] { return heard > 0; }));
}

TEST(Network, ABurstOfAThousandChunksLosesNothing) {
  Bus a({kUrl, "", 1});
  Bus b({kUrl, "", 2});
  std::int64_t heard = 0;
  b.subscribe<Chunk>(kChunkChannel, [&](const auto&, const Stamp&) { ++heard; });
  Chunk chunk;
  chunk.packed_bytes = 1000 * kChunkBytes;
  chunk.piece.resize(static_cast<std::size_t>(kChunkBytes));
  for (chunk.number = 0; chunk.number < 1000; ++chunk.number) {
    a.publish(kChunkChannel, chunk, a.now());
  }
  poll_until(b, 5.0, [&] { return heard == 1000; });
  const BusCounters counters = b.counters();
  // The kernel's limit may be low here; then the loss must be known.
  EXPECT_EQ(heard + counters.dropped_packets, 1000);
  EXPECT_LE(counters.gaps, counters.dropped_packets);
}

TEST(Network, PacketsThatEndOtherReceiversAreCountedAndThenAllGoesOn) {
  Bus a({kUrl, "", 1});
  Bus b({kUrl, "", 2});
  int heard = 0;
  b.subscribe<PlanCancel>(kPlanCancelChannel, [&](const auto&, const Stamp&) { ++heard; });
  b.subscribe_raw([](const RawMessage&) {});
  const auto bytes = [](std::string_view text) {
    const ByteView view = bytes_of(text);
    return Bytes(view.begin(), view.end());
  };
  using namespace std::string_view_literals;
  const std::vector<Bytes> killers = {
      bytes("LC02\0\0\0\1CHANNEL"sv),
      bytes("LC03\0\0\0\1\0\0\0\xC8\0\0"sv),
      bytes("LC03\0\0\0\2\0\0\0\xC8\0\0\0\0\0\0\0\2A\0data"sv),
      bytes("LC03\0\0\0\2\0\0\0\xC8\xFF\xFF\xFF\xF0\0\1\0\2data"sv),
      bytes("LC03\0\0\0\3\x10\0\0\0\0\0\0\0\0\0\0\1A\0data"sv),
      bytes("garbage"sv),
  };
  for (const Bytes& killer : killers) {
    send_raw(killer);
  }
  std::mt19937 random(std::random_device{}());
  for (int i = 0; i < 2000; ++i) {
    Bytes packet(random() % 100);
    for (std::byte& byte : packet) {
      byte = static_cast<std::byte>(random());
    }
    if (packet.size() > 4) {
      std::memcpy(packet.data(), i % 2 == 0 ? "LC02" : "LC03", 4);
    }
    send_raw(packet);
  }
  a.publish(kPlanCancelChannel, PlanCancel{{1, 2}}, a.now());
  EXPECT_TRUE(poll_until(b, 5.0, [&] { return heard == 1; }));
  EXPECT_GE(b.counters().bad_packets, 5);
}

TEST(Network, MessagesOfAnotherTypeOrVersionAreRefusedAndNamed) {
  Bus b({kUrl, "", 2});
  int heard = 0;
  b.subscribe<MapIndex>(kMapIndexChannel, [&](const auto&, const Stamp&) { ++heard; });
  const auto send = [](const Bytes& message) {
    Bytes packet;
    const auto add = [&](ByteView bytes) {
      packet.insert(packet.end(), bytes.begin(), bytes.end());
    };
    using namespace std::string_view_literals;
    add(bytes_of("LC02\0\0\0\1MAP_INDEX\0"sv));
    add(message);
    send_raw(packet);
  };
  const Stamp stamp{Time{1'700'000'000'000'000}, 1, 1};
  const Bytes good = to_message(test::example_map_index(), stamp);
  // As a program with another lcmtypes would send it: one field more changes the fingerprint.
  Bytes of_another_type = good;
  of_another_type[3] ^= std::byte{0x10};
  send(of_another_type);
  ASSERT_TRUE(poll_until(b, 5.0, [&] { return b.counters().rejected == 1; }));
  EXPECT_THAT(b.counters().last_rejection, testing::HasSubstr("MAP_INDEX"));
  EXPECT_THAT(b.counters().last_rejection, testing::HasSubstr("map_index_v2_t"));
  EXPECT_THAT(b.counters().last_rejection, testing::HasSubstr("fingerprint"));
  // The version stands after fingerprint, time, sender and number.
  Bytes of_another_version = good;
  of_another_version[33] = std::byte{77};
  send(of_another_version);
  ASSERT_TRUE(poll_until(b, 5.0, [&] { return b.counters().rejected == 2; }));
  EXPECT_THAT(b.counters().last_rejection, testing::HasSubstr("version"));
  EXPECT_THAT(b.counters().last_rejection, testing::HasSubstr("77"));
  EXPECT_EQ(heard, 0);
  send(good);
  EXPECT_TRUE(poll_until(b, 5.0, [&] { return heard == 1; }));
  EXPECT_EQ(b.counters().rejected_by_channel["MAP_INDEX"], 2);
}

TEST(Network, AMapCrossesBitForBit) {
  std::mt19937 random(std::random_device{}());
  map::Map map = test::make_map(400, 300, 30.0, [&](double x, double y) {
    return 0.05 * x + 0.02 * y + static_cast<double>(random() % 64) / 64.0;
  });
  test::finish_map(map);
  std::atomic<bool> is_done = false;
  std::thread tiler([&] {
    Bus bus({kUrl, "", 1});
    BlobExchange exchange({}, bus);
    const MapIndex index = offer_map(map, 128, exchange);
    Time next;
    while (!is_done) {
      bus.poll(std::min(0.01, exchange.next_tick_s(bus.now())));
      if (bus.now() >= next) {
        next = bus.now() + 0.1;
        bus.publish(kMapIndexChannel, index, bus.now());
      }
      exchange.tick(bus.now());
    }
  });
  Bus bus({kUrl, "", 2});
  BlobExchange exchange({}, bus);
  MapAssembly assembly(exchange);
  bus.subscribe<MapIndex>(kMapIndexChannel,
                          [&](const MapIndex& index, const Stamp&) { assembly.receive(index); });
  const Time begin = bus.now();
  while (assembly.map() == nullptr && seconds_between(begin, bus.now()) < 20.0) {
    bus.poll(std::min(0.01, exchange.next_tick_s(bus.now())));
    exchange.tick(bus.now());
    assembly.tick();
  }
  is_done = true;
  tiler.join();
  ASSERT_NE(assembly.map(), nullptr) << assembly.missing();
  EXPECT_EQ(map::map_hash(*assembly.map()), map.hash);
  EXPECT_EQ(std::memcmp(assembly.map()->surface_m.row(0), map.surface_m.row(0),
                        map.geometry.cell_count() * sizeof(float)),
            0);
  std::cout << "map of " << map.geometry.cell_count() << " cells in "
            << seconds_between(begin, bus.now()) << " s\n";
}

TEST(Network, LcmLoggerRecordsWhatWeSendAndItsLogIsOurs) {
  if (!has_program("lcm-logger")) {
    GTEST_SKIP() << "lcm-logger is not installed (Debian: liblcm-bin)";
  }
  const fs::path path =
      fs::temp_directory_path() / ("hedgehop_lcm_log_" + std::to_string(::getpid()));
  {
    Program logger({"lcm-logger", std::string("--lcm-url=") + kUrl, "-f", "-q", path.string()});
    Bus bus({kUrl, "", 1});
    // The logger needs a moment to listen; it has begun once the file grows.
    const Time begin = bus.now();
    std::int64_t sent = 0;
    while ((!fs::exists(path) || fs::file_size(path) == 0) &&
           seconds_between(begin, bus.now()) < 10.0) {
      bus.publish(kPlanCancelChannel, PlanCancel{{1, 2}}, bus.now());
      ++sent;
      bus.poll(0.02);
    }
    bus.publish(kMapIndexChannel, test::example_map_index(), bus.now());
    bus.publish(kServiceStatusChannel, test::example_service_status(), bus.now());
    bus.poll(0.3);
    EXPECT_EQ(logger.stop(), 0);
    EXPECT_GT(sent, 0);
  }
  Bus log({"file://" + path.string(), "", 0});
  int indices = 0;
  int statuses = 0;
  log.subscribe<MapIndex>(kMapIndexChannel, [&](const MapIndex& index, const Stamp& stamp) {
    ++indices;
    EXPECT_EQ(index, test::example_map_index());
    EXPECT_EQ(stamp.sender_id, 1);
  });
  log.subscribe<ServiceStatus>(kServiceStatusChannel,
                               [&](const auto&, const Stamp&) { ++statuses; });
  while (!log.is_finished()) {
    log.poll(0.0);
  }
  EXPECT_EQ(indices, 1);
  EXPECT_EQ(statuses, 1);
  EXPECT_EQ(log.counters().rejected, 0);
  fs::remove(path);
}

TEST(Network, LcmLogplayerPlaysOurLog) {
  if (!has_program("lcm-logplayer")) {
    GTEST_SKIP() << "lcm-logplayer is not installed (Debian: liblcm-bin)";
  }
  const fs::path path =
      fs::temp_directory_path() / ("hedgehop_own_log_" + std::to_string(::getpid()));
  const auto examples = test::example_of_each_channel();
  {
    EventLogWriter writer(path, true, 0.1);
    std::int64_t time_us = 1'700'000'000'000'000;
    for (int round = 0; round < 20; ++round) {
      for (const auto& [channel, bytes] : examples) {
        writer.write(Time{time_us += 1000}, channel, bytes);
      }
    }
  }
  Bus bus({kUrl, "", 2});
  std::vector<std::pair<std::string, Bytes>> heard;
  bus.subscribe_raw([&](const RawMessage& raw) {
    heard.emplace_back(raw.channel, Bytes(raw.bytes.begin(), raw.bytes.end()));
  });
  Program player({"lcm-logplayer", std::string("--lcm-url=") + kUrl, path.string()});
  poll_until(bus, 10.0, [&] { return heard.size() >= 20 * examples.size(); });
  EXPECT_EQ(player.wait(), 0);
  ASSERT_EQ(heard.size(), 20 * examples.size());
  for (std::size_t i = 0; i < heard.size(); ++i) {
    EXPECT_EQ(heard[i], examples[i % examples.size()]);
  }
  fs::remove(path);
}

TEST(Network, WithoutAMulticastRouteTheErrorSaysWhatToDo) {
  if (std::system("ip route del 224.0.0.0/4 dev lo") != 0) {
    GTEST_SKIP() << "the route cannot be taken away here";
  }
  try {
    Bus bus({kUrl, "", 1});
    ADD_FAILURE() << "no route, and yet no error";
  } catch (const BusError& error) {
    EXPECT_THAT(error.hint(), testing::HasSubstr("scripts/net-setup"));
    EXPECT_EQ(error.code(), ExitCode::kBusUnreachable);
  }
  EXPECT_EQ(std::system("ip route add 224.0.0.0/4 dev lo"), 0);
}

TEST(Network, LockstepRunsFarFasterThanTheFlight) {
  Bus planner({kUrl, "", 1});
  std::atomic<bool> is_done = false;
  std::thread model([&] {
    Bus bus({kUrl, "", 2});
    bus.subscribe<VehicleTarget>(kVehicleTargetChannel,
                                 [&](const VehicleTarget& target, const Stamp&) {
                                   VehicleState state = test::example_vehicle_state();
                                   state.step_number = target.step_number;
                                   bus.publish(kVehicleStateChannel, state, bus.now());
                                 });
    while (!is_done) {
      bus.poll(0.01);
    }
  });
  std::int64_t answered = -1;
  planner.subscribe<VehicleState>(
      kVehicleStateChannel,
      [&](const VehicleState& state, const Stamp&) { answered = state.step_number; });
  VehicleTarget target = test::example_vehicle_target();
  const Time begin = planner.now();
  constexpr int kSteps = 2000;
  for (target.step_number = 0; target.step_number < kSteps; ++target.step_number) {
    do {
      planner.publish(kVehicleTargetChannel, target, planner.now());
    } while (!poll_until(planner, 0.2, [&] { return answered == target.step_number; }) &&
             seconds_between(begin, planner.now()) < 60.0);
  }
  const double steps_per_s = kSteps / seconds_between(begin, planner.now());
  is_done = true;
  model.join();
  std::cout << steps_per_s << " steps/s\n";
  // 20 steps make a second of flight; ten times that is plenty on a busy machine.
  EXPECT_GT(steps_per_s, 200.0);
}

}  // namespace
}  // namespace hedgehop::bus
