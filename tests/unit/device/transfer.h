#pragma once

#include <sys/socket.h>

#include <array>
#include <cstdint>
#include <optional>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "filter/image/check.h"
#include "proto/device/socket_stream.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::device {

/// What receive() makes of a message that went over a socket.
template <typename Send, typename Receive>
auto Transfer(const Send& send, const Receive& receive)
    -> decltype(receive(static_cast<SocketStream*>(nullptr))) {
  std::array<int, 2> ends = {-1, -1};
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) != 0) return {};
  rpc::FileHandle from(ends[0]);
  const rpc::FileHandle to(ends[1]);
  std::thread sender([&] {
    SocketStream stream(from.get());
    (void)send(&stream);
    from = {};
  });
  SocketStream stream(to.get());
  auto received = receive(&stream);
  shutdown(to.get(), SHUT_RDWR);  // what is refused is not read to its end
  sender.join();
  return received;
}

/// The value, which must be there.
template <typename Value>
Value Present(std::optional<Value> value) {
  LUMIFOLD_CHECK(value.has_value());
  return *std::move(value);
}

/// Whether any of some messages of random words is received.
template <typename Receive>
bool AnyIsReceived(const Receive& receive) {
  std::mt19937 random(7);
  bool is_any = false;
  for (int i = 0; i < 150; ++i) {
    std::vector<uint32_t> words(64);
    for (uint32_t& word : words) word = static_cast<uint32_t>(random() >> (random() % 32));
    const auto send = [&](SocketStream* to) { return to->Write(words.data(), 4 * words.size()); };
    is_any |= Transfer(send, receive);
  }
  return is_any;
}

}  // namespace lumifold::device
