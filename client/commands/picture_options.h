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

/// Output files of a result: options of `render` and `download`.
struct PictureOptions {
  void AddTo(CommandLine& command_line);

  /// Checks names and folders before any work is done; for several frames each name needs a placeholder for
  /// the frame number. For an error it prints to `err` and returns the exit code. `command` is "lumifold
  /// COMMAND".
  std::optional<ExitCode> Check(const Frames& frames, const std::string& command,
                                const Environment& environment) const;

  /// Downloads a frame to PartPath() of the output and writes the requested files.
  /// Errors: those of DownloadFrame() and client/output_file.h; the partial download then stays.
  absl::Status Fetch(FarmClient& farm, const std::string& job_id, int frame, Progress& progress,
                     Backoff backoff) const;

  std::string output;  // # are replaced by the frame number, see PathOfFrame()
  std::string noisy;   // the same; empty: not written
  float exposure = 1;

 private:
  absl::Status Write(const std::string& part_path, int frame) const;
};

}  // namespace lumifold::client
