#pragma once

#include <algorithm>
#include <optional>

namespace lumifold::filter {

// Numbers of ReturnRemoved (filter/denoise/firefly.h), which devices have, too.

/// 1 - 1/n of n equal outliers of a layer, from the sums of their luminance and its squares.
inline float SharedPartOfAll(double sum, double squares) {
  return squares > 0 ? static_cast<float>(1.0 - std::min(1.0, squares / (sum * sum))) : 0.0f;
}

/// What is added to a channel of energy for each of its light: `part` of what was removed and has not been
/// returned nearby; all are sums over the layer. nullopt: nothing is.
inline std::optional<float> GainOfRest(float part, double removed, double returned, double light) {
  const double rest = removed - returned;
  if (!(rest > 0 && light > 0)) return std::nullopt;
  return part * static_cast<float>(rest / light);
}

}  // namespace lumifold::filter
