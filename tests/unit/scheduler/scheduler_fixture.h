#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/scheduler/scheduler.h"
#include "tests/unit/scheduler/unit_names.h"

namespace lumifold::scheduler {

inline const job::JobId kJob("j-1");
inline const job::JobId kOther("j-2");
inline const absl::Time kStart = absl::FromUnixSeconds(1'000'000);

/// A job of 4 tiles x (1 + 2) units a frame.
inline v1::JobSpec Spec(int frames = 1) {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(16);
  spec.set_height(16);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(8);
  spec.set_pass_samples(4);
  spec.set_first_frame(10);
  spec.set_frame_count(frames);
  return spec;
}

/// A job of a row of tiles x 2 units a frame.
inline v1::JobSpec RowSpec(int tiles, int frames = 1) {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(8 * tiles);
  spec.set_height(8);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(4);
  spec.set_pass_samples(4);
  spec.set_frame_count(frames);
  return spec;
}

/// A scheduler without jobs and workers, with leases of 30 s, whose third failure of a unit is the last.
class SchedulerFixture : public ::testing::Test {
 protected:
  /// Delivers and commits a unit; true if it was the last one of its frame.
  bool Commit(job::WorkerId worker, const GrantedLease& lease) {
    EXPECT_EQ(scheduler_.units().Complete(worker, lease.unit, lease.attempt, kStart), Completion::kAccepted);
    return scheduler_.units().Commit(lease.unit);
  }

  /// The workers say that they have received the leases.
  void Receive(const std::vector<GrantedLease>& leases) {
    for (const GrantedLease& lease : leases) {
      const HeldLease held{.unit = lease.unit, .attempt = lease.attempt};
      EXPECT_THAT(scheduler_.workers().Heartbeat(lease.worker, {held}, job::Attempt(0), kStart),
                  ::testing::IsEmpty());
    }
  }
  /// Grants leases to all workers, which receive them.
  std::vector<GrantedLease> GrantReceived() {
    std::vector<GrantedLease> granted = scheduler_.GrantLeases(kStart);
    Receive(granted);
    return granted;
  }

  Scheduler scheduler_{{.lease = absl::Seconds(30), .first_attempt = job::Attempt(100)}};
};

}  // namespace lumifold::scheduler
