#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "filter/blocks.h"
#include "filter/image/file_system.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "server/film/unit_source.h"
#include "server/job/frame_rounds.h"

namespace lumifold::server {

/// A frame whose units are all here. What it names must outlive the call.
struct CompleteFrame {
  const v1::JobSpec& spec;  // normalised
  int32_t frame = 0;
  std::string numeric_class;  // of its units
  const film::UnitSource& units;
  /// Of a job with adaptive sampling; else null.
  const job::FrameRounds* rounds = nullptr;
};

/// Where its picture goes.
struct PictureFile {
  std::string path;  // its folder exists
  FileSystem* files = nullptr;
  /// Asked once, before the file gets its name; an error is returned, and there is no file.
  std::function<absl::Status()> may_commit = [] { return absl::OkStatus(); };
};

/// Assembles the film of a frame from its units, filters it and writes the OpenEXR file. A frame of more than
/// one of `blocks` is assembled and filtered block by block and written in bands of rows, so that memory
/// holds one block, not the film. The bytes depend on the frame alone. Returns the time of each stage,
/// measured with `now`.
/// Errors: kDataLoss naming the damaged or missing record; those of the filter; kUnavailable for a disk
/// error.
/// Threads: safe for different files; the file does not depend on `pool`, which may be null.
absl::StatusOr<v1::FrameReport> MakePicture(const CompleteFrame& frame, const PictureFile& file,
                                            TaskPool* pool, const std::function<absl::Time()>& now,
                                            const filter::BlockParams& blocks = {});

/// Memory that MakePicture takes for a frame of the job, at most: with all layers and levels.
uint64_t PictureMemoryOf(const v1::JobSpec& spec);
/// Memory that the pictures made at a time on this machine may take together: half of what may be used, which
/// is the machine's or its control group's. The rest is for files that are read again.
uint64_t MemoryForPictures();
/// Whether a frame of the job is one block.
bool IsOneBlock(const v1::JobSpec& spec);

}  // namespace lumifold::server
