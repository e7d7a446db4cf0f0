#include "server/film/result.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/layers.h"
#include "proto/rpc/version.h"

namespace lumifold::film {
namespace {

void MoveChannel(std::string_view name, LayeredImage* from, LayeredImage* to) {
  const auto found = std::find_if(from->channels().begin(), from->channels().end(),
                                  [&](const LayeredImage::Channel& channel) { return channel.name == name; });
  LUMIFOLD_CHECK(found != from->channels().end());
  to->Add(name, std::move(found->plane));
}

void MoveColor(std::string_view layer, LayeredImage* from, LayeredImage* to) {
  for (const std::string& name : layers::ColorChannels(layer)) MoveChannel(name, from, to);
}

void Describe(const ResultInfo& info, LayeredImage* result) {
  auto& metadata = result->metadata();
  const v1::JobSpec& spec = info.spec;
  metadata["lumifold.version"] = std::string(rpc::kVersion);
  metadata["lumifold.numeric_class"] = info.numeric_class;
  metadata["lumifold.scene"] = spec.scene().display_name();
  metadata["lumifold.scene_sha256"] = spec.scene().file().sha256();
  metadata["lumifold.camera"] = spec.camera();
  metadata["lumifold.frame"] = absl::StrCat(info.frame);
  metadata["lumifold.size"] = absl::StrCat(spec.width(), "x", spec.height());
  metadata["lumifold.samples_per_pixel"] = absl::StrCat(spec.samples_per_pixel());
  metadata["lumifold.pass_samples"] = absl::StrCat(spec.pass_samples());
  metadata["lumifold.seed"] = absl::StrCat(spec.seed());
  metadata["lumifold.max_bounces"] = absl::StrCat(spec.max_bounces());
  metadata["lumifold.filter"] = spec.filter().method();
}

}  // namespace

LayeredImage BuildResult(LayeredImage film, std::array<Plane, 3> filtered, const ResultInfo& info) {
  LayeredImage result(film.width(), film.height());
  const auto beauty = layers::ColorChannels(layers::kBeauty);
  for (size_t c = 0; c < beauty.size(); ++c) result.Add(beauty[c], std::move(filtered[c]));
  MoveChannel(layers::kAlpha, &film, &result);
  for (const std::string_view layer : {layers::kNoisy, layers::kDirect, layers::kIndirect, layers::kAlbedo,
                                       layers::kEmission, layers::kReflection1}) {
    MoveColor(layer, &film, &result);
  }
  for (const std::string_view name : {layers::kNormalX, layers::kNormalY, layers::kNormalZ,
                                      layers::kPlanarDepth, layers::kDistance, layers::kObjectId}) {
    MoveChannel(name, &film, &result);
  }
  if (info.spec.save_film()) {
    for (const std::string_view layer : layers::kHalved) {
      MoveColor(layers::HalfA(layer), &film, &result);
      MoveColor(layers::HalfB(layer), &film, &result);
    }
    for (const std::string_view name : {layers::kMask, layers::kSamplesA, layers::kSamplesB}) {
      MoveChannel(name, &film, &result);
    }
  }
  Describe(info, &result);
  return result;
}

}  // namespace lumifold::film
