#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/parallel.h"
#include "filter/image/rect.h"
#include "lumifold/v1/farm.pb.h"
#include "server/child/child_process.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// Pixels of a preview, across or down, at most. Filtering that many takes about a second.
inline constexpr int kPreviewSide = 512;
/// A pixel of an unfinished frame's preview stands for as many of the frame's that it has about this many
/// samples: noise hides smaller things, and a quarter of the pixels is filtered in a quarter of the time.
inline constexpr int kPreviewSamples = 8;
/// But at least this many pixels remain across or down of a frame that has them.
inline constexpr int kLeastPreviewSide = 128;

/// Preview.units of a finished frame. A double can hold it, as programs need that read it as JSON.
inline constexpr int64_t kFinishedUnits = (int64_t{1} << 53) - 1;

/// Pixels of a preview of a region, across or down, at most: what a screen shows of it.
inline constexpr int kPreviewRegionSide = 768;

/// What a preview is made for.
struct PreviewRequest {
  /// As fast as the machine can, because somebody waits for it; otherwise with what others leave.
  bool urgent = true;
  /// Of the frame, to see these pixels and all of them: at most kPreviewRegionSide a side. Empty: the whole
  /// frame, reduced.
  Rect region = {};
};

/// Makes the preview of a frame, reduced to kPreviewSide or less, or of a region: of its result, or of a film
/// of the units that are committed, which is filtered after it is reduced; its picture is coarse where no
/// sample is yet (FillGaps). The latter has all channels of a result, and "samples.Y", the samples per pixel
/// of the frame; where the job's filter knows it (filter::CheckDeviation) also "error.Y", the estimated error
/// of the filtered picture: the root of the mean square of blocks of kSampleBlock pixels, in 8-bit steps, 0
/// where a tile has no pass.
/// Memory: a band of rows of the film, and twice the preview with all channels of the film.
/// Errors: those of CommittedUnits, ExrFilm and FilterFilm; kOutOfRange while no unit is committed;
/// kInvalidArgument for a region that is not within the frame.
/// Threads: safe concurrently; the preview does not depend on `pool`, which may be null.
absl::StatusOr<v1::Preview> MakePreview(const DataFolder& folder, ledger::JobStore& store,
                                        const job::JobId& job, int32_t frame, const PreviewRequest& request,
                                        TaskPool* pool);

/// The part of a preview that is one layer of GetPreviewRequest.
/// Errors: kInvalidArgument naming the layers that there are.
absl::StatusOr<v1::Preview> LayerOfPreview(const v1::Preview& all, const std::string& layer);

/// MakePreview in a child process. Errors: also those of ChildProcess::Run.
absl::StatusOr<v1::Preview> RunMakePreview(ChildProcess* process, const DataFolder& folder, int threads,
                                           const job::JobId& job, int32_t frame,
                                           const PreviewRequest& request);
/// First argument of the child process.
inline constexpr char kMakePreviewCommand[] = "make-preview";
/// Its main function: `arguments` are those after the command. Returns the exit code.
int RunMakePreviewProcess(const std::vector<std::string>& arguments);

}  // namespace lumifold::server
