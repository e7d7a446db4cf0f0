#pragma once

#include <cstdint>

#include "filter/manifold/layer_call.h"
#include "filter/opencl/kernel_run.h"
#include "filter/opencl/layer_planes.h"

namespace lumifold::filter {

/// Choice (filter/layers/choice.h) on the device. The run's program is that of layers.
class ChoiceRun {
 public:
  ChoiceRun(const LayerCall& call, const LayerPlanes& layer, KernelRun* run);
  static DeviceMemory Need(const LayerSizes& sizes);

  /// For comparisons with the picture as it is.
  void WeighErrors(KernelRun::Buffer picture);
  /// Compares a picture with another by the noisy layer, and moves it towards `to`, which may be noisy.
  void Move(KernelRun::Buffer picture, KernelRun::Buffer other, KernelRun::Buffer to, bool is_noisy);

 private:
  void CompareCells();

  const LayerCall& call_;
  const LayerPlanes& layer_;
  const LayerSizes& sizes_;
  KernelRun& run_;
  // Weights of errors, kinds, terms, and shares: of windows, smoothed, of cells.
  KernelRun::Buffer errors_ = {}, kind_ = {}, terms_ = {}, rough_ = {}, smooth_ = {};
  KernelRun::Buffer cells_ = {}, row_sums_ = {}, of_cells_ = {};
};

}  // namespace lumifold::filter
