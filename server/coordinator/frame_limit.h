#pragma once

#include <cstddef>
#include <cstdint>

#include "lumifold/v1/job.pb.h"
#include "server/job/tile_grid.h"

namespace lumifold::server {

/// What the coordinator's machine has for the unit logs and the bookkeeping of frames in flight.
struct FrameResources {
  /// Number of unit logs that may be open.
  size_t open_logs = 0;
  uint64_t free_disk_bytes = 0;
  /// Physical memory.
  uint64_t memory_bytes = 0;
};

/// What the largest frame needs until its result is written.
struct FrameDemand {
  uint64_t log_bytes = 0;
  int64_t units = 0;
};

/// Mean size of the records of a job's units, as far as they are known.
struct UnitBytes {
  uint64_t bytes = 0;
  int64_t units = 0;
};

/// The demand of a frame of a job. Before its first units are committed it is taken to have 120 floats for
/// each pixel and pass, which is between what a scene without reflections has (60) and one with all
/// reflection levels (250).
FrameDemand DemandOf(const v1::JobSpec& spec, const job::FrameUnits& units, const UnitBytes& known);

/// Number of frames that may be in flight, at least 1: each has an open log, half of the free disk holds
/// their logs, and a sixteenth of the memory the bookkeeping of their units. The other half of the disk is
/// for results, assets and frames whose units turn out larger; with more than one open log for each frame
/// logs would be opened again and again.
int MaxActiveFrames(const FrameResources& resources, const FrameDemand& demand);

/// The frames that may be in flight, by what the machine has and what the largest frame of any job demands.
/// Pure state.
/// Threads: one at a time.
class FrameLimit {
 public:
  explicit FrameLimit(const FrameResources& resources) : resources_(resources) {}

  /// Forgets all demands: those of the jobs that are active now follow.
  void Reset(uint64_t free_disk_bytes);
  /// Adds the demand of a job's frames.
  void Add(const FrameDemand& demand);
  int MaxActiveFrames() const { return server::MaxActiveFrames(resources_, largest_); }

 private:
  FrameResources resources_;
  FrameDemand largest_;
};

/// Number of unit logs that this process may keep open: a quarter of its descriptors, at most 256. The others
/// are for connections, uploads, downloads and the ledger.
size_t MaxOpenLogs();

}  // namespace lumifold::server
