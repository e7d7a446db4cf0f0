#include "client/commands/picture_options.h"

#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "client/output_file.h"
#include "filter/image/layers.h"

namespace lumifold::client {

void PictureOptions::AddTo(CommandLine& command_line) {
  command_line.AddRequiredText("-o,--output", "FILE", &output,
                               "Where the picture goes: .exr with all layers, or .png");
  command_line.AddText("--noisy", "FILE", &noisy, "Also write the unfiltered picture, as .png");
  command_line.AddPositiveNumber("--exposure", &exposure, "Factor on the light of a .png (default 1)");
}

std::optional<ExitCode> PictureOptions::Check(const std::string& command,
                                              const Environment& environment) const {
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(output);
  if (!format.ok()) return ReportUsage(environment, command, absl::StrCat("-o: ", format.status().message()));
  const absl::StatusOr<PictureFormat> noisy_format = PictureFormatOf(noisy);
  if (!noisy.empty() && (!noisy_format.ok() || *noisy_format != PictureFormat::kPng)) {
    return ReportUsage(environment, command,
                       absl::StrCat("--noisy: expected a name that ends in .png; got '", noisy, "'"));
  }
  absl::Status writable = CheckOutput(output);
  if (writable.ok() && !noisy.empty()) writable = CheckOutput(noisy);
  if (!writable.ok()) return ReportError(environment, writable);
  return std::nullopt;
}

absl::Status PictureOptions::Write(const std::string& part_path) const {
  if (!noisy.empty()) {
    absl::Status written = WritePngOfLayer(part_path, std::string(layers::kNoisy), exposure, noisy);
    if (!written.ok()) return written;
  }
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(output);
  if (!format.ok()) return format.status();
  if (*format == PictureFormat::kExr) return MoveIntoPlace(part_path, output);
  absl::Status written = WritePngOfLayer(part_path, std::string(layers::kBeauty), exposure, output);
  if (!written.ok()) return written;
  std::error_code ignored;  // the picture is there; what is left over is only untidy
  std::filesystem::remove(part_path, ignored);
  return absl::OkStatus();
}

}  // namespace lumifold::client
