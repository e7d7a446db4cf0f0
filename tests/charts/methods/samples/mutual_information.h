#pragma once

#include <cstdint>
#include <vector>

#include "absl/types/span.h"

namespace lumifold::charts {

/// Bins of values that have mean 0 and deviation 1: a deviation wide, the middle one around 0, the outermost
/// for all beyond.
inline constexpr int kBins = 5;

void SortIntoBins(absl::Span<const float> values, std::vector<uint8_t>* bins);

/// How much one variable says of another, in nats, from pairs of samples. Threads: safe concurrently.
class MutualInformation {
 public:
  /// For up to `most_samples` pairs.
  explicit MutualInformation(size_t most_samples);

  /// Of two lists of bins, pair by pair. Estimates from few samples are too high, by about (rows - 1)
  /// (columns - 1) / (2 samples) of the bins that hold any: that is taken off where `unbiased`, down to 0.
  /// Source:  Miller 1955 (the bias).
  double Of(absl::Span<const uint8_t> a, absl::Span<const uint8_t> b, bool unbiased) const;

 private:
  /// Sum of n ln n.
  double SumOfLogs(absl::Span<const uint32_t> counts) const;

  std::vector<double> n_log_n_;
};

}  // namespace lumifold::charts
