#include "filter/layers/magnitude.h"

#include <cmath>

namespace lumifold::filter {

double RowMagnitude(const ConstColorView& color, ConstFloatView weight, int y) {
  double sum = 0;
  for (const ConstFloatView& channel : color) {
    const float* row = channel.Row(y);
    for (int x = 0; x < channel.width(); ++x) {
      const bool counts = weight.IsEmpty() || weight.At(x, y) != 0;
      if (counts) sum += static_cast<double>(std::abs(UsableOr0(row[x])));
    }
  }
  return sum;
}

float MeanMagnitude(const ConstColorView& color, TaskPool* pool) {
  const int width = color[0].width();
  const int height = color[0].height();
  const double sum = SumRows(pool, height, [&](int y) { return RowMagnitude(color, {}, y); });
  return static_cast<float>(sum / (3.0 * width * height));
}

}  // namespace lumifold::filter
