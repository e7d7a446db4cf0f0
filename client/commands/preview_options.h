#pragma once

#include <memory>
#include <optional>
#include <string>

#include "client/cli/command_line.h"
#include "client/cli/environment.h"
#include "client/farm/farm_client.h"
#include "client/pictures/preview_file.h"

namespace lumifold::client {

/// Adds --preview: a file that is kept up to date while a job is followed.
void AddPreview(CommandLine& command_line, std::string* path);

/// Checks name and folder of a preview, if there is one. For an error it prints to `err` and returns the exit
/// code. `command` is "lumifold COMMAND".
std::optional<ExitCode> CheckPreview(const std::string& path, const std::string& command,
                                     const Environment& environment);

/// Starts to keep the file up to date; null where there is none.
std::unique_ptr<PreviewFile> StartPreview(std::unique_ptr<FarmClient> farm, const PreviewFileOptions& file);

}  // namespace lumifold::client
