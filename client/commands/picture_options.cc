#include "client/commands/picture_options.h"

#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/download.h"
#include "client/output_file.h"
#include "filter/image/layers.h"

namespace lumifold::client {

void PictureOptions::AddTo(CommandLine& command_line) {
  command_line.AddRequiredText(
      "-o,--output", "FILE", &output,
      "Output file: .exr with all layers, or .png; ### is replaced by the frame number");
  command_line.AddText("--noisy", "FILE", &noisy, "Also write the unfiltered picture, as .png");
  command_line.AddPositiveNumber("--exposure", &exposure, "Factor on the radiance of a .png (default 1)");
}

std::optional<ExitCode> PictureOptions::Check(const Frames& frames, const std::string& command,
                                              const Environment& environment) const {
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(output);
  if (!format.ok()) return ReportUsage(environment, command, absl::StrCat("-o: ", format.status().message()));
  const absl::StatusOr<PictureFormat> noisy_format = PictureFormatOf(noisy);
  if (!noisy.empty() && (!noisy_format.ok() || *noisy_format != PictureFormat::kPng)) {
    return ReportUsage(environment, command,
                       absl::StrCat("--noisy: expected a name that ends in .png; got '", noisy, "'"));
  }
  for (const auto& [option, path] : {std::pair("-o", output), std::pair("--noisy", noisy)}) {
    if (frames.IsOne() || path.empty() || HasFrameNumber(path)) continue;
    return ReportUsage(
        environment, command,
        absl::StrCat(option, ": expected a name with ### for the frame's number; got '", path, "'"));
  }
  absl::Status writable = CheckOutput(PathOfFrame(output, frames.first()));
  if (writable.ok() && !noisy.empty()) writable = CheckOutput(PathOfFrame(noisy, frames.first()));
  if (!writable.ok()) return ReportError(environment, writable);
  return std::nullopt;
}

absl::Status PictureOptions::Fetch(FarmClient& farm, const std::string& job_id, int frame, Progress& progress,
                                   Backoff backoff) const {
  const absl::StatusOr<std::string> part = PartPath(PathOfFrame(output, frame), job_id, frame);
  if (!part.ok()) return part.status();
  const absl::Status downloaded = DownloadFrame(farm, job_id, frame, *part, progress, std::move(backoff));
  return downloaded.ok() ? Write(*part, frame) : downloaded;
}

absl::Status PictureOptions::Write(const std::string& part_path, int frame) const {
  const std::string path = PathOfFrame(output, frame);
  if (!noisy.empty()) {
    absl::Status written =
        WritePngOfLayer(part_path, std::string(layers::kNoisy), exposure, PathOfFrame(noisy, frame));
    if (!written.ok()) return written;
  }
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(output);
  if (!format.ok()) return format.status();
  if (*format == PictureFormat::kExr) return MoveIntoPlace(part_path, path);
  absl::Status written = WritePngOfLayer(part_path, std::string(layers::kBeauty), exposure, path);
  if (!written.ok()) return written;
  std::error_code ignored;  // the picture is written; a leftover part is harmless
  std::filesystem::remove(part_path, ignored);
  return absl::OkStatus();
}

}  // namespace lumifold::client
