#include "server/scheduler/kept_frames.h"

#include <utility>

#include "filter/image/check.h"

namespace lumifold::scheduler {

using job::WorkerId;

void KeptFrames::Open(const Frame& frame, WorkerId keeper, int64_t units, uint64_t bytes) {
  const auto [kept, is_new] =
      frames_.try_emplace(frame, Kept{.keeper = keeper, .units = units, .bytes = bytes});
  LUMIFOLD_CHECK(is_new);
  by_worker_[keeper].insert(frame);
}

void KeptFrames::Close(const Frame& frame) {
  const auto kept = frames_.find(frame);
  if (kept == frames_.end()) return;
  const auto of_worker = by_worker_.find(kept->second.keeper);
  of_worker->second.erase(frame);
  if (of_worker->second.empty()) by_worker_.erase(of_worker);
  broken_.erase(frame);
  frames_.erase(kept);
}

void KeptFrames::CloseJob(int64_t job) {
  for (auto first = FirstOf(job); first != frames_.end() && first->first.first == job; first = FirstOf(job))
    Close(Frame(first->first));
}

std::optional<WorkerId> KeptFrames::KeeperOf(const Frame& frame) const {
  const auto kept = frames_.find(frame);
  return kept == frames_.end() ? std::nullopt : std::optional(kept->second.keeper);
}

int KeptFrames::CountOf(int64_t job) const {
  int count = 0;
  for (auto kept = FirstOf(job); kept != frames_.end() && kept->first.first == job; ++kept) ++count;
  return count;
}

KeptFrames::Load KeptFrames::LoadOf(WorkerId worker) const {
  Load load;
  const auto of_worker = by_worker_.find(worker);
  if (of_worker == by_worker_.end()) return load;
  for (const Frame& frame : of_worker->second) {
    ++load.frames;
    load.bytes += frames_.at(frame).bytes;
  }
  return load;
}

bool KeptFrames::HasUnleased(int64_t job) const {
  for (auto kept = FirstOf(job); kept != frames_.end() && kept->first.first == job; ++kept) {
    if (kept->second.next < kept->second.units) return true;
  }
  return false;
}

std::optional<Place> KeptFrames::TakeNext(int64_t job, WorkerId worker) {
  const auto of_worker = by_worker_.find(worker);
  if (of_worker == by_worker_.end()) return std::nullopt;
  for (const Frame& frame : of_worker->second) {
    Kept& kept = frames_.at(frame);
    if (frame.first == job && kept.next < kept.units) return Place{frame.second, kept.next++};
  }
  return std::nullopt;
}

void KeptFrames::BreakOf(WorkerId worker) {
  if (const auto frames = by_worker_.find(worker); frames != by_worker_.end())
    broken_.insert(frames->second.begin(), frames->second.end());
}

void KeptFrames::BreakOf(int64_t job) {
  for (auto kept = FirstOf(job); kept != frames_.end() && kept->first.first == job; ++kept)
    broken_.insert(kept->first);
}

void KeptFrames::BreakOf(int64_t job, WorkerId worker) {
  const auto frames = by_worker_.find(worker);
  if (frames == by_worker_.end()) return;
  for (const Frame& frame : frames->second) {
    if (frame.first == job) broken_.insert(frame);
  }
}

std::vector<KeptFrames::Frame> KeptFrames::TakeBroken() {
  const std::set<Frame> broken = std::exchange(broken_, {});
  return {broken.begin(), broken.end()};
}

}  // namespace lumifold::scheduler
