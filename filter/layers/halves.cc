#include "filter/layers/halves.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "filter/layers/magnitude.h"

namespace lumifold::filter {
namespace {

bool IsUsableColor(const ConstColorView& color, int x, int y) {
  return IsUsable(color[0].At(x, y)) && IsUsable(color[1].At(x, y)) && IsUsable(color[2].At(x, y));
}

/// Mean magnitude of the usable values, 0 for a black layer.
double MeanOfUsable(const HalvesView& film, const Halves& halves, TaskPool* pool) {
  const double total = SumRows(pool, halves.height(), [&](int y) {
    return RowMagnitude(film.a, halves.weight_a.view(), y) + RowMagnitude(film.b, halves.weight_b.view(), y);
  });
  const double known = SumRows(pool, halves.height(), [&](int y) {
    double sum = 0;
    for (int x = 0; x < halves.width(); ++x) {
      sum += static_cast<double>(halves.weight_a.At(x, y) + halves.weight_b.At(x, y));
    }
    return sum;
  });
  return known > 0 ? total / (3 * known) : 0;
}

/// Sets scale to the power of two below the mean magnitude, and level to what is left of it.
void SetScale(double mean, Halves* halves) {
  if (!(mean > 1e-36)) return;
  const double power = std::bit_cast<double>(std::bit_cast<uint64_t>(mean) & 0x7ff0000000000000u);
  halves->scale = static_cast<float>(power);
  halves->level = static_cast<float>(mean / power);
}

void FillPixel(const HalvesView& film, ConstFloatView validity, float inverse_scale, int x, int y,
               Halves* out) {
  const bool has_a = film.samples_a.At(x, y) > 0 && IsUsableColor(film.a, x, y);
  const bool has_b = film.samples_b.At(x, y) > 0 && IsUsableColor(film.b, x, y);
  const float unit = validity.At(x, y) > 0 ? inverse_scale / validity.At(x, y) : inverse_scale;
  for (size_t c = 0; c < 3; ++c) {
    const float a = has_a ? film.a[c].At(x, y) * unit : 0.0f;
    const float b = has_b ? film.b[c].At(x, y) * unit : a;
    out->a[c].At(x, y) = has_a ? a : b;
    out->b[c].At(x, y) = b;
  }
}

void WeightPixel(const HalvesView& film, ConstFloatView validity, int x, int y, Halves* out) {
  const float n_a = IsUsableColor(film.a, x, y) ? film.samples_a.At(x, y) : 0.0f;
  const float n_b = IsUsableColor(film.b, x, y) ? film.samples_b.At(x, y) : 0.0f;
  const float covered = validity.At(x, y);
  out->weight_a.At(x, y) = n_a > 0 ? covered : 0.0f;
  out->weight_b.At(x, y) = n_b > 0 ? covered : 0.0f;
  out->weight.At(x, y) = n_a > 0 || n_b > 0 ? covered : 0.0f;
  const float samples = (n_a > 0 ? n_a : 0.0f) + (n_b > 0 ? n_b : 0.0f);
  out->samples.At(x, y) = samples;
  out->share_a.At(x, y) = n_a > 0 ? n_a / samples : 0.0f;
}

/// Mean square of x[i-1] - 2 x[i] + x[i+1] over valid triples, over 6: the variance of white noise.
double SecondDifferenceVariance(const Halves& halves, const Planes& picture, TaskPool* pool) {
  std::vector<double> counts(static_cast<size_t>(halves.height()), 0.0);
  const double sum = SumRows(pool, halves.height(), [&](int y) {
    double row_sum = 0;
    const float* weight = halves.weight.Row(y);
    for (int x = 1; x + 1 < halves.width(); ++x) {
      if (weight[x - 1] * weight[x] * weight[x + 1] == 0) continue;
      counts[static_cast<size_t>(y)] += 3;
      for (const Plane& plane : picture) {
        const float* row = plane.Row(y);
        const double difference = static_cast<double>(row[x - 1] - 2 * row[x] + row[x + 1]);
        row_sum += difference * difference;
      }
    }
    return row_sum;
  });
  double count = 0;
  for (const double row_count : counts) count += row_count;
  return count > 0 ? sum / (6 * count) : 0;
}

double HalfDifferenceVariance(const Halves& halves, const Planes& a, const Planes& b, TaskPool* pool) {
  std::vector<double> counts(static_cast<size_t>(halves.height()), 0.0);
  const double sum = SumRows(pool, halves.height(), [&](int y) {
    double row_sum = 0;
    for (int x = 0; x < halves.width(); ++x) {
      const double weight = static_cast<double>(halves.weight_a.At(x, y) * halves.weight_b.At(x, y));
      if (weight == 0) continue;
      counts[static_cast<size_t>(y)] += 3 * weight;
      const double share = static_cast<double>(halves.share_a.At(x, y));
      for (size_t c = 0; c < a.size(); ++c) {
        const double difference = static_cast<double>(a[c].At(x, y) - b[c].At(x, y));
        row_sum += weight * share * (1 - share) * difference * difference;
      }
    }
    return row_sum;
  });
  double count = 0;
  for (const double row_count : counts) count += row_count;
  return count > 0 ? sum / count : 0;
}

}  // namespace

Halves MakeHalves(const HalvesView& film, ConstFloatView validity, TaskPool* pool) {
  const int width = validity.width();
  const int height = validity.height();
  Halves halves;
  halves.a = MakeUninitializedPlanes(3, width, height);
  halves.b = MakeUninitializedPlanes(3, width, height);
  for (Plane* plane : {&halves.weight_a, &halves.weight_b, &halves.weight, &halves.share_a, &halves.samples})
    *plane = Plane::Uninitialized(width, height);
  ForEachPixel(pool, width, height, [&](int x, int y) { WeightPixel(film, validity, x, y, &halves); });
  SetScale(MeanOfUsable(film, halves, pool), &halves);
  ForEachPixel(pool, width, height,
               [&](int x, int y) { FillPixel(film, validity, 1.0f / halves.scale, x, y, &halves); });
  // A pixel with both halves counts 1, one with one half -1.
  const double balance = SumRows(pool, height, [&](int y) {
    double count = 0;
    for (int x = 0; x < width; ++x) {
      const bool has_a = halves.weight_a.At(x, y) > 0;
      const bool has_b = halves.weight_b.At(x, y) > 0;
      if (has_a || has_b) count += has_a && has_b ? 1 : -1;
    }
    return count;
  });
  halves.has_noise_estimate = balance > 0;
  return halves;
}

Plane BothHalvesMask(const Halves& halves) {
  Plane mask = Plane::Uninitialized(halves.width(), halves.height());
  ForEachPixel(mask.width(), mask.height(),
               [&](int x, int y) { mask.At(x, y) = halves.weight_a.At(x, y) * halves.weight_b.At(x, y); });
  return mask;
}

Planes Combine(const Planes& a, const Planes& b, ConstFloatView share_a, TaskPool* pool) {
  Planes combined = MakeUninitializedPlanes(a.size(), share_a.width(), share_a.height());
  for (size_t c = 0; c < a.size(); ++c) {
    ForEachPixel(pool, share_a.width(), share_a.height(), [&](int x, int y) {
      const float share = share_a.At(x, y);
      combined[c].At(x, y) = share * a[c].At(x, y) + (1.0f - share) * b[c].At(x, y);
    });
  }
  return combined;
}

Planes Difference(const Planes& x, const Planes& y, TaskPool* pool) {
  Planes difference = MakeUninitializedPlanes(x.size(), x[0].width(), x[0].height());
  ForEachBand(pool, x[0].height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < x.size(); ++c) {
      for (int row = y0; row < y1; ++row) {
        const float* __restrict from = x[c].Row(row);
        const float* __restrict less = y[c].Row(row);
        float* __restrict out = difference[c].Row(row);
        for (int i = 0; i < x[c].width(); ++i) out[i] = from[i] - less[i];
      }
    }
  });
  return difference;
}

float NoiseLevel(const Halves& halves, const Planes& a, const Planes& b, TaskPool* pool) {
  const double variance = halves.has_noise_estimate ? HalfDifferenceVariance(halves, a, b, pool)
                                                    : SecondDifferenceVariance(halves, a, pool);
  return static_cast<float>(std::sqrt(variance));
}

float PositiveNoise(const Halves& halves, TaskPool* pool) {
  constexpr float kLeast = 1e-4f;
  return std::max(NoiseLevel(halves, halves.a, halves.b, pool), kLeast * halves.level);
}

}  // namespace lumifold::filter
