#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/output_file.h"

namespace lumifold::client {

ExitCode RunConvert(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string picture;
  std::string output;
  std::string layer;
  float exposure = 1;
  CommandLine command_line("convert", SummaryOf("convert"));
  command_line.AddArgument("PICTURE", &picture, "The OpenEXR picture");
  command_line.AddRequiredText("-o,--output", "FILE", &output, "Output file, .png");
  command_line.AddText("--layer", "NAME", &layer,
                       "Layer to write, such as 'noisy' (default: the finished picture)");
  command_line.AddPositiveNumber("--exposure", &exposure, "Factor on the radiance (default 1)");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<PictureFormat> format = PictureFormatOf(output);
  if (!format.ok() || *format != PictureFormat::kPng) {
    return ReportUsage(environment, "lumifold convert",
                       absl::StrCat("-o: expected a name that ends in .png; got '", output, "'"));
  }
  absl::Status status = CheckOutput(output);
  if (status.ok()) status = WritePngOfLayer(picture, layer, exposure, output);
  return status.ok() ? ExitCode::kOk : ReportError(environment, status);
}

}  // namespace lumifold::client
