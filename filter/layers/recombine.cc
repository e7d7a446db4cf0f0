#include "filter/layers/recombine.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "filter/image/layers.h"
#include "filter/kernels/box_mean.h"

namespace lumifold::filter {
namespace {

constexpr float kShrink = 4.0f;   // residuals up to this many variances are taken for noise
constexpr int kShrinkRadius = 2;  // 5x5 window
/// Few samples that find much light leave small windows that none has hit: they are dark and look free of
/// noise.
constexpr int kNoiseRadius = 12;  // 25x25 window
/// Up to so many samples such a window speaks in full; with more, the less the more they are, or it would
/// keep the picture from converging beside lamps.
constexpr float kNoiseSamples = 16;
constexpr float kLargest = 1e34f;
constexpr float kRounding = 1e-6f;  // of C: what sums of a few floats lose

/// The channel's value where it is usable, else 0.
float Finite(float value) { return std::abs(value) <= kLargest ? value : 0.0f; }

/// out += sign * x, plane by plane; not finite values count as 0.
void AddTo(const ConstColorView& x, float sign, TaskPool* pool, Planes* out) {
  ForEachBand(pool, x[0].height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        const float* __restrict in = x[c].Row(y);
        float* __restrict sum = (*out)[c].Row(y);
        for (int i = 0; i < x[c].width(); ++i) sum[i] += sign * Finite(in[i]);
      }
    }
  });
}

/// out -= value * factor. Where `count`, if given, is 0, `mean` stands for the value.
void SubtractProduct(const ConstColorView& value, const ConstColorView& factor, const ConstFloatView* count,
                     const ConstColorView& mean, TaskPool* pool, Planes* out) {
  ForEachBand(pool, value[0].height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < value[c].width(); ++x) {
          const bool known = count == nullptr || count->At(x, y) > 0;
          const float v = known ? value[c].At(x, y) : mean[c].At(x, y);
          (*out)[c].At(x, y) -= Finite(v * factor[c].At(x, y));
        }
      }
    }
  });
}

/// C without all that shines by itself, seen first or in a level.
Planes WithoutEmission(const LayeredImage& film, const ConstColorView& noisy, TaskPool* pool) {
  Planes rest = MakePlanes(3, film.width(), film.height());
  AddTo(noisy, 1, pool, &rest);
  AddTo(film.GetColor(layers::kEmission), -1, pool, &rest);
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    const std::string emission = layers::OfLevel(layers::Level::Of(i), layers::kEmission);
    if (film.HasColor(emission)) AddTo(film.GetColor(emission), -1, pool, &rest);
  }
  return rest;
}

/// 1 where both halves have samples.
Plane MeasurableMask(const LayeredImage& film) {
  const ConstFloatView a = film.Get(layers::kSamplesA);
  const ConstFloatView b = film.Get(layers::kSamplesB);
  Plane mask(film.width(), film.height());
  for (int y = 0; y < film.height(); ++y) {
    for (int x = 0; x < film.width(); ++x) mask.At(x, y) = a.At(x, y) > 0 && b.At(x, y) > 0 ? 1.0f : 0.0f;
  }
  return mask;
}

/// What the shrink compares: variance of C and (C - F)^2, summed over the channels and relative to the mean
/// brightness squared, so that neither tiny nor huge units leave float's range.
Planes MeasureResidual(const LayeredImage& film, const std::array<Plane, 3>& picture, float unit,
                       TaskPool* pool) {
  Planes residual = MakePlanes(2, film.width(), film.height());
  const ConstFloatView n_a = film.Get(layers::kSamplesA);
  const ConstFloatView n_b = film.Get(layers::kSamplesB);
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  const ConstColorView half_a = film.GetColor(layers::HalfA(layers::kNoisy));
  const ConstColorView half_b = film.GetColor(layers::HalfB(layers::kNoisy));
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < film.width(); ++x) {
          const float n = std::max(1.0f, n_a.At(x, y) + n_b.At(x, y));
          const float difference = (Finite(half_a[c].At(x, y)) - Finite(half_b[c].At(x, y))) / unit;
          residual[0].At(x, y) += n_a.At(x, y) * n_b.At(x, y) / (n * n) * difference * difference;
          const float off = (Finite(noisy[c].At(x, y)) - picture[c].At(x, y)) / unit;
          residual[1].At(x, y) += off * off;
        }
      }
    }
  });
  return residual;
}

/// How much the noise of a wide window counts with n samples.
float Fewness(float n) { return kNoiseSamples / std::max(n, kNoiseSamples); }

/// Bounds what one pixel says of how far F is from C, so that with few samples it takes two to draw the
/// window back: a firefly that both halves have caught looks free of noise.
void CapSquares(const LayeredImage& film, const Plane& variance_around, Plane* squares) {
  constexpr float kWindow = (2 * kShrinkRadius + 1) * (2 * kShrinkRadius + 1);
  const ConstFloatView n_a = film.Get(layers::kSamplesA);
  const ConstFloatView n_b = film.Get(layers::kSamplesB);
  for (int y = 0; y < squares->height(); ++y) {
    for (int x = 0; x < squares->width(); ++x) {
      const float most = kWindow * kShrink * variance_around.At(x, y) / Fewness(n_a.At(x, y) + n_b.At(x, y));
      squares->At(x, y) = std::min(squares->At(x, y), most);
    }
  }
}

}  // namespace

float MeanMagnitude(const ConstColorView& color, TaskPool* pool) {
  const int width = color[0].width();
  const int height = color[0].height();
  const double sum = SumRows(pool, height, [&](int y) {
    double row = 0;
    for (const ConstFloatView& channel : color) {
      for (int x = 0; x < width; ++x) row += static_cast<double>(std::abs(Finite(channel.At(x, y))));
    }
    return row;
  });
  return static_cast<float>(sum / (3.0 * width * height));
}

Remainder MakeRemainder(const LayeredImage& film, const std::vector<Product>& products, TaskPool* pool) {
  Remainder rest;
  rest.mean = WithoutEmission(film, film.GetColor(layers::kNoisy), pool);
  rest.a = WithoutEmission(film, film.GetColor(layers::HalfA(layers::kNoisy)), pool);
  rest.b = WithoutEmission(film, film.GetColor(layers::HalfB(layers::kNoisy)), pool);
  for (const Product& p : products) {
    SubtractProduct(p.mean, p.factor, nullptr, p.mean, pool, &rest.mean);
    SubtractProduct(p.halves.a, p.factor, &p.halves.samples_a, p.mean, pool, &rest.a);
    SubtractProduct(p.halves.b, p.factor, &p.halves.samples_b, p.mean, pool, &rest.b);
  }
  return rest;
}

bool IsRounding(const Remainder& remainder, const LayeredImage& film, TaskPool* pool) {
  const float most = kRounding * MeanMagnitude(film.GetColor(layers::kNoisy), pool);
  return MeanMagnitude(ViewOf(remainder.a), pool) <= most && MeanMagnitude(ViewOf(remainder.b), pool) <= most;
}

std::array<Plane, 3> Recombine(const LayeredImage& film, const std::vector<Product>& products,
                               const std::vector<Planes>& filtered, TaskPool* pool) {
  Planes changes = MakePlanes(3, film.width(), film.height());
  for (size_t i = 0; i < products.size(); ++i) {
    const Rect& box = products[i].box;
    ForEachBand(pool, box.height(), [&](int, int y0, int y1) {
      for (size_t c = 0; c < 3; ++c) {
        for (int y = y0; y < y1; ++y) {
          for (int x = 0; x < box.width(); ++x) {
            const float change = filtered[i][c].At(x, y) - products[i].mean[c].At(box.x0 + x, box.y0 + y);
            changes[c].At(box.x0 + x, box.y0 + y) +=
                Finite(change * products[i].factor[c].At(box.x0 + x, box.y0 + y));
          }
        }
      }
    });
  }
  std::array<Plane, 3> picture;
  for (size_t c = 0; c < 3; ++c) {
    const ConstFloatView noisy = film.GetColor(layers::kNoisy)[c];
    picture[c] = std::move(changes[c]);
    for (int y = 0; y < film.height(); ++y) {
      float* row = picture[c].Row(y);
      for (int x = 0; x < film.width(); ++x) row[x] = Finite(Finite(noisy.At(x, y)) + row[x]);
    }
  }
  return picture;
}

void AddChange(const Planes& before, const Planes& after, const Rect& box, TaskPool* pool,
               std::array<Plane, 3>* picture) {
  ForEachBand(pool, box.height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        const float* from = before[c].Row(box.y0 + y) + box.x0;
        const float* to = after[c].Row(y);
        float* row = (*picture)[c].Row(box.y0 + y) + box.x0;
        for (int x = 0; x < box.width(); ++x) row[x] = Finite(row[x] + Finite(to[x] - from[x]));
      }
    }
  });
}

void ShrinkResidual(const LayeredImage& film, TaskPool* pool, std::array<Plane, 3>* picture) {
  const float unit = MeanMagnitude(film.GetColor(layers::kNoisy), pool);
  if (!(unit > 0)) return;
  const Plane mask = MeasurableMask(film);
  Planes residual = MeasureResidual(film, *picture, unit, pool);
  Plane square_of_each = std::move(residual.back());
  residual.pop_back();
  const Planes around = BoxMeans(residual, mask.view(), kNoiseRadius, pool);
  CapSquares(film, around[0], &square_of_each);
  residual.push_back(std::move(square_of_each));
  const Planes means = BoxMeans(residual, mask.view(), kShrinkRadius, pool);
  const Plane& square = means[1];
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  const ConstFloatView n_a = film.Get(layers::kSamplesA);
  const ConstFloatView n_b = film.Get(layers::kSamplesB);
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < film.width(); ++x) {
        const float few = Fewness(n_a.At(x, y) + n_b.At(x, y));
        const float noise = kShrink * std::max(means[0].At(x, y), few * around[0].At(x, y));
        if (mask.At(x, y) == 0 || !(square.At(x, y) > noise)) continue;
        const float back = 1.0f - noise / square.At(x, y);
        for (size_t c = 0; c < 3; ++c) {
          float& value = (*picture)[c].At(x, y);
          if (std::abs(noisy[c].At(x, y)) <= kLargest) value += back * (noisy[c].At(x, y) - value);
        }
      }
    }
  });
}

}  // namespace lumifold::filter
