#pragma once

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace lumifold::retry {

/// Marks an error of storage that may work again as such. `plain` is what callers of the farm are told of the
/// cause; the message, which may quote a library, is for logs.
absl::Status MarkStorageAway(absl::Status error, absl::string_view plain);

/// What a caller is told whose call failed by storage that is away: kUnavailable with one line, that of
/// MarkStorageAway where the error was marked, else with its message.
absl::Status StorageAway(const absl::Status& error);

/// The error as a caller is told it: StorageAway of one that is marked, others as they are.
absl::Status ForCaller(const absl::Status& error);

/// Whether a coordinator answered that its storage is away: the call had no effect that is known, and the
/// same call may succeed later.
bool IsStorageAway(const absl::Status& status);

}  // namespace lumifold::retry
