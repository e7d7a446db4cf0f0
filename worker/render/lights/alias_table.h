#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace lumifold::render {

/// Samples indices in proportion to weights in constant time. The same weights give the same table on every
/// machine. Threads: safe concurrently. Sources: Walker 1977; Vose 1991.
class AliasTable {
 public:
  AliasTable() = default;
  /// Weights must be finite and not negative. If they sum to 0 the table is empty.
  explicit AliasTable(const std::vector<double>& weights);

  bool IsEmpty() const { return cells_.empty(); }

  /// The index that `u` in [0, 1) selects. The table must not be empty.
  uint32_t Pick(float u) const {
    // Without branches: nobody foresees them.
    const float scaled = u * static_cast<float>(cells_.size());
    const uint32_t number = std::min(static_cast<uint32_t>(scaled), static_cast<uint32_t>(cells_.size() - 1));
    const Cell cell = cells_[number];
    return scaled - static_cast<float>(number) < cell.threshold ? number : cell.alias;
  }

  /// The probability with which Pick() returns `index`.
  float Probability(uint32_t index) const { return cells_[index].probability; }

 private:
  struct Cell {
    float threshold = 1;  // below: this index; above: the alias
    uint32_t alias = 0;
    float probability = 0;
  };

  std::vector<Cell> cells_;
};

}  // namespace lumifold::render
