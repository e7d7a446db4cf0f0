#include "tests/bench/share_window.h"

#include <algorithm>
#include <cmath>

namespace lumifold::sim {
namespace {

/// A share of a user whose slots are fewer than this is not compared: one unit more or less is no unfairness.
constexpr double kLeastSlots = 20;

}  // namespace

double ShareWindow::Close(const std::vector<double>& weights) {
  double used = 0;
  double weight = 0;
  for (size_t user = 0; user < used_.size(); ++user) {
    if (weights[user] == 0 || !had_work_[user]) continue;
    used += used_[user];
    weight += weights[user];
  }
  double largest = 0;
  for (size_t user = 0; user < used_.size(); ++user) {
    if (weights[user] > 0 && had_work_[user]) {
      const double share = used * weights[user] / weight;
      if (share / seconds_ >= kLeastSlots) largest = std::max(largest, std::abs(used_[user] / share - 1));
    }
    had_work_[user] = weights[user] > 0 && weights[user] == weights_[user];
    used_[user] = 0;
  }
  weights_ = weights;
  return largest;
}

}  // namespace lumifold::sim
