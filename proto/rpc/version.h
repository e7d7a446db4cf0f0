#pragma once

#include <string_view>

namespace lumifold::rpc {

/// Version of the protocol between workers and the coordinator. Workers send it in Hello; the coordinator
/// refuses other versions. It increases when the meaning of a message changes, not for a new optional field.
inline constexpr int kWireVersion = 19;

/// Version of the programs.
inline constexpr std::string_view kVersion = LUMIFOLD_VERSION;

}  // namespace lumifold::rpc
