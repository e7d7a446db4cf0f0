#pragma once

#include <cstdint>
#include <vector>

#include "absl/time/time.h"
#include "lumifold/v1/job.pb.h"
#include "server/job/tile_grid.h"
#include "tests/bench/farm_sim.h"

namespace lumifold::sim {

/// What the units of a simulated farm's jobs cost on the reference machine.
class UnitCosts {
 public:
  explicit UnitCosts(const FarmSettings& settings);

  /// Of all jobs.
  const v1::JobSpec& spec() const { return spec_; }
  int64_t units_of_a_job() const { return units_.count() * spec_.frame_count(); }
  /// Adds the next job, whose units cost `mean_seconds` in the mean.
  void AddJob(double mean_seconds);
  /// `job` as it was added. A unit costs the same whoever renders it.
  double SecondsOf(int job, const job::UnitKey& key) const;
  /// Of the units of all jobs.
  double total_seconds() const { return total_seconds_; }
  absl::Duration longest_unit() const { return longest_unit_; }

 private:
  const double spread_;
  const v1::JobSpec spec_;
  const job::FrameUnits units_;
  std::vector<double> mean_seconds_;  // by job
  double total_seconds_ = 0;
  absl::Duration longest_unit_;
};

}  // namespace lumifold::sim
