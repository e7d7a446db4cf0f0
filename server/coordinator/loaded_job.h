#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "server/job/dependencies.h"
#include "server/job/frame_rounds.h"
#include "server/ledger/job_store.h"
#include "server/scheduler/types.h"

namespace lumifold::server {

/// What a job that is to be entered into the scheduler has on the disk.
struct LoadedJob {
  ledger::JobRecord record;
  std::vector<int32_t> finished;
  /// Committed units of the other frames, these frames, and the ends of the logs that this coordinator
  /// writes.
  std::vector<scheduler::RestoredUnit> units;
  std::set<int32_t> frames;
  std::map<int32_t, uint64_t> committed_bytes;
  /// Rounds of the frames with committed units, with adaptive sampling.
  std::map<int32_t, std::shared_ptr<const job::FrameRounds>> rounds;
  std::vector<job::Prerequisite> after;
  /// Workers that delivered units of the job.
  std::vector<std::string> deliverers;
  /// Why the job cannot continue; empty if it can.
  std::string error;
};

}  // namespace lumifold::server
