#pragma once

#include <cstdint>
#include <string_view>

namespace lumifold::rpc {

/// XXH3-64 of `bytes`: detects accidental damage, not tampering.
uint64_t Checksum(std::string_view bytes);

}  // namespace lumifold::rpc
