#pragma once

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "server/job/ids.h"
#include "server/scheduler/frames.h"
#include "server/scheduler/leasing.h"
#include "server/scheduler/state.h"
#include "server/scheduler/types.h"

namespace lumifold::scheduler {

/// Frames that a worker keeps: it gets all their units, and no other worker gets one (decision 33). Whether a
/// frame is kept is decided when its first unit is leased; it ends with the frame's result, or when one of
/// its units comes back, its worker is available no longer or its job requires other workers.
///
/// Threads: one at a time.
class Keeping {
 public:
  /// All must outlive it.
  Keeping(State* state, Frames* frames, Leasing* leasing);

  /// What a frame of the job takes of its keeper; its frames are kept from now on, as far as workers offer
  /// that. No effect on an unknown job.
  void SetDemand(const job::JobId& job, const KeepDemand& demand);
  /// Who keeps the frame; nullopt if nobody does.
  std::optional<job::WorkerId> KeeperOf(const job::JobId& job, int32_t frame) const;
  /// Frames that are kept. O(these).
  int CountOf(const job::JobId& job) const;
  /// Frames that can be kept no longer, since the last call. The caller calls Stop for each, before units are
  /// leased; not for one that is committed and whose result may still come.
  std::vector<std::pair<job::JobId, int32_t>> TakeBroken();
  /// The frame is not kept any more: its units that are not committed are free for all, and leases of them
  /// are revoked. The caller revokes the others (Units::Revoke).
  void Stop(const job::JobId& job, int32_t frame);
  /// The worker could not make a result: it keeps no other frames on this connection.
  void Exclude(job::WorkerId worker);
  /// The frame's result is here.
  void End(const job::JobId& job, int32_t frame);

  // For the other parts of the scheduler.

  /// Takes the next unit of a frame that the worker keeps.
  std::optional<Place> TakeUnit(Job& job, job::WorkerId worker);
  enum class Next {
    kTravels,  // its units are for all
    kIsKept,
    kWaits,  // the worker keeps as many frames as it can finish, and one more: its threads have work
  };
  /// What becomes of the next frame of the job, if the worker begins it.
  Next NextOf(const Job& job, job::WorkerId worker) const;
  /// It is kept; takes the frame's first unit.
  Place Begin(Job& job, job::WorkerId worker);

 private:
  /// Null for an unknown job; `index` is that of the frame.
  Job* FindKept(const job::JobId& job, int32_t frame, int* index) const;
  void Close(const Job& job, int index);

  State* const state_;
  Frames* const frames_;
  Leasing* const leasing_;
};

}  // namespace lumifold::scheduler
