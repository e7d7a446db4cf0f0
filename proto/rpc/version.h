#pragma once

#include <string_view>

namespace lumifold::rpc {

/// The wire this build speaks. A worker says it in Hello; the coordinator refuses any other. Raised whenever
/// a message changes its meaning; a new optional field does not.
inline constexpr int kWireVersion = 2;

/// Version of the programs, from the build.
inline constexpr std::string_view kVersion = LUMIFOLD_VERSION;

}  // namespace lumifold::rpc
