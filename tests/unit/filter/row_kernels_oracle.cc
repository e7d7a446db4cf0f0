#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"
#include "filter/kernels/kernel_constants.h"
#include "tests/unit/filter/kernel_oracles.h"

namespace lumifold::filter::oracle {
namespace {

/// Pixel x of a row of cells.
float Widened(const Widening& widening, const float* cells, int x) {
  const int phase = x % 64;
  const float* left = cells + widening.left[static_cast<size_t>(phase)] + (x - phase) / widening.step;
  return left[0] + widening.part[static_cast<size_t>(phase)] * (left[1] - left[0]);
}

struct Position {
  float square;  // squared distance from the manifold
  float along;   // along the axis that splits its cluster
};

Position PositionOf(const Widening& widening, const WeighArgs& args, const SplitArgs* split, int x) {
  Position position{0, 0};
  for (size_t k = 0; k < args.dimensions; ++k) {
    const float offset = args.features[k][x] - Widened(widening, args.eta + k * args.eta_stride, x);
    position.square += offset * offset;
    if (split != nullptr) position.along += split->axis[k] * offset;
  }
  return position;
}

void SplitPixel(const WeighArgs& args, const SplitArgs& split, float along, int x) {
  split.members[x] *= std::min(1.0f, std::abs(along) * (1.0f / kSeam));
  const bool is_far = along >= 0;
  split.next_labels[x] = 2 * split.cluster + (is_far ? 1.0f : 0.0f);
  const float mass = split.members[x] * (1.0f - args.weight[x]);
  float* const* sums = is_far ? split.far_sums : split.near_sums;
  for (size_t k = 0; k < args.dimensions; ++k) sums[k][x] += mass * args.features[k][x];
  sums[args.dimensions][x] += mass;
}

}  // namespace

void BlendCells(const BlendArgs& args) {
  for (size_t i = 0; i < args.planes; ++i) {
    for (int p = 0; p < args.count; ++p) {
      const int c = std::clamp(args.first + p, 0, args.columns - 1);
      const float upper = args.upper[i][c];
      args.out[i * args.out_stride + static_cast<size_t>(p)] =
          upper + args.fraction * (args.lower[i][c] - upper);
    }
  }
}

bool WeighRow(const Widening& widening, const WeighArgs& args, const SplitArgs* split) {
  bool found = false;
  for (int x = 0; x < args.count; ++x) {
    const Position position = PositionOf(widening, args, split, x);
    args.weight[x] = position.square < kFarthest ? Exp(-position.square) : 0.0f;
    args.total[x] += args.weight[x];
    if (split == nullptr || split->labels[x] != split->cluster) continue;
    found = true;
    SplitPixel(args, *split, position.along, x);
  }
  return found;
}

bool SplatRow(const SplatArgs& args) {
  bool found = false;
  for (int x = 0; x < args.count; ++x) {
    found |= args.weight[x] > 0;
    const float mass = args.mask[x] * args.weight[x];
    for (size_t c = 0; c < args.signal_count; ++c) args.sums[c][x] += mass * args.signals[c][x];
    args.sums[args.signal_count][x] += mass;
  }
  return found;
}

void SliceRow(const Widening& widening, const SliceArgs& args) {
  for (size_t c = 0; c < args.planes; ++c) {
    for (int x = 0; x < args.count; ++x) {
      for (size_t i = 0; i < args.manifolds; ++i) {
        const float* psi = args.psi + (i * args.planes + c) * args.psi_stride;
        args.sums[c][x] += args.weights[i][x] * Widened(widening, psi, x);
      }
    }
  }
}

void AddProductRow(const float* a, const float* b, int count, float* sums) {
  for (int x = 0; x < count; ++x) sums[x] += a[x] * b[x];
}

void AddPairs(const float* from, int count, float scale, float* to) {
  for (int i = 0; i < count / 2; ++i) to[i] = scale * (from[2 * i] + from[2 * i + 1]);
}

void QuotientRow(const float* total, float least, const float* instead, int count, float* sums) {
  for (int x = 0; x < count; ++x) sums[x] = total[x] < least ? instead[x] : sums[x] / total[x];
}

void StabiliseRow(const float* in, float inverse_knee, float shift, int count, float* out) {
  for (int x = 0; x < count; ++x) out[x] = Asinh(in[x] * inverse_knee) - shift;
}

}  // namespace lumifold::filter::oracle
