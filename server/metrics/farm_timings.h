#pragma once

#include <memory>

#include "absl/time/time.h"
#include "lumifold/v1/job.pb.h"

namespace prometheus {
class Collectable;
class Histogram;
class Registry;
}  // namespace prometheus

namespace lumifold::monitoring {

/// Durations of what a coordinator does, as histograms since its start.
/// Threads: safe.
class FarmTimings {
 public:
  FarmTimings();

  /// A transaction of the ledger that commits units, whether it succeeded or not.
  void ObserveCommit(absl::Duration duration);
  /// A frame whose result is written.
  void ObserveFrame(const v1::StageTimes& times);

  std::shared_ptr<prometheus::Collectable> source() const;

 private:
  std::shared_ptr<prometheus::Registry> registry_;
  // Owned by the registry.
  prometheus::Histogram* commit_;
  prometheus::Histogram* assemble_;
  prometheus::Histogram* filter_;
  prometheus::Histogram* write_;
};

}  // namespace lumifold::monitoring
