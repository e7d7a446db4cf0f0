#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "filter/manifold/layer_call.h"
#include "filter/opencl/fit_run.h"
#include "filter/opencl/kernel_run.h"
#include "filter/opencl/layer_planes.h"

namespace lumifold::filter {

/// The samples of FitLight (filter/edges/light_regression.h), and where they are.
struct LightLayout {
  LightLayout(const LayerCall& call, const RegressionParams& fit);
  LightLayout(const LightLayout&) = delete;  // the fit refers to it
  LightLayout& operator=(const LightLayout&) = delete;

  /// What the fit needs at least, with its samples.
  DeviceMemory Need() const;

  RegressionParams params;
  FitOnDevice fit;  // without samples and centres
  std::vector<int32_t> firsts, targets;
  std::vector<int32_t> sites;  // of each sample
  std::vector<bool> on_grid;   // whether it may be the centre of a model
  uint64_t most_centres = 0;
};

/// FitLight on the device: makes `fitted` what the fit of a picture says. `memory`: what is left to it.
/// Errors: those of the run, whose program becomes another.
absl::Status RunLightFit(const LayerCall& call, const LightLayout& layout, const LayerPlanes& layer,
                         const DeviceMemory& memory, KernelRun::Buffer picture, KernelRun::Buffer fitted,
                         KernelRun* run);

}  // namespace lumifold::filter
