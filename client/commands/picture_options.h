#pragma once

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "client/cli/command_line.h"
#include "client/cli/environment.h"
#include "client/cli/frame_range.h"
#include "client/cli/progress.h"
#include "client/farm/backoff.h"
#include "client/farm/farm_client.h"
#include "client/pictures/display_file.h"

namespace lumifold::client {

/// Output files of a result: options of `render`, `download` and `submit`.
struct PictureOptions {
  /// `output_option` is the name of the option for the picture itself, such as "-o,--output".
  void AddTo(CommandLine& command_line, const std::string& output_option, bool is_required);

  /// Checks names and folders before any work is done; for several frames each name needs a placeholder for
  /// the frame number. For an error it prints to `err` and returns the exit code. `command` is "lumifold
  /// COMMAND".
  std::optional<ExitCode> Check(const Frames& frames, const std::string& command,
                                const Environment& environment) const;

  /// The path of a frame's picture.
  std::string OutputOf(const v1::JobStatus& job, int frame) const;

  /// Downloads a frame to PartPath() of the output and writes the requested files.
  /// Errors: those of DownloadFrame() and client/pictures/output_file.h; the partial download then stays.
  absl::Status Fetch(FarmClient& farm, const v1::JobStatus& job, int frame, Progress& progress,
                     Backoff backoff) const;
  /// The same for several frames, without those that the job skips.
  absl::Status FetchAll(FarmClient& farm, const v1::JobStatus& job, const Frames& frames, Progress& progress,
                        const Backoff& backoff) const;

  std::string output;  // see client/pictures/output_template.h; empty: none is written
  std::string noisy;   // the same
  pictures::DisplayOptions display;
  std::string compression;       // of an .exr, see ExrCopyOptions; empty: as the coordinator wrote it
  std::string parts = "single";  // or "layers"
  std::string exr;               // "lean" or "full"; empty: full of films and reproducible ones, else lean
  bool is_reproducible = false;  // without date, owner and times
  int threads = 1;               // to compress with

 private:
  std::string output_option_ = "-o";  // as errors name it
  absl::Status CheckName(const char* option, const std::string& path, const Frames& frames) const;
  absl::Status Write(const std::string& part_path, const v1::JobStatus& job, int frame) const;
  absl::Status WriteExr(const std::string& part_path, const v1::JobStatus& job,
                        const std::string& path) const;
};

/// "out.exr", or "out.0001.exr to out.0048.exr": the files of an output.
std::string FilesOf(const std::string& path, const v1::JobStatus& job, const Frames& frames);

}  // namespace lumifold::client
