#include "worker/scene/out_of_memory.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace lumifold::scene {
namespace {

constexpr absl::string_view kLead = "not enough memory for ";

}  // namespace

absl::Status OutOfMemory(absl::string_view for_what) {
  return absl::ResourceExhaustedError(absl::StrCat(kLead, for_what));
}

bool IsOutOfMemory(const absl::Status& status) {
  return absl::IsResourceExhausted(status) && absl::StrContains(status.message(), kLead);
}

}  // namespace lumifold::scene
