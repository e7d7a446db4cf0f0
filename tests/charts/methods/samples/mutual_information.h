#pragma once

#include <cstdint>
#include <vector>

#include "absl/types/span.h"

namespace lumifold::charts {

/// Bins for values of mean 0 and standard deviation 1: one standard deviation wide, the middle one centred at
/// 0, the outermost unbounded.
inline constexpr int kBins = 5;

void SortIntoBins(absl::Span<const float> values, std::vector<uint8_t>* bins);

/// Mutual information of two variables, in nats, from pairs of samples. Threads: safe concurrently.
class MutualInformation {
 public:
  /// For up to `most_samples` pairs.
  explicit MutualInformation(size_t most_samples);

  /// The mutual information of two lists of bins, pair by pair. Estimates from few samples are too high by
  /// about (rows - 1) (columns - 1) / (2 samples), where rows and columns count the bins in use. If
  /// `unbiased`, that is subtracted, and the result is at least 0. Source: Miller 1955 (the bias).
  double Of(absl::Span<const uint8_t> a, absl::Span<const uint8_t> b, bool unbiased) const;

 private:
  /// Sum of n ln n.
  double SumOfLogs(absl::Span<const uint32_t> counts) const;

  std::vector<double> n_log_n_;
};

}  // namespace lumifold::charts
