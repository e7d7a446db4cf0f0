#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "absl/synchronization/notification.h"
#include "server/finish/frame_finisher.h"

namespace lumifold::server {

/// Finishes nothing before it is opened, or cancelled.
class GatedFinisher final : public FrameFinisher {
 public:
  explicit GatedFinisher(std::unique_ptr<FrameFinisher> inner) : inner_(std::move(inner)) {}

  absl::StatusOr<v1::FrameReport> Finish(const ledger::OwnedJob& job, int32_t frame, int threads,
                                         const std::vector<int>& blocks,
                                         const FilterProgress& progress) override {
    gate_.WaitForNotification();
    return inner_->Finish(job, frame, threads, blocks, progress);
  }
  absl::StatusOr<v1::FrameReport> Filter(const ledger::OwnedJob& job, int32_t frame, int block,
                                         int threads) override {
    return inner_->Filter(job, frame, block, threads);
  }
  absl::StatusOr<v1::FrameReport> Estimate(const RoundToEstimate& round, int threads) override {
    return inner_->Estimate(round, threads);
  }
  void CancelJob(const job::JobId& job) override { inner_->CancelJob(job); }
  void Cancel() override {
    if (!gate_.HasBeenNotified()) gate_.Notify();
    inner_->Cancel();
  }
  void Open() { gate_.Notify(); }

 private:
  const std::unique_ptr<FrameFinisher> inner_;
  absl::Notification gate_;
};

}  // namespace lumifold::server
