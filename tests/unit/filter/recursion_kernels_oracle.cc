#include <vector>

#include "tests/unit/filter/kernel_oracles.h"

namespace lumifold::filter::oracle {

void RecurseRows(const RecurseArgs& args, const float* const* weights) {
  for (size_t i = 0; i < args.signals * args.rows; ++i) {
    const float* from = args.from[i];
    const float* weight = weights[i % args.rows];
    float* to = args.to[i];
    to[0] = from[0];
    for (int x = 1; x < args.count; ++x) to[x] = from[x] + weight[x] * (to[x - 1] - from[x]);
    for (int x = args.count - 2; x >= 0; --x) to[x] += weight[x + 1] * (to[x + 1] - to[x]);
  }
}

void RecurseRowsEvenly(const RecurseArgs& args, float weight) {
  const std::vector<float> links(static_cast<size_t>(args.count), weight);
  const std::vector<const float*> rows(args.rows, links.data());
  oracle::RecurseRows(args, rows.data());
}

void PullRow(const float* weight, const float* from, int count, float* to) {
  for (int x = 0; x < count; ++x) to[x] += weight[x] * (from[x] - to[x]);
}

void PullRowEvenly(float weight, const float* from, int count, float* to) {
  for (int x = 0; x < count; ++x) to[x] += weight * (from[x] - to[x]);
}

}  // namespace lumifold::filter::oracle
