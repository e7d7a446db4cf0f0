#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/byte_stream.h"
#include "server/film/unit_log.h"
#include "server/film/unit_record.h"
#include "worker/finish/memory_files.h"
#include "worker/units/unit_renderer.h"

namespace lumifold::worker {

/// A unit that was rendered, as the record that the coordinator would store of it, and checked as there.
/// Errors: those of film::UnitAssembler::Add.
absl::StatusOr<film::EncodedUnit> RecordOf(const v1::JobSpec& spec, const v1::Lease& lease,
                                           const RenderedUnit& unit);

/// The records of frames that the worker keeps: a unit log for each, in memory.
/// Threads: one at a time; records of units that were added can be read meanwhile.
class KeptUnits {
 public:
  KeptUnits() = default;
  KeptUnits(const KeptUnits&) = delete;
  KeptUnits& operator=(const KeptUnits&) = delete;

  /// Errors: those of film::UnitLog.
  absl::Status Add(const film::EncodedUnit& unit);
  /// The log of the frame. Errors: kFailedPrecondition where nothing of it is here; those of opening it.
  absl::StatusOr<rpc::FileHandle> Open(const v1::UnitId& unit);
  void Drop(const v1::UnitId& unit) { Drop({unit.job_id(), unit.frame()}); }
  void DropJob(const std::string& job_id);
  void Clear();
  bool IsEmpty() const { return logs_.empty(); }

 private:
  using Frame = std::pair<std::string, int32_t>;

  static std::string PathOf(const Frame& frame);
  void Drop(const Frame& frame);

  MemoryFiles files_;
  std::map<Frame, film::UnitLog> logs_;
};

}  // namespace lumifold::worker
