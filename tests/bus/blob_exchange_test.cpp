#include "bus/blob_exchange.hpp"

#include <bit>
#include <cmath>
#include <cstring>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <random>

#include "base/errors.hpp"
#include "bus/map_exchange.hpp"
#include "bus/packing.hpp"
#include "messages/map_tiles.hpp"
#include "messages/message_error.hpp"
#include "support/test_map.hpp"

namespace hedgehop::bus {
namespace {

using messages::BlobRef;
using messages::Chunk;
using messages::ChunkRequest;

BlobExchangeOptions quick_options() { return {}; }

Bytes random_bytes(std::mt19937_64& random, std::size_t size) {
  Bytes bytes(size);
  for (std::byte& b : bytes) {
    b = static_cast<std::byte>(random());
  }
  return bytes;
}

/// Several exchanges on a network that loses, doubles and delays, in virtual time.
class Network {
 public:
  Network(std::uint64_t seed, double loss, double doubling, double delay_max_s)
      : random_(seed), loss_(loss), doubling_(doubling), delay_max_s_(delay_max_s) {}

  BlobExchange& add(const BlobExchangeOptions& options) {
    const auto id = static_cast<std::int64_t>(nodes_.size()) + 1;
    nodes_.push_back(std::make_unique<BlobExchange>(
        options, id,
        [this](const Chunk& chunk) {
          ++chunks_sent;
          post([chunk](BlobExchange& node) { node.receive(chunk); });
        },
        [this](const ChunkRequest& request) {
          EXPECT_LE(request.ranges.size(), messages::kMaxRangesPerRequest);
          EXPECT_FALSE(request.ranges.empty());
          ++requests_sent;
          post([request](BlobExchange& node) { node.receive(request); });
        }));
    return *nodes_.back();
  }

  /// Until `is_done` or the time is over; returns the virtual seconds that passed.
  double run(double limit_s, const std::function<bool()>& is_done) {
    const Time begin = now_;
    while (seconds_between(begin, now_) < limit_s && !is_done()) {
      now_ = now_ + 0.005;
      while (!mail_.empty() && mail_.begin()->first <= now_) {
        const auto letter = std::move(mail_.begin()->second);
        mail_.erase(mail_.begin());
        letter();
      }
      for (const auto& node : nodes_) {
        node->tick(now_);
      }
    }
    return seconds_between(begin, now_);
  }

  std::int64_t chunks_sent = 0;
  std::int64_t requests_sent = 0;

 private:
  template <typename Deliver>
  void post(const Deliver& deliver) {
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    for (const auto& node : nodes_) {
      const int copies = 1 + (unit(random_) < doubling_ ? 1 : 0);
      for (int copy = 0; copy < copies; ++copy) {
        if (unit(random_) < loss_) {
          continue;
        }
        mail_.emplace(now_ + unit(random_) * delay_max_s_,
                      [deliver, target = node.get()] { deliver(*target); });
      }
    }
  }

  std::mt19937_64 random_;
  double loss_;
  double doubling_;
  double delay_max_s_;
  Time now_{1'000'000'000};
  std::vector<std::unique_ptr<BlobExchange>> nodes_;
  std::multimap<Time, std::function<void()>> mail_;
};

std::uint64_t fresh_seed() {
  const std::uint64_t seed = std::random_device{}();
  std::cout << "seed " << seed << '\n';
  return seed;
}

TEST(BlobExchange, BlobsArriveWholeThroughLossDoublingAndDisorder) {
  const std::uint64_t seed = fresh_seed();
  std::mt19937_64 random(seed);
  for (const double loss : {0.0, 0.05, 0.3, 0.7}) {
    Network network(random(), loss, 0.3, 0.2);
    BlobExchange& sender = network.add(quick_options());
    BlobExchange& reader_1 = network.add(quick_options());
    BlobExchange& reader_2 = network.add(quick_options());
    std::vector<Bytes> contents;
    std::vector<BlobRef> refs;
    for (const std::size_t size : {0U, 1U, 1279U, 1280U, 1281U, 100'000U, 777'777U}) {
      contents.push_back(random_bytes(random, size));
      refs.push_back(sender.offer(contents.back(), false));
      reader_1.want(refs.back(), "blob");
      reader_2.want(refs.back(), "blob");
    }
    const auto is_done = [&] { return reader_1.missing().empty() && reader_2.missing().empty(); };
    network.run(300.0, is_done);
    ASSERT_TRUE(is_done()) << "loss " << loss;
    for (std::size_t i = 0; i < refs.size(); ++i) {
      ASSERT_NE(reader_1.content(refs[i].id), nullptr);
      EXPECT_EQ(*reader_1.content(refs[i].id), contents[i]);
      EXPECT_EQ(*reader_2.content(refs[i].id), contents[i]);
    }
  }
}

TEST(BlobExchange, WithoutLossEachChunkIsSentOnceForTwoReaders) {
  Network network(fresh_seed(), 0.0, 0.0, 0.002);
  BlobExchange& sender = network.add(quick_options());
  BlobExchange& reader_1 = network.add(quick_options());
  BlobExchange& reader_2 = network.add(quick_options());
  std::mt19937_64 random(1);
  const BlobRef ref = sender.offer(random_bytes(random, 500'000), false);
  reader_1.want(ref, "blob");
  reader_2.want(ref, "blob");
  const double took_s =
      network.run(10.0, [&] { return reader_1.missing().empty() && reader_2.missing().empty(); });
  EXPECT_EQ(network.chunks_sent, ref.chunk_count());
  EXPECT_EQ(network.requests_sent, 2);
  EXPECT_LT(took_s, 0.3);
}

TEST(BlobExchange, AReplayWithoutAnybodyToAnswerNeedsOnlyTheChunks) {
  // GIVEN all chunks of a blob, and a reader whose questions go nowhere
  std::vector<Chunk> chunks;
  BlobExchange sender(
      quick_options(), 1, [&](const Chunk& chunk) { chunks.push_back(chunk); },
      [](const ChunkRequest&) {});
  std::mt19937_64 random(fresh_seed());
  const Bytes content = random_bytes(random, 300'000);
  const BlobRef ref = sender.offer(content, true);
  for (int i = 0; i < 100; ++i) {
    sender.tick(Time{1'000'000 + i * 10'000});
  }
  ASSERT_EQ(chunks.size(), static_cast<std::size_t>(ref.chunk_count()));
  std::shuffle(chunks.begin(), chunks.end(), random);

  // WHEN half of them come before the blob is announced, in any order and some twice
  BlobExchange reader(
      quick_options(), 2, [](const Chunk&) {}, [](const ChunkRequest&) {});
  const std::size_t half = chunks.size() / 2;
  for (std::size_t i = 0; i < half; ++i) {
    reader.receive(chunks[i]);
    reader.receive(chunks[i / 2]);
  }
  reader.want(ref, "route");
  EXPECT_EQ(reader.missing_chunk_count(), static_cast<std::int64_t>(chunks.size() - half));
  EXPECT_EQ(reader.content(ref.id), nullptr);
  for (std::size_t i = half; i < chunks.size(); ++i) {
    reader.receive(chunks[i]);
  }

  // THEN it is complete
  ASSERT_NE(reader.content(ref.id), nullptr);
  EXPECT_EQ(*reader.content(ref.id), content);
}

TEST(BlobExchange, AMissingChunkIsNamed) {
  std::vector<Chunk> chunks;
  BlobExchange sender(
      quick_options(), 1, [&](const Chunk& chunk) { chunks.push_back(chunk); },
      [](const ChunkRequest&) {});
  std::mt19937_64 random(7);
  const BlobRef ref = sender.offer(random_bytes(random, 15'000), true);
  sender.tick(Time{1'000'000});
  ASSERT_EQ(chunks.size(), 12U);
  BlobExchange reader(
      quick_options(), 2, [](const Chunk&) {}, [](const ChunkRequest&) {});
  reader.want(ref, "tile of layer surface, column 3, row 0");
  for (const Chunk& chunk : chunks) {
    if (chunk.number != 4 && chunk.number != 7 && chunk.number != 8) {
      reader.receive(chunk);
    }
  }
  ASSERT_EQ(reader.missing().size(), 1U);
  EXPECT_EQ(to_text(reader.missing()[0]), "tile of layer surface, column 3, row 0 (blob " +
                                              ref.id.hex().substr(0, 8) +
                                              "): 3 of 12 chunks missing: 4, 7-8");
}

TEST(BlobExchange, QuestionsGrowRareWhileNobodyAnswersAndComeBackWithNewWishes) {
  std::vector<Time> asked;
  Time now{1'000'000'000};
  BlobExchange reader(
      quick_options(), 5, [](const Chunk&) {}, [&](const ChunkRequest&) { asked.push_back(now); });
  reader.want({{1, 2}, 5000, 9000}, "route");
  for (int i = 0; i < 20'000; ++i) {  // 100 s
    now = now + 0.005;
    reader.tick(now);
  }
  // At 2 s to 3 s a question after the first few: 34 to 55.
  EXPECT_GE(asked.size(), 34U);
  EXPECT_LE(asked.size(), 60U);
  reader.want({{3, 4}, 5000, 9000}, "another");
  const std::size_t before = asked.size();
  for (int i = 0; i < 100; ++i) {  // 0.5 s
    now = now + 0.005;
    reader.tick(now);
  }
  EXPECT_GT(asked.size(), before);
}

TEST(BlobExchange, SendingKeepsItsPace) {
  std::int64_t bytes = 0;
  BlobExchangeOptions options = quick_options();
  options.send_rate_bytesps = 1e6;
  options.send_burst_bytes = 50'000.0;
  BlobExchange sender(
      options, 1,
      [&](const Chunk& chunk) { bytes += static_cast<std::int64_t>(chunk.piece.size()); },
      [](const ChunkRequest&) {});
  std::mt19937_64 random(7);
  sender.offer(random_bytes(random, 4'000'000), true);
  Time now{1'000'000};
  sender.tick(now);
  EXPECT_LE(bytes, 50'000);
  for (int i = 0; i < 200; ++i) {
    now = now + 0.005;
    sender.tick(now);
  }
  // One second at 1 MB/s less the share of headers, and the first burst.
  EXPECT_LE(bytes, 1'050'000);
  EXPECT_GE(bytes, 900'000);
}

TEST(BlobExchange, AForgedChunkIsFoundOutAndTheBlobAskedForAgain) {
  std::vector<Chunk> chunks;
  BlobExchange sender(
      quick_options(), 1, [&](const Chunk& chunk) { chunks.push_back(chunk); },
      [](const ChunkRequest&) {});
  std::mt19937_64 random(7);
  const Bytes content = random_bytes(random, 10'000);
  const BlobRef ref = sender.offer(content, true);
  sender.tick(Time{1'000'000});
  BlobExchange reader(
      quick_options(), 2, [](const Chunk&) {}, [](const ChunkRequest&) {});
  reader.want(ref, "route");
  Chunk forged = chunks[3];
  forged.piece[100] ^= std::byte{1};
  reader.receive(forged);
  for (const Chunk& chunk : chunks) {
    reader.receive(chunk);
  }
  EXPECT_FALSE(reader.is_complete(ref.id));
  EXPECT_EQ(reader.missing_chunk_count(), ref.chunk_count());
  for (const Chunk& chunk : chunks) {
    reader.receive(chunk);
  }
  ASSERT_TRUE(reader.is_complete(ref.id));
  EXPECT_EQ(*reader.content(ref.id), content);
}

TEST(BlobExchange, UnclaimedChunksStayWithinTheirMemory) {
  BlobExchangeOptions options = quick_options();
  options.unclaimed_bytes_max = 100'000;
  BlobExchange reader(
      options, 2, [](const Chunk&) {}, [](const ChunkRequest&) {});
  const auto chunk_of = [](std::uint64_t blob, std::int32_t number) {
    Chunk chunk;
    chunk.blob_id = {blob, 1};
    chunk.packed_bytes = 64LL << 20;
    chunk.number = number;
    chunk.piece.resize(static_cast<std::size_t>(messages::kChunkBytes));
    return chunk;
  };
  for (std::uint64_t blob = 1; blob <= 10'000; ++blob) {
    reader.receive(chunk_of(blob, static_cast<std::int32_t>(blob % 50'000)));
  }
  // 1400 bytes each: the last 71 remain, the older ones have made room.
  reader.want({{10'000, 1}, 64LL << 20, 100}, "newest");
  EXPECT_EQ(reader.missing()[0].missing_count, reader.missing()[0].chunk_count - 1);
  reader.want({{1, 1}, 64LL << 20, 100}, "oldest");
  EXPECT_EQ(reader.missing()[1].missing_count, reader.missing()[1].chunk_count);
}

TEST(BlobExchange, WishesBeyondTheMemoryAreRefused) {
  BlobExchangeOptions options = quick_options();
  options.kept_bytes_max = 1'000'000;
  BlobExchange reader(
      options, 2, [](const Chunk&) {}, [](const ChunkRequest&) {});
  reader.want({{1, 1}, 900'000, 1}, "first");
  EXPECT_THROW(reader.want({{2, 1}, 200'000, 1}, "second"), messages::MessageError);
  reader.forget({1, 1});
  EXPECT_NO_THROW(reader.want({{2, 1}, 200'000, 1}, "second"));
}

TEST(BlobExchange, WhatIsOfferedHereNeedsNoTransfer) {
  BlobExchange both(
      quick_options(), 2, [](const Chunk&) {}, [](const ChunkRequest&) {});
  const Bytes content(5000, std::byte{7});
  const BlobRef ref = both.offer(content, false);
  both.want(ref, "own");
  ASSERT_NE(both.content(ref.id), nullptr);
  EXPECT_EQ(*both.content(ref.id), content);
  EXPECT_EQ(both.missing_chunk_count(), 0);
}

TEST(Packing, ComesBackAndClaimsAreChecked) {
  std::mt19937_64 random(fresh_seed());
  for (const std::size_t size : {0U, 1U, 100'000U}) {
    const Bytes content = random_bytes(random, size);
    const Bytes packed = pack(content);
    EXPECT_EQ(unpack(packed, static_cast<std::int64_t>(size)), content);
    EXPECT_THROW(unpack(packed, static_cast<std::int64_t>(size) + 1), messages::MessageError);
    Bytes cut = packed;
    cut.pop_back();
    EXPECT_THROW(unpack(cut, static_cast<std::int64_t>(size)), messages::MessageError);
  }
  EXPECT_THROW(unpack(Bytes(), 0), messages::MessageError);
  EXPECT_THROW(unpack(random_bytes(random, 100), 1LL << 60), messages::MessageError);
}

void append_big_endian(Bytes& bytes, double value) {
  const auto word = std::bit_cast<std::uint64_t>(value);
  for (int shift = 56; shift >= 0; shift -= 8) {
    bytes.push_back(static_cast<std::byte>(word >> shift));
  }
}

TEST(Packing, RecordsComeBackBitForBitWhateverTheyHold) {
  std::mt19937_64 random(fresh_seed());
  const std::vector<double> odd = {0.0,
                                   -0.0,
                                   1.0,
                                   -1.0,
                                   std::numeric_limits<double>::infinity(),
                                   -std::numeric_limits<double>::infinity(),
                                   std::numeric_limits<double>::quiet_NaN(),
                                   std::numeric_limits<double>::denorm_min(),
                                   std::numeric_limits<double>::lowest()};
  for (const std::size_t record_bytes : {8U, 24U, 152U, 4096U}) {
    for (const std::size_t size : {0U, 5U, 8U, 4096U, 50'003U}) {
      Bytes content = random_bytes(random, size);
      for (std::size_t i = 0; i < size / 20; ++i) {
        append_big_endian(content, odd[random() % odd.size()]);
      }
      EXPECT_EQ(
          unpack(pack_records(content, record_bytes), static_cast<std::int64_t>(content.size())),
          content)
          << record_bytes << " and " << content.size();
    }
  }
}

TEST(Packing, SmoothRecordsBecomeHalfAsLongAsByCompressionAlone) {
  std::mt19937_64 random(fresh_seed());
  std::uniform_real_distribution<double> phase_rad(0.0, 6.28);
  const double first_rad = phase_rad(random);
  const double second_rad = phase_rad(random);
  Bytes content = random_bytes(random, 77);
  for (int step = 0; step < 5000; ++step) {
    const double time_s = 0.05 * step;
    append_big_endian(content, 690'000.0 + 3000.0 * std::sin(0.02 * time_s + first_rad));
    append_big_endian(content, 0.5 * std::cos(0.3 * time_s + second_rad));
  }
  const Bytes packed = pack_records(content, 16);
  EXPECT_LT(packed.size() * 2, pack(content).size());
  EXPECT_EQ(unpack(packed, static_cast<std::int64_t>(content.size())), content);
}

TEST(Packing, RecordsAreReadAsTheFormatSays) {
  // One byte before four records of the number 1.0, a = 0xBFF0... in the floats' order; the
  // sequence 0, 0, 0, a, a, a, a has the third differences a, -2a, a, 0, folded to 0x801FFF...,
  // 0xFFBFFF..., 0x801FFF..., 0. The frame holds them uncompressed.
  std::vector<int> numbers = {'H',
                              'R',
                              '3',
                              'D',
                              0,
                              0,
                              0,
                              8,  // eight bytes a record
                              0x28,
                              0xB5,
                              0x2F,
                              0xFD,
                              0x20,
                              33,  // content size 33
                              (33 << 3 | 1) & 255,
                              (33 << 3 | 1) >> 8,
                              0,
                              0x5A};
  for (int plane = 0; plane < 6; ++plane) {
    numbers.insert(numbers.end(), {0xFF, 0xFF, 0xFF, 0x00});
  }
  numbers.insert(numbers.end(), {0x1F, 0xBF, 0x1F, 0x00, 0x80, 0xFF, 0x80, 0x00});
  Bytes packed;
  for (const int number : numbers) {
    packed.push_back(static_cast<std::byte>(number));
  }
  Bytes content(1, std::byte{0x5A});
  for (int i = 0; i < 4; ++i) {
    append_big_endian(content, 1.0);
  }
  EXPECT_EQ(unpack(packed, 33), content);

  for (const int record_bytes : {0, 7, 12}) {
    packed[7] = static_cast<std::byte>(record_bytes);
    EXPECT_THROW(unpack(packed, 33), messages::MessageError) << record_bytes;
    EXPECT_THROW(pack_records(content, static_cast<std::size_t>(record_bytes)),
                 std::invalid_argument);
  }
  packed[7] = std::byte{0};
  packed[6] = std::byte{0x20};  // 8192 bytes
  EXPECT_THROW(unpack(packed, 33), messages::MessageError);
  packed.resize(7);
  EXPECT_THROW(unpack(packed, 33), messages::MessageError);
}

// ----------------------------------------------------------------------------------------------

map::Map random_map(std::mt19937_64& random, int columns, int rows) {
  std::uniform_real_distribution<double> height(-400.0, 4000.0);
  map::Map map =
      test::make_map(columns, rows, 30.0, [&](double, double) { return height(random); });
  map.crs_wkt = "PROJCRS[\"some\"]";
  map.label = "SYNTHETIC";
  map.attributions = {"first line", "second line"};
  map.overhead_lines = {{5, {{{10.0, 20.0}, 30.0}, {{40.5, 50.0}, 25.0}}},
                        {-6, {{{1.0, 2.0}, 3.0}, {{4.0, 5.0}, 6.0}, {{7.0, 8.0}, 9.0}}}};
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      map.surface_m.at(column, row) += static_cast<float>(random() % 100) / 64.0F;
      map.semantics.at(column, row) = static_cast<std::uint16_t>(random() % 5);
      map.visibility.at(column, row) = static_cast<std::uint16_t>(random());
    }
  }
  for (const double height_m : {4.5, 60.0}) {
    map.further_visibility.push_back({height_m, map.visibility});
    for (std::uint16_t& share : map.further_visibility.back().share.values()) {
      share = static_cast<std::uint16_t>(random());
    }
  }
  map.terrain_m.at(1, 1) = map.surface_m.at(1, 1) = std::numeric_limits<float>::quiet_NaN();
  map.terrain_m.at(2, 1) = -0.0F;
  map.surface_m.at(2, 1) = 0.0F;
  test::finish_map(map);
  return map;
}

void expect_same_map(const map::Map& a, const map::Map& b) {
  EXPECT_EQ(a.hash, b.hash);
  EXPECT_EQ(map::map_hash(a), b.hash);
  ASSERT_EQ(a.geometry, b.geometry);
  const std::size_t cells = a.geometry.cell_count();
  EXPECT_EQ(std::memcmp(a.terrain_m.row(0), b.terrain_m.row(0), cells * 4), 0);
  EXPECT_EQ(std::memcmp(a.surface_m.row(0), b.surface_m.row(0), cells * 4), 0);
  EXPECT_EQ(a.semantics.values(), b.semantics.values());
  EXPECT_EQ(a.visibility.values(), b.visibility.values());
  ASSERT_EQ(a.further_visibility.size(), b.further_visibility.size());
  for (std::size_t i = 0; i < a.further_visibility.size(); ++i) {
    EXPECT_EQ(a.further_visibility[i].height_m, b.further_visibility[i].height_m);
    EXPECT_EQ(a.further_visibility[i].share.values(), b.further_visibility[i].share.values());
  }
}

TEST(MapExchange, TheMapArrivesBitForBitThroughLoss) {
  const std::uint64_t seed = fresh_seed();
  std::mt19937_64 random(seed);
  for (const auto& [columns, rows, tile_cells] :
       {std::tuple{100, 70, 32}, std::tuple{64, 64, 64}, std::tuple{17, 33, 16}}) {
    const map::Map map = random_map(random, columns, rows);
    Network network(random(), 0.2, 0.2, 0.1);
    BlobExchange& tiler = network.add(quick_options());
    BlobExchange& planner = network.add(quick_options());
    const messages::MapIndex index = offer_map(map, tile_cells, tiler);
    MapAssembly assembly(planner);
    EXPECT_EQ(assembly.missing(), "no MAP_INDEX heard");
    assembly.receive(index);
    network.run(60.0, [&] {
      assembly.receive(index);  // comes every second
      assembly.tick();
      return assembly.map() != nullptr || !assembly.refusal().empty();
    });
    ASSERT_NE(assembly.map(), nullptr) << assembly.missing();
    expect_same_map(*assembly.map(), map);
    EXPECT_EQ(assembly.missing(), "");
    EXPECT_EQ(planner.missing_chunk_count(), 0);
  }
}

TEST(MapExchange, AMissingTileIsNamedByLayerColumnAndRow) {
  std::mt19937_64 random(3);
  const map::Map map = random_map(random, 100, 70);
  std::vector<Chunk> chunks;
  BlobExchange tiler(
      quick_options(), 1, [&](const Chunk& chunk) { chunks.push_back(chunk); },
      [](const ChunkRequest&) {});
  const messages::MapIndex index = offer_map(map, 32, tiler);
  const BlobRef lost =
      tiler.offer(messages::encode_map_tile(map, 32, {messages::MapLayer::kSurface, 2, 1}), false);
  BlobExchange planner(
      quick_options(), 2, [](const Chunk&) {},
      [&](const ChunkRequest& request) { tiler.receive(request); });
  MapAssembly assembly(planner);
  assembly.receive(index);
  Time now{1'000'000'000};
  for (int i = 0; i < 2000; ++i) {
    now = now + 0.005;
    planner.tick(now);
    tiler.tick(now);
    for (const Chunk& chunk : chunks) {
      if (chunk.blob_id != lost.id || chunk.number != 1) {
        planner.receive(chunk);
      }
    }
    chunks.clear();
    assembly.tick();
  }
  EXPECT_EQ(assembly.map(), nullptr);
  EXPECT_THAT(assembly.missing(),
              testing::AllOf(testing::HasSubstr("layer surface, tile column 2, tile row 1"),
                             testing::HasSubstr("chunks missing: 1")));
}

TEST(MapExchange, AMapThatIsNotWhatTheIndexSaysIsRefused) {
  std::mt19937_64 random(3);
  const map::Map map = random_map(random, 40, 40);
  Network network(1, 0.0, 0.0, 0.001);
  BlobExchange& tiler = network.add(quick_options());
  BlobExchange& planner = network.add(quick_options());
  messages::MapIndex index = offer_map(map, 32, tiler);
  index.geometry.west_m += 1.0;  // a shifted map has another hash
  MapAssembly assembly(planner);
  assembly.receive(index);
  network.run(20.0, [&] {
    assembly.tick();
    return !assembly.refusal().empty();
  });
  EXPECT_THAT(assembly.refusal(), testing::HasSubstr("hash"));
  EXPECT_EQ(assembly.map(), nullptr);

  // The right index makes it good.
  index.geometry.west_m -= 1.0;
  assembly.receive(index);
  network.run(20.0, [&] {
    assembly.tick();
    return assembly.map() != nullptr;
  });
  ASSERT_NE(assembly.map(), nullptr);
  expect_same_map(*assembly.map(), map);
}

TEST(MapExchange, TwoTilersOnOneBusDoNotKeepAMapFromArriving) {
  std::mt19937_64 random(3);
  const map::Map first = random_map(random, 60, 60);
  const map::Map second = random_map(random, 60, 60);
  Network network(1, 0.1, 0.0, 0.01);
  BlobExchange& tiler = network.add(quick_options());
  BlobExchange& planner = network.add(quick_options());
  const messages::MapIndex index_1 = offer_map(first, 32, tiler);
  const messages::MapIndex index_2 = offer_map(second, 32, tiler);
  MapAssembly assembly(planner);
  network.run(10.0, [&] {
    assembly.receive(index_1);
    assembly.tick();
    if (assembly.map() == nullptr) {
      assembly.receive(index_2);
    }
    return assembly.map() != nullptr;
  });
  ASSERT_NE(assembly.map(), nullptr);
  EXPECT_EQ(assembly.map()->hash, first.hash);
}

TEST(MapExchange, AMapWhoseTilerHasGoneGivesWay) {
  std::mt19937_64 random(3);
  const map::Map first = random_map(random, 60, 60);
  const map::Map second = random_map(random, 60, 60);
  BlobExchange gone(
      quick_options(), 7, [](const Chunk&) {}, [](const ChunkRequest&) {});
  Network network(1, 0.1, 0.0, 0.01);
  BlobExchange& tiler = network.add(quick_options());
  BlobExchange& planner = network.add(quick_options());
  MapAssembly assembly(planner);
  assembly.receive(offer_map(first, 32, gone));
  const messages::MapIndex index = offer_map(second, 32, tiler);
  int heard = 0;
  network.run(10.0, [&] {
    if (++heard <= 3) {
      assembly.receive(index);
    }
    assembly.tick();
    return assembly.map() != nullptr;
  });
  ASSERT_NE(assembly.map(), nullptr);
  EXPECT_EQ(assembly.map()->hash, second.hash);
}

TEST(MapExchange, ANewMapReplacesTheOldOneOnceItIsWhole) {
  std::mt19937_64 random(3);
  const map::Map first = random_map(random, 40, 40);
  const map::Map second = random_map(random, 50, 30);
  Network network(1, 0.1, 0.0, 0.01);
  BlobExchange& tiler = network.add(quick_options());
  BlobExchange& planner = network.add(quick_options());
  MapAssembly assembly(planner);
  assembly.receive(offer_map(first, 32, tiler));
  const auto until = [&](const map::Map& map) {
    network.run(30.0, [&] {
      assembly.tick();
      return assembly.map() != nullptr && assembly.map()->hash == map.hash;
    });
  };
  until(first);
  ASSERT_NE(assembly.map(), nullptr);
  const std::shared_ptr<const map::Map> held = assembly.map();
  assembly.receive(offer_map(second, 32, tiler));
  EXPECT_EQ(assembly.map()->hash, first.hash);
  until(second);
  expect_same_map(*assembly.map(), second);
  expect_same_map(*held, first);
}

TEST(MapExchange, OfAMapThatChangesInOneCellOnlyThatTileTravels) {
  std::mt19937_64 random(3);
  const auto first = std::make_shared<const map::Map>(random_map(random, 100, 70));
  auto second = std::make_shared<map::Map>(*first);
  second->visibility.at(40, 10) ^= 1;
  second->hash = map_hash(*second);
  Network network(1, 0.1, 0.0, 0.01);
  BlobExchange& tiler = network.add(quick_options());
  BlobExchange& planner = network.add(quick_options());
  MapAssembly assembly(planner);
  MapOffer offer(32, tiler);
  const auto until = [&](const map::Map& map) {
    network.run(30.0, [&] {
      assembly.tick();
      return assembly.map() != nullptr && assembly.map()->hash == map.hash;
    });
    ASSERT_NE(assembly.map(), nullptr);
    expect_same_map(*assembly.map(), map);
  };
  constexpr std::int64_t kTiler = 7;
  assembly.receive(offer.offer(first), kTiler);
  until(*first);
  EXPECT_EQ(assembly.patch_number(), 0);
  const std::int64_t whole = tiler.sent_chunk_count();
  messages::MapIndex index = offer.offer(second);
  index.patch_number = 1;
  assembly.receive(index, kTiler);
  EXPECT_EQ(assembly.patch_number(), 0);
  until(*second);
  EXPECT_EQ(assembly.patch_number(), 1);
  EXPECT_LT(tiler.sent_chunk_count() - whole, whole / 4);
  // And back: the same bytes as at the beginning.
  index = offer.offer(first);
  index.patch_number = 2;
  assembly.receive(index, kTiler);
  until(*first);
  EXPECT_EQ(assembly.patch_number(), 2);
}

TEST(MapExchange, AChangeWhileAMapIsCollectedLosesNothingThatHasArrived) {
  std::mt19937_64 random(3);
  const auto first = std::make_shared<const map::Map>(random_map(random, 100, 70));
  auto second = std::make_shared<map::Map>(*first);
  second->visibility.at(40, 10) ^= 1;
  second->hash = map_hash(*second);
  Network network(1, 0.0, 0.0, 0.0);
  BlobExchange& tiler = network.add(quick_options());
  BlobExchange& planner = network.add(quick_options());
  MapAssembly assembly(planner);
  MapOffer offer(32, tiler);
  constexpr std::int64_t kTiler = 7;
  assembly.receive(offer.offer(first), kTiler);
  std::int64_t sent = 0;
  network.run(30.0, [&] {
    assembly.tick();
    sent = tiler.sent_chunk_count();
    return sent > 12;
  });
  assembly.receive(offer.offer(second), kTiler);
  network.run(30.0, [&] {
    assembly.tick();
    return assembly.map() != nullptr;
  });
  ASSERT_NE(assembly.map(), nullptr);
  expect_same_map(*assembly.map(), *second);
  // About as much as for one map alone.
  Network quiet(1, 0.0, 0.0, 0.0);
  BlobExchange& other_tiler = quiet.add(quick_options());
  MapAssembly other(quiet.add(quick_options()));
  other.receive(offer_map(*second, 32, other_tiler), kTiler);
  quiet.run(30.0, [&] {
    other.tick();
    return other.map() != nullptr;
  });
  EXPECT_LT(tiler.sent_chunk_count(), other_tiler.sent_chunk_count() * 5 / 4 + sent);
  EXPECT_GT(sent, 12);
}

TEST(MapExchange, AWholeMapStaysWhileAnotherTilerOffersAnotherOneAndNamesIt) {
  std::mt19937_64 random(3);
  const map::Map first = random_map(random, 60, 60);
  const map::Map second = random_map(random, 60, 60);
  Network network(1, 0.0, 0.0, 0.01);
  BlobExchange& tiler = network.add(quick_options());
  BlobExchange& planner = network.add(quick_options());
  const messages::MapIndex index_1 = offer_map(first, 32, tiler);
  const messages::MapIndex index_2 = offer_map(second, 32, tiler);
  MapAssembly assembly(planner);
  assembly.receive(index_1, 7);
  network.run(10.0, [&] {
    assembly.tick();
    return assembly.map() != nullptr;
  });
  for (int i = 0; i < 20; ++i) {
    assembly.receive(index_2, 8);
    assembly.receive(index_1, 7);
    assembly.tick();
    ASSERT_TRUE(assembly.rival().has_value());
    EXPECT_EQ(assembly.rival()->map_hash, second.hash);
    EXPECT_EQ(assembly.index()->map_hash, first.hash);
    EXPECT_EQ(assembly.map()->hash, first.hash);
  }
  // Alone again, then gone.
  for (int i = 0; i < 3; ++i) {
    assembly.receive(index_1, 7);
  }
  EXPECT_FALSE(assembly.rival().has_value());
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(assembly.index()->map_hash, first.hash);
    assembly.receive(index_2, 8);
  }
  EXPECT_EQ(assembly.index()->map_hash, second.hash);
}

// ----------------------------------------------------------------------------------------------
// Named observers

void add_observer(std::mt19937_64& random, const std::string& name, map::Map& map) {
  map::HeightLayer& layer = map.threats.emplace_back();
  layer.name = name;
  layer.height_m = raster::Grid<float>(map.geometry, std::nanf(""));
  for (float& height_m : layer.height_m.values()) {
    if (random() % 3 != 0) {
      height_m = static_cast<float>(random() % 20000) / 64.0F;
    }
  }
  test::finish_map(map);
}

map::Map watched_map(std::mt19937_64& random, int columns, int rows) {
  map::Map map = random_map(random, columns, rows);
  add_observer(random, "tower", map);
  add_observer(random, "hill \xC3\xBC", map);
  return map;
}

void expect_same_observers(const map::Map& a, const map::Map& b) {
  ASSERT_EQ(a.threats.size(), b.threats.size());
  for (std::size_t i = 0; i < a.threats.size(); ++i) {
    EXPECT_EQ(a.threats[i].name, b.threats[i].name);
    EXPECT_EQ(std::memcmp(a.threats[i].height_m.row(0), b.threats[i].height_m.row(0),
                          4 * a.geometry.cell_count()),
              0);
  }
}

// A tiler and a planner, and the planner's map.
class WatchedMapExchange : public testing::Test {
 protected:
  void receive(const messages::MapIndex& index) {
    constexpr std::int64_t kTiler = 7;
    index_ = index;
    assembly_.receive(index, kTiler);
  }
  bool run_until(const std::function<bool()>& is_reached) {
    network_.run(60.0, [&] {
      assembly_.receive(index_, 7);
      assembly_.tick();
      return is_reached();
    });
    return is_reached();
  }
  bool collect(const Hash128& hash) {
    return run_until([&] { return assembly_.map_of(hash) != nullptr; });
  }

  std::mt19937_64 random_{3};
  Network network_{1, 0.1, 0.1, 0.01};
  BlobExchange& tiler_ = network_.add(quick_options());
  BlobExchange& planner_ = network_.add(quick_options());
  MapAssembly assembly_{planner_};
  messages::MapIndex index_;
};

TEST_F(WatchedMapExchange, NamedObserversTravelOnceSomebodyNeedsThemAndArriveBitForBit) {
  const map::Map map = watched_map(random_, 100, 70);
  map::Map bare = map;
  bare.threats.clear();
  test::finish_map(bare);
  const messages::MapIndex index = offer_map(map, 32, tiler_);
  EXPECT_EQ(index.map_hash, bare.hash);
  ASSERT_TRUE(index.threats.has_value());
  EXPECT_EQ(index.threats->count, 2);
  EXPECT_EQ(index.threats->map_hash, map.hash);
  receive(index);
  assembly_.need(bare.hash);
  ASSERT_TRUE(collect(bare.hash));
  expect_same_map(*assembly_.map(), bare);
  EXPECT_TRUE(assembly_.map()->threats.empty());
  EXPECT_EQ(assembly_.missing(), "");
  EXPECT_EQ(assembly_.map_with_threats(), nullptr);
  EXPECT_FALSE(assembly_.lacks_only_threats());
  EXPECT_FALSE(planner_.is_complete(index.threats->table.id));

  assembly_.need(map.hash);
  assembly_.tick();
  EXPECT_TRUE(assembly_.lacks_only_threats());
  EXPECT_THAT(assembly_.missing(), testing::HasSubstr("table of named observers"));
  ASSERT_TRUE(collect(map.hash));
  const auto with = assembly_.map_of(map.hash);
  EXPECT_EQ(assembly_.map_with_threats(), with);
  expect_same_map(*with, map);
  expect_same_observers(*with, map);
  EXPECT_EQ(assembly_.map()->hash, bare.hash);
  EXPECT_EQ(assembly_.missing(), "");
  EXPECT_EQ(planner_.missing_chunk_count(), 0);
}

TEST_F(WatchedMapExchange, WhatIsNeededBeforeAnIndexIsHeardIsCollectedToo) {
  const map::Map map = watched_map(random_, 40, 40);
  assembly_.need(map.hash);
  receive(offer_map(map, 32, tiler_));
  EXPECT_TRUE(collect(map.hash));
}

TEST_F(WatchedMapExchange, OfAnObserverWhoAppearsOnlyItsOwnTilesTravel) {
  const auto first = std::make_shared<const map::Map>(watched_map(random_, 100, 70));
  auto second = std::make_shared<map::Map>(*first);
  add_observer(random_, "", *second);
  MapOffer offer(32, tiler_);
  receive(offer.offer(first));
  assembly_.need(first->hash);
  ASSERT_TRUE(collect(first->hash));
  const std::int64_t before = tiler_.sent_chunk_count();

  receive(offer.offer(second));
  ASSERT_TRUE(collect(second->hash));
  expect_same_observers(*assembly_.map_with_threats(), *second);
  // One layer of 28,000 bytes that do not pack; loss is asked for again.
  EXPECT_LT(tiler_.sent_chunk_count() - before, 2 * 28000 / messages::kChunkBytes);

  // And gone again.
  receive(offer.offer(first));
  ASSERT_TRUE(run_until([&] {
    const auto with = assembly_.map_with_threats();
    return with && with->hash == first->hash;
  }));
  expect_same_observers(*assembly_.map_with_threats(), *first);
  EXPECT_EQ(planner_.missing_chunk_count(), 0);
}

TEST_F(WatchedMapExchange, AnObserverWhoGoesWhileItsTilesAreCollectedLeavesNoQuestions) {
  const auto first = std::make_shared<const map::Map>(watched_map(random_, 100, 70));
  auto bare = std::make_shared<map::Map>(*first);
  bare->threats.clear();
  test::finish_map(*bare);
  MapOffer offer(32, tiler_);
  receive(offer.offer(first));
  assembly_.need(first->hash);
  ASSERT_TRUE(
      run_until([&] { return assembly_.missing().find("layer observer") != std::string::npos; }));
  receive(offer.offer(bare));
  EXPECT_EQ(assembly_.missing(), "");
  EXPECT_EQ(planner_.missing_chunk_count(), 0);
  EXPECT_EQ(assembly_.map_with_threats(), nullptr);
}

TEST_F(WatchedMapExchange, ObserversThatAreNotWhatTheIndexSaysAreRefusedAndTheMapStays) {
  const map::Map map = watched_map(random_, 40, 40);
  const messages::MapIndex honest = offer_map(map, 32, tiler_);
  const auto expect_refused = [&](const messages::MapIndex& index, const std::string& why) {
    receive(index);
    assembly_.need(index.threats->map_hash);
    ASSERT_TRUE(run_until([&] { return !assembly_.refusal().empty(); }));
    EXPECT_THAT(assembly_.refusal(), testing::HasSubstr(why));
    EXPECT_THAT(assembly_.missing(), testing::HasSubstr(why));
    ASSERT_NE(assembly_.map(), nullptr);
    EXPECT_EQ(assembly_.map()->hash, honest.map_hash);
    EXPECT_EQ(assembly_.map_with_threats(), nullptr);
    EXPECT_EQ(planner_.missing_chunk_count(), 0);
  };
  messages::MapIndex other_count = honest;
  other_count.threats->count = 1;
  expect_refused(other_count, "num_threats");
  messages::MapIndex other_hash = honest;
  other_hash.threats->map_hash = {1, 2};
  expect_refused(other_hash, "map_hash");
  messages::MapIndex other_blob = honest;
  other_blob.threats->table = honest.features;
  expect_refused(other_blob, "fingerprint");
  // Tiles that are whole, but of other observers than the hash says.
  map::Map swapped = map;
  std::swap(swapped.threats[0].height_m, swapped.threats[1].height_m);
  expect_refused(offer_map(swapped, 32, tiler_), "content does not match its hash");
  map::Map below = map;
  below.threats[1].height_m.at(5, 6) = -2.0F;
  test::finish_map(below);
  expect_refused(offer_map(below, 32, tiler_), "holds -2 m at column 5, row 6");

  receive(honest);
  ASSERT_TRUE(collect(map.hash));
  expect_same_observers(*assembly_.map_with_threats(), map);
}

TEST(MapExchange, MoreObserversThanTheBusCarriesAreRefusedByTheirTiler) {
  BlobExchange tiler(
      quick_options(), 1, [](const Chunk&) {}, [](const ChunkRequest&) {});
  map::Map map = test::make_map(20, 20, 30.0, [](double, double) { return 1.0; });
  map.threats.assign(100, {"tower", raster::Grid<float>(map.geometry, 3.0F)});
  test::finish_map(map);
  EXPECT_EQ(offer_map(map, 32, tiler).threats->count, 100);
  map.threats.push_back(map.threats[0]);
  test::finish_map(map);
  try {
    offer_map(map, 32, tiler);
    FAIL() << "101 observers";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("101 named observers"));
    EXPECT_THAT(error.hint(), testing::HasSubstr("--observers"));
  }
  map.threats.resize(1);
  map.threats[0].name.assign(201, 'x');
  test::finish_map(map);
  EXPECT_THROW(offer_map(map, 32, tiler), UsageError);
}

TEST(NewestIndex, TheSameMapWithOtherObserversIsAnotherOne) {
  messages::MapIndex index;
  index.map_hash = {1, 2};
  NewestIndex newest;
  newest.hear(index, 7);
  messages::MapIndex other = index;
  other.threats = messages::ThreatLayers{1, {3, 4}, {}};
  for (int i = 0; i < 2; ++i) {
    newest.hear(other, 8);
    EXPECT_FALSE(newest.index()->threats.has_value());
  }
  newest.hear(other, 8);
  EXPECT_EQ(newest.index()->hash_for(true), (Hash128{3, 4}));
}

}  // namespace
}  // namespace hedgehop::bus
