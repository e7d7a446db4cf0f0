#pragma once

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "client/command_line.h"
#include "client/environment.h"

namespace lumifold::client {

/// Which files a result becomes: the options `render` and `download` share.
struct PictureOptions {
  void AddTo(CommandLine& command_line);

  /// Looks at the names and their folders before any work is done. A value means that the program ends with
  /// it, the reason said on `err`. `command` is "lumifold COMMAND".
  std::optional<ExitCode> Check(const std::string& command, const Environment& environment) const;

  /// Makes of a result, an OpenEXR file at `part_path`, the files asked for, and leaves nothing at
  /// `part_path`. Errors: as client/output_file.h; `part_path` then stays.
  absl::Status Write(const std::string& part_path) const;

  std::string output;
  std::string noisy;  // empty: not wanted
  float exposure = 1;
};

}  // namespace lumifold::client
