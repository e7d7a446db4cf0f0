#pragma once

#include <array>
#include <span>
#include <vector>

#include "filter/image/layered_image.h"
#include "filter/image/layers.h"
#include "filter/image/level_images.h"
#include "worker/render/tracing/layer_sample.h"
#include "worker/render/tracing/tracing_plan.h"

namespace lumifold::render {

/// Sums over the samples of one pixel that reach a level.
struct LevelSums {
  std::array<std::array<scene::Vec3, layers::kLevelHalved.size()>, 2> halved;  // by half, then by layer
  std::array<std::array<scene::Vec3, layers::kLevelWhole.size()>, 2> whole;    // as in PixelSums
  std::array<float, 2> count = {0, 0};  // samples that hit a surface with a diffuse lobe, by half
};

/// Sums that A is made of, see layers::kMatte.
struct MatteSums {
  float opacity = 0;
  float catcher = 0;
  std::array<float, 2> light = {0, 0};  // by half
  std::array<float, 2> shadow = {0, 0};

  void Add(const LayerSample& sample, size_t half);
};

/// Sums over the samples of one pixel.
struct PixelSums {
  std::array<std::array<scene::Vec3, layers::kHalved.size()>, 2> halved;
  std::array<std::array<scene::Vec3, layers::kWhole.size()>, 2>
      whole;  // by half with a lens, else all in the first
  std::array<float, 2> count = {0, 0};
  MatteSums matte;
  ByLevel<LevelSums> levels;

  /// `half` is 0 for A, 1 for B.
  void Add(const LayerSample& sample, size_t half, bool lens);
};

/// The channels of a pass.
class PassPicture {
 public:
  /// `carried`: the layers that the picture has besides C. `has_matte`: it has layers::kMatte.
  PassPicture(int width, int height, const TracingPlan::Layers& carried = {}, bool has_matte = false);

  bool HasLens() const { return lens_; }
  void Store(int x, int y, const PixelSums& sums);
  /// Moves the picture out; levels come last.
  LayeredImage Take();

 private:
  LayeredImage image_;
  const bool lens_;
  LevelImages levels_;
  /// A layer that the picture has, by its number in PixelSums.
  template <typename Views>
  struct Carried {
    size_t number;
    Views views;
  };
  std::vector<Carried<std::array<ColorView, 2>>> halved_;
  std::vector<Carried<std::array<ColorView, 2>>> whole_;  // the second with a lens alone
  std::array<FloatView, 2> count_;
  std::vector<FloatView> matte_;  // empty: none
};

/// Sets one pixel of every channel; `values` has the order of the channels.
void PutAll(std::span<const float> values, int x, int y, LayeredImage* image);

/// Sets one pixel of a colour.
inline void Put(const ColorView& view, int x, int y, scene::Vec3 value) {
  view[0].At(x, y) = value.x;
  view[1].At(x, y) = value.y;
  view[2].At(x, y) = value.z;
}

}  // namespace lumifold::render
