#include "worker/render/lights/alias_table.h"

#include <cstddef>

namespace lumifold::render {

AliasTable::AliasTable(const std::vector<double>& weights) {
  double total = 0;
  for (const double weight : weights) total += weight;
  if (total <= 0) return;
  const size_t count = weights.size();
  cells_.resize(count);
  std::vector<double> share(count);
  std::vector<uint32_t> small;
  std::vector<uint32_t> large;
  for (size_t i = 0; i < count; ++i) {
    cells_[i].alias = static_cast<uint32_t>(i);
    cells_[i].probability = static_cast<float>(weights[i] / total);
    share[i] = weights[i] / total * static_cast<double>(count);
    (share[i] < 1 ? small : large).push_back(static_cast<uint32_t>(i));
  }
  while (!small.empty() && !large.empty()) {
    const uint32_t under = small.back();
    const uint32_t over = large.back();
    small.pop_back();
    cells_[under].threshold = static_cast<float>(share[under]);
    cells_[under].alias = over;
    share[over] -= 1 - share[under];
    if (share[over] < 1) {
      large.pop_back();
      small.push_back(over);
    }
  }
}

}  // namespace lumifold::render
