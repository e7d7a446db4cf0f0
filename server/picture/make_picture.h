#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "filter/blocks.h"
#include "filter/image/file_system.h"
#include "filter/image/filtered_picture.h"
#include "filter/image/parallel.h"
#include "filter/image/rect.h"
#include "lumifold/v1/job.pb.h"
#include "server/film/unit_layout.h"
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
  /// The pictures of blocks that MakeBlock has made, by number; nullopt or null: it is made here.
  std::function<absl::StatusOr<std::optional<std::string>>(int block)> ready_blocks = nullptr;
  FilterProgress progress = nullptr;  // null: nobody is told
};

/// The blocks of a frame of the job, numbered row by row.
class FrameBlocks {
 public:
  explicit FrameBlocks(const v1::JobSpec& spec, const filter::BlockParams& params = {});

  int count() const { return grid_.columns() * grid_.rows(); }
  int NumberOf(int column, int row) const { return row * grid_.columns() + column; }
  /// The pixels whose units are needed, and those of the picture that is made of them.
  Rect Input(int number) const { return grid_.Input(number % grid_.columns(), number / grid_.columns()); }
  Rect Output(int number) const { return grid_.Output(number % grid_.columns(), number / grid_.columns()); }
  /// Bytes of that picture.
  uint64_t PictureBytes(int number) const;

 private:
  filter::BlockGrid grid_;
};

/// The picture of one block of a frame: red, green and blue of its Output(), each as float32 row by row.
/// `frame.units` has those of its Input() at least, `levels` are those of the whole frame.
/// Errors: as MakePicture.
absl::StatusOr<std::string> MakeBlock(const CompleteFrame& frame, int block, const film::LevelSet& levels,
                                      TaskPool* pool, const filter::BlockParams& params = {});

/// Where its picture goes.
struct PictureFile {
  std::string path;  // its folder exists
  FileSystem* files = nullptr;
  /// Asked once, before the file gets its name; an error is returned, and there is no file.
  std::function<absl::Status()> may_commit = [] { return absl::OkStatus(); };
};

/// Assembles the film of a frame from its units, filters it and writes the OpenEXR file. A frame of more than
/// one of `blocks` is assembled and filtered block by block and written in bands of rows, so that memory
/// holds one block, not the film. The bytes depend on the frame alone, not on which blocks are ready. Returns
/// the time of each stage, measured with `now`.
/// Errors: kDataLoss naming the damaged or missing record, or for a ready block of the wrong size; those of
/// the filter; kUnavailable for a disk error.
/// Threads: safe for different files; the file does not depend on `pool`, which may be null.
absl::StatusOr<v1::FrameReport> MakePicture(const CompleteFrame& frame, const PictureFile& file,
                                            TaskPool* pool, const std::function<absl::Time()>& now,
                                            const filter::BlockParams& blocks = {});

/// Memory that MakePicture takes for a frame of the job, at most: with all layers and levels.
uint64_t PictureMemoryOf(const v1::JobSpec& spec);
/// Memory that the pictures made at a time on this machine may take together: half of what may be used, which
/// is the machine's or its control group's. The rest is for files that are read again.
uint64_t MemoryForPictures();

}  // namespace lumifold::server
