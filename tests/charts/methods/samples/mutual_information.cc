#include "tests/charts/methods/samples/mutual_information.h"

#include <algorithm>
#include <array>

#include "filter/image/check.h"
#include "filter/image/portable_math.h"

namespace lumifold::charts {

void SortIntoBins(absl::Span<const float> values, std::vector<uint8_t>* bins) {
  constexpr float kHalf = 0.5f * kBins;
  bins->resize(values.size());
  for (size_t i = 0; i < values.size(); ++i)
    (*bins)[i] = static_cast<uint8_t>(std::clamp(values[i] + kHalf, 0.0f, kBins - 0.5f));
}

MutualInformation::MutualInformation(size_t most_samples) : n_log_n_(most_samples + 1, 0.0) {
  for (size_t n = 2; n <= most_samples; ++n)
    n_log_n_[n] = static_cast<double>(n) * static_cast<double>(Log(static_cast<float>(n)));
}

double MutualInformation::SumOfLogs(absl::Span<const uint32_t> counts) const {
  double sum = 0;
  for (const uint32_t n : counts) sum += n_log_n_[n];
  return sum;
}

double MutualInformation::Of(absl::Span<const uint8_t> a, absl::Span<const uint8_t> b, bool unbiased) const {
  LUMIFOLD_CHECK(a.size() == b.size() && a.size() < n_log_n_.size());
  if (a.empty()) return 0;
  // Alternates between two tables: successive samples often fall into one bin, whose update would stall.
  std::array<std::array<uint32_t, kBins * kBins>, 2> tables = {};
  for (size_t i = 0; i < a.size(); ++i) ++tables[i & 1][size_t{a[i]} * kBins + b[i]];
  std::array<uint32_t, kBins * kBins> joint;
  std::array<uint32_t, kBins> rows = {};
  std::array<uint32_t, kBins> columns = {};
  for (size_t i = 0; i < joint.size(); ++i) {
    joint[i] = tables[0][i] + tables[1][i];
    rows[i / kBins] += joint[i];
    columns[i % kBins] += joint[i];
  }
  const double n = static_cast<double>(a.size());
  const double information =
      (SumOfLogs(joint) - SumOfLogs(rows) - SumOfLogs(columns) + n_log_n_[a.size()]) / n;
  const auto filled = [](const std::array<uint32_t, kBins>& counts) {
    return static_cast<double>(kBins - std::count(counts.begin(), counts.end(), 0u));
  };
  const double bias = unbiased ? (filled(rows) - 1) * (filled(columns) - 1) / (2 * n) : 0.0;
  return std::max(0.0, information - bias);
}

}  // namespace lumifold::charts
