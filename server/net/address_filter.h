#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace lumifold::server {

/// Makes the kernel drop what these networks (see NetworkOf) send to a listening socket, which costs next to
/// nothing: their connections do not come about, and those who try wait. Replaces the networks of the last
/// call; those beyond kMaxFilteredNetworks are left out. Connections that exist stay. Sockets that are
/// accepted later have the filter too, so RemoveAddressFilter them. Returns whether the kernel does it.
bool FilterAddresses(int listening, const std::vector<std::string>& networks);
void RemoveAddressFilter(int socket);

inline constexpr size_t kMaxFilteredNetworks = 64;

}  // namespace lumifold::server
