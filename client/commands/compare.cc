#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "filter/image/exr_io.h"
#include "filter/metrics/metrics.h"
#include "filter/metrics/ssim.h"

namespace lumifold::client {
namespace {

struct CompareOptions {
  std::string picture;
  std::string reference;
  std::string layer;
  std::string reference_layer;
  std::string metrics = "mse255,psnr,relmse";
  float exposure = 1;
  bool json = false;
};

using MetricFunction = absl::StatusOr<double> (*)(const ConstColorView& picture,
                                                  const ConstColorView& reference, float exposure);

/// A way to judge a picture: its name for --metric and in words and JSON, and how its value is printed.
struct Metric {
  std::string_view name;
  std::string_view title;
  std::string_view json_key;
  int decimals = 0;
  std::string_view unit;
  MetricFunction measure = nullptr;
};

using Color = ConstColorView;
constexpr std::array<Metric, 6> kMetrics = {{
    {"mse255", "MSE255", "mse255", 4, "",
     [](const Color& x, const Color& r, float exposure) -> absl::StatusOr<double> {
       return metrics::Mse255(x, r, exposure);
     }},
    {"psnr", "PSNR", "psnr_db", 2, " dB",
     [](const Color& x, const Color& r, float exposure) -> absl::StatusOr<double> {
       return metrics::Psnr(x, r, exposure);
     }},
    {"relmse", "relMSE", "rel_mse", 6, "",
     [](const Color& x, const Color& r, float) -> absl::StatusOr<double> { return metrics::RelMse(x, r); }},
    {"trimmed-relmse", "trimmed relMSE", "trimmed_rel_mse", 6, "",
     [](const Color& x, const Color& r, float) -> absl::StatusOr<double> {
       return metrics::TrimmedRelMse(x, r);
     }},
    {"ssim", "SSIM", "ssim", 6, "", metrics::Ssim},
    {"ms-ssim", "MS-SSIM", "ms_ssim", 6, "", metrics::MsSsim},
}};

/// What one metric found.
struct Judged {
  const Metric* metric = nullptr;
  double value = 0;
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

/// Errors: kInvalidArgument naming a metric that is unknown.
absl::StatusOr<std::vector<const Metric*>> ParseMetrics(const std::string& text) {
  std::vector<const Metric*> chosen;
  const std::vector<std::string> names = absl::StrSplit(text, ',');
  for (const std::string& name : names) {
    const auto found =
        std::find_if(kMetrics.begin(), kMetrics.end(), [&](const Metric& m) { return m.name == name; });
    if (found == kMetrics.end())
      return absl::InvalidArgumentError(absl::StrCat("--metric: no metric is named '", name, "'"));
    chosen.push_back(&*found);
  }
  return chosen;
}

absl::StatusOr<std::vector<Judged>> Compare(const CompareOptions& options,
                                            const std::vector<const Metric*>& chosen) {
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
  std::vector<Judged> judged;
  for (const Metric* metric : chosen) {
    const absl::StatusOr<double> value = metric->measure(x, r, options.exposure);
    if (!value.ok()) return value.status();
    judged.push_back({metric, *value});
  }
  return judged;
}

void PrintJson(const std::vector<Judged>& judged, std::ostream& out) {
  // JSON knows no infinity: the PSNR of equal pictures is null.
  nlohmann::ordered_json json;
  for (const Judged& j : judged) json[std::string(j.metric->json_key)] = j.value;
  out << json.dump() << "\n" << std::flush;
}

void PrintWords(const std::vector<Judged>& judged, std::ostream& out) {
  for (const Judged& j : judged) {
    out << absl::StrFormat("%s %.*f%s\n", std::string(j.metric->title), j.metric->decimals, j.value,
                           std::string(j.metric->unit));
  }
  out << std::flush;
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
                                 "Factor on the light, for all but relMSE (default 1)");
  command_line.AddText("--metric", "NAME,...", &options.metrics,
                       "What to measure: mse255, psnr, relmse, trimmed-relmse, ssim, ms-ssim (default "
                       "mse255,psnr,relmse)");
  AddJson(command_line, &options.json);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  const absl::StatusOr<std::vector<const Metric*>> chosen = ParseMetrics(options.metrics);
  if (!chosen.ok())
    return ReportUsage(environment, "lumifold compare", std::string(chosen.status().message()));

  const absl::StatusOr<std::vector<Judged>> judged = Compare(options, *chosen);
  if (!judged.ok()) return ReportError(environment, judged.status());
  options.json ? PrintJson(*judged, environment.out) : PrintWords(*judged, environment.out);
  return ExitCode::kOk;
}

}  // namespace lumifold::client
