#include <arpa/inet.h>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <iostream>
#include <lcm/lcm.h>
#include <memory>
#include <mutex>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include "base/errors.hpp"
#include "bus/inbox.hpp"
#include "bus/packets.hpp"
#include "bus/transport.hpp"

namespace hedgehop::bus {
namespace {

constexpr int kReceiveBufferBytes = 4 << 20;
constexpr std::size_t kDatagramBytesMax = 65536;

struct UdpmAddress {
  in_addr group{};
  std::uint16_t port = 0;
  int receive_buffer_bytes = kReceiveBufferBytes;
};

int number_in(std::string_view text, int low, int high, const std::string& what,
              const std::string& url) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < low || value > high) {
    throw UsageError(url + ": " + what + " is '" + std::string(text) + "', must be " +
                         std::to_string(low) + " to " + std::to_string(high),
                     "write udpm://GROUP:PORT?ttl=N");
  }
  return value;
}

UdpmAddress address_of(const std::string& url) {
  std::string_view rest(url);
  rest.remove_prefix(std::string_view("udpm://").size());
  const std::size_t question = rest.find('?');
  std::string_view place = rest.substr(0, question);
  std::string_view options = question == std::string_view::npos ? "" : rest.substr(question + 1);
  if (place.empty()) {
    place = "239.255.76.67:7667";
  }
  UdpmAddress address;
  const std::size_t colon = place.find(':');
  const std::string group(place.substr(0, colon));
  if (inet_aton(group.c_str(), &address.group) == 0 || !IN_MULTICAST(ntohl(address.group.s_addr))) {
    throw UsageError(url + ": '" + group + "' is no IPv4 multicast group",
                     "groups lie in 224.0.0.0 to 239.255.255.255");
  }
  address.port = static_cast<std::uint16_t>(
      colon == std::string_view::npos
          ? 7667
          : number_in(place.substr(colon + 1), 1, 65535, "the port", url));
  while (!options.empty()) {
    const std::size_t end = options.find('&');
    const std::string_view option = options.substr(0, end);
    options = end == std::string_view::npos ? "" : options.substr(end + 1);
    const std::size_t equals = option.find('=');
    const std::string_view key = option.substr(0, equals);
    const std::string_view value =
        equals == std::string_view::npos ? "" : option.substr(equals + 1);
    if (key == "recv_buf_size") {
      address.receive_buffer_bytes = number_in(value, 2048, 1 << 30, "recv_buf_size", url);
    } else if (key == "ttl") {
      number_in(value, 0, 255, "ttl", url);
    } else {
      throw UsageError(url + ": unknown option '" + std::string(key) + "'",
                       "known options are ttl and recv_buf_size");
    }
  }
  return address;
}

[[noreturn]] void unreachable(const std::string& url, const std::string& why) {
  throw BusError(url + ": " + why,
                 "multicast needs a route: run scripts/net-setup, or by hand "
                 "'ip link set lo up; ip route add 224.0.0.0/4 dev lo'");
}

/// Sends through liblcm, which then opens one unbound socket and no thread. Receives with a socket
/// of its own, because the receiving part of liblcm 1.3.1 can be ended by one damaged packet.
class UdpmTransport final : public Transport {
 public:
  UdpmTransport(const std::string& url, Wants wants) : wants_(std::move(wants)) {
    const UdpmAddress address = address_of(url);
    open_socket(url, address);
    lcm_ = lcm_create(url.c_str());
    if (lcm_ == nullptr) {
      close_all();
      unreachable(url, "LCM cannot send there");
    }
    stop_event_ = ::eventfd(0, EFD_CLOEXEC);
    if (stop_event_ < 0) {
      close_all();
      throw SystemFailure(std::string("eventfd: ") + std::strerror(errno));
    }
    thread_ = std::thread([this] { receive(); });
  }

  ~UdpmTransport() override {
    const std::uint64_t one = 1;
    if (::write(stop_event_, &one, sizeof one) == sizeof one) {
      thread_.join();
    } else {
      thread_.detach();
    }
    close_all();
  }
  UdpmTransport(const UdpmTransport&) = delete;
  UdpmTransport& operator=(const UdpmTransport&) = delete;

  bool publish(const std::string& channel, const Bytes& bytes) override {
    return lcm_publish(lcm_, channel.c_str(), bytes.data(), static_cast<unsigned>(bytes.size())) ==
           0;
  }

  std::optional<Incoming> take(double timeout_s) override { return inbox_.take(timeout_s); }

  void hurry() override {
    // The lowest real-time priority; the kernel keeps a share of the time for all others.
    sched_param parameter{};
    parameter.sched_priority = 1;
    (void)::pthread_setschedparam(thread_.native_handle(), SCHED_RR, &parameter);
  }

  [[nodiscard]] TransportCounters counters() const override {
    return {kernel_drops_.load() + inbox_.dropped(), bad_packets_.load()};
  }

 private:
  void open_socket(const std::string& url, const UdpmAddress& address) {
    socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (socket_ < 0) {
      unreachable(url, std::string("no socket: ") + std::strerror(errno));
    }
    const auto fail = [&](const char* what) {
      const std::string why = std::string(what) + ": " + std::strerror(errno);
      close_all();
      unreachable(url, why);
    };
    const int on = 1;
    const int off = 0;
    // Several programs listen on one port; liblcm sets the same.
    ::setsockopt(socket_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    ::setsockopt(socket_, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
    ::setsockopt(socket_, IPPROTO_IP, IP_MULTICAST_ALL, &off, sizeof off);
    set_receive_buffer(address.receive_buffer_bytes);
    sockaddr_in local{};
    local.sin_family = AF_INET;
    local.sin_port = htons(address.port);
    // Bound to the group, so that nothing else that comes to the port gets in.
    local.sin_addr = address.group;
    if (::bind(socket_, reinterpret_cast<const sockaddr*>(&local), sizeof local) != 0) {
      fail("the port cannot be bound");
    }
    ip_mreq membership{};
    membership.imr_multiaddr = address.group;
    membership.imr_interface.s_addr = htonl(INADDR_ANY);
    if (::setsockopt(socket_, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) != 0) {
      fail("the multicast group cannot be joined");
    }
  }

  void set_receive_buffer(int wanted_bytes) {
    // The first needs a privilege and passes over the limit that the second obeys.
    if (::setsockopt(socket_, SOL_SOCKET, SO_RCVBUFFORCE, &wanted_bytes, sizeof wanted_bytes) !=
        0) {
      ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &wanted_bytes, sizeof wanted_bytes);
    }
    int given_bytes = 0;
    socklen_t size = sizeof given_bytes;
    ::getsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &given_bytes, &size);
    // The kernel reports twice what it was asked for.
    if (given_bytes / 2 < wanted_bytes) {
      static std::once_flag told;
      std::call_once(told, [&] {
        std::cerr << "bus: the receive buffer has " << given_bytes / 2 << " bytes, not "
                  << wanted_bytes << "; scripts/net-setup raises the limit\n";
      });
    }
  }

  void close_all() {
    for (int* file : {&socket_, &stop_event_}) {
      if (*file >= 0) {
        ::close(*file);
        *file = -1;
      }
    }
    if (lcm_ != nullptr) {
      lcm_destroy(lcm_);
      lcm_ = nullptr;
    }
  }

  /// Room for as many packets as one call takes from the socket.
  struct Batch {
    static constexpr std::size_t kPackets = 32;
    struct alignas(cmsghdr) Control {
      std::array<char, 64> bytes;
    };

    // Uninitialised: only what packets fill becomes memory.
    std::unique_ptr<std::byte[]> bytes{new std::byte[kPackets * kDatagramBytesMax]};
    std::array<Control, kPackets> controls{};
    std::array<sockaddr_in, kPackets> senders{};
    std::array<iovec, kPackets> pieces{};
    std::array<mmsghdr, kPackets> headers{};

    /// Number of packets; -1 when nothing waits.
    int take(int socket) {
      for (std::size_t i = 0; i < kPackets; ++i) {
        pieces[i] = {bytes.get() + i * kDatagramBytesMax, kDatagramBytesMax};
        msghdr& header = headers[i].msg_hdr;
        header = {};
        header.msg_name = &senders[i];
        header.msg_namelen = sizeof senders[i];
        header.msg_iov = &pieces[i];
        header.msg_iovlen = 1;
        header.msg_control = controls[i].bytes.data();
        header.msg_controllen = controls[i].bytes.size();
      }
      return ::recvmmsg(socket, headers.data(), kPackets, MSG_DONTWAIT, nullptr);
    }
  };

  void receive() {
    // Whoever is late here loses messages for good; the thread only moves them to memory. Where it
    // is not allowed it has to do without.
    constexpr int kNiceness = -10;
    (void)::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kNiceness);
    Batch batch;
    PacketReader reader;
    std::vector<Incoming> messages;
    std::array<pollfd, 2> files = {pollfd{socket_, POLLIN, 0}, pollfd{stop_event_, POLLIN, 0}};
    while (true) {
      if (::poll(files.data(), files.size(), -1) < 0 && errno != EINTR) {
        return;
      }
      if ((files[1].revents & POLLIN) != 0) {
        return;
      }
      while (true) {
        const int count = batch.take(socket_);
        if (count <= 0) {
          if (count < 0 && errno == EINTR) {
            continue;
          }
          break;
        }
        const Time now = wall_clock();
        for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
          read_one(batch, i, now, reader, messages);
        }
        inbox_.put(messages);
        if (count < static_cast<int>(Batch::kPackets)) {
          break;  // nothing more waits, or poll() says so
        }
      }
      bad_packets_ = reader.bad_packets();
    }
  }

  void read_one(Batch& batch, std::size_t i, Time now, PacketReader& reader,
                std::vector<Incoming>& messages) {
    msghdr& header = batch.headers[i].msg_hdr;
    for (cmsghdr* c = CMSG_FIRSTHDR(&header); c != nullptr; c = CMSG_NXTHDR(&header, c)) {
      if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SO_RXQ_OVFL) {
        std::uint32_t drops = 0;
        std::memcpy(&drops, CMSG_DATA(c), sizeof drops);
        kernel_drops_ = drops;
      }
    }
    const sockaddr_in& sender = batch.senders[i];
    const std::uint64_t origin =
        (static_cast<std::uint64_t>(ntohl(sender.sin_addr.s_addr)) << 16) | ntohs(sender.sin_port);
    std::optional<PacketMessage> message = reader.read(
        ByteView(batch.bytes.get() + i * kDatagramBytesMax, batch.headers[i].msg_len), origin);
    if (message && wants_(message->channel)) {
      messages.push_back({std::move(message->channel), now, std::move(message->bytes)});
    }
  }

  Wants wants_;
  lcm_t* lcm_ = nullptr;
  int socket_ = -1;
  int stop_event_ = -1;
  Inbox inbox_;
  std::atomic<std::int64_t> kernel_drops_ = 0;
  std::atomic<std::int64_t> bad_packets_ = 0;
  std::thread thread_;
};

}  // namespace

std::unique_ptr<Transport> udpm_transport(const std::string& url, Transport::Wants wants) {
  return std::make_unique<UdpmTransport>(url, std::move(wants));
}

}  // namespace hedgehop::bus
