#include <cstdio>
#include <cstdlib>
#include <thread>

#include "bus/bus.hpp"
#include "messages/channels.hpp"

// flood URL COUNT PAUSE_US_PER_1000: publishes COUNT messages as fast as it goes, or slower.
int main(int argc, char** argv) {
  using namespace hedgehop;
  if (argc != 4) {
    return 2;
  }
  bus::Bus bus({.url = argv[1], .channel_prefix = {}});
  const std::int64_t count = std::atoll(argv[2]);
  const std::chrono::microseconds pause(std::atoll(argv[3]));
  const auto begin = std::chrono::steady_clock::now();
  for (std::int64_t i = 0; i < count; ++i) {
    bus.publish(messages::kPlanCancelChannel, messages::PlanCancel{{1, 2}}, bus.now());
    if (i % 1000 == 999) {
      std::this_thread::sleep_for(pause);
    }
  }
  std::printf("%.0f\n",
              static_cast<double>(count) /
                  std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  return 0;
}
