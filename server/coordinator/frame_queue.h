#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/time/time.h"
#include "lumifold/v1/job.pb.h"
#include "proto/retry/pauses.h"
#include "server/commit/open_logs.h"
#include "server/coordinator/finish_options.h"
#include "server/job/ids.h"
#include "server/job/unit.h"
#include "server/ledger/job_store.h"
#include "server/scheduler/fair_share.h"

namespace lumifold::server {

/// What is being finished: a frame, one of its blocks, or the estimate of one of its rounds.
struct FramePart {
  FrameKey frame;
  int block = kWhole;
  int round = kResult;
  static constexpr int kWhole = -1;
  static constexpr int kResult = -1;

  bool IsBlock() const { return block != kWhole; }
  bool IsEstimate() const { return round != kResult; }
  /// It is a result, and not what this coordinator makes one of.
  bool IsResult() const { return !IsBlock() && !IsEstimate(); }

  friend bool operator==(const FramePart&, const FramePart&) = default;
};

/// As which unit it is leased, and the inverse for a unit of these kinds.
job::UnitRef UnitOf(const FramePart& part);
FramePart PartOf(const job::UnitRef& unit);
/// Whether a unit of this kind is leased so.
bool IsOfFinishing(v1::UnitKind kind);

/// What a worker has delivered of a frame, or of a block, that is audited.
struct ClaimedResult {
  std::string worker;  // name
  std::string sha256;  // of the file
  std::optional<double> estimated_error = std::nullopt;

  /// Whether another one has delivered the same.
  bool Confirms(const ClaimedResult& other) const {
    return sha256 == other.sha256 && estimated_error == other.estimated_error;
  }
};
using Claims = std::vector<ClaimedResult>;
/// Where so many differ this coordinator says who is right.
inline constexpr size_t kMostClaims = 2;

/// How far the blocks of a frame are that workers and this coordinator filter side by side. The errors of a
/// round that a worker has estimated count as its only block.
struct BlockProgress {
  bool have_begun = false;
  /// Those that wait for somebody; the next one is the last.
  std::vector<int> waiting;
  int running = 0;
  /// Those whose picture is here.
  std::vector<int> done;
  std::map<int, Claims> claims{};
  /// Seconds of one core that those took.
  double seconds = 0;
  int failures = 0;

  bool IsOver() const { return waiting.empty() && running == 0; }
  Claims ClaimsOf(int block) const {
    const auto found = claims.find(block);
    return found == claims.end() ? Claims() : found->second;
  }
};

/// A frame for which something is due: its result, or with adaptive sampling the estimate of a round.
struct DueFrame {
  job::JobId job;
  int32_t number = 0;
  /// The round whose estimate is due; kResult: the frame is committed.
  int round = kResult;
  static constexpr int kResult = FramePart::kResult;
  /// Render time of the job when that round was committed, and its camera samples, of all frames.
  absl::Duration rendered = {};
  int64_t samples = 0;
  /// Memory that finishing it takes.
  uint64_t memory_bytes = 0;
  /// A worker may finish it, too.
  bool may_travel = false;
  /// Only this worker can finish it: it keeps the frame's units.
  std::optional<job::WorkerId> keeper{};
  /// Those, once its result is here.
  std::shared_ptr<const ledger::JobCommit> kept{};
  /// More than 1: its blocks may be filtered side by side, where a worker takes part.
  int block_count = 1;
  BlockProgress blocks{};
  /// It is audited: this was delivered, and somebody else is to make it again. Of a running block: its own.
  Claims claims{};
  /// Number of times that finishing it has failed, and when it may be tried again.
  int failures = 0;
  /// Number of times that the storage could not be written meanwhile, which is no failure of the frame.
  int waits = 0;
  absl::Time not_before = absl::InfinitePast();

  FrameKey key() const { return {job, number}; }
};

/// A frame that is being finished, or a block of it.
struct RunningFrame {
  DueFrame due;
  int block = FramePart::kWhole;
  /// Whose job it is, and its number in the queue.
  std::string user;
  int64_t job_number = 0;
  /// That finishes it; nullopt: this coordinator.
  std::optional<job::WorkerId> worker;
  /// That it has there.
  int threads = 1;
  absl::Time since;
  /// Share that is filtered, as whoever finishes it has told.
  double filtered = 0;
  /// Units were taken back meanwhile: its result is of no use.
  bool is_stale = false;

  FramePart part() const { return {due.key(), block, due.round}; }
};

/// Frames of a job that are being finished, here or by workers, and those that wait for it.
struct JobFrames {
  int running = 0;
  int waiting = 0;
  /// What the filter has done of those that are running, in frames.
  double filtered = 0;
};

/// The frames that wait to be finished, and those that are being finished. Pure state.
///
/// Users and jobs share the finisher as they share workers (scheduler::FairShare): what counts is the frames
/// that are being finished and, once they are, the time of their threads. The frames of a job go in the order
/// in which they became due. A frame alone gets all threads; of several, each gets its part. Frames for which
/// this coordinator has no place go to workers that have one. So do the blocks of a frame of several, where
/// workers can take any; once all are here this coordinator makes the result of them.
/// Threads: one at a time.
class FrameQueue {
 public:
  explicit FrameQueue(const FinishOptions& options);

  /// Before its first frame is queued.
  void AddJob(const job::JobId& job, const v1::Scheduling& scheduling);
  /// No effect for a job that is not here.
  void SetPriority(const job::JobId& job, int priority);
  void SetTurn(const job::JobId& job, int64_t turn);
  /// Its frames that wait are dropped.
  void ForgetJob(const job::JobId& job);

  /// Of a job that is here. No effect where the same is queued already.
  void Push(DueFrame frame);
  /// Frames that wait may be finished now, or tried again.
  void Wake() { has_news_ = true; }
  /// Whether a frame has been queued, Wake called or a frame's end made room, since the last call.
  bool TakeNews();
  /// Takes the frame that is to be finished next, if one may be now: it is running until End.
  std::optional<RunningFrame> Begin(absl::Time now);
  /// The same for a worker, where Begin has none. `find_worker` has a place for a frame, or for a block with
  /// such claims, or not.
  using FindWorker = absl::FunctionRef<std::optional<job::WorkerId>(const DueFrame&, const Claims&)>;
  std::optional<RunningFrame> BeginAway(absl::Time now, FindWorker find_worker);
  /// Of a frame of several blocks `has_workers` says whether any worker could take one: then they wait for
  /// workers and this coordinator. Otherwise this coordinator filters what is missing with the result; those
  /// that were claimed it filters before, and compares.
  void OfferBlocks(absl::FunctionRef<bool(const DueFrame&)> has_workers);
  /// Of what is running, as ComeBack. A block is done; it took so many seconds of one core. So is the filter
  /// of a round that a worker had: its estimate is queued again, for this coordinator.
  void End(const FramePart& part, absl::Time now, double block_seconds = 0);
  /// Ends what a worker has not finished. A frame is queued again, for this coordinator; a block, for any
  /// worker.
  void ComeBack(const FramePart& part, absl::Time now);
  /// A worker has delivered a frame or a block that is audited: it is queued again for another one, or for
  /// this coordinator where two differ.
  void Audit(const FramePart& part, ClaimedResult claim, absl::Time now);
  /// When the next of those that may not be finished yet may be; InfiniteFuture if there is none.
  absl::Time NextDue(absl::Time now) const;
  /// Queues a frame again that failed, for later. False where it has failed too often.
  bool Retry(DueFrame* frame, absl::Time now);
  /// Queues a frame again whose result could not be written.
  void AwaitStorage(DueFrame* frame, absl::Time now);

  bool IsFinishing(const job::JobId& job) const { return CountsOf(job).running > 0; }
  /// Linear in all frames.
  JobFrames CountsOf(const job::JobId& job) const;
  /// How far the filter of what is running is, 0 to 1. False where that changes nothing.
  bool SetFiltered(const FramePart& part, double share);
  /// Units of the frame were taken back: what was made of them is of no use, nor compared. A frame that
  /// somebody kept is not queued any more.
  void MarkStale(const FrameKey& frame);
  bool IsStale(const FrameKey& frame) const;
  const std::deque<DueFrame>& waiting() const { return waiting_; }
  const std::vector<RunningFrame>& running() const { return running_; }
  /// Frames that are finished here.
  int CountHere() const;

 private:
  /// As a whole, its result or the estimate of a round.
  bool IsRunning(const FrameKey& frame) const;
  bool MayBegin(const DueFrame& frame, absl::Time now) const {
    return frame.not_before <= now && frame.blocks.IsOver() && !IsRunning(frame.key());
  }
  /// Whether the frame, or a block of it, may begin.
  bool IsReady(const DueFrame& frame, absl::Time now) const {
    return (!frame.blocks.waiting.empty() && !IsStaleHere(frame.key())) || MayBegin(frame, now);
  }
  /// A block of it is filtered here of units that were taken back: its file would replace a newer one.
  bool IsStaleHere(const FrameKey& frame) const;
  /// Whether it, or a block of it, may go to a worker.
  bool MayLeave(const DueFrame& frame, absl::Time now) const;
  /// Jobs with a frame that may be finished now are ready for the next place.
  void FindReady(absl::Time now);
  /// It is running.
  std::vector<RunningFrame>::iterator FindRunning(const FramePart& part);
  /// The first frame of a job that meets the condition; end() if there is none.
  std::deque<DueFrame>::iterator FirstOf(int64_t job, absl::FunctionRef<bool(const DueFrame&)> condition);
  /// The frame whose blocks are being filtered; end() if it is not queued any more.
  std::deque<DueFrame>::iterator FindWaiting(const FrameKey& frame);
  /// `block`: which of those that wait; kWhole: the frame.
  RunningFrame Start(const scheduler::FairShare::Candidate& first, std::deque<DueFrame>::iterator due,
                     int block, std::optional<job::WorkerId> worker, int threads, absl::Time now);
  /// Ends what is running; returns it.
  RunningFrame Take(const FramePart& part, absl::Time now);
  uint64_t MemoryOf(const DueFrame& frame) const;
  /// Memory of the frames that are finished here.
  uint64_t UsedMemory() const;
  bool HasRoom(const DueFrame& frame, const std::string& user) const;
  /// Of a frame that begins while so many may, itself included.
  int ThreadsFor(const DueFrame& frame, int64_t ready) const;

  const retry::Pauses after_failures_;
  const retry::Pauses for_storage_;
  const FinishOptions options_;
  std::deque<DueFrame> waiting_;
  std::vector<RunningFrame> running_;
  scheduler::FairShare share_;
  scheduler::FairShare::Queue ready_;
  std::map<job::JobId, int64_t> numbers_;  // of the jobs that are here, for share_
  int64_t next_number_ = 0;
  bool has_news_ = false;
};

}  // namespace lumifold::server
