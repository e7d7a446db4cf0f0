#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/cli/exit_code.h"
#include "client/cli/json_line.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/pictures/output_file.h"
#include "filter/image/exr_io.h"
#include "filter/image/layers.h"
#include "filter/image/png_io.h"
#include "filter/metrics/flip.h"
#include "filter/metrics/heat_map.h"
#include "filter/metrics/metrics.h"
#include "filter/metrics/regions.h"
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
  bool by_region = false;
  std::string heat_map;
  bool json = false;
};

using MetricFunction = absl::StatusOr<double> (*)(const ConstColorView& picture,
                                                  const ConstColorView& reference, float exposure);

/// An error metric: its name for --metric, in text and in JSON, and the format of its value.
struct Metric {
  std::string_view name;
  std::string_view title;
  std::string_view json_key;
  int decimals = 0;
  std::string_view unit;
  MetricFunction measure = nullptr;
};

using Color = ConstColorView;
constexpr std::array<Metric, 8> kMetrics = {{
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
    {"flip", "FLIP", "flip", 6, "",
     [](const Color& x, const Color& r, float exposure) -> absl::StatusOr<double> {
       return metrics::Flip(x, r, exposure);
     }},
    {"flip-hdr", "HDR-FLIP", "flip_hdr", 6, "",
     [](const Color& x, const Color& r, float) -> absl::StatusOr<double> { return metrics::HdrFlip(x, r); }},
}};

/// Value of one metric.
struct MetricValue {
  const Metric* metric = nullptr;
  double value = 0;
};

/// All values of a comparison.
struct Comparison {
  std::vector<MetricValue> values;
  std::optional<metrics::RegionMeans> regions;  // of MSE255
  std::optional<float> heat_scale;              // 8-bit steps
};

absl::StatusOr<EdgedImage> ReadWithLayer(const std::string& path, const std::string& layer) {
  absl::StatusOr<EdgedImage> image = ReadEdgedExr(path);
  if (absl::IsInvalidArgument(image.status())) return absl::DataLossError(image.status().message());
  if (image.ok() && !image->pixels.HasColor(layer)) {
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

/// Errors: kNotFound if the reference has none of the layers that define regions.
absl::StatusOr<metrics::RegionMeans> CompareRegions(const CompareOptions& options,
                                                    const EdgedImage& reference, const Color& x,
                                                    const Color& r) {
  const LayeredImage& pixels = reference.pixels;
  if (!pixels.HasColor(layers::kAlbedo) && !pixels.HasColor(layers::kDirect) &&
      !reference.edges.Has(layers::kPixelX)) {
    return absl::NotFoundError(
        absl::StrCat(options.reference, ": has no layers that define regions: 'albedo', 'direct' or edges"));
  }
  return metrics::Mse255ByRegion(x, r, metrics::RegionsOf(reference), options.exposure);
}

/// Writes the heat map of the errors and returns its scale.
absl::StatusOr<float> WriteHeatMap(const CompareOptions& options, const Color& x, const Color& r) {
  const Plane errors = metrics::StepErrors(x, r, options.exposure);
  const float scale = metrics::HeatScale(errors.view());
  const std::array<Plane, 3> map = metrics::HeatMap(errors.view(), scale);
  const absl::Status written = WritePng(options.heat_map, {map[0].view(), map[1].view(), map[2].view()});
  if (!written.ok()) return OfThisMachine(written);
  return scale;
}

absl::StatusOr<Comparison> Compare(const CompareOptions& options, const std::vector<const Metric*>& chosen) {
  const absl::StatusOr<EdgedImage> picture = ReadWithLayer(options.picture, options.layer);
  if (!picture.ok()) return picture.status();
  const absl::StatusOr<EdgedImage> reference = ReadWithLayer(options.reference, options.reference_layer);
  if (!reference.ok()) return reference.status();
  if (picture->pixels.bounds() != reference->pixels.bounds()) {
    return absl::InvalidArgumentError(absl::StrCat(
        options.picture, " has ", picture->pixels.width(), "x", picture->pixels.height(), " pixels, ",
        options.reference, " has ", reference->pixels.width(), "x", reference->pixels.height()));
  }
  const Color x = picture->pixels.GetColor(options.layer);
  const Color r = reference->pixels.GetColor(options.reference_layer);
  Comparison comparison;
  for (const Metric* metric : chosen) {
    const absl::StatusOr<double> value = metric->measure(x, r, options.exposure);
    if (!value.ok()) return value.status();
    comparison.values.push_back({metric, *value});
  }
  if (options.by_region) {
    const absl::StatusOr<metrics::RegionMeans> regions = CompareRegions(options, *reference, x, r);
    if (!regions.ok()) return regions.status();
    comparison.regions = *regions;
  }
  if (!options.heat_map.empty()) {
    const absl::StatusOr<float> scale = WriteHeatMap(options, x, r);
    if (!scale.ok()) return scale.status();
    comparison.heat_scale = *scale;
  }
  return comparison;
}

nlohmann::ordered_json RegionsJson(const metrics::RegionMeans& regions) {
  nlohmann::ordered_json json;
  for (size_t i = 0; i < metrics::kRegionCount; ++i) {
    if (regions.share[i] == 0) continue;
    json[std::string(metrics::kRegionNames[i])] = {{"share", regions.share[i]},
                                                   {"mse255", regions.of_region[i]}};
  }
  return json;
}

void PrintJson(const Comparison& comparison, std::ostream& out) {
  // JSON has no infinity: the PSNR of equal pictures is null.
  nlohmann::ordered_json json;
  for (const MetricValue& j : comparison.values) json[std::string(j.metric->json_key)] = j.value;
  if (comparison.regions.has_value()) json["regions"] = RegionsJson(*comparison.regions);
  if (comparison.heat_scale.has_value()) json["heatmap_scale"] = *comparison.heat_scale;
  out << JsonLine(json) << "\n" << std::flush;
}

void PrintText(const CompareOptions& options, const Comparison& comparison, std::ostream& out) {
  for (const MetricValue& j : comparison.values) {
    out << absl::StrFormat("%s %.*f%s\n", std::string(j.metric->title), j.metric->decimals, j.value,
                           std::string(j.metric->unit));
  }
  for (size_t i = 0; comparison.regions.has_value() && i < metrics::kRegionCount; ++i) {
    if (comparison.regions->share[i] == 0) continue;
    out << absl::StrFormat("MSE255 of %s %.4f (%.1f %% of pixels)\n", std::string(metrics::kRegionNames[i]),
                           comparison.regions->of_region[i], 100 * comparison.regions->share[i]);
  }
  if (comparison.heat_scale.has_value()) {
    out << absl::StrFormat(
        "%s: black is 0, pale yellow is %g or more 8-bit steps (root mean square of R G B)\n",
        options.heat_map, *comparison.heat_scale);
  }
  out << std::flush;
}

/// Errors: kInvalidArgument for a name that does not end in .png; those of CheckOutput.
absl::Status CheckHeatMap(const std::string& path) {
  if (path.empty()) return absl::OkStatus();
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(path);
  if (!format.ok() || *format != PictureFormat::kPng)
    return absl::InvalidArgumentError(
        absl::StrCat("--heatmap: expected a name that ends in .png; got '", path, "'"));
  return CheckOutput(path);
}

}  // namespace

ExitCode RunCompare(const std::vector<std::string>& arguments, const Environment& environment) {
  CompareOptions options;
  CommandLine command_line(WordsOf("compare"));
  command_line.AddArgument("PICTURE", &options.picture, "The OpenEXR picture");
  command_line.AddArgument("REFERENCE", &options.reference, "The OpenEXR reference picture");
  command_line.AddText("--layer", "NAME", &options.layer,
                       "Layer of PICTURE, such as 'noisy' (default: the finished picture)");
  command_line.AddText("--reference-layer", "NAME", &options.reference_layer,
                       "Layer of REFERENCE (default: the finished picture)");
  command_line.AddPositiveNumber(
      "--exposure", &options.exposure,
      "Factor on the radiance, for all metrics except relMSE and flip-hdr (default 1)");
  command_line.AddText("--metric", "NAME,...", &options.metrics,
                       "Metrics: mse255, psnr, relmse, trimmed-relmse, ssim, ms-ssim, flip, flip-hdr "
                       "(default mse255,psnr,relmse)");
  command_line.AddFlag(
      "--by-region", &options.by_region,
      "Also MSE255 of edges, mirrors, shadow bands, textures and flat surfaces, defined by the layers of "
      "REFERENCE");
  command_line.AddText("--heatmap", "FILE.png", &options.heat_map,
                       "Write the error of each pixel as a heat map");
  AddJson(command_line, &options.json);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  const absl::StatusOr<std::vector<const Metric*>> chosen = ParseMetrics(options.metrics);
  if (!chosen.ok())
    return ReportUsage(environment, "lumifold compare", std::string(chosen.status().message()));

  if (const absl::Status status = CheckHeatMap(options.heat_map); !status.ok())
    return ReportError(environment, status);

  const absl::StatusOr<Comparison> comparison = Compare(options, *chosen);
  if (!comparison.ok()) return ReportError(environment, comparison.status());
  options.json ? PrintJson(*comparison, environment.out) : PrintText(options, *comparison, environment.out);
  return ExitCode::kOk;
}

}  // namespace lumifold::client
