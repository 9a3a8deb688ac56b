// Writes a log with one example of each channel, and prints what a reader must find in it:
// "CHANNEL type utime sender_id seq".
#include <iostream>

#include "bus/event_log.hpp"
#include "bus/service.hpp"
#include "support/example_messages.hpp"

int main(int argc, char** argv) {
  using namespace hedgehop;
  return bus::run_main("example_log", [&] {
    if (argc != 2) {
      throw UsageError("usage: example_log FILE");
    }
    bus::EventLogWriter writer(argv[1], true, 1.0);
    const messages::Stamp& stamp = test::kExampleStamp;
    for (const auto& [channel, bytes] : test::example_of_each_channel()) {
      writer.write(stamp.time, channel, bytes);
      for (const messages::ChannelType& type : messages::kChannelTypes) {
        if (type.channel == channel) {
          std::cout << channel << ' ' << type.type << ' ' << stamp.time.utime_us << ' '
                    << stamp.sender_id << ' ' << stamp.seq << '\n';
        }
      }
    }
    return 0;
  });
}
