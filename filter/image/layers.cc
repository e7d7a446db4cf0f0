#include "filter/image/layers.h"

#include <algorithm>
#include <utility>

namespace lumifold::layers {
namespace {

void AddColor(std::string_view layer, std::vector<std::string>* names) {
  for (std::string& name : ColorChannels(layer)) names->push_back(std::move(name));
}

}  // namespace

bool Carried::Has(std::string_view layer) const {
  if (layer == kDirect) return direct;
  if (layer == kIndirect) return indirect;
  if (layer == kAlbedo) return albedo;
  if (layer == kEmission) return emission;
  if (layer == kGlossy || layer == kGlossyAlbedo) return glossy;
  return true;
}

std::vector<std::string> LevelPassChannels(Level level, bool lens) {
  std::vector<std::string> names;
  for (const std::string_view layer : kLevelHalved) {
    AddColor(HalfA(OfLevel(level, layer)), &names);
    AddColor(HalfB(OfLevel(level, layer)), &names);
  }
  for (const std::string_view layer : kLevelWhole) {
    if (!lens) AddColor(OfLevel(level, layer), &names);
    if (lens) AddColor(HalfA(OfLevel(level, layer)), &names);
    if (lens) AddColor(HalfB(OfLevel(level, layer)), &names);
  }
  for (const std::string_view count : {kSamplesA, kSamplesB}) names.push_back(OfLevel(level, count));
  return names;
}

std::vector<std::string> LevelFeatureChannels(Level level) {
  std::vector<std::string> names;
  names.reserve(kLevelFeatures.size());
  for (const std::string_view feature : kLevelFeatures) names.push_back(OfLevel(level, feature));
  return names;
}

std::vector<std::string> EdgeChannels() {
  std::vector<std::string> names;
  for (const std::string_view name : {kPixelX, kPixelY, kNormalX, kNormalY, kNormalZ, kDistance})
    names.emplace_back(name);
  AddColor(kAlbedo, &names);
  AddColor(kEmission, &names);
  for (const std::string_view name : {kObjectId, kMask}) names.emplace_back(name);
  return names;
}

std::vector<std::string> FragmentChannels(absl::FunctionRef<bool(std::string_view layer)> has) {
  if (std::none_of(kFragmentHalved.begin(), kFragmentHalved.end(), has)) return {};
  std::vector<std::string> names;
  for (const std::string_view name : {kPixelX, kPixelY, kSurface}) names.emplace_back(name);
  for (const std::string_view name : kFragmentFeatures) names.emplace_back(name);
  if (has(kGlossy)) names.emplace_back(kRoughness);
  for (const std::string_view layer : kFragmentHalved) {
    if (!has(layer)) continue;
    AddColor(HalfA(layer), &names);
    AddColor(HalfB(layer), &names);
  }
  for (const std::string_view layer : kFragmentWhole) {
    if (has(layer)) AddColor(layer, &names);
  }
  for (const std::string_view name : {kSamplesA, kSamplesB}) names.emplace_back(name);
  return names;
}

std::vector<std::string> FragmentChannels() {
  return FragmentChannels([](std::string_view) { return true; });
}

}  // namespace lumifold::layers
