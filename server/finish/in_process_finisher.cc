#include <atomic>
#include <utility>

#include "filter/image/parallel.h"
#include "server/finish/estimate_round.h"
#include "server/finish/finish_frame.h"
#include "server/finish/frame_finisher.h"

namespace lumifold::server {
namespace {

class InProcessFinisher final : public FrameFinisher {
 public:
  InProcessFinisher(const DataFolder& folder, ledger::JobStore* store, std::function<absl::Time()> now)
      : folder_(folder), store_(store), now_(std::move(now)) {}

  absl::StatusOr<v1::FrameReport> Finish(const ledger::OwnedJob& job, int32_t frame, int threads,
                                         const std::vector<int>& blocks,
                                         const FilterProgress& progress) override {
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    return FinishFrame(folder_, *store_, job, frame, MakeTaskPool(threads).get(), now_, {}, blocks, progress);
  }

  absl::StatusOr<v1::FrameReport> Filter(const ledger::OwnedJob& job, int32_t frame, int block,
                                         int threads) override {
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    return FilterBlock(folder_, *store_, job, frame, block, MakeTaskPool(threads).get(), now_);
  }

  absl::StatusOr<v1::FrameReport> Estimate(const RoundToEstimate& round, int threads) override {
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    return EstimateRound(folder_, *store_, round, MakeTaskPool(threads).get(), now_);
  }

  void CancelJob(const job::JobId&) override {}
  void Cancel() override { cancelled_ = true; }

 private:
  const DataFolder folder_;
  ledger::JobStore* const store_;
  const std::function<absl::Time()> now_;
  std::atomic<bool> cancelled_{false};
};

}  // namespace

std::unique_ptr<FrameFinisher> MakeInProcessFinisher(const DataFolder& folder, ledger::JobStore* store,
                                                     std::function<absl::Time()> now) {
  return std::make_unique<InProcessFinisher>(folder, store, std::move(now));
}

}  // namespace lumifold::server
