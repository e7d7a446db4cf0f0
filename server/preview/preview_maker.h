#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"
#include "proto/threads/event.h"
#include "server/job/ids.h"
#include "server/preview/make_preview.h"

namespace lumifold::server {

struct PreviewOptions {
  /// Makes the preview of a frame; blocks. kOutOfRange: there is nothing to see yet.
  std::function<absl::StatusOr<v1::Preview>(const job::JobId& job, int32_t frame,
                                            const PreviewRequest& request)>
      make;
  /// Stops a `make` that runs, and all later ones.
  std::function<void()> cancel = [] {};
  /// Units of the job that are committed, or kFinishedUnits where the frame is finished. A preview is made
  /// again when it changes. Errors: kNotFound for the job or frame; kFailedPrecondition where the job has
  /// ended without the frame.
  std::function<absl::StatusOr<int64_t>(const job::JobId& job, int32_t frame)> count_units;
  /// Share of time that is spent on the previews of a frame that are not urgent, so that viewers cost the
  /// farm little. That of a finished frame is made at once, and is urgent.
  double duty = 0.15;
  /// Previews of a frame are urgent as long as they have taken less time than this, and this share of the
  /// time since the first one began: those who wait for a picture soon see one, and those who look for hours
  /// take what is idle.
  absl::Duration urgent_time = absl::Seconds(2);
  double urgent_share = 0.005;
  /// Between the starts of two previews of a frame, at least.
  absl::Duration interval = absl::Milliseconds(250);
  /// A caller waits for this long.
  absl::Duration patience = absl::Seconds(5);
  /// Callers that wait, and frames whose last preview is kept, at a time.
  size_t waiting = 256;
  size_t frames = 16;
};

/// Makes previews for those who ask, one at a time, and keeps the last one of each frame and region: however
/// many look at it, it is made once.
/// Threads: safe; it has two of its own. Answers are called on them or on the caller's thread.
class PreviewMaker {
 public:
  using Answer = std::function<void(absl::StatusOr<v1::Preview>)>;

  explicit PreviewMaker(PreviewOptions options);
  ~PreviewMaker() { Stop(); }

  /// Errors: as GetPreview of farm.proto; kUnavailable after Stop.
  void Get(const v1::GetPreviewRequest& request, const Answer& answer);
  /// Answers all that wait.
  void Stop();

 private:
  struct Waiting {
    v1::GetPreviewRequest request;
    Answer answer;
    absl::Time until;
  };
  struct Frame {
    std::shared_ptr<const v1::Preview> newest;
    int64_t made_of = -1;  // units of the job
    absl::Time next = absl::InfinitePast();
    absl::Time begun = absl::InfiniteFuture();  // its first preview
    absl::Duration urgent;                      // time that urgent ones took
    absl::Time used;
    std::vector<Waiting> waiting;
  };
  /// A frame, and the corners of a region of it; zeros for the whole frame.
  struct Key {
    job::JobId job;
    int32_t frame = 0;
    std::array<int32_t, 4> region = {};

    friend auto operator<=>(const Key&, const Key&) = default;  // NOLINT(modernize-use-nullptr)
  };
  using Answers = std::vector<std::pair<Answer, absl::StatusOr<v1::Preview>>>;

  void Run();
  /// Answers those whose patience ends, also while a preview is made.
  void WatchPatience();
  /// Makes the preview of a frame if that is due.
  void Renew(const Key& key);
  /// The newest preview of a frame if it answers a request, otherwise null.
  static std::shared_ptr<const v1::Preview> NewestFor(const Frame& frame,
                                                      const v1::GetPreviewRequest& request);
  /// Whether the next preview of a frame may be urgent.
  bool IsUrgent(const Frame& frame, absl::Time now) const {
    return frame.urgent <= options_.urgent_time + options_.urgent_share * (now - frame.begun);
  }
  /// The whole frame, to which the time of its regions is counted.
  Frame& WholeOf(const Key& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return frames_[{key.job, key.frame, {}}];
  }
  /// Removes the callers of a frame that get an answer now.
  Answers TakeAnswers(const Key& key, const absl::Status& error, absl::Time now)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::vector<Key> Wanted() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Forget() ABSL_LOCKS_EXCLUDED(mutex_);
  bool HasWorkOrStops() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return stopping_ || waiting_ > 0; }

  const PreviewOptions options_;
  absl::Mutex mutex_;
  threads::Event stop_;  // with stopping_
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  size_t waiting_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<Key, Frame> frames_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;  // these two last: they use the members above
  std::thread patience_thread_;
};

}  // namespace lumifold::server
