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

}  // namespace lumifold::filter
