#include "server/net/address_filter.h"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace lumifold::server {
namespace {

// Offsets of fields in a packet's network header.
constexpr uint32_t kVersion = static_cast<uint32_t>(SKF_NET_OFF);
constexpr uint32_t kIp4Source = static_cast<uint32_t>(SKF_NET_OFF) + 12;
constexpr uint32_t kIp6Source = static_cast<uint32_t>(SKF_NET_OFF) + 8;

constexpr sock_filter Statement(uint16_t code, uint32_t value) { return {code, 0, 0, value}; }
/// Goes on with the next instruction if the loaded number is `value`, or else `skipped` instructions later.
constexpr sock_filter SkipUnless(uint32_t value, uint8_t skipped) {
  return {BPF_JMP | BPF_JEQ | BPF_K, 0, skipped, value};
}
constexpr sock_filter LoadWord(uint32_t offset) { return Statement(BPF_LD | BPF_W | BPF_ABS, offset); }
constexpr sock_filter kDrop = Statement(BPF_RET | BPF_K, 0);
constexpr sock_filter kPass = Statement(BPF_RET | BPF_K, UINT32_MAX);

using Program = std::vector<sock_filter>;

/// Drops packets of the IPv4 addresses among the networks.
Program Ip4Part(const std::vector<std::string>& networks) {
  Program program = {LoadWord(kIp4Source)};
  for (const std::string& network : networks) {
    in_addr address = {};
    if (inet_pton(AF_INET, network.c_str(), &address) != 1) continue;
    program.insert(program.end(), {SkipUnless(ntohl(address.s_addr), 1), kDrop});
  }
  program.push_back(kPass);
  return program;
}

/// Drops packets of the IPv6 networks of 64 bits among the networks.
Program Ip6Part(const std::vector<std::string>& networks) {
  Program program;
  for (const std::string& network : networks) {
    std::array<uint32_t, 4> words = {};
    const std::string address = network.substr(0, network.find('/'));
    if (inet_pton(AF_INET6, address.c_str(), words.data()) != 1) continue;
    program.insert(program.end(), {LoadWord(kIp6Source), SkipUnless(ntohl(words[0]), 3),
                                   LoadWord(kIp6Source + 4), SkipUnless(ntohl(words[1]), 1), kDrop});
  }
  program.push_back(kPass);
  return program;
}

}  // namespace

bool FilterAddresses(int listening, const std::vector<std::string>& networks) {
  if (networks.empty()) {
    RemoveAddressFilter(listening);
    return true;
  }
  const size_t count = std::min(networks.size(), kMaxFilteredNetworks);
  const std::vector<std::string> filtered(networks.begin(),
                                          networks.begin() + static_cast<std::ptrdiff_t>(count));
  const Program ip4 = Ip4Part(filtered);
  const Program ip6 = Ip6Part(filtered);
  Program program = {Statement(BPF_LD | BPF_B | BPF_ABS, kVersion), Statement(BPF_ALU | BPF_RSH | BPF_K, 4),
                     SkipUnless(4, static_cast<uint8_t>(ip4.size()))};
  program.insert(program.end(), ip4.begin(), ip4.end());
  program.insert(program.end(), ip6.begin(), ip6.end());
  const sock_fprog filter = {static_cast<uint16_t>(program.size()), program.data()};
  return setsockopt(listening, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0;
}

void RemoveAddressFilter(int socket) {
  const int unused = 0;
  setsockopt(socket, SOL_SOCKET, SO_DETACH_FILTER, &unused, sizeof unused);
}

}  // namespace lumifold::server
