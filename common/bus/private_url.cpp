#include "bus/private_url.hpp"

#include <arpa/inet.h>
#include <cerrno>
#include <cstring>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/errors.hpp"

namespace hedgehop::bus {

std::string private_url() {
  const int socket_id = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_ANY);
  socklen_t length = sizeof address;
  const bool is_found =
      socket_id >= 0 &&
      ::bind(socket_id, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
      ::getsockname(socket_id, reinterpret_cast<sockaddr*>(&address), &length) == 0;
  const int error = errno;
  if (socket_id >= 0) {
    ::close(socket_id);
  }
  if (!is_found) {
    throw BusError(std::string("no UDP port is free: ") + std::strerror(error));
  }
  return "udpm://239.255.76.67:" + std::to_string(ntohs(address.sin_port)) + "?ttl=0";
}

}  // namespace hedgehop::bus
