#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace hedgehop::output {

/// Writes a recording in the MCAP format, version 0, into memory: messages in chunks without
/// compression, an index of the messages of each chunk, and a summary, each with its CRC.
///
/// Source: "MCAP File Format Specification", mcap.dev/spec.
class McapFile {
 public:
  using Entries = std::vector<std::pair<std::string, std::string>>;

  explicit McapFile(std::string_view library);

  /// A stream of JSON messages that follow a JSON schema; the name tells readers its meaning.
  /// Channels come before messages. Returns its number.
  std::uint16_t add_channel(std::string_view topic, std::string_view schema_name,
                            std::string_view schema);
  /// Keys and texts about the whole.
  void add_metadata(std::string_view name, const Entries& entries);
  /// Times of one channel must not go back [ns].
  void add_message(std::uint16_t channel, std::uint64_t time_ns, std::string_view json);

  /// The whole file; nothing may be added afterwards.
  std::string finish();

 private:
  struct Channel {
    std::string schema_record;
    std::string channel_record;
    std::uint64_t messages = 0;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> in_chunk;  // time, offset in the chunk
  };
  struct MetadataPlace {
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;
    std::string name;
  };

  void end_chunk();

  std::string file_;
  std::string chunk_;
  std::uint64_t chunk_first_ns_ = 0;
  std::uint64_t chunk_last_ns_ = 0;
  std::uint64_t first_ns_ = 0;
  std::uint64_t last_ns_ = 0;
  std::uint64_t messages_ = 0;
  std::vector<Channel> channels_;
  std::vector<std::string> chunk_indexes_;  // records of the summary
  std::vector<MetadataPlace> metadata_;
};

}  // namespace hedgehop::output
