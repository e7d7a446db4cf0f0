#include "worker/render/geometry/fragments.h"

#include <algorithm>
#include <string_view>

#include "filter/image/surface_key.h"

namespace lumifold::render {
namespace {

using scene::Vec3;

/// The values of a fragment in the order of layers::FragmentChannels().
std::vector<float> ValuesOf(int x, int y, const FragmentSums& sums) {
  std::vector<float> values = {static_cast<float>(x), static_cast<float>(y), sums.surface,  sums.normal.x,
                               sums.normal.y,         sums.normal.z,         sums.distance, sums.roughness};
  const auto append = [&](Vec3 v) { values.insert(values.end(), {v.x, v.y, v.z}); };
  for (size_t layer = 0; layer < layers::kFragmentHalved.size(); ++layer) {
    for (const auto& half : sums.halved) append(half[layer]);
  }
  for (const Vec3& whole : sums.whole) append(whole);
  values.insert(values.end(), sums.count.begin(), sums.count.end());
  return values;
}

std::vector<std::string> ChannelsOf(const TracingPlan::Layers& carried) {
  return layers::FragmentChannels([&carried](std::string_view layer) { return carried.Has(layer); });
}

}  // namespace

void FragmentSums::Add(const LayerSample& s, size_t half) {
  normal += s.first.normal;
  distance += s.first.distance;
  roughness += s.first.roughness;
  halved[half][0] += s.direct;
  halved[half][1] += s.indirect;
  halved[half][2] += s.glossy;
  whole[0] += s.albedo;
  whole[1] += s.emitted;
  whole[2] += s.glossy_albedo;
  count[half] += 1;
}

void PixelFragments::Add(const LayerSample& sample, size_t half) {
  const Vec3 n = sample.first.normal;
  const float surface =
      SurfaceKey(static_cast<float>(sample.first.instance + 1), {n.x, n.y, n.z}, sample.first.distance);
  if (surface > 0) Of(surface).Add(sample, half);
}

FragmentSums& PixelFragments::Of(float surface) {
  for (size_t i = 0; i < count_; ++i) {
    if (fragments_[i].surface == surface) return fragments_[i];
  }
  if (count_ == fragments_.size()) return fragments_.back();
  fragments_[count_].surface = surface;
  return fragments_[count_++];
}

std::span<const FragmentSums> PixelFragments::Sorted() {
  const auto end = fragments_.begin() + static_cast<std::ptrdiff_t>(count_);
  std::sort(fragments_.begin(), end,
            [](const FragmentSums& a, const FragmentSums& b) { return a.surface < b.surface; });
  return {fragments_.data(), count_};
}

FragmentRows::FragmentRows(const TracingPlan::Layers& carried) : rows_(ChannelsOf(carried), 1) {
  const std::vector<std::string> all = layers::FragmentChannels();
  for (const std::string& channel : ChannelsOf(carried))
    carried_.push_back(static_cast<size_t>(std::find(all.begin(), all.end(), channel) - all.begin()));
}

void FragmentRows::Add(int x, int y, std::span<const FragmentSums> fragments) {
  std::vector<float> values(carried_.size());
  for (const FragmentSums& fragment : fragments) {
    const std::vector<float> all = ValuesOf(x, y, fragment);
    for (size_t i = 0; i < values.size(); ++i) values[i] = all[carried_[i]];
    rows_.Add(values);
  }
}

}  // namespace lumifold::render
