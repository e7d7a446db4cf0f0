#include <nlohmann/json.hpp>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "filter/image/exr_io.h"
#include "filter/metrics/metrics.h"

namespace lumifold::client {
namespace {

struct CompareOptions {
  std::string picture;
  std::string reference;
  std::string layer;
  std::string reference_layer;
  float exposure = 1;
  bool json = false;
};

struct Errors {
  double mse255 = 0;
  double psnr_db = 0;
  double rel_mse = 0;
};

absl::StatusOr<LayeredImage> ReadWithLayer(const std::string& path, const std::string& layer) {
  absl::StatusOr<LayeredImage> image = ReadExr(path);
  if (absl::IsInvalidArgument(image.status())) return absl::DataLossError(image.status().message());
  if (image.ok() && !image->HasColor(layer)) {
    return absl::NotFoundError(layer.empty() ? absl::StrCat(path, ": has no channels R, G and B")
                                             : absl::StrCat(path, ": has no colour layer '", layer, "'"));
  }
  return image;
}

absl::StatusOr<Errors> Compare(const CompareOptions& options) {
  const absl::StatusOr<LayeredImage> picture = ReadWithLayer(options.picture, options.layer);
  if (!picture.ok()) return picture.status();
  const absl::StatusOr<LayeredImage> reference = ReadWithLayer(options.reference, options.reference_layer);
  if (!reference.ok()) return reference.status();
  if (picture->bounds() != reference->bounds()) {
    return absl::InvalidArgumentError(absl::StrCat(options.picture, " has ", picture->width(), "x",
                                                   picture->height(), " pixels, ", options.reference, " has ",
                                                   reference->width(), "x", reference->height()));
  }
  const ConstColorView x = picture->GetColor(options.layer);
  const ConstColorView r = reference->GetColor(options.reference_layer);
  return Errors{.mse255 = metrics::Mse255(x, r, options.exposure),
                .psnr_db = metrics::Psnr(x, r, options.exposure),
                .rel_mse = metrics::RelMse(x, r)};
}

}  // namespace

ExitCode RunCompare(const std::vector<std::string>& arguments, const Environment& environment) {
  CompareOptions options;
  CommandLine command_line("compare", SummaryOf("compare"));
  command_line.AddArgument("PICTURE", &options.picture, "The OpenEXR picture to judge");
  command_line.AddArgument("REFERENCE", &options.reference, "The OpenEXR picture taken for true");
  command_line.AddText("--layer", "NAME", &options.layer,
                       "Judge this layer of PICTURE, such as 'noisy' (default: the finished picture)");
  command_line.AddText("--reference-layer", "NAME", &options.reference_layer,
                       "Against this layer of REFERENCE (default: the finished picture)");
  command_line.AddPositiveNumber("--exposure", &options.exposure,
                                 "Factor on the light, for MSE255 and PSNR (default 1)");
  AddJson(command_line, &options.json);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<Errors> errors = Compare(options);
  if (!errors.ok()) return ReportError(environment, errors.status());
  if (options.json) {
    // JSON knows no infinity: the PSNR of equal pictures is null.
    const nlohmann::ordered_json json{
        {"mse255", errors->mse255}, {"psnr_db", errors->psnr_db}, {"rel_mse", errors->rel_mse}};
    environment.out << json.dump() << "\n" << std::flush;
  } else {
    environment.out << absl::StrFormat("MSE255 %.4f\nPSNR %.2f dB\nrelMSE %.6f\n", errors->mse255,
                                       errors->psnr_db, errors->rel_mse)
                    << std::flush;
  }
  return ExitCode::kOk;
}

}  // namespace lumifold::client
