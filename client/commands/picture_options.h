#pragma once

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "client/backoff.h"
#include "client/command_line.h"
#include "client/environment.h"
#include "client/farm_client.h"
#include "client/frame_range.h"
#include "client/progress.h"

namespace lumifold::client {

/// Which files a result becomes: the options `render` and `download` share.
struct PictureOptions {
  void AddTo(CommandLine& command_line);

  /// Looks at the names and their folders before any work is done: several frames need a place for their
  /// number in each name. A value means that the program ends with it, the reason said on `err`. `command` is
  /// "lumifold COMMAND".
  std::optional<ExitCode> Check(const FrameRange& frames, const std::string& command,
                                const Environment& environment) const;

  /// Downloads a frame and makes of it the files asked for; on its way it is at PartPath() of its output.
  /// Errors: as DownloadFrame() and client/output_file.h; the part then stays.
  absl::Status Fetch(FarmClient& farm, const std::string& job_id, int frame, Progress& progress,
                     Backoff backoff) const;

  std::string output;  // # stand for the frame's number, see PathOfFrame()
  std::string noisy;   // the same; empty: not wanted
  float exposure = 1;

 private:
  absl::Status Write(const std::string& part_path, int frame) const;
};

}  // namespace lumifold::client
