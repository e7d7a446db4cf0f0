#include "filter/manifold/fit_layout.h"

#include <utility>

#include "filter/image/planes.h"
#include "filter/kernels/box_mean.h"

namespace lumifold::filter {

FitLayout MakeFitLayout(ConstFloatView fitted, int radius, absl::FunctionRef<size_t(int, int)> count) {
  // Part of the window that is fitted; the sums of exact zeros are 0.
  Planes part;
  part.push_back(Clone(fitted));
  const Plane ones = MakePlane(fitted.width(), fitted.height(), 1.0f);
  const Plane near = std::move(BoxMeans(part, ones.view(), radius, nullptr)[0]);
  FitLayout layout;
  layout.firsts.reserve(static_cast<size_t>(fitted.width()) * static_cast<size_t>(fitted.height()) + 1);
  layout.firsts.push_back(0);
  ForEachPixel(fitted.width(), fitted.height(), [&](int x, int y) {
    const int32_t first = layout.firsts.back();
    const int32_t end = first + (near.At(x, y) > 0 ? static_cast<int32_t>(count(x, y)) : 0);
    layout.firsts.push_back(end);
    for (int32_t i = first; i < end && fitted.At(x, y) > 0; ++i) layout.targets.push_back(i);
  });
  return layout;
}

}  // namespace lumifold::filter
