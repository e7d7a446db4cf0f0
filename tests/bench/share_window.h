#pragma once

#include <cstddef>
#include <vector>

namespace lumifold::sim {

/// Compares what users get of a farm with their shares, window by window.
class ShareWindow {
 public:
  /// `seconds`: length of a window.
  ShareWindow(int users, double seconds)
      : seconds_(seconds),
        used_(static_cast<size_t>(users)),
        weights_(used_.size()),
        had_work_(used_.size(), false) {}

  /// A slot of the user was busy for so long in this window.
  void Use(int user, double slot_seconds) { used_[static_cast<size_t>(user)] += slot_seconds; }
  /// Ends the window. `weights`: of users with free units now, 0 for others. Returns the relative deviation
  /// from their share that is largest, of users that had the same weight at both ends; 0 where there is none.
  double Close(const std::vector<double>& weights);

 private:
  const double seconds_;
  std::vector<double> used_;
  std::vector<double> weights_;  // at the end of the last window
  std::vector<bool> had_work_;   // with the same weight since the window before
};

}  // namespace lumifold::sim
