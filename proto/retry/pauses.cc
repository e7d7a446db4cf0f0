#include "proto/retry/pauses.h"

#include <algorithm>
#include <cmath>

namespace lumifold::retry {
namespace {

/// Keeps the power finite, so that a first pause of zero stays zero. A product that is too long for
/// absl::Duration becomes infinite.
constexpr int kMaxGrowths = 60;

}  // namespace

absl::Duration Pauses::After(int failures) const {
  return std::min(longest, first * std::pow(factor, std::min(failures - 1, kMaxGrowths)));
}

}  // namespace lumifold::retry
