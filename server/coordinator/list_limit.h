#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

namespace lumifold::server {

/// Entries of one page of a list, from the `limit` of a request; 0 there: as many as are usual.
/// Errors: kInvalidArgument for one below 0 or above what a page may have.
inline absl::StatusOr<int> LimitOf(int32_t limit) {
  constexpr int kUsual = 100;
  constexpr int kMost = 1000;
  if (limit < 0 || limit > kMost)
    return absl::InvalidArgumentError(absl::StrCat("limit is ", limit, ", not 0 to ", kMost));
  return limit == 0 ? kUsual : limit;
}

}  // namespace lumifold::server
