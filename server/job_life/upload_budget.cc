#include "server/job_life/upload_budget.h"

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"

namespace lumifold::job_life {

absl::Status UploadBudget::Begin(const std::string& name) {
  if (uploads_ >= kMaxUploads) {
    return absl::ResourceExhaustedError(
        absl::StrCat(name, ": ", uploads_, " uploads are running, as many as this coordinator allows"));
  }
  ++uploads_;
  return absl::OkStatus();
}

absl::Status UploadBudget::Expect(const std::string& name, uint64_t bytes, uint64_t room) {
  const uint64_t left = room > expected_bytes_ ? room - expected_bytes_ : 0;
  if (bytes > left) {
    return absl::ResourceExhaustedError(absl::StrCat(name, ": ", bytes,
                                                     " bytes are to come, but there is room for ", room,
                                                     ", of which running uploads need ", expected_bytes_));
  }
  expected_bytes_ += bytes;
  return absl::OkStatus();
}

void UploadBudget::Arrived(uint64_t bytes) {
  LUMIFOLD_CHECK(bytes <= expected_bytes_);
  expected_bytes_ -= bytes;
}

void UploadBudget::End(uint64_t bytes) {
  Arrived(bytes);
  LUMIFOLD_CHECK(uploads_ > 0);
  --uploads_;
}

}  // namespace lumifold::job_life
