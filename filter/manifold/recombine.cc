#include "filter/manifold/recombine.h"

#include <algorithm>
#include <cmath>

#include "filter/image/layers.h"
#include "filter/manifold/box_mean.h"

namespace lumifold::filter {
namespace {

constexpr float kShrink = 4.0f;   // residuals up to this many variances are taken for noise
constexpr int kShrinkRadius = 2;  // 5x5 window
constexpr float kLargest = 1e34f;

/// The channel's value where it is usable, else 0.
float Finite(float value) { return std::abs(value) <= kLargest ? value : 0.0f; }

Planes RemainderOf(const LayeredImage& film, const ConstColorView& noisy, const ConstColorView& direct,
                   const ConstColorView& indirect, TaskPool* pool) {
  const ConstColorView albedo = film.GetColor(layers::kAlbedo);
  const ConstColorView emission = film.GetColor(layers::kEmission);
  Planes rest = MakePlanes(3, film.width(), film.height());
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < film.width(); ++x) {
          const float diffuse = (direct[c].At(x, y) + indirect[c].At(x, y)) * albedo[c].At(x, y);
          rest[c].At(x, y) = Finite(noisy[c].At(x, y) - diffuse - emission[c].At(x, y));
        }
      }
    }
  });
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

float MeanMagnitude(const LayeredImage& film, TaskPool* pool) {
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  const double sum = SumRows(pool, film.height(), [&](int y) {
    double row = 0;
    for (const ConstFloatView& channel : noisy) {
      for (int x = 0; x < film.width(); ++x) row += static_cast<double>(std::abs(Finite(channel.At(x, y))));
    }
    return row;
  });
  return static_cast<float>(sum / (3.0 * film.width() * film.height()));
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

}  // namespace

Remainder MakeRemainder(const LayeredImage& film, TaskPool* pool) {
  const auto part = [&](std::string (*name)(std::string_view)) {
    return RemainderOf(film, film.GetColor(name(layers::kNoisy)), film.GetColor(name(layers::kDirect)),
                       film.GetColor(name(layers::kIndirect)), pool);
  };
  return {part([](std::string_view layer) { return std::string(layer); }), part(layers::HalfA),
          part(layers::HalfB)};
}

std::array<Plane, 3> Recombine(const LayeredImage& film, const Remainder& before,
                               const FilteredLayers& filtered, TaskPool* pool) {
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  const ConstColorView direct = film.GetColor(layers::kDirect);
  const ConstColorView indirect = film.GetColor(layers::kIndirect);
  const ConstColorView albedo = film.GetColor(layers::kAlbedo);
  std::array<Plane, 3> picture = {Plane(film.width(), film.height()), Plane(film.width(), film.height()),
                                  Plane(film.width(), film.height())};
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < film.width(); ++x) {
          const float diffuse = (filtered.direct[c].At(x, y) - direct[c].At(x, y)) +
                                (filtered.indirect[c].At(x, y) - indirect[c].At(x, y));
          const float change = Finite(diffuse * albedo[c].At(x, y)) +
                               Finite(filtered.remainder[c].At(x, y) - before.mean[c].At(x, y));
          picture[c].At(x, y) = Finite(Finite(noisy[c].At(x, y)) + change);
        }
      }
    }
  });
  return picture;
}

void ShrinkResidual(const LayeredImage& film, TaskPool* pool, std::array<Plane, 3>* picture) {
  const float unit = MeanMagnitude(film, pool);
  if (!(unit > 0)) return;
  const Plane mask = MeasurableMask(film);
  const Planes means =
      BoxMeans(MeasureResidual(film, *picture, unit, pool), mask.view(), kShrinkRadius, pool);
  const Plane& variance = means[0];
  const Plane& square = means[1];
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < film.width(); ++x) {
        const float noise = kShrink * variance.At(x, y);
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
