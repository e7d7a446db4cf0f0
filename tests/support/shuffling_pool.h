#pragma once

#include <cstdint>
#include <numeric>
#include <random>
#include <vector>

#include "filter/image/parallel.h"

namespace lumifold {

/// Runs its tasks one after another in a random order: whoever depends on the order of tasks shows it.
class ShufflingPool final : public TaskPool {
 public:
  explicit ShufflingPool(uint32_t seed) : random_(seed) {}

  void Run(int64_t count, absl::FunctionRef<void(int64_t)> task) override {
    std::vector<int64_t> order(static_cast<size_t>(count));
    std::iota(order.begin(), order.end(), int64_t{0});
    for (size_t left = order.size(); left > 1; --left) std::swap(order[left - 1], order[random_() % left]);
    for (const int64_t i : order) task(i);
  }

  int Width() const override { return 3; }

 private:
  std::mt19937 random_;
};

}  // namespace lumifold
