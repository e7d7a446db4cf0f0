#include "filter/manifold/lattice.h"

#include <bit>

namespace lumifold::filter {

CellSpan SpanOf(int p, int step, int cells) {
  if (step == 1) return {p, p, 0.0f};
  const int shifted = p + step / 2;  // counted from the centre of the cell before the first
  const int first = (shifted >> std::countr_zero(static_cast<unsigned>(step))) - 1;
  const float part = (static_cast<float>(shifted & (step - 1)) + 0.5f) / static_cast<float>(step);
  return {std::max(first, 0), std::min(first + 1, cells - 1), part};
}

float CellReader::Read(const Plane& cells) const {
  const float* upper = cells.Row(row_.first);
  const float* lower = cells.Row(row_.second);
  const float left = upper[column_.first] + row_.part * (lower[column_.first] - upper[column_.first]);
  const float right = upper[column_.second] + row_.part * (lower[column_.second] - upper[column_.second]);
  return left + column_.part * (right - left);
}

}  // namespace lumifold::filter
