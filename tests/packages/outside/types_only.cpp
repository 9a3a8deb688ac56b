// Publishes and decodes a message with LCM itself and the installed types.
#include <cstdio>
#include <hedgehop/plan_cancel_t.hpp>
#include <lcm/lcm-cpp.hpp>

struct Listener {
  hedgehop::plan_cancel_t heard;
  int count = 0;
  void receive(const lcm::ReceiveBuffer*, const std::string&, const hedgehop::plan_cancel_t* m) {
    heard = *m;
    ++count;
  }
};

int main() {
  lcm::LCM lcm("memq://");
  Listener listener;
  lcm.subscribe("PLAN_CANCEL", &Listener::receive, &listener);
  hedgehop::plan_cancel_t sent{};
  sent.utime = 1234567;
  sent.seq = 42;
  if (!lcm.good() || lcm.publish("PLAN_CANCEL", &sent) != 0 || lcm.handleTimeout(5000) <= 0) {
    return 1;
  }
  // A cut message must be refused, as in hedgehop itself.
  unsigned char bytes[400];
  const int length = sent.encode(bytes, 0, sizeof bytes);
  hedgehop::plan_cancel_t cut{};
  if (cut.decode(bytes, 0, length) != length || cut.decode(bytes, 0, length - 1) >= 0) {
    return 1;
  }
  std::printf("heard %lld %lld\n", static_cast<long long>(listener.heard.utime),
              static_cast<long long>(listener.heard.seq));
  return listener.count == 1 && listener.heard.seq == 42 ? 0 : 1;
}
