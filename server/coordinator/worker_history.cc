#include "server/coordinator/worker_history.h"

namespace lumifold::server {

FrameOfWorker& WorkerHistory::FrameOf(const std::string& worker, const job::JobId& job, int32_t frame,
                                      absl::Time now) {
  const auto [found, is_new] = workers_.try_emplace(worker);
  Past& past = found->second;
  if (is_new) {
    order_.push_front(worker);
    past.place = order_.begin();
  } else {
    order_.splice(order_.begin(), order_, past.place);
  }
  if (workers_.size() > kMaxWorkers) {
    workers_.erase(order_.back());
    order_.pop_back();
  }
  if (past.frames.empty() || past.frames.back().job != job || past.frames.back().frame != frame) {
    past.frames.push_back({.job = job, .frame = frame, .first = now});
    if (past.frames.size() > kMaxFrames) past.frames.pop_front();
  }
  past.frames.back().last = now;
  return past.frames.back();
}

void WorkerHistory::AddUnit(const std::string& worker, const job::JobId& job, int32_t frame, absl::Time now,
                            absl::Duration rendering) {
  FrameOfWorker& of_frame = FrameOf(worker, job, frame, now);
  ++of_frame.units;
  of_frame.rendering += rendering;
}

void WorkerHistory::AddFailure(const std::string& worker, const job::JobId& job, int32_t frame,
                               absl::Time now) {
  ++FrameOf(worker, job, frame, now).failed;
}

std::deque<FrameOfWorker> WorkerHistory::Of(const std::string& worker) const {
  const auto found = workers_.find(worker);
  return found == workers_.end() ? std::deque<FrameOfWorker>() : found->second.frames;
}

}  // namespace lumifold::server
