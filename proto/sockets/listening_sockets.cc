#include "proto/sockets/listening_sockets.h"

#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace lumifold::sockets {
namespace {

absl::Status ListenError(const std::string& address) {
  return absl::UnavailableError(
      absl::StrCat("cannot listen on ", address, ": the port is taken, or the host is not this machine"));
}

/// Not listening where the machine does not have the address; port 0 of `address` takes that of `port`.
absl::StatusOr<rpc::FileHandle> ListenAtOne(const addrinfo& address, int* port) {
  sockaddr_storage bound = {};
  std::memcpy(&bound, address.ai_addr, address.ai_addrlen);
  in_port_t* const bound_port = address.ai_family == AF_INET
                                    ? &reinterpret_cast<sockaddr_in&>(bound).sin_port
                                    : &reinterpret_cast<sockaddr_in6&>(bound).sin6_port;
  if (*bound_port == 0) *bound_port = htons(static_cast<uint16_t>(*port));
  rpc::FileHandle socket(::socket(address.ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) return absl::NotFoundError("no such family");
  const int on = 1;
  const int off = 0;
  setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (address.ai_family == AF_INET6) {
    // "[::]" takes IPv4 as well.
    const bool is_any = IN6_IS_ADDR_UNSPECIFIED(&reinterpret_cast<sockaddr_in6&>(bound).sin6_addr);
    setsockopt(socket.get(), IPPROTO_IPV6, IPV6_V6ONLY, is_any ? &off : &on, sizeof on);
  }
  if (bind(socket.get(), reinterpret_cast<sockaddr*>(&bound), address.ai_addrlen) != 0) {
    if (errno == EADDRNOTAVAIL) return absl::NotFoundError("not an address of this machine");
    return absl::UnavailableError("the port is taken");
  }
  if (listen(socket.get(), SOMAXCONN) != 0) return absl::UnavailableError("the port is taken");
  socklen_t size = sizeof bound;
  getsockname(socket.get(), reinterpret_cast<sockaddr*>(&bound), &size);
  *port = ntohs(*bound_port);
  return socket;
}

}  // namespace

absl::StatusOr<ListeningSockets> ListenAt(const std::string& address) {
  const size_t colon = address.rfind(':');
  std::string host = address.substr(0, colon);
  if (host.size() > 2 && host.front() == '[') host = host.substr(1, host.size() - 2);
  addrinfo hints = {};
  hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (getaddrinfo(host.c_str(), address.substr(colon + 1).c_str(), &hints, &found) != 0)
    return ListenError(address);
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> addresses(found, freeaddrinfo);
  ListeningSockets listening;
  for (const addrinfo* one = found; one != nullptr; one = one->ai_next) {
    if (one->ai_family != AF_INET && one->ai_family != AF_INET6) continue;
    absl::StatusOr<rpc::FileHandle> socket = ListenAtOne(*one, &listening.port);
    if (absl::IsNotFound(socket.status())) continue;
    if (!socket.ok()) return ListenError(address);
    listening.sockets.push_back(*std::move(socket));
  }
  if (listening.sockets.empty()) return ListenError(address);
  return listening;
}

}  // namespace lumifold::sockets
