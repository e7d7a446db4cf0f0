#pragma once

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
    const float scaled = u * static_cast<float>(cells_.size());
    const auto last = static_cast<uint32_t>(cells_.size() - 1);
    const uint32_t cell = scaled < static_cast<float>(last) ? static_cast<uint32_t>(scaled) : last;
    return scaled - static_cast<float>(cell) < cells_[cell].threshold ? cell : cells_[cell].alias;
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
