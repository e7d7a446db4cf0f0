#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "client/cli/json_line.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/options/display_options.h"
#include "client/pictures/output_file.h"

namespace lumifold::client {

ExitCode RunConvert(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string picture;
  std::string output;
  std::string layer;
  pictures::DisplayOptions display;
  bool json = false;
  CommandLine command_line(WordsOf("convert"));
  command_line.AddArgument("PICTURE", &picture, "The OpenEXR picture");
  command_line.AddRequiredText("-o,--output", "FILE", &output, "Output file, .png or .jpg");
  command_line.AddText("--layer", "NAME", &layer,
                       "Layer to write, such as 'noisy' (default: the finished picture)");
  AddDisplayOptions(command_line, &display);
  AddJson(command_line, &json);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<PictureFormat> format = PictureFormatOf(output);
  if (!format.ok() || !IsDisplayed(*format)) {
    return ReportUsage(environment, "lumifold convert",
                       absl::StrCat("-o: expected a name that ends in .png or .jpg; got '", output, "'"));
  }
  absl::Status status = CheckOutput(output);
  if (status.ok()) status = WriteLayer(picture, layer, display, output);
  if (!status.ok()) return ReportError(environment, status);
  if (json) environment.out << JsonLine({{"output", output}}) << "\n" << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
