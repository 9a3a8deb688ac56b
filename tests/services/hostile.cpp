#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <netinet/in.h>
#include <random>
#include <set>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

#include "bus/bus.hpp"
#include "messages/channels.hpp"
#include "support/example_messages.hpp"

// hostile COUNT PAUSE_US_PER_100 SEED: sends COUNT packets that no program of ours sends to the
// default group and port, then asks each service something and prints as JSON how long the answers
// took and what the services say that they refused and missed.

namespace {

using namespace hedgehop;

class Fuzzer {
 public:
  explicit Fuzzer(std::uint64_t seed) : random_(seed), examples_(test::example_of_each_channel()) {}

  Bytes packet() {
    switch (below(9)) {
      case 0:
        return noise(below(300));
      case 1:
        return joined({text(below(2) == 0 ? "LC02" : "LC03"), noise(below(300))});
      case 2: {  // the right type, and anything behind it
        const auto& [channel, message] = example();
        return whole(channel,
                     joined({Bytes(message.begin(), message.begin() + 8), noise(below(300))}));
      }
      case 3: {
        auto [channel, message] = example();
        for (std::size_t i = below(8) + 1; i > 0; --i) {
          message[below(message.size())] = static_cast<std::byte>(random_());
        }
        return whole(channel, message);
      }
      case 4: {
        auto [channel, message] = example();
        message.resize(below(message.size()));
        return whole(channel, message);
      }
      case 5: {  // counts, lengths and numbers at their limits
        static constexpr std::array<std::uint32_t, 8> kExtremes = {
            0, 1, 0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, 0x20000000, 0x7FF00000, 0x0FFFFFFF};
        auto [channel, message] = example();
        for (std::size_t i = below(3) + 1; i > 0; --i) {
          put(message, 8 + below(message.size() - 12), kExtremes[below(kExtremes.size())], 4);
        }
        return whole(channel, message);
      }
      case 6:  // no end of the channel's name, or one that is too long
        return joined({text("LC02"), noise(4), Bytes(below(400), std::byte{'C'})});
      default:
        return fragment();
    }
  }

 private:
  std::size_t below(std::size_t limit) { return static_cast<std::size_t>(random_() % limit); }
  const std::pair<std::string, Bytes>& example() { return examples_[below(examples_.size())]; }
  Bytes noise(std::size_t size) {
    Bytes bytes(size);
    for (std::byte& byte : bytes) {
      byte = static_cast<std::byte>(random_());
    }
    return bytes;
  }
  static Bytes text(std::string_view text) {
    const ByteView view = bytes_of(text);
    return {view.begin(), view.end()};
  }
  static Bytes joined(std::initializer_list<Bytes> parts) {
    Bytes all;
    for (const Bytes& part : parts) {
      all.insert(all.end(), part.begin(), part.end());
    }
    return all;
  }
  static void put(Bytes& bytes, std::size_t place, std::uint64_t value, int size) {
    for (int i = size - 1; i >= 0; --i) {
      bytes[place++] = static_cast<std::byte>(value >> (8 * i));
    }
  }
  Bytes whole(const std::string& channel, const Bytes& message) {
    return joined({text("LC02"), noise(4), text(channel), Bytes(1), message});
  }
  // Now and then one fits its predecessor.
  Bytes fragment() {
    const auto& [channel, message] = example();
    Bytes packet = joined({text("LC03"), Bytes(16)});
    put(packet, 4, below(4) == 0 ? random_() : 7, 4);
    const std::uint32_t lengths[] = {200, 0x10000000, 0xFFFFFFFF,
                                     0,   100000,     static_cast<std::uint32_t>(random_())};
    put(packet, 8, lengths[below(6)], 4);
    const std::uint32_t offsets[] = {0, 100, 0xFFFFFFF0, static_cast<std::uint32_t>(random_())};
    put(packet, 12, offsets[below(4)], 4);
    put(packet, 16, below(3) == 0 ? random_() : below(3), 2);
    put(packet, 18, below(3) == 0 ? random_() : 2, 2);
    packet = joined({packet, below(2) == 0 ? joined({text(channel), Bytes(1)}) : Bytes(),
                     Bytes(message.begin(), message.begin() + static_cast<long>(below(100)))});
    packet.resize(below(5) == 0 ? below(packet.size()) : packet.size());
    return packet;
  }

  std::mt19937_64 random_;
  std::vector<std::pair<std::string, Bytes>> examples_;
};

void send_all(std::int64_t count, std::chrono::microseconds pause, std::uint64_t seed) {
  const int file = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(7667);
  to.sin_addr.s_addr = htonl(0xEFFF4C43);
  Fuzzer fuzzer(seed);
  for (std::int64_t i = 0; i < count; ++i) {
    const Bytes packet = fuzzer.packet();
    (void)::sendto(file, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                   sizeof to);
    if (i % 100 == 99) {
      std::this_thread::sleep_for(pause);
    }
  }
  ::close(file);
}

}  // namespace

int main(int argc, char** argv) {
  using namespace messages;
  if (argc != 4) {
    return 2;
  }
  const std::uint64_t seed = std::strtoull(argv[3], nullptr, 10);
  send_all(std::atoll(argv[1]), std::chrono::microseconds(std::atoll(argv[2])), seed);

  bus::Bus bus({.url = bus::kDefaultUrl, .channel_prefix = {}});
  const Time begin = bus.now();
  std::map<std::string, double> answered_s;
  const auto note = [&](const std::string& name) {
    answered_s.try_emplace(name, seconds_between(begin, bus.now()));
  };
  std::map<std::string, ServiceStatus> statuses;
  std::optional<MapIndex> index;
  std::optional<Time> chunk_asked;  // it takes an index to know what to ask for
  PlanRequestMessage request = test::example_plan_request();
  request.request_id = {seed, 1};
  RouteHeader route = test::example_route_header();
  route.request_id = {seed, 2};
  bus.subscribe<MapIndex>(kMapIndexChannel,
                          [&](const MapIndex& heard, const Stamp&) { index = heard; });
  bus.subscribe<Chunk>(kChunkChannel, [&](const Chunk& chunk, const Stamp&) {
    if (chunk_asked && chunk.blob_id == index->tile_table.id) {
      answered_s.try_emplace("map_tiler", seconds_between(*chunk_asked, bus.now()));
    }
  });
  bus.subscribe<PlanStatus>(kPlanStatusChannel, [&](const PlanStatus& status, const Stamp&) {
    if (status.request_id == request.request_id && status.stage == PlanStage::kGlobal) {
      note("global_planner");
    }
    if (status.request_id == route.request_id && status.stage == PlanStage::kLocal) {
      note("local_planner");
    }
  });
  bus.subscribe<ServiceStatus>(
      kServiceStatusChannel, [&](const ServiceStatus& status, const Stamp&) {
        statuses[status.name] = status;
        // These two are asked nothing that they would answer here.
        if (status.name == "command_model" || status.name == "flight_logger") {
          note(status.name);
        }
      });
  Time next;
  while (seconds_between(begin, bus.now()) < 10.0 &&
         (answered_s.size() < 5 || statuses.size() < 5)) {
    if (bus.now() >= next) {
      next = bus.now() + 0.1;
      bus.publish(kPlanRequestChannel, request, bus.now());
      bus.publish(kRouteChannel, route, bus.now());
      if (index) {
        chunk_asked = chunk_asked.value_or(bus.now());
        ChunkRequest question;
        question.ranges.push_back({index->tile_table.id, 0, 1});
        bus.publish(kChunkRequestChannel, question, bus.now());
      }
    }
    bus.poll(0.02);
  }
  std::printf("{");
  const char* comma = "";
  for (const auto& [name, status] : statuses) {
    const auto answer = answered_s.find(name);
    std::printf("%s\"%s\": {\"answered_s\": %.3f, \"rejected\": %lld, \"dropped\": %lld}", comma,
                name.c_str(), answer == answered_s.end() ? 1e9 : answer->second,
                static_cast<long long>(status.rejected_count),
                static_cast<long long>(status.drop_count));
    comma = ", ";
  }
  std::printf("}\n");
  return 0;
}
