#pragma once

#include <cstdint>
#include <string_view>

namespace lumifold::rpc {

/// XXH3-64 of `bytes`: guards what is sent and stored against accidents, not against malice.
uint64_t Checksum(std::string_view bytes);

}  // namespace lumifold::rpc
