#include "client/commands/preview_options.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "client/pictures/output_file.h"

namespace lumifold::client {

void AddPreview(CommandLine& command_line, std::string* path) {
  command_line.AddText(
      "--preview", "FILE", path,
      "Keep this .png, .jpg or .exr up to date with a small filtered picture of what is rendered");
}

std::optional<ExitCode> CheckPreview(const std::string& path, const std::string& command,
                                     const Environment& environment) {
  if (path.empty()) return std::nullopt;
  if (const absl::StatusOr<PictureFormat> format = PictureFormatOf(path); !format.ok())
    return ReportUsage(environment, command, absl::StrCat("--preview: ", format.status().message()));
  if (const absl::Status writable = CheckOutput(path); !writable.ok())
    return ReportError(environment, writable);
  return std::nullopt;
}

std::unique_ptr<PreviewFile> StartPreview(std::unique_ptr<FarmClient> farm, const PreviewFileOptions& file) {
  if (file.path.empty()) return nullptr;
  return std::make_unique<PreviewFile>(std::move(farm), file);
}

}  // namespace lumifold::client
