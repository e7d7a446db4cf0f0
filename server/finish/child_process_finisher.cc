#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "proto/rpc/monotonic.h"
#include "server/child/child_process.h"
#include "server/child/child_task.h"
#include "server/finish/estimate_round.h"
#include "server/finish/finish_frame.h"
#include "server/finish/frame_finisher.h"

namespace lumifold::server {
namespace {

/// In place of a round: the frame's result. In place of a block: all of it.
constexpr int kResult = -1;
constexpr int kWhole = -1;

class ChildProcessFinisher final : public FrameFinisher {
 public:
  ChildProcessFinisher(const DataFolder& folder, const ChildProcessOptions& options)
      : folder_(folder), child_(options) {}

  absl::StatusOr<v1::FrameReport> Finish(const ledger::OwnedJob& job, int32_t frame, int threads,
                                         const std::vector<int>& blocks,
                                         const FilterProgress& progress) override {
    return Run(ResultOf(job, frame), kWhole, threads, blocks, progress);
  }
  absl::StatusOr<v1::FrameReport> Filter(const ledger::OwnedJob& job, int32_t frame, int block,
                                         int threads) override {
    return Run(ResultOf(job, frame), block, threads, {}, nullptr);
  }
  absl::StatusOr<v1::FrameReport> Estimate(const RoundToEstimate& round, int threads) override {
    return Run(round, kWhole, threads, {}, nullptr);
  }
  void CancelJob(const job::JobId& job) override { child_.CancelJob(job); }
  void Cancel() override { child_.Cancel(); }

 private:
  static RoundToEstimate ResultOf(const ledger::OwnedJob& job, int32_t frame) {
    return {
        .job = job.job, .epoch = job.epoch, .frame = frame, .round = kResult, .rendered = {}, .samples = 0};
  }
  /// Starts a child for the estimate of a round, for the result or a block of it.
  absl::StatusOr<v1::FrameReport> Run(const RoundToEstimate& what, int block, int threads,
                                      const std::vector<int>& ready, const FilterProgress& progress);

  const DataFolder folder_;
  ChildProcess child_;
};

absl::StatusOr<v1::FrameReport> ChildProcessFinisher::Run(const RoundToEstimate& what, int block, int threads,
                                                          const std::vector<int>& ready,
                                                          const FilterProgress& progress) {
  const std::string task = absl::StrCat("frame ", what.frame);
  const absl::StatusOr<std::string> answer = child_.Run(
      {.command = kFinishFrameCommand,
       .root = folder_.root(),
       .threads = threads,
       .arguments = {what.job.value(), absl::StrCat(what.frame), absl::StrCat(what.round),
                     absl::StrCat(absl::ToInt64Milliseconds(what.rendered)), absl::StrCat(what.samples),
                     absl::StrCat(what.epoch.value()), absl::StrCat(block), absl::StrJoin(ready, ","),
                     what.filtered.has_value() ? absl::StrCat(absl::ToDoubleSeconds(*what.filtered)) : "",
                     what.round == kResult ? "" : kUrgent},  // workers wait for rounds
       .job = what.job,
       .task = task,
       .progress = progress});
  if (!answer.ok()) return answer.status();
  v1::FrameReport report;
  if (!report.ParseFromString(*answer))
    return absl::InternalError(absl::StrCat("the filter process of ", task, " ended without an answer"));
  return report;
}

bool ParseBlocks(const std::string& list, std::vector<int>* blocks) {
  for (const absl::string_view text : absl::StrSplit(list, ',', absl::SkipEmpty())) {
    if (!absl::SimpleAtoi(text, &blocks->emplace_back())) return false;
  }
  return true;
}

absl::StatusOr<std::string> FinishAsChild(const ChildTask& task) {
  RoundToEstimate what;
  int64_t rendered_ms = 0;
  int64_t epoch = 0;
  const std::vector<std::string>& arguments = task.arguments;
  int block = kWhole;
  std::vector<int> ready;
  if (arguments.size() != 10 || !absl::SimpleAtoi(arguments[6], &block) ||
      !ParseBlocks(arguments[7], &ready) || !absl::SimpleAtoi(arguments[1], &what.frame) ||
      !absl::SimpleAtoi(arguments[2], &what.round) || !absl::SimpleAtoi(arguments[3], &rendered_ms) ||
      !absl::SimpleAtoi(arguments[4], &what.samples) || !absl::SimpleAtoi(arguments[5], &epoch)) {
    return absl::InvalidArgumentError("finish-frame: only the coordinator starts this command");
  }
  what.job = job::JobId(arguments[0]);
  what.rendered = absl::Milliseconds(rendered_ms);
  what.epoch = ledger::Epoch(epoch);
  if (double seconds = 0; absl::SimpleAtod(arguments[8], &seconds)) what.filtered = absl::Seconds(seconds);
  const ledger::OwnedJob job = {what.job, what.epoch};
  const absl::StatusOr<v1::FrameReport> report =
      block != kWhole
          ? FilterBlock(task.folder, task.store, job, what.frame, block, task.pool, rpc::MonotonicNow)
      : what.round == kResult ? FinishFrame(task.folder, task.store, job, what.frame, task.pool,
                                            rpc::MonotonicNow, {}, ready, task.progress)
                              : EstimateRound(task.folder, task.store, what, task.pool, rpc::MonotonicNow);
  if (!report.ok()) return report.status();
  return report->SerializeAsString();
}

}  // namespace

bool IsWorthRetrying(const absl::Status& status) {
  return absl::IsInternal(status) || absl::IsResourceExhausted(status);
}

std::unique_ptr<FrameFinisher> MakeChildProcessFinisher(const DataFolder& folder,
                                                        const ChildProcessOptions& options) {
  return std::make_unique<ChildProcessFinisher>(folder, options);
}

int RunFinishFrameProcess(const std::vector<std::string>& arguments) {
  return RunChildTask(arguments, kChildNiceness, FinishAsChild);
}

}  // namespace lumifold::server
