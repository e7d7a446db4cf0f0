#pragma once

#include <optional>
#include <string>
#include <utility>

#include "absl/types/span.h"

namespace lumifold::charts {

/// A mean of ratios of pairs.
struct MeanRatio {
  double mean = 1;
  double standard_error = 0;  // 0 for one pair
};

/// Of second over first. A pair of equal values has ratio 1; nullopt without pairs, or where a first value
/// that differs from its second is not above 0.
std::optional<MeanRatio> MeanRatioOf(absl::Span<const std::pair<double, double>> pairs);

/// "0.853 ± 0.004", "1.000" where all ratios are equal, "-" without a ratio.
std::string RatioCell(const std::optional<MeanRatio>& ratio);

}  // namespace lumifold::charts
