#include <atomic>
#include <utility>

#include "filter/image/parallel.h"
#include "filter/manifold/filter_device.h"
#include "server/finish/estimate_round.h"
#include "server/finish/finish_frame.h"
#include "server/finish/frame_finisher.h"

namespace lumifold::server {
namespace {

class InProcessFinisher final : public FrameFinisher {
 public:
  InProcessFinisher(const DataFolder& folder, ledger::JobStore* store, std::function<absl::Time()> now,
                    std::shared_ptr<filter::FilterDevice> device)
      : folder_(folder), store_(store), now_(std::move(now)), device_(std::move(device)) {}

  absl::StatusOr<v1::FrameReport> Finish(const ledger::OwnedJob& job, int32_t frame, int threads,
                                         const std::vector<int>& blocks,
                                         const FilterProgress& progress) override {
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    return FinishFrame(folder_, *store_, job, frame, MakePool(threads).get(), now_, {}, blocks, progress);
  }

  absl::StatusOr<v1::FrameReport> Filter(const ledger::OwnedJob& job, int32_t frame, int block,
                                         int threads) override {
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    return FilterBlock(folder_, *store_, job, frame, block, MakePool(threads).get(), now_);
  }

  absl::StatusOr<v1::FrameReport> Estimate(const RoundToEstimate& round, int threads) override {
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    return EstimateRound(folder_, *store_, round, MakePool(threads).get(), now_);
  }

  void CancelJob(const job::JobId&) override {}
  void Cancel() override { cancelled_ = true; }

 private:
  std::unique_ptr<TaskPool> MakePool(int threads) const {
    return filter::WithDevice(MakeTaskPool(threads), device_);
  }

  const DataFolder folder_;
  ledger::JobStore* const store_;
  const std::function<absl::Time()> now_;
  const std::shared_ptr<filter::FilterDevice> device_;
  std::atomic<bool> cancelled_{false};
};

}  // namespace

std::unique_ptr<FrameFinisher> MakeInProcessFinisher(const DataFolder& folder, ledger::JobStore* store,
                                                     std::function<absl::Time()> now,
                                                     std::shared_ptr<filter::FilterDevice> device) {
  return std::make_unique<InProcessFinisher>(folder, store, std::move(now), std::move(device));
}

}  // namespace lumifold::server
