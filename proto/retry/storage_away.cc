#include "proto/retry/storage_away.h"

#include <string>
#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace lumifold::retry {
namespace {

constexpr absl::string_view kPayload = "lumifold/storage";
/// Between the programs: clients know such an answer by it.
constexpr absl::string_view kLead = "the storage of the farm is away, try again later: ";

}  // namespace

absl::Status MarkStorageAway(absl::Status error, absl::string_view plain) {
  error.SetPayload(kPayload, absl::Cord(plain));
  return error;
}

absl::Status StorageAway(const absl::Status& error) {
  if (IsStorageAway(error)) return error;
  const auto plain = error.GetPayload(kPayload);
  return absl::UnavailableError(
      absl::StrCat(kLead, plain.has_value() ? std::string(*plain) : std::string(error.message())));
}

absl::Status ForCaller(const absl::Status& error) {
  return error.GetPayload(kPayload).has_value() ? StorageAway(error) : error;
}

bool IsStorageAway(const absl::Status& status) {
  return absl::IsUnavailable(status) && absl::StrContains(status.message(), kLead);
}

}  // namespace lumifold::retry
