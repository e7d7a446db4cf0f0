#include "filter/layers/recombination.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"

namespace lumifold::filter {
namespace {

void AddMixedPixels(const Rect& box, const FilteredLayer& layer, size_t h, size_t c, Planes* change) {
  const LayerFragments& fragments = layer.fragments;
  for (const LayerFragments::Pixel& p : fragments.pixels) {
    const float filtered = fragments.SumOver(p, fragments.coverage[h], layer.light.points[h], c);
    (*change)[c].At(box.x0 + p.x, box.y0 + p.y) += UsableOr0(filtered - fragments.Noisy(p, h, c));
  }
}

/// A row of a half's layer, of the mean where the half has no samples.
void TakeNoisy(const float* samples, const float* half, const float* mean, std::vector<float>* noisy) {
  float* __restrict out = noisy->data();
  for (size_t x = 0; x < noisy->size(); ++x) out[x] = samples[x] > 0 ? half[x] : mean[x];
}

/// rest -= light * factor but in mixed pixels; unusable values count as 0.
void SubtractProduct(const std::vector<float>& light, const float* factor, const float* mixed,
                     float* __restrict rest) {
  for (size_t x = 0; x < light.size(); ++x) {
    const float product = UsableOr0(light[x] * factor[x]);
    rest[x] -= mixed[x] > 0 ? 0.0f : product;
  }
}

/// 1 at the pixels of a W x H picture that have fragments, else 0.
Plane MixedPixels(const Product& product, const LayerFragments& fragments) {
  Plane is_mixed(product.mean[0].width(), product.mean[0].height());
  for (const LayerFragments::Pixel& p : fragments.pixels)
    is_mixed.At(product.box.x0 + p.x, product.box.y0 + p.y) = 1;
  return is_mixed;
}

/// Calls body(y, noisy, factor) for each row of channel c of a half: its noisy light, and what multiplies it.
void ForEachNoisyRow(const Product& product, size_t h, size_t c, TaskPool* pool,
                     absl::FunctionRef<void(int, const std::vector<float>&, const float*)> body) {
  const ConstColorView& half = h == 0 ? product.halves.a : product.halves.b;
  const ConstFloatView& count = h == 0 ? product.halves.samples_a : product.halves.samples_b;
  const ConstColorView& factors = product.factor_of[h];
  const auto width = static_cast<size_t>(product.mean[0].width());
  const std::vector<float> ones(width, 1.0f);
  ForEachBand(pool, product.mean[0].height(), [&](int, int y0, int y1) {
    std::vector<float> noisy(width);
    for (int y = y0; y < y1; ++y) {
      TakeNoisy(count.Row(y), half[c].Row(y), product.mean[c].Row(y), &noisy);
      body(y, noisy, factors[0].IsEmpty() ? ones.data() : factors[c].Row(y));
    }
  });
}

void AddHalf(const Product& product, const FilteredLayer& layer, size_t h, TaskPool* pool, Planes* change) {
  const Rect& box = product.box;
  const Planes& after = h == 0 ? layer.light.a : layer.light.b;
  const Plane is_mixed = MixedPixels(product, layer.fragments);
  for (size_t c = 0; c < 3; ++c) {
    ForEachNoisyRow(product, h, c, pool, [&](int y, const std::vector<float>& noisy, const float* factor) {
      if (y < box.y0 || y >= box.y1) return;
      const float* mixed = is_mixed.Row(y);
      const float* valid = product.validity.Row(y - box.y0);
      const float* filtered = after[c].Row(y - box.y0);
      float* __restrict out = (*change)[c].Row(y);
      for (int x = box.x0; x < box.x1; ++x) {
        const float by = UsableOr0((filtered[x - box.x0] - noisy[static_cast<size_t>(x)]) * factor[x]);
        out[x] += mixed[x] > 0 || !(valid[x - box.x0] > 0) ? 0.0f : by;
      }
    });
    AddMixedPixels(box, layer, h, c, change);
  }
}

/// Adds planes of the box to those of the whole picture.
void AddInBox(const Planes& planes, const Rect& box, Planes* sum) {
  for (size_t c = 0; c < planes.size(); ++c) {
    ForEachPixel(box.width(), box.height(),
                 [&](int x, int y) { (*sum)[c].At(box.x0 + x, box.y0 + y) += planes[c].At(x, y); });
  }
}

/// The mean factor of a mixed pixel's points, weighted by coverage; channel c.
float MeanFactor(const LayerFragments& fragments, const LayerFragments::Pixel& pixel, size_t c) {
  float factor = 0;
  float total = 0;
  for (size_t i = pixel.first; i < pixel.last; ++i) {
    const float coverage = fragments.coverage[0][i] + fragments.coverage[1][i];
    factor += coverage * fragments.factor[i][c];
    total += coverage;
  }
  return total > 0 ? factor / total : 0.0f;
}

}  // namespace

FilteredLayer SameForBothHalves(Planes planes) {
  Planes copy = Clone(planes);
  return {.light = {std::move(planes), std::move(copy)}};
}

FilteredLayer BlackLayer(const Product& product) {
  return SameForBothHalves(MakePlanes(3, product.box.width(), product.box.height()));
}

FrameChange NoChange(const Frame& frame) {
  return {MakePlanes(3, frame.width, frame.height), MakePlanes(3, frame.width, frame.height)};
}

void SubtractNoisy(const Product& product, const LayerFragments& fragments, TaskPool* pool, Remainder* rest) {
  const Plane is_mixed = MixedPixels(product, fragments);
  for (size_t h = 0; h < 2; ++h) {
    Planes& of_half = h == 0 ? rest->a : rest->b;
    for (size_t c = 0; c < 3; ++c) {
      ForEachNoisyRow(product, h, c, pool, [&](int y, const std::vector<float>& noisy, const float* factor) {
        SubtractProduct(noisy, factor, is_mixed.Row(y), of_half[c].Row(y));
      });
      for (const LayerFragments::Pixel& p : fragments.pixels) {
        of_half[c].At(product.box.x0 + p.x, product.box.y0 + p.y) -= UsableOr0(fragments.Noisy(p, h, c));
      }
    }
  }
}

void AddFiltered(const Product& product, const FilteredLayer& layer, TaskPool* pool, Remainder* rest,
                 FrameChange* change) {
  for (size_t h = 0; h < 2; ++h) {
    AddHalf(product, layer, h, pool, &(*change)[h]);
    AddInBox(layer.missing[h], product.box, &(*change)[h]);
    if (rest != nullptr) AddInBox(layer.missing[h], product.box, h == 0 ? &rest->a : &rest->b);
  }
}

void AddReturned(const Frame& frame, const Product& product, const FilteredLayer& layer, TaskPool* pool,
                 Planes* returned) {
  if (layer.returned.empty()) return;
  if (returned->empty()) *returned = MakePlanes(3, frame.width, frame.height);
  const Rect& box = product.box;
  const bool has_factor = !product.factor[0].IsEmpty();
  for (size_t c = 0; c < 3; ++c) {
    Plane factor(box.width(), box.height());
    ForEachPixel(pool, box.width(), box.height(), [&](int x, int y) {
      factor.At(x, y) = has_factor ? product.factor[c].At(box.x0 + x, box.y0 + y) : 1.0f;
    });
    for (const LayerFragments::Pixel& pixel : layer.fragments.pixels)
      factor.At(pixel.x, pixel.y) = MeanFactor(layer.fragments, pixel, c);
    ForEachPixel(pool, box.width(), box.height(), [&](int x, int y) {
      (*returned)[c].At(box.x0 + x, box.y0 + y) += UsableOr0(layer.returned[c].At(x, y) * factor.At(x, y));
    });
  }
}

Picture PictureOf(const Frame& frame, const FrameChange& change, TaskPool* pool) {
  const Planes mean = MeanOfHalves(frame, change[0], change[1], pool);
  Picture picture = ClonePicture(frame.combined.mean);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
      float& value = picture[c].At(x, y);
      const float noisy = UsableOr0(value);
      value = std::max(UsableOr0(noisy + mean[c].At(x, y)), std::min(0.0f, noisy));
    });
  }
  return picture;
}

Picture DeviationOf(const Frame& frame, const FrameChange& change, TaskPool* pool) {
  Picture deviation;
  for (size_t c = 0; c < 3; ++c) {
    deviation[c] = Plane::Uninitialized(frame.width, frame.height);
    ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
      const float a = frame.combined.a[c].At(x, y) + change[0][c].At(x, y);
      const float b = frame.combined.b[c].At(x, y) + change[1][c].At(x, y);
      const float factor = frame.samples.VarianceFactor(x, y);
      deviation[c].At(x, y) = factor > 0 ? UsableOr0(std::sqrt(factor) * (a - b)) : 0.0f;
    });
  }
  return deviation;
}

Picture DeviationOfReturned(const Frame& frame, const Planes& returned, TaskPool* pool) {
  Picture deviation;
  for (size_t c = 0; c < 3; ++c) {
    deviation[c] = Plane(frame.width, frame.height);
    if (returned.empty()) continue;
    ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
      deviation[c].At(x, y) = UsableOr0(std::sqrt(frame.samples.VarianceFactor(x, y)) * returned[c].At(x, y));
    });
  }
  return deviation;
}

}  // namespace lumifold::filter
