#include "server/film/result.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "filter/image/layers.h"
#include "proto/rpc/plan_text.h"
#include "proto/rpc/version.h"
#include "server/film/cryptomatte.h"
#include "server/film/matte.h"

namespace lumifold::film {
namespace {

/// The method that leaves the picture as it is.
constexpr char kNoFilter[] = "none";

void MoveChannel(std::string_view name, LayeredImage* from, LayeredImage* to) {
  const auto found = std::find_if(from->channels().begin(), from->channels().end(),
                                  [&](const LayeredImage::Channel& channel) { return channel.name == name; });
  LUMIFOLD_CHECK(found != from->channels().end());
  to->Add(name, std::move(found->plane));
}

void MoveColor(std::string_view layer, LayeredImage* from, LayeredImage* to) {
  for (const std::string& name : layers::ColorChannels(layer)) MoveChannel(name, from, to);
}

/// Adds R = C - (D + I) T - E: what the first diffuse surface and its emission do not explain.
void AddReflection(LayeredImage* result) {
  const ColorView reflection = result->AddColor(layers::kReflection1);
  const LayeredImage& film = *result;
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  const ConstColorView direct = film.GetColor(layers::kDirect);
  const ConstColorView indirect = film.GetColor(layers::kIndirect);
  const ConstColorView albedo = film.GetColor(layers::kAlbedo);
  const ConstColorView emission = film.GetColor(layers::kEmission);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < film.height(); ++y) {
      for (int x = 0; x < film.width(); ++x) {
        const float diffuse = (direct[c].At(x, y) + indirect[c].At(x, y)) * albedo[c].At(x, y);
        reflection[c].At(x, y) = noisy[c].At(x, y) - diffuse - emission[c].At(x, y);
      }
    }
  }
}

/// With all digits: whoever reads it gets the same budgets.
std::string ScheduleText(const std::vector<double>& schedule) {
  return absl::StrJoin(
      schedule, ",", [](std::string* text, double budget) { absl::StrAppendFormat(text, "%.17g", budget); });
}

/// "blackman-harris 1.5".
std::string PixelFilterText(const v1::PixelFilter& filter) {
  const char* const kind = filter.kind() == v1::PIXEL_FILTER_KIND_GAUSSIAN          ? "gaussian"
                           : filter.kind() == v1::PIXEL_FILTER_KIND_BLACKMAN_HARRIS ? "blackman-harris"
                                                                                    : "box";
  return absl::StrCat(kind, " ", filter.width());
}

void Describe(const ResultInfo& info, LayeredImage* result) {
  auto& metadata = result->metadata();
  const v1::JobSpec& spec = info.spec;
  metadata["software"] = absl::StrCat("lumifold ", std::string(rpc::kVersion));
  metadata["lumifold.version"] = std::string(rpc::kVersion);
  metadata["lumifold.numeric_class"] = info.numeric_class;
  metadata["lumifold.scene"] = spec.scene().display_name();
  metadata["lumifold.scene_sha256"] = spec.scene().file().sha256();
  metadata["lumifold.camera"] = spec.camera();
  if (!spec.animation().empty()) metadata["lumifold.animation"] = spec.animation();
  if (!spec.variant().empty()) metadata["lumifold.variant"] = spec.variant();
  if (!info.facts.environment().empty()) metadata["lumifold.environment"] = info.facts.environment();
  if (spec.background() == v1::BACKGROUND_TRANSPARENT) metadata["lumifold.background"] = "transparent";
  if (spec.ground() == v1::GROUND_SHADOW) metadata["lumifold.ground"] = "shadow";
  metadata["lumifold.frame"] = absl::StrCat(info.frame);
  metadata["lumifold.size"] = absl::StrCat(spec.width(), "x", spec.height());
  if (spec.has_pixel_filter()) metadata["lumifold.pixel_filter"] = PixelFilterText(spec.pixel_filter());
  metadata["lumifold.samples_per_pixel"] = absl::StrCat(spec.samples_per_pixel());
  metadata["lumifold.pass_samples"] = absl::StrCat(spec.pass_samples());
  metadata["lumifold.seed"] = absl::StrCat(spec.seed());
  metadata["lumifold.max_bounces"] = absl::StrCat(spec.max_bounces());
  metadata["lumifold.method"] = spec.filter().method();
  if (info.estimated_error.has_value())
    metadata["lumifold.estimated_error"] = absl::StrFormat("%.4g", *info.estimated_error);
  if (!info.schedule.empty()) metadata["lumifold.schedule"] = ScheduleText(info.schedule);
  if (spec.has_plan()) metadata["lumifold.plan"] = rpc::PlanLine(spec.plan());
}

}  // namespace

EdgedImage BuildResult(EdgedImage film, std::array<Plane, 3> filtered, const ResultInfo& info) {
  LayeredImage result(film.pixels.width(), film.pixels.height());
  const auto beauty = layers::ColorChannels(layers::kBeauty);
  for (size_t c = 0; c < beauty.size(); ++c) result.Add(beauty[c], std::move(filtered[c]));
  const bool is_transparent = info.spec.background() == v1::BACKGROUND_TRANSPARENT;
  const Plane alpha = is_transparent ? AlphaOf(film, info.spec.filter().method() != kNoFilter) : Plane();
  MoveChannel(layers::kAlpha, &film.pixels, &result);
  for (const std::string_view layer :
       {layers::kNoisy, layers::kDirect, layers::kIndirect, layers::kAlbedo, layers::kEmission}) {
    MoveColor(layer, &film.pixels, &result);
  }
  AddReflection(&result);
  for (const std::string_view name : {layers::kNormalX, layers::kNormalY, layers::kNormalZ,
                                      layers::kPlanarDepth, layers::kDistance, layers::kObjectId}) {
    MoveChannel(name, &film.pixels, &result);
  }
  AddCryptomatte(info.facts.objects(), film.edges, &result);  // by the coverage of the geometry
  if (is_transparent) CopyPlane(alpha.view(), result.Get(layers::kAlpha));
  if (info.spec.save_film()) {
    for (LayeredImage::Channel& channel : film.pixels.channels()) {
      if (!result.Has(channel.name) && channel.name != layers::kShadow)
        result.Add(channel.name, std::move(channel.plane));
    }
  }
  Describe(info, &result);
  if (!info.spec.save_film()) return {std::move(result)};
  return {std::move(result), std::move(film.edges), std::move(film.fragments)};
}

}  // namespace lumifold::film
