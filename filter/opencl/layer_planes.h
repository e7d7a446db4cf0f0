#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "filter/manifold/layer_call.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// Sizes of one layer.
struct LayerSizes {
  explicit LayerSizes(const LayerCall& call);

  static constexpr uint64_t kPicturePlanes = 6;  // of sites: two halves

  Grid grid = {};  // its cells are those of choices
  uint64_t pixels = 0, points = 0, sites = 0, cells = 0;
  uint64_t geometry = 0;  // features
  int32_t kinds = 1;      // of pixels that are compared apart
};

/// What is there of each point; they are in runs, as choice.cl has them.
struct PointLists {
  uint64_t runs = 0;
  KernelRun::Buffer firsts = {}, places = {}, offsets = {}, weights = {}, samples = {};
  std::array<KernelRun::Buffer, 2> coverage = {}, shares = {};
};

/// A layer on the device. Pictures and geometry are planes of sites; others, of pixels.
struct LayerPlanes {
  LayerPlanes(const LayerCall& call, const LayerSizes& sizes, KernelRun* run);
  static DeviceMemory Need(const LayerSizes& sizes);

  /// Puts values of points behind the pixels of a picture.
  void PutPoints(const std::array<absl::Span<const float>, 2>& values, KernelRun::Buffer picture) const;

  const LayerSizes& sizes;
  KernelRun& run;
  KernelRun::Buffer noisy = {}, geometry = {};
  std::array<KernelRun::Buffer, 2> masks = {};
  KernelRun::Buffer weight = {}, share_a = {}, samples = {}, light = {}, expected = {}, mixed = {};
  PointLists points;

 private:
  /// A plane of pixels; zeros if it is empty.
  KernelRun::Buffer Put(ConstFloatView plane) const;
  void PutLists(const LayerCall& call);
  void PutGeometry(const LayerCall& call);
};

}  // namespace lumifold::filter
