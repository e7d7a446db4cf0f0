#include <cmath>
#include <vector>

#include "filter/image/portable_math.h"
#include "filter/kernels/kernel_constants.h"
#include "filter/kernels/recursion_kernels.h"

namespace lumifold::filter::slow {

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
  slow::RecurseRows(args, rows.data());
}

void PullRow(const float* weight, const float* from, int count, float* to) {
  for (int x = 0; x < count; ++x) to[x] += weight[x] * (from[x] - to[x]);
}

void PullRowEvenly(float weight, const float* from, int count, float* to) {
  for (int x = 0; x < count; ++x) to[x] += weight * (from[x] - to[x]);
}

void LinkRow(const LinkArgs& args, const LinkReach& reach, float* weights) {
  for (int x = 0; x < args.count; ++x) {
    float square = 0;
    for (size_t k = 0; k < args.planes; ++k) {
      const float difference = args.here[k][x] - args.there[k][x];
      square += difference * difference;
    }
    weights[x] = Exp((-kSqrt2 / reach.sigma) * std::sqrt(1.0f + reach.stretch * square));
  }
}

}  // namespace lumifold::filter::slow
