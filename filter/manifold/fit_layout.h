#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/functional/function_ref.h"
#include "filter/image/plane.h"

namespace lumifold::filter {

/// Numbers of samples, as FitCall has them.
struct FitLayout {
  std::vector<int32_t> firsts;
  std::vector<int32_t> targets;
};

/// Samples of the pixels within a window of those with `fitted` > 0, which are the targets. count(x, y): of a
/// pixel.
FitLayout MakeFitLayout(ConstFloatView fitted, int radius, absl::FunctionRef<size_t(int, int)> count);

}  // namespace lumifold::filter
