#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "filter/image/portable_math.h"
#include "filter/kernels/kernel_constants.h"
#include "tests/unit/filter/kernel_oracles.h"

namespace lumifold::filter::oracle {
namespace {

/// A row of cells, from one before the first on, at the pixel of a phase in cell c.
float Widened(const Phases& phases, const float* cells, int phase, int c) {
  const float* left = cells + c + phases.Side(phase);
  return left[0] + phases.part[static_cast<size_t>(phase)] * (left[1] - left[0]);
}

struct Position {
  float square;  // squared distance from the manifold
  float along;   // along the axis that splits its cluster
};

Position PositionOf(const Phases& phases, const WeighArgs& args, const SplitArgs* split, int phase, int c) {
  Position position{0, 0};
  for (size_t k = 0; k < args.dimensions; ++k) {
    const float offset = args.features[k][phase * args.phase_stride + c] -
                         Widened(phases, args.eta + k * args.eta_stride, phase, c);
    position.square += offset * offset;
    if (split != nullptr) position.along += split->axis[k] * offset;
  }
  return position;
}

/// `x`: of the pixel in its rows, `at`: in strips.
void SplitPixel(const WeighArgs& args, const SplitArgs& split, float along, std::ptrdiff_t x,
                std::ptrdiff_t at) {
  split.members[x] *= std::min(1.0f, std::abs(along) * (1.0f / kSeam));
  const bool is_far = along >= 0;
  split.next_labels[x] = 2 * split.cluster + (is_far ? 1.0f : 0.0f);
  const float mass = split.members[x] * (1.0f - args.weight[x]);
  float* const* sums = is_far ? split.far_sums : split.near_sums;
  for (size_t k = 0; k < args.dimensions; ++k) sums[k][at] += mass * args.features[k][x];
  sums[args.dimensions][at] += mass;
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

bool WeighRow(const Phases& phases, const WeighArgs& args, const SplitArgs* split) {
  bool found = false;
  for (int phase = 0; phase < phases.step; ++phase) {
    for (int c = 0; c < args.count; ++c) {
      const std::ptrdiff_t x = phase * args.phase_stride + c;
      const Position position = PositionOf(phases, args, split, phase, c);
      args.weight[x] = position.square < kFarthest ? Exp(-position.square) : 0.0f;
      args.total[x] += args.weight[x];
      if (split == nullptr || split->labels[x] != split->cluster) continue;
      found = true;
      SplitPixel(args, *split, position.along, x, phase * split->sum_stride + c);
    }
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

void SliceRow(const Phases& phases, const SliceArgs& args) {
  for (size_t k = 0; k < args.planes; ++k) {
    for (int i = 0; i < phases.step * args.count; ++i) {
      const int phase = i / args.count;
      const int c = i % args.count;
      const std::ptrdiff_t x = phase * args.phase_stride + c;
      if (!args.adds) args.sums[k][x] = 0;
      for (size_t j = 0; j < args.manifolds; ++j) {
        const float* psi = args.psi + (j * args.planes + k) * args.psi_stride;
        args.sums[k][x] += args.weights[j][x] * Widened(phases, psi, phase, c);
      }
    }
  }
}

void AddProductRow(const float* a, const float* b, int count, float* sums) {
  for (int x = 0; x < count; ++x) sums[x] += a[x] * b[x];
}

void SumPhases(float* sums, std::ptrdiff_t stride, int step, float scale, int count, float* means) {
  for (int c = 0; c < count; ++c) {
    std::vector<float> phases;
    for (int j = 0; j < step; ++j) phases.push_back(std::exchange(sums[j * stride + c], 0.0f));
    for (; phases.size() > 1; phases.resize(phases.size() / 2)) {
      for (size_t j = 0; j < phases.size() / 2; ++j) phases[j] = phases[2 * j] + phases[2 * j + 1];
    }
    means[c] = scale * phases[0];
  }
}

void QuotientRow(const float* total, float least, const float* instead, int count, float* sums) {
  for (int x = 0; x < count; ++x) sums[x] = total[x] < least ? instead[x] : sums[x] / total[x];
}

void StabiliseRow(const float* in, float inverse_knee, float shift, int count, float* out) {
  for (int x = 0; x < count; ++x) out[x] = Asinh(in[x] * inverse_knee) - shift;
}

}  // namespace lumifold::filter::oracle
