#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"

namespace lumifold::page {

class FarmCalls;

/// Gets previews for browsers, once for all who look at the same picture with the same session.
/// Threads: safe; calls block.
class SharedPreviews {
 public:
  using Bytes = std::shared_ptr<const std::string>;

  /// `calls` must outlive it.
  explicit SharedPreviews(const FarmCalls* calls) : calls_(*calls) {}

  /// BytesOfPreview of a preview with more units than the request states. Waits for it as GetPreview does.
  /// Errors: those of GetPreview.
  absl::StatusOr<Bytes> Get(const v1::PageSession& session, const v1::GetPreviewRequest& request);

 private:
  /// A call that is made, or was made a moment ago.
  struct Call {
    bool done = false;
    absl::Time end;
    absl::StatusOr<Bytes> bytes = Bytes();
    int64_t units = 0;
  };
  void Make(const v1::PageSession& session, const v1::GetPreviewRequest& request, Call* call);
  void Forget(absl::Time now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const FarmCalls& calls_;
  absl::Mutex mutex_;
  std::map<std::string, std::shared_ptr<Call>> last_ ABSL_GUARDED_BY(mutex_);  // by session and picture
};

}  // namespace lumifold::page
