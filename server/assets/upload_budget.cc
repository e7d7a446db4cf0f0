#include "server/assets/upload_budget.h"

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"

namespace lumifold::server {

absl::Status UploadBudget::Begin(const std::string& caller, const std::string& name, uint64_t bytes,
                                 uint64_t room) {
  if (uploads_ >= limits_.uploads) {
    return absl::ResourceExhaustedError(absl::StrCat(
        name, ": ", uploads_, " uploads are announced and not complete, as many as this coordinator allows"));
  }
  const auto use = of_callers_.find(caller);
  if (use != of_callers_.end() && use->second.uploads >= limits_.uploads_of_caller) {
    return absl::ResourceExhaustedError(
        absl::StrCat(name, ": ", use->second.uploads,
                     " uploads of this caller are announced and not complete, as many as one may have"));
  }
  const bool is_new = of_callers_.try_emplace(caller).second;
  if (absl::Status status = Expect(caller, name, bytes, room); !status.ok()) {
    if (is_new) of_callers_.erase(caller);
    return status;
  }
  ++uploads_;
  ++of_callers_.at(caller).uploads;
  return absl::OkStatus();
}

absl::Status UploadBudget::Expect(const std::string& caller, const std::string& name, uint64_t bytes,
                                  uint64_t room) {
  Use& use = of_callers_.at(caller);
  if (bytes > limits_.bytes_of_caller - use.expected_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrCat(name, ": ", bytes, " bytes are to come, and ", use.expected_bytes,
                     " of other uploads of this caller; one may announce ", limits_.bytes_of_caller));
  }
  const uint64_t left = room > expected_bytes_ ? room - expected_bytes_ : 0;
  if (bytes > left) {
    return absl::ResourceExhaustedError(absl::StrCat(name, ": ", bytes,
                                                     " bytes are to come, but there is room for ", room,
                                                     ", of which running uploads need ", expected_bytes_));
  }
  expected_bytes_ += bytes;
  use.expected_bytes += bytes;
  return absl::OkStatus();
}

void UploadBudget::Arrived(const std::string& caller, uint64_t bytes) {
  Use& use = of_callers_.at(caller);
  LUMIFOLD_CHECK(bytes <= use.expected_bytes && bytes <= expected_bytes_);
  expected_bytes_ -= bytes;
  use.expected_bytes -= bytes;
}

void UploadBudget::End(const std::string& caller, uint64_t bytes) {
  Arrived(caller, bytes);
  const auto use = of_callers_.find(caller);
  LUMIFOLD_CHECK(uploads_ > 0 && use->second.uploads > 0);
  --uploads_;
  if (--use->second.uploads == 0) of_callers_.erase(use);
}

}  // namespace lumifold::server
