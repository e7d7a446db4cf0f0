#include "tests/charts/mean_ratio.h"

#include <cmath>
#include <numeric>
#include <vector>

#include "absl/strings/str_format.h"

namespace lumifold::charts {

std::optional<MeanRatio> MeanRatioOf(absl::Span<const std::pair<double, double>> pairs) {
  std::vector<double> ratios;
  for (const auto& [first, second] : pairs) {
    if (first != second && !(first > 0)) return std::nullopt;
    ratios.push_back(first == second ? 1 : second / first);
  }
  if (ratios.empty()) return std::nullopt;
  const auto count = static_cast<double>(ratios.size());
  MeanRatio result = {.mean = std::accumulate(ratios.begin(), ratios.end(), 0.0) / count};
  if (ratios.size() == 1) return result;
  double squares = 0;
  for (const double ratio : ratios) squares += (ratio - result.mean) * (ratio - result.mean);
  result.standard_error = std::sqrt(squares / (count - 1) / count);
  return result;
}

std::string RatioCell(const std::optional<MeanRatio>& ratio) {
  if (!ratio.has_value()) return "-";
  if (ratio->standard_error == 0) return absl::StrFormat("%.3f", ratio->mean);
  return absl::StrFormat("%.3f ± %.3f", ratio->mean, ratio->standard_error);
}

}  // namespace lumifold::charts
