#include "server/coordinator/frame_queue.h"

#include <algorithm>
#include <set>
#include <utility>

#include "filter/image/check.h"

namespace lumifold::server {
namespace {

/// A frame that failed this often, of a cause that may go away, fails its job.
constexpr int kMaxFailures = 3;
constexpr double kPauseGrowth = 4;
/// Longest pause before a frame that found the disk full is tried again.
constexpr absl::Duration kLongestPause = absl::Minutes(1);

/// Whether this coordinator alone may make what has these claims.
bool IsDisputed(const Claims& claims) { return claims.size() >= kMostClaims; }

/// The blocks that wait, the next one first; kWhole where none does.
std::vector<int> PartsOf(const BlockProgress& blocks) {
  if (blocks.waiting.empty()) return {FramePart::kWhole};
  return {blocks.waiting.rbegin(), blocks.waiting.rend()};
}

/// The one that this coordinator takes: first what nobody else may have.
int BlockForHere(const BlockProgress& blocks) {
  const std::vector<int> parts = PartsOf(blocks);
  const auto disputed =
      std::find_if(parts.begin(), parts.end(), [&](int block) { return IsDisputed(blocks.ClaimsOf(block)); });
  return disputed == parts.end() ? parts.front() : *disputed;
}

}  // namespace

job::UnitRef UnitOf(const FramePart& part) {
  const auto& [job, number] = part.frame;
  if (part.IsBlock()) return {job, {number, part.block, 0, v1::UNIT_KIND_BLOCK}};
  if (part.IsEstimate()) return {job, {number, 0, part.round, v1::UNIT_KIND_ESTIMATE}};
  return {job, {number, 0, 0, v1::UNIT_KIND_RESULT}};
}

FramePart PartOf(const job::UnitRef& unit) {
  return {{unit.job, unit.key.frame},
          unit.key.kind == v1::UNIT_KIND_BLOCK ? unit.key.tile : FramePart::kWhole,
          unit.key.kind == v1::UNIT_KIND_ESTIMATE ? unit.key.pass : FramePart::kResult};
}

bool IsOfFinishing(v1::UnitKind kind) {
  return kind == v1::UNIT_KIND_RESULT || kind == v1::UNIT_KIND_BLOCK || kind == v1::UNIT_KIND_ESTIMATE;
}

FrameQueue::FrameQueue(const FinishOptions& options)
    : after_failures_{.first = options.pause, .factor = kPauseGrowth},
      for_storage_{.first = options.pause, .longest = kLongestPause, .factor = kPauseGrowth},
      options_(options) {}

void FrameQueue::AddJob(const job::JobId& job, const v1::Scheduling& scheduling) {
  numbers_[job] = next_number_;
  share_.AddJob(next_number_++, scheduling.user(), scheduling.priority(), scheduling.turn_ms());
}

void FrameQueue::SetPriority(const job::JobId& job, int priority) {
  if (const auto number = numbers_.find(job); number != numbers_.end())
    share_.SetPriority(number->second, priority);
}

void FrameQueue::SetTurn(const job::JobId& job, int64_t turn) {
  if (const auto number = numbers_.find(job); number != numbers_.end()) share_.SetTurn(number->second, turn);
}

void FrameQueue::ForgetJob(const job::JobId& job) {
  std::erase_if(waiting_, [&job](const DueFrame& frame) { return frame.job == job; });
  const auto number = numbers_.find(job);
  if (number == numbers_.end()) return;
  share_.RemoveJob(number->second);
  numbers_.erase(number);
}

void FrameQueue::Push(DueFrame frame) {
  has_news_ = true;
  const bool is_queued = std::any_of(waiting_.begin(), waiting_.end(), [&](const DueFrame& queued) {
    return queued.key() == frame.key() && queued.round == frame.round;
  });
  if (!is_queued) waiting_.push_back(std::move(frame));
}

bool FrameQueue::TakeNews() { return std::exchange(has_news_, false); }

void FrameQueue::FindReady(absl::Time now) {
  for (const DueFrame& frame : waiting_) {
    if (IsReady(frame, now)) share_.SetQueue(numbers_.at(frame.job), &ready_, now);
  }
}

std::deque<DueFrame>::iterator FrameQueue::FirstOf(int64_t job,
                                                   absl::FunctionRef<bool(const DueFrame&)> condition) {
  return std::find_if(waiting_.begin(), waiting_.end(), [&](const DueFrame& frame) {
    return numbers_.at(frame.job) == job && condition(frame);
  });
}

std::optional<RunningFrame> FrameQueue::Begin(absl::Time now) {
  FindReady(now);
  const auto is_ready = [&](const DueFrame& frame) {
    return IsReady(frame, now) && !frame.keeper.has_value();
  };
  std::set<int64_t> passed;  // jobs whose frames were taken back, or are kept
  while (const std::optional<scheduler::FairShare::Candidate> first = share_.First(ready_, passed)) {
    const auto due = FirstOf(first->job, is_ready);
    if (due == waiting_.end()) {
      passed.insert(first->job);
      continue;
    }
    // Others do not overtake a frame that needs more memory than is left, or it would wait for ever.
    if (!HasRoom(*due, share_.UserOf(first->job))) return std::nullopt;
    const auto ready = std::count_if(waiting_.begin(), waiting_.end(), is_ready);
    return Start(*first, due, BlockForHere(due->blocks), std::nullopt, ThreadsFor(*due, ready), now);
  }
  return std::nullopt;
}

void FrameQueue::OfferBlocks(absl::FunctionRef<bool(const DueFrame&)> has_workers) {
  for (DueFrame& frame : waiting_) {
    if (frame.block_count <= 1 || (frame.blocks.have_begun && frame.blocks.waiting.empty())) continue;
    if (!has_workers(frame)) {
      std::erase_if(frame.blocks.waiting, [&](int block) { return !frame.blocks.claims.contains(block); });
    } else if (!std::exchange(frame.blocks.have_begun, true)) {
      for (int block = frame.block_count; block > 0;) frame.blocks.waiting.push_back(--block);
    }
  }
}

bool FrameQueue::IsStaleHere(const FrameKey& frame) const {
  return std::any_of(running_.begin(), running_.end(), [&](const RunningFrame& other) {
    return other.due.key() == frame && other.is_stale && !other.worker.has_value();
  });
}

bool FrameQueue::MayLeave(const DueFrame& frame, absl::Time now) const {
  if (!IsReady(frame, now)) return false;
  const std::vector<int>& blocks = frame.blocks.waiting;
  return std::any_of(blocks.begin(), blocks.end(),
                     [&](int block) { return !IsDisputed(frame.blocks.ClaimsOf(block)); }) ||
         (blocks.empty() && frame.may_travel && !IsDisputed(frame.claims));
}

std::optional<RunningFrame> FrameQueue::BeginAway(absl::Time now, FindWorker find_worker) {
  FindReady(now);
  std::set<int64_t> passed;  // jobs whose frames stay here
  while (const std::optional<scheduler::FairShare::Candidate> first = share_.First(ready_, passed)) {
    const auto due = FirstOf(first->job, [&](const DueFrame& frame) {
      return MayLeave(frame, now) &&
             (!frame.keeper.has_value() || find_worker(frame, frame.claims).has_value());
    });
    if (due != waiting_.end()) {
      for (const int part : PartsOf(due->blocks)) {
        const Claims claims = part == FramePart::kWhole ? due->claims : due->blocks.ClaimsOf(part);
        const auto worker = IsDisputed(claims) ? std::nullopt : find_worker(*due, claims);
        if (worker.has_value()) return Start(*first, due, part, worker, /*threads=*/1, now);
      }
    }
    passed.insert(first->job);
  }
  return std::nullopt;
}

RunningFrame FrameQueue::Start(const scheduler::FairShare::Candidate& first,
                               std::deque<DueFrame>::iterator due, int block,
                               std::optional<job::WorkerId> worker, int threads, absl::Time now) {
  RunningFrame frame = {.due = *due,
                        .block = block,
                        .user = share_.UserOf(first.job),
                        .job_number = first.job,
                        .worker = worker,
                        .threads = threads,
                        .since = now};
  if (block != FramePart::kWhole) {
    frame.due.claims = due->blocks.ClaimsOf(block);
    std::erase(due->blocks.waiting, block);
    ++due->blocks.running;
  } else {
    waiting_.erase(due);
  }
  running_.push_back(frame);
  share_.Choose(first);
  share_.Granted(first.job, now);
  const auto next = FirstOf(first.job, [&](const DueFrame& other) { return IsReady(other, now); });
  if (next == waiting_.end()) share_.SetQueue(first.job, nullptr, now);
  return frame;
}

std::vector<RunningFrame>::iterator FrameQueue::FindRunning(const FramePart& part) {
  const auto frame = std::find_if(running_.begin(), running_.end(),
                                  [&](const RunningFrame& other) { return other.part() == part; });
  LUMIFOLD_CHECK(frame != running_.end());
  return frame;
}

std::deque<DueFrame>::iterator FrameQueue::FindWaiting(const FrameKey& frame) {
  return std::find_if(waiting_.begin(), waiting_.end(), [&](const DueFrame& other) {
    return other.key() == frame && other.blocks.running > 0;
  });
}

RunningFrame FrameQueue::Take(const FramePart& part, absl::Time now) {
  const auto running = FindRunning(part);
  RunningFrame frame = std::move(*running);
  running_.erase(running);
  // Of a job that has ended, and perhaps begun again, nothing is charged.
  const auto number = numbers_.find(part.frame.first);
  if (number != numbers_.end() && number->second == frame.job_number)
    share_.Ended(number->second, frame.threads * (now - frame.since));
  has_news_ = true;
  return frame;
}

void FrameQueue::End(const FramePart& part, absl::Time now, double block_seconds) {
  RunningFrame ended = Take(part, now);
  if (ended.is_stale || part.IsResult()) return;
  if (part.IsEstimate()) {
    const auto number = numbers_.find(part.frame.first);
    if (!ended.worker.has_value() || number == numbers_.end() || number->second != ended.job_number) return;
    ended.due.may_travel = false;
    BlockProgress& progress = ended.due.blocks;
    progress.have_begun = true;
    progress.done = {part.block};
    progress.seconds = block_seconds;
    return waiting_.push_front(std::move(ended.due));
  }
  const auto frame = FindWaiting(part.frame);
  if (frame == waiting_.end()) return;
  --frame->blocks.running;
  frame->blocks.done.push_back(part.block);
  frame->blocks.seconds += block_seconds;
}

void FrameQueue::ComeBack(const FramePart& part, absl::Time now) {
  RunningFrame ended = Take(part, now);
  if (ended.is_stale || !numbers_.contains(part.frame.first)) return;
  if (!part.IsBlock()) {
    ended.due.may_travel = false;
    return waiting_.push_front(std::move(ended.due));
  }
  const auto frame = FindWaiting(part.frame);
  if (frame == waiting_.end()) return;
  --frame->blocks.running;
  // Workers that fail again and again: this coordinator makes what is left.
  if (++frame->blocks.failures > frame->block_count) return frame->blocks.waiting.clear();
  frame->blocks.waiting.push_back(part.block);
}

void FrameQueue::Audit(const FramePart& part, ClaimedResult claim, absl::Time now) {
  RunningFrame ended = Take(part, now);
  if (ended.is_stale || !numbers_.contains(part.frame.first)) return;
  if (part.IsBlock()) {
    const auto frame = FindWaiting(part.frame);
    if (frame == waiting_.end()) return;
    --frame->blocks.running;
    frame->blocks.claims[part.block].push_back(std::move(claim));
    frame->blocks.waiting.insert(frame->blocks.waiting.begin(), part.block);
    return;
  }
  ended.due.claims.push_back(std::move(claim));
  waiting_.push_front(std::move(ended.due));
}

uint64_t FrameQueue::MemoryOf(const DueFrame& frame) const {
  return options_.frame_memory_bytes == 0 ? frame.memory_bytes
                                          : std::min(frame.memory_bytes, options_.frame_memory_bytes);
}

uint64_t FrameQueue::UsedMemory() const {
  uint64_t bytes = 0;
  for (const RunningFrame& frame : running_) bytes += frame.worker.has_value() ? 0 : MemoryOf(frame.due);
  return bytes;
}

int FrameQueue::CountHere() const {
  return static_cast<int>(std::count_if(running_.begin(), running_.end(),
                                        [](const RunningFrame& frame) { return !frame.worker.has_value(); }));
}

bool FrameQueue::HasRoom(const DueFrame& frame, const std::string& user) const {
  const int count = CountHere();
  if (options_.processes > 0) return count < options_.processes;
  if (count == 0) return true;
  if (UsedMemory() + MemoryOf(frame) > options_.memory_bytes) return false;
  if (count < options_.threads) return true;
  const bool has_none = std::none_of(running_.begin(), running_.end(), [&](const RunningFrame& other) {
    return other.user == user && !other.worker.has_value();
  });
  return has_none && count < 2 * options_.threads;
}

int FrameQueue::ThreadsFor(const DueFrame& frame, int64_t ready) const {
  const int64_t places = options_.PlacesFor(MemoryOf(frame));
  const int64_t together = std::min(ready, std::max<int64_t>(1, places - CountHere()));
  int64_t idle = options_.threads;
  for (const RunningFrame& other : running_) idle -= other.worker.has_value() ? 0 : other.threads;
  const int64_t part = (std::max<int64_t>(0, idle) + together - 1) / together;
  return static_cast<int>(std::max({int64_t{1}, options_.threads / places, part}));
}

absl::Time FrameQueue::NextDue(absl::Time now) const {
  absl::Time next = absl::InfiniteFuture();
  for (const DueFrame& frame : waiting_) {
    if (frame.not_before > now) next = std::min(next, frame.not_before);
  }
  return next;
}

bool FrameQueue::Retry(DueFrame* frame, absl::Time now) {
  if (++frame->failures == kMaxFailures) return false;
  frame->not_before = now + after_failures_.After(frame->failures);
  waiting_.push_back(*frame);
  return true;
}

void FrameQueue::AwaitStorage(DueFrame* frame, absl::Time now) {
  frame->not_before = now + for_storage_.After(++frame->waits);
  waiting_.push_back(*frame);
}

bool FrameQueue::IsRunning(const FrameKey& frame) const {
  return std::any_of(running_.begin(), running_.end(), [&](const RunningFrame& other) {
    return other.due.key() == frame && !other.part().IsBlock();
  });
}

JobFrames FrameQueue::CountsOf(const job::JobId& job) const {
  JobFrames counts;
  std::set<int32_t> running;
  for (const RunningFrame& frame : running_) {
    if (frame.due.job != job) continue;
    running.insert(frame.due.number);
    counts.filtered += frame.filtered / (frame.block == FramePart::kWhole ? 1 : frame.due.block_count);
  }
  counts.running = static_cast<int>(running.size());
  for (const DueFrame& frame : waiting_) {
    if (frame.job != job) continue;
    if (frame.blocks.running == 0) {
      ++counts.waiting;
    } else {
      counts.filtered += static_cast<double>(frame.blocks.done.size()) / frame.block_count;
    }
  }
  return counts;
}

bool FrameQueue::SetFiltered(const FramePart& part, double share) {
  const double filtered = share > 0 ? std::min(share, 1.0) : 0.0;  // of a worker's word, which may be NaN
  for (RunningFrame& frame : running_) {
    if (frame.part() == part) return std::exchange(frame.filtered, filtered) != filtered;
  }
  return false;
}

void FrameQueue::MarkStale(const FrameKey& frame) {
  for (RunningFrame& other : running_) other.is_stale = other.is_stale || other.due.key() == frame;
  for (DueFrame& other : waiting_) {
    if (other.key() == frame) other.claims.clear();
  }
  // What its blocks were made of is gone. It is queued again when it is committed again.
  std::erase_if(waiting_, [&](const DueFrame& other) {
    return other.key() == frame && (other.blocks.have_begun || other.keeper.has_value());
  });
}

bool FrameQueue::IsStale(const FrameKey& frame) const {
  return std::any_of(running_.begin(), running_.end(),
                     [&](const RunningFrame& other) { return other.due.key() == frame && other.is_stale; });
}

}  // namespace lumifold::server
