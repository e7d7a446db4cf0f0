#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "worker/render/geometry/pixel_rows.h"
#include "worker/render/tracing/layer_sample.h"
#include "worker/render/tracing/tracing_plan.h"

namespace lumifold::render {

/// Sums over the samples of one pixel that hit one surface first.
struct FragmentSums {
  float surface = 0;  // see SurfaceKey
  scene::Vec3 normal;
  float distance = 0;
  float roughness = 0;
  std::array<std::array<scene::Vec3, layers::kFragmentHalved.size()>, 2> halved;  // by half, then by layer
  std::array<scene::Vec3, layers::kFragmentWhole.size()> whole;
  std::array<float, 2> count = {0, 0};

  /// `half` is 0 for A, 1 for B.
  void Add(const LayerSample& sample, size_t half);
};

/// The samples of one pixel by the surface that they hit first.
class PixelFragments {
 public:
  /// Adds a finite sample; one that hits nothing is left out. One that hits a surface after kMaxFragments
  /// others is added to the last of these.
  void Add(const LayerSample& sample, size_t half);

  /// The fragments, ascending by surface; valid until the next call of Add.
  std::span<const FragmentSums> Sorted();

 private:
  FragmentSums& Of(float surface);

  std::array<FragmentSums, kMaxFragments> fragments_;  // in the order in which their first samples came
  size_t count_ = 0;
};

/// Collects the fragments of a pass.
class FragmentRows {
 public:
  /// `carried`: the layers that the pass has besides C.
  explicit FragmentRows(const TracingPlan::Layers& carried);

  /// Whether the pass has fragments at all: without light of their surfaces it has none.
  bool IsCarried() const { return !carried_.empty(); }

  /// Adds the fragments of the pixel at (x, y) of the whole frame; pixels come in the order of rows.
  void Add(int x, int y, std::span<const FragmentSums> fragments);

  /// The rows as EdgedImage::fragments of a unit.
  LayeredImage Make() const { return rows_.Make(); }

 private:
  std::vector<size_t> carried_;  // numbers of the pass's channels among layers::FragmentChannels()
  PixelRows rows_;
};

}  // namespace lumifold::render
