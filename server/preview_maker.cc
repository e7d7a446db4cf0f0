#include "server/preview_maker.h"

#include <algorithm>
#include <string>

#include "proto/rpc/monotonic.h"
#include "server/make_preview.h"

namespace lumifold::server {
namespace {

/// Between two looks at whether units were committed, while somebody waits for a preview.
constexpr absl::Duration kLook = absl::Milliseconds(100);

}  // namespace

PreviewMaker::PreviewMaker(PreviewOptions options)
    : options_(std::move(options)),
      thread_([this] { Run(); }),
      patience_thread_([this] { WatchPatience(); }) {}

void PreviewMaker::Get(const v1::GetPreviewRequest& request, const Answer& answer) {
  const Key key(job::JobId(request.job_id()), request.frame());
  const absl::StatusOr<int64_t> units = options_.count_units(key.first, key.second);
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
  const absl::StatusOr<int64_t> units = options_.count_units(key.first, key.second);
  absl::Status error = units.status();
  const absl::Time start = rpc::MonotonicNow();
  bool is_due = false;
  PreviewWish wish;
  {
    absl::MutexLock lock(&mutex_);
    Frame& frame = frames_.at(key);
    frame.begun = std::min(frame.begun, start);
    wish.urgent = IsUrgent(frame, start);
    wish.error = std::any_of(frame.waiting.begin(), frame.waiting.end(),
                             [](const Waiting& waiting) { return waiting.request.layer() == kErrorLayer; });
    const bool has_what_is_wished =
        !wish.error || frame.newest == nullptr || frame.newest->finished() || HasErrorLayer(*frame.newest);
    is_due = units.ok() && (*units != frame.made_of || !has_what_is_wished) &&
             (start >= frame.next || *units == kFinishedUnits);
  }
  if (is_due) {
    absl::StatusOr<v1::Preview> made = options_.make(key.first, key.second, wish);
    const absl::Time end = rpc::MonotonicNow();
    absl::MutexLock lock(&mutex_);
    Frame& frame = frames_.at(key);
    frame.made_of = *units;
    if (wish.urgent) frame.urgent += end - start;
    frame.next = start + options_.interval;
    if (!IsUrgent(frame, end))
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
  if (frame.newest == nullptr || frame.newest->units() <= request.newer_than_units()) return nullptr;
  // A finished frame has no errors, and who asks for them is told so.
  const bool lacks_errors =
      request.layer() == kErrorLayer && !frame.newest->finished() && !HasErrorLayer(*frame.newest);
  return lacks_errors ? nullptr : frame.newest;
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
