#include "server/page/shared_previews.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/monotonic.h"
#include "server/page/farm_calls.h"
#include "server/page/preview_bytes.h"

namespace lumifold::page {
namespace {

/// An answer is given to those who ask in this time after it; by then there may be a newer one.
constexpr absl::Duration kFresh = absl::Milliseconds(500);

}  // namespace

absl::StatusOr<SharedPreviews::Bytes> SharedPreviews::Get(const v1::PageSession& session,
                                                          const v1::GetPreviewRequest& request) {
  const std::string key =
      absl::StrCat(session.credential(), "/", session.job_id(), "/", request.job_id(), "/", request.frame(),
                   "/", request.region().x0(), ",", request.region().y0(), ",", request.region().x1(), ",",
                   request.region().y1(), "/", request.layer());
  std::shared_ptr<Call> call;
  while (true) {
    absl::MutexLock lock(&mutex_);
    Forget(rpc::MonotonicNow());
    std::shared_ptr<Call>& last = last_[key];
    if (last == nullptr) {
      last = std::make_shared<Call>();
      call = last;
      break;
    }
    const std::shared_ptr<Call> other = last;
    mutex_.Await(absl::Condition(&other->done));
    if (!other->bytes.ok() || other->units > request.newer_than_units()) return other->bytes;
    if (last_[key] == other) last_.erase(key);  // of a viewer that had less
  }
  Make(session, request, call.get());
  absl::MutexLock lock(&mutex_);
  return call->bytes;
}

void SharedPreviews::Make(const v1::PageSession& session, const v1::GetPreviewRequest& request, Call* call) {
  v1::Preview preview;
  const absl::Status status = calls_.Call(session, "GetPreview", request, &preview);
  absl::StatusOr<std::string> encoded = status.ok() ? BytesOfPreview(preview) : status;
  absl::StatusOr<Bytes> bytes =
      encoded.status().ok() ? absl::StatusOr<Bytes>(std::make_shared<const std::string>(*std::move(encoded)))
                            : absl::StatusOr<Bytes>(encoded.status());
  absl::MutexLock lock(&mutex_);
  call->bytes = std::move(bytes);
  call->units = preview.units();
  call->end = rpc::MonotonicNow();
  call->done = true;
}

void SharedPreviews::Forget(absl::Time now) {
  std::erase_if(last_,
                [now](const auto& entry) { return entry.second->done && now - entry.second->end > kFresh; });
}

}  // namespace lumifold::page
