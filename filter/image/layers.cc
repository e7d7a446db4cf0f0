#include "filter/image/layers.h"

#include <utility>

namespace lumifold::layers {
namespace {

void AddColor(std::string_view layer, std::vector<std::string>* names) {
  for (std::string& name : ColorChannels(layer)) names->push_back(std::move(name));
}

}  // namespace

std::vector<std::string> LevelPassChannels(Level level) {
  std::vector<std::string> names;
  for (const std::string_view layer : kLevelHalved) {
    AddColor(HalfA(OfLevel(level, layer)), &names);
    AddColor(HalfB(OfLevel(level, layer)), &names);
  }
  for (const std::string_view layer : kLevelWhole) AddColor(OfLevel(level, layer), &names);
  for (const std::string_view count : {kSamplesA, kSamplesB}) names.push_back(OfLevel(level, count));
  return names;
}

std::vector<std::string> LevelFeatureChannels(Level level) {
  std::vector<std::string> names;
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

}  // namespace lumifold::layers
