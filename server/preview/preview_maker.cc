#include "server/preview/preview_maker.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/rect_codec.h"
#include "server/preview/make_preview.h"

namespace lumifold::server {
namespace {

/// Between two looks at whether units were committed, while somebody waits for a preview.
constexpr absl::Duration kLook = absl::Milliseconds(100);

/// Whether the region may be one of a frame.
absl::Status CheckRegion(const v1::GetPreviewRequest& request) {
  if (!request.has_region()) return absl::OkStatus();
  const Rect region = rpc::RectOf(request.region());
  const auto is_side = [](int32_t from, int32_t to) {
    return 0 <= from && from < to && to - from <= kPreviewRegionSide;
  };
  if (is_side(region.x0, region.x1) && is_side(region.y0, region.y1)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("a region has 1 to ", kPreviewRegionSide, " pixels across and down, from 0 on"));
}

}  // namespace

PreviewMaker::PreviewMaker(PreviewOptions options)
    : options_(std::move(options)),
      thread_([this] { Run(); }),
      patience_thread_([this] { WatchPatience(); }) {}

void PreviewMaker::Get(const v1::GetPreviewRequest& request, const Answer& answer) {
  const v1::Rect& region = request.region();
  const Key key = {
      job::JobId(request.job_id()), request.frame(), {region.x0(), region.y0(), region.x1(), region.y1()}};
  if (absl::Status status = CheckRegion(request); !status.ok()) return answer(status);
  const absl::StatusOr<int64_t> units = options_.count_units(key.job, key.frame);
  if (!units.ok()) return answer(units.status());
  std::shared_ptr<const v1::Preview> newest;
  absl::Status refusal;
  {
    absl::MutexLock lock(&mutex_);
    if (stopping_) {
      refusal = absl::UnavailableError("the coordinator is stopping");
    } else if (waiting_ >= options_.waiting) {
      refusal = absl::ResourceExhaustedError("too many callers wait for previews");
    } else {
      Frame& frame = frames_[key];
      frame.used = rpc::MonotonicNow();
      const bool runs_again = *units != kFinishedUnits && frame.newest != nullptr && frame.newest->finished();
      if (runs_again) frame.newest = nullptr;
      newest = NewestFor(frame, request);
      if (newest == nullptr) {
        frame.waiting.push_back({request, answer, frame.used + options_.patience});
        ++waiting_;
      }
    }
  }
  if (!refusal.ok()) return answer(refusal);
  if (newest != nullptr) answer(LayerOfPreview(*newest, request.layer()));
}

void PreviewMaker::Stop() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
  }
  stop_.Notify();
  options_.cancel();
  if (thread_.joinable()) thread_.join();
  if (patience_thread_.joinable()) patience_thread_.join();
}

void PreviewMaker::WatchPatience() {
  do {
    Answers answers;
    {
      absl::MutexLock lock(&mutex_);
      mutex_.Await(absl::Condition(this, &PreviewMaker::HasWorkOrStops));
      for (const Key& key : Wanted()) {
        for (auto& entry : TakeAnswers(key, absl::OkStatus(), rpc::MonotonicNow()))
          answers.push_back(std::move(entry));
      }
    }
    for (auto& [answer, result] : answers) answer(std::move(result));
  } while (!stop_.WaitFor(kLook));
}

void PreviewMaker::Run() {
  while (true) {
    std::vector<Key> wanted;
    {
      absl::MutexLock lock(&mutex_);
      mutex_.Await(absl::Condition(this, &PreviewMaker::HasWorkOrStops));
      if (stopping_) break;
      wanted = Wanted();
    }
    for (const Key& key : wanted) Renew(key);
    Forget();
    stop_.WaitFor(kLook);
  }
  Answers answers;
  {
    absl::MutexLock lock(&mutex_);
    for (const Key& key : Wanted()) {
      for (auto& entry :
           TakeAnswers(key, absl::UnavailableError("the coordinator is stopping"), absl::Time()))
        answers.push_back(std::move(entry));
    }
  }
  for (auto& [answer, result] : answers) answer(std::move(result));
}

void PreviewMaker::Renew(const Key& key) {
  const absl::StatusOr<int64_t> units = options_.count_units(key.job, key.frame);
  absl::Status error = units.status();
  const absl::Time start = rpc::MonotonicNow();
  bool is_due = false;
  PreviewRequest request;
  request.region = {key.region[0], key.region[1], key.region[2], key.region[3]};
  {
    absl::MutexLock lock(&mutex_);
    const Frame& frame = frames_.at(key);
    Frame& whole = WholeOf(key);
    whole.begun = std::min(whole.begun, start);
    // A finished frame is not filtered, and its preview is made once.
    const bool is_finished = units.ok() && *units == kFinishedUnits;
    request.urgent = is_finished || IsUrgent(whole, start);
    is_due = units.ok() && *units != frame.made_of && (start >= frame.next || is_finished);
  }
  if (is_due) {
    absl::StatusOr<v1::Preview> made = options_.make(key.job, key.frame, request);
    const absl::Time end = rpc::MonotonicNow();
    absl::MutexLock lock(&mutex_);
    Frame& frame = frames_.at(key);
    if (!absl::IsInvalidArgument(made.status())) frame.made_of = *units;  // so that the next one is told, too
    Frame& whole = WholeOf(key);
    if (request.urgent) whole.urgent += end - start;
    frame.next = start + options_.interval;
    if (!IsUrgent(whole, end))
      frame.next = std::max(frame.next, end + (end - start) * (1 / options_.duty - 1));
    if (made.ok()) {
      frame.newest = std::make_shared<const v1::Preview>(*std::move(made));
    } else if (!absl::IsOutOfRange(made.status())) {
      error = made.status();
    }
  }
  Answers answers;
  {
    absl::MutexLock lock(&mutex_);
    answers = TakeAnswers(key, error, rpc::MonotonicNow());
  }
  for (auto& [answer, result] : answers) answer(std::move(result));
}

std::shared_ptr<const v1::Preview> PreviewMaker::NewestFor(const Frame& frame,
                                                           const v1::GetPreviewRequest& request) {
  const bool is_news = frame.newest != nullptr && frame.newest->units() > request.newer_than_units();
  return is_news ? frame.newest : nullptr;
}

PreviewMaker::Answers PreviewMaker::TakeAnswers(const Key& key, const absl::Status& error, absl::Time now) {
  Answers answers;
  Frame& frame = frames_.at(key);
  std::erase_if(frame.waiting, [&](const Waiting& waiting) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const std::shared_ptr<const v1::Preview> newest = NewestFor(frame, waiting.request);
    if (newest != nullptr) {
      answers.emplace_back(waiting.answer, LayerOfPreview(*newest, waiting.request.layer()));
    } else if (!error.ok()) {
      answers.emplace_back(waiting.answer, error);
    } else if (now >= waiting.until) {
      answers.emplace_back(waiting.answer, absl::OutOfRangeError("there is no newer preview yet"));
    } else {
      return false;
    }
    --waiting_;
    return true;
  });
  return answers;
}

std::vector<PreviewMaker::Key> PreviewMaker::Wanted() const {
  std::vector<Key> wanted;
  for (const auto& [key, frame] : frames_) {
    if (!frame.waiting.empty()) wanted.push_back(key);
  }
  return wanted;
}

/// Of the frames that nobody waits for, those that were asked for last are kept.
void PreviewMaker::Forget() {
  absl::MutexLock lock(&mutex_);
  while (frames_.size() > options_.frames) {
    auto oldest = frames_.end();
    for (auto it = frames_.begin(); it != frames_.end(); ++it) {
      if (it->second.waiting.empty() && (oldest == frames_.end() || it->second.used < oldest->second.used))
        oldest = it;
    }
    if (oldest == frames_.end()) return;
    frames_.erase(oldest);
  }
}

}  // namespace lumifold::server
