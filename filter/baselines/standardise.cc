#include "filter/baselines/standardise.h"

#include <algorithm>
#include <cmath>

#include "absl/functional/function_ref.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

StandardPlanes Standardise(const Planes& planes, ConstFloatView mask, bool to_unit_variance, TaskPool* pool) {
  constexpr double kLeastDeviation = 1e-4;
  const auto sum = [&](absl::FunctionRef<double(int, int)> value) {
    return SumRows(pool, mask.height(), [&](int y) {
      double row = 0;
      for (int x = 0; x < mask.width(); ++x) row += static_cast<double>(mask.At(x, y)) * value(x, y);
      return row;
    });
  };
  const double total = std::max(sum([](int, int) { return 1.0; }), 1e-30);
  StandardPlanes standard;
  for (const Plane& plane : planes) {
    const double mean = sum([&](int x, int y) { return static_cast<double>(plane.At(x, y)); }) / total;
    const double variance = sum([&](int x, int y) {
                              const double off = static_cast<double>(plane.At(x, y)) - mean;
                              return off * off;
                            }) /
                            total;
    const double deviation = std::sqrt(variance);
    const double scale = !to_unit_variance ? 1.0 : (deviation > kLeastDeviation ? 1.0 / deviation : 0.0);
    Plane& out = standard.planes.emplace_back(plane.width(), plane.height());
    ForEachPixel(plane.width(), plane.height(), [&](int x, int y) {
      out.At(x, y) = static_cast<float>((static_cast<double>(plane.At(x, y)) - mean) * scale);
    });
    standard.means.push_back(static_cast<float>(mean));
    standard.scales.push_back(static_cast<float>(scale));
  }
  return standard;
}

}  // namespace lumifold::filter
