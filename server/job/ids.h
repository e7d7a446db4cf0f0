#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace lumifold::job {

/// A value of type T that identifies one kind of object; Tag makes the ids of different kinds different
/// types.
template <typename Tag, typename T>
class StrongId {
 public:
  StrongId() = default;
  explicit StrongId(T value) : value_(std::move(value)) {}

  const T& value() const { return value_; }

  // clang-tidy 14 takes the result's comparison with 0 for one of pointers.
  friend auto operator<=>(const StrongId&, const StrongId&) = default;  // NOLINT(modernize-use-nullptr)

 private:
  T value_{};
};

using JobId = StrongId<struct JobTag, std::string>;
/// One connection of a worker: a worker that reconnects gets a new id.
using WorkerId = StrongId<struct WorkerTag, int64_t>;
/// Fencing token: each new lease has a higher one.
using Attempt = StrongId<struct AttemptTag, int64_t>;

/// "j-" and 16 lower-case digits of Crockford's base 32: 45 bits of milliseconds since 1970, then 35 of
/// `random`, so that jobs submitted in the same millisecond do not collide. Ids sort by time.
JobId MakeJobId(absl::Time now, uint64_t random);

/// "w-7", and back; nullopt for any other text.
std::string TextOf(WorkerId worker);
std::optional<WorkerId> ParseWorkerId(absl::string_view text);

}  // namespace lumifold::job
