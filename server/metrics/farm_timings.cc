#include "server/metrics/farm_timings.h"

#include <prometheus/histogram.h>
#include <prometheus/registry.h>

namespace lumifold::monitoring {
namespace {

/// Upper bounds in seconds: a ledger on a local disk takes milliseconds; after 5 s leases of 30 s are in
/// danger.
const prometheus::Histogram::BucketBoundaries kCommitBounds = {0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1,
                                                               0.25,  0.5,    1,     2.5,  5,     10};
/// From a preview to a large frame with all layers.
const prometheus::Histogram::BucketBoundaries kStageBounds = {0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 3000};

}  // namespace

FarmTimings::FarmTimings() : registry_(std::make_shared<prometheus::Registry>()) {
  commit_ = &prometheus::BuildHistogram()
                 .Name("lumifold_ledger_commit_seconds")
                 .Help("Time of a transaction of the ledger that commits units.")
                 .Register(*registry_)
                 .Add({}, kCommitBounds);
  prometheus::Family<prometheus::Histogram>& stages =
      prometheus::BuildHistogram()
          .Name("lumifold_frame_stage_seconds")
          .Help("Time of the stages in which a frame is finished.")
          .Register(*registry_);
  assemble_ = &stages.Add({{"stage", "assemble"}}, kStageBounds);
  filter_ = &stages.Add({{"stage", "filter"}}, kStageBounds);
  write_ = &stages.Add({{"stage", "write"}}, kStageBounds);
}

void FarmTimings::ObserveCommit(absl::Duration duration) {
  commit_->Observe(absl::ToDoubleSeconds(duration));
}

void FarmTimings::ObserveFrame(const v1::StageTimes& times) {
  assemble_->Observe(times.assemble_seconds());
  filter_->Observe(times.filter_seconds());
  write_->Observe(times.write_seconds());
}

std::shared_ptr<prometheus::Collectable> FarmTimings::source() const { return registry_; }

}  // namespace lumifold::monitoring
