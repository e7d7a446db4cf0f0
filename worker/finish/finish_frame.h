#pragma once

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/byte_stream.h"
#include "worker/finish/frame_link.h"
#include "worker/units/unit_renderer.h"

namespace lumifold::filter {
class FilterDevice;
}  // namespace lumifold::filter

namespace lumifold::worker {

/// How a worker finishes frames.
struct FrameWork {
  FrameLink* link = nullptr;  // null: it finishes none
  std::string numeric_class;  // the worker's, which is the job's
  /// Filters beside this thread; null: nothing does.
  std::shared_ptr<filter::FilterDevice> device = nullptr;
};

/// Makes the result of a leased frame on this thread and delivers it, or a block of it, or the errors of one
/// of its rounds: the bytes are those that the coordinator would write. No file is written; units and result
/// lie in memory. `kept`: the records of the frame's units, one after another; not valid: they are fetched.
/// Errors: those of FrameLink, MakePicture and job::FrameRounds::Replay; kResourceExhausted without memory;
/// kCancelled once control->stop is true, between its stages.
/// Threads: safe concurrently.
absl::Status FinishFrame(const v1::JobSpec& spec, const v1::Lease& lease, rpc::FileHandle kept,
                         const FrameWork& work, UnitControl* control);

}  // namespace lumifold::worker
