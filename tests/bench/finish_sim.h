#pragma once

#include <cstdint>

namespace lumifold::sim {

/// A farm that renders one animation and finishes its frames. Times are seconds of a core.
struct FinishSettings {
  int workers = 1;
  int worker_threads = 2;
  int coordinator_cores = 2;
  /// For each frame: rendering its units and finishing it, on any machine.
  double render_seconds = 8.5;
  double finish_seconds = 8.2;
  /// For each frame, of the coordinator, as farm-load --measure frames tells: receiving, checking and storing
  /// its units; and sending them again and receiving the file where a worker finishes it.
  double receive_seconds = .25;
  double send_seconds = .09;
  int units = 24;  // of a frame
  bool workers_finish = true;
  /// So many workers render, but fail each frame that they are to finish, as soon as they have it.
  int failing_workers = 0;
  /// Workers keep frames, as scheduler::Keeping has it.
  bool workers_keep = false;
  /// For each kept frame, of the coordinator: what is told of its units. The file takes half of send_seconds.
  double keep_seconds = .02;
  /// Frames that the coordinator finishes at a time; 0: as many as it has cores.
  int processes = 0;
};

struct FinishResult {
  double frames_per_hour = 0;
  /// Of what the workers' cores alone would render and finish.
  double share = 0;
  double finished_by_workers = 0;  // share of the frames
  double coordinator_busy = 0;     // share of its cores, for messages
  int failures = 0;                // of workers, to finish a frame
  double seconds = 0;              // all of it
};

/// Plays it in virtual time with the coordinator's own queue and leases (FrameQueue, FinishLeases). Workers
/// hold two units for each thread, which count until they are received; frames take the turns of units. The
/// coordinator's filter gets what messages leave of its cores. Beginning and end do not count.
FinishResult SimulateFinishing(const FinishSettings& settings);

}  // namespace lumifold::sim
