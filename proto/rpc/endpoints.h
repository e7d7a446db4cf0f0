#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace lumifold::rpc {

/// Maximum number of coordinators in a list. It bounds how long a caller that asks one after the other takes
/// to ask all.
inline constexpr size_t kMaxEndpoints = 16;

/// The addresses of a list "HOST:PORT,HOST:PORT,...", in its order: 1 to kMaxEndpoints, each "HOST:PORT" with
/// a port above 0, or "unix:PATH". Spaces around an address are dropped. The coordinators of one farm:
/// whoever cannot reach one goes on to the next.
/// Errors: kInvalidArgument naming what is malformed, empty, twice in the list, or one too many.
absl::StatusOr<std::vector<std::string>> ParseEndpoints(const std::string& list);

}  // namespace lumifold::rpc
