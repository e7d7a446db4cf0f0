#include "worker/render/tracing/pass_sums.h"

#include <utility>
#include <vector>

namespace lumifold::render {
namespace {

using scene::Vec3;

void AddLevel(const LevelSample& sample, size_t half, size_t half_of_whole, LevelSums* sums) {
  sums->halved[half][0] += sample.direct;
  sums->halved[half][1] += sample.indirect;
  sums->whole[half_of_whole][0] += sample.albedo;
  sums->whole[half_of_whole][1] += sample.emitted;
  if (sample.has_diffuse) sums->count[half] += 1;
}

/// The sums in the order of layers::LevelPassChannels.
std::vector<float> ValuesOf(const LevelSums& sums, bool lens) {
  std::vector<float> values;
  const auto append = [&](Vec3 v) { values.insert(values.end(), {v.x, v.y, v.z}); };
  for (size_t i = 0; i < layers::kLevelHalved.size(); ++i) {
    append(sums.halved[0][i]);
    append(sums.halved[1][i]);
  }
  for (size_t i = 0; i < layers::kLevelWhole.size(); ++i) {
    append(sums.whole[0][i]);
    if (lens) append(sums.whole[1][i]);
  }
  values.insert(values.end(), sums.count.begin(), sums.count.end());
  return values;
}

}  // namespace

void PutAll(std::span<const float> values, int x, int y, LayeredImage* image) {
  LUMIFOLD_CHECK(values.size() == image->channels().size());
  for (size_t i = 0; i < values.size(); ++i) image->channels()[i].plane.At(x, y) = values[i];
}

void MatteSums::Add(const LayerSample& sample, size_t half) {
  if (sample.first.instance != scene::kNone) opacity += 1;
  if (!sample.caught.is_hit) return;
  catcher += 1;
  light[half] += sample.caught.light;
  shadow[half] += sample.caught.shadow;
}

void PixelSums::Add(const LayerSample& s, size_t half, bool lens) {
  halved[half][0] += s.combined;
  halved[half][1] += s.direct;
  halved[half][2] += s.indirect;
  halved[half][3] += s.glossy;
  const size_t half_of_whole = lens ? half : 0;
  whole[half_of_whole][0] += s.albedo;
  whole[half_of_whole][1] += s.emitted;
  whole[half_of_whole][2] += s.glossy_albedo;
  count[half] += 1;
  matte.Add(s, half);
  s.levels.ForEach([&](layers::Level level, const LevelSample& sample) {
    AddLevel(sample, half, half_of_whole, &levels.Set(level));
  });
}

PassPicture::PassPicture(int width, int height, const TracingPlan::Layers& carried, bool has_matte)
    : image_(width, height),
      lens_(carried.lens),
      levels_(width, height,
              [lens = carried.lens](layers::Level level) { return layers::LevelPassChannels(level, lens); }) {
  for (size_t i = 0; i < layers::kHalved.size(); ++i) {
    if (!carried.Has(layers::kHalved[i])) continue;
    const ColorView a = image_.AddColor(layers::HalfA(layers::kHalved[i]));
    const ColorView b = image_.AddColor(layers::HalfB(layers::kHalved[i]));
    halved_.push_back({i, {a, b}});
  }
  for (size_t i = 0; i < layers::kWhole.size(); ++i) {
    if (!carried.Has(layers::kWhole[i])) continue;
    const ColorView first = image_.AddColor(lens_ ? layers::HalfA(layers::kWhole[i]) : layers::kWhole[i]);
    whole_.push_back({i, {first, lens_ ? image_.AddColor(layers::HalfB(layers::kWhole[i])) : first}});
  }
  count_ = {image_.Add(layers::kSamplesA), image_.Add(layers::kSamplesB)};
  if (!has_matte) return;
  for (const std::string_view name : layers::kMatte) matte_.push_back(image_.Add(name));
}

void PassPicture::Store(int x, int y, const PixelSums& sums) {
  for (size_t half = 0; half < 2; ++half) {
    for (const auto& layer : halved_) Put(layer.views[half], x, y, sums.halved[half][layer.number]);
    count_[half].At(x, y) = sums.count[half];
  }
  for (const auto& layer : whole_) {
    for (size_t half = 0; half < (lens_ ? 2 : 1); ++half)
      Put(layer.views[half], x, y, sums.whole[half][layer.number]);
  }
  if (!matte_.empty()) {
    const MatteSums& m = sums.matte;
    const std::array<float, layers::kMatte.size()> values = {m.opacity,  m.catcher,   m.light[0],
                                                             m.light[1], m.shadow[0], m.shadow[1]};
    for (size_t i = 0; i < values.size(); ++i) matte_[i].At(x, y) = values[i];
  }
  sums.levels.ForEach([&](layers::Level level, const LevelSums& level_sums) {
    PutAll(ValuesOf(level_sums, lens_), x, y, &levels_.At(level));
  });
}

LayeredImage PassPicture::Take() {
  levels_.MoveTo(&image_);
  return std::move(image_);
}

}  // namespace lumifold::render
