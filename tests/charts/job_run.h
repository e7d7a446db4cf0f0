#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "lumifold/v1/job.pb.h"
#include "worker/units/job_scene.h"

namespace lumifold::charts {

/// What a job of one frame took, from its plan to the filtered picture.
struct JobCosts {
  int64_t rays = 0;          // of passes and of the probe
  int64_t float_bytes = 0;   // of the channels of all units as float32
  int64_t wire_bytes = 0;    // of the messages that deliver units and plan
  int64_t stored_bytes = 0;  // of the records in the unit log
  // Processor seconds, all threads together.
  double plan_seconds = 0;
  double render_seconds = 0;    // with the scene's tables and tree
  double transfer_seconds = 0;  // encoding, checks, log, assembly
  double filter_seconds = 0;

  double TotalSeconds() const { return plan_seconds + render_seconds + transfer_seconds + filter_seconds; }
};

struct JobResult {
  v1::JobSpec spec;  // with its plan
  JobCosts costs;
  Picture picture;  // filtered
};

/// Runs a job as a worker and a coordinator do, by their own code, in this process and without a network:
/// plan, units, messages, unit log, film, filter. `scene` is that of the job's only frame, `spec` is
/// normalised and uniformly sampled. `scratch`: a folder for the log, which is deleted.
/// Errors: those of the stages.
absl::StatusOr<JobResult> RunJob(const worker::JobScene& scene, v1::JobSpec spec, const std::string& scratch,
                                 TaskPool* pool);

}  // namespace lumifold::charts
