#include "filter/layers/choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "filter/kernels/box_mean.h"
#include "filter/layers/error_weight.h"

namespace lumifold::filter {
namespace {

constexpr size_t kKinds = 2;  // pixels that are not mixed, and those that are
/// Terms that are summed: numerator n and denominator d of t, n^2, n d, d^2, and d times the relative variance of a half.
constexpr size_t kTerms = 6;

int CellsIn(int pixels) { return (pixels + kChoiceCell - 1) / kChoiceCell; }

/// Sums over the pixels of each cell.
Planes CellSums(const Planes& planes, TaskPool* pool) {
  Planes cells;
  for (const Plane& plane : planes) cells.emplace_back(CellsIn(plane.width()), CellsIn(plane.height()));
  ParallelFor(pool, static_cast<int64_t>(planes.size()), [&](int64_t task) {
    const Plane& plane = planes[static_cast<size_t>(task)];
    Plane& sums = cells[static_cast<size_t>(task)];
    ForEachPixel(plane.width(), plane.height(),
                 [&](int x, int y) { sums.At(x / kChoiceCell, y / kChoiceCell) += plane.At(x, y); });
  });
  return cells;
}

/// Variance of t = sum(n) / sum(d) from the residuals n - t d, as for a regression through 0 with unequal variances. A
/// pixel of leverage h, its part of sum(d), draws t towards itself, which makes residuals too small by 1 - h, and
/// without it t may be smaller by h t: what a single pixel alone asks for, such as a firefly that both halves have
/// hit, is not significant. For all leverages stands their mean. `mean(k)`: of the terms over `cells` cells. With
/// `by_pixel` leverage counts as far as the halves may have agreed by chance: many samples tell by themselves what one pixel
/// shows. They do not tell of others, so that leverage counts in full over windows wider than what looks alike.
template <typename Mean>
float VarianceOf(float t, const Mean& mean, float cells, bool by_pixel) {
  constexpr float kMostLeverage = 0.99f;
  const float residuals = std::max(0.0f, mean(2) - t * (2 * mean(3) - t * mean(4)));
  const float squared = mean(1) * mean(1) * cells;
  const float chance = by_pixel ? std::min(1.0f, std::sqrt(mean(5) / mean(1))) : 1.0f;
  const float leverage = chance * std::min(mean(4) / squared, kMostLeverage);
  return residuals / (squared * (1.0f - leverage) * (1.0f - leverage)) + leverage * leverage * t * t;
}

/// Cells of a row or column of `size` in the window of this radius around cell i.
int CellsInWindow(int i, int radius, int size) {
  return std::min(i + radius, size - 1) - std::max(i - radius, 0) + 1;
}

}  // namespace

Choice::Choice(const Halves& halves, const Plane& light, const ChoiceParams& params, TaskPool* pool)
    : halves_(halves), params_(params), weight_(BothHalvesMask(halves)) {
  ForEachPixel(pool, halves.width(), halves.height(), [&](int x, int y) {
    float& weight = weight_.At(x, y);
    if (weight > 0) weight = ErrorWeight(light.At(x, y), params.dim);
  });
}

Planes Choice::Terms(const Candidate& f, const Candidate& g, TaskPool* pool) const {
  Planes terms = MakePlanes((HasMixed() ? kKinds : 1) * kTerms, halves_.width(), halves_.height());
  ForEachPixel(pool, halves_.width(), halves_.height(), [&](int x, int y) {
    const float weight = weight_.At(x, y);
    if (!(weight > 0)) return;
    float numerator = 0;
    float denominator = 0;
    float between_halves =
        halves_.expected_difference.width() > 0 ? halves_.expected_difference.At(x, y) : 0.0f;
    for (size_t c = 0; c < 3; ++c) {
      const float a = halves_.a[c].At(x, y);
      const float b = halves_.b[c].At(x, y);
      const float fa = f.a[c].At(x, y);
      const float fb = f.b[c].At(x, y);
      const float da = g.a[c].At(x, y) - fa;
      const float db = g.b[c].At(x, y) - fb;
      numerator += da * (b - fa) + db * (a - fb) + 0.5f * (da - db) * (fa - fb);
      denominator += 0.5f * (da + db) * (da + db);
      between_halves += (a - b) * (a - b);
    }
    const size_t first = IsMixed(x, y) ? kTerms : 0;
    const float n = weight * numerator;
    const float d = weight * denominator;
    // The halves may agree by chance; n samples that vary by as much as their mean have relative variance 1 / n.
    const float variance = weight * between_halves + 2 * d / halves_.samples.At(x, y);
    const std::array<float, kTerms> values = {n, d, n * n, n * d, d * d, variance};
    for (size_t k = 0; k < kTerms; ++k) terms[first + k].At(x, y) = values[k];
  });
  return terms;
}

void Choice::Refine(const Planes& terms, int cell, int radius, TaskPool* pool, Plane* t) const {
  const int width = terms[0].width();
  const int height = terms[0].height();
  const Planes means = BoxMeans(terms, MakePlane(width, height, 1.0f).view(), radius, pool);
  ForEachPixel(pool, t->width(), t->height(), [&](int x, int y) {
    const int cx = x / cell;
    const int cy = y / cell;
    const size_t first = IsMixed(x, y) ? kTerms : 0;
    const auto mean = [&](size_t k) { return means[first + k].At(cx, cy); };
    if (!(mean(1) > 0)) return;
    const auto cells =
        static_cast<float>(CellsInWindow(cx, radius, width) * CellsInWindow(cy, radius, height));
    const float of_window = mean(0) / mean(1);
    const float difference = of_window - t->At(x, y);
    const float least = params_.significance * VarianceOf(of_window, mean, cells, cell == 1);
    const float square = difference * difference;
    if (square > least) t->At(x, y) += (1.0f - least / square) * difference;
  });
}

Plane Choice::Smooth(const Planes& share, TaskPool* pool) const {
  if (!HasMixed()) return std::move(BoxMeans(share, halves_.weight.view(), params_.blend_radius, pool)[0]);
  std::array<Plane, kKinds> weights;
  for (Plane& weight : weights) weight = Plane(halves_.width(), halves_.height());
  ForEachPixel(pool, halves_.width(), halves_.height(),
               [&](int x, int y) { weights[IsMixed(x, y) ? 1 : 0].At(x, y) = halves_.weight.At(x, y); });
  Plane smooth = std::move(BoxMeans(share, weights[0].view(), params_.blend_radius, pool)[0]);
  const Planes of_mixed = BoxMeans(share, weights[1].view(), params_.blend_radius, pool);
  ForEachPixel(pool, halves_.width(), halves_.height(), [&](int x, int y) {
    if (IsMixed(x, y)) smooth.At(x, y) = of_mixed[0].At(x, y);
  });
  return smooth;
}

Plane Choice::ShareOf(const Candidate& f, const Candidate& g, TaskPool* pool) const {
  const Planes terms = Terms(f, g, pool);
  Planes share = MakePlanes(1, halves_.width(), halves_.height());
  Plane& t = share[0];
  const Planes cells = CellSums(terms, pool);
  for (const int radius : {params_.widest_radius, params_.wide_radius})
    Refine(cells, kChoiceCell, radius / kChoiceCell, pool, &t);
  Refine(terms, 1, params_.narrow_radius, pool, &t);
  ForEachPixel(pool, t.width(), t.height(),
               [&](int x, int y) { t.At(x, y) = std::clamp(t.At(x, y), 0.0f, 1.0f); });
  return Smooth(share, pool);
}

Plane LightOf(const Halves& halves, const Candidate& picture, TaskPool* pool) {
  if (halves.picture_light.width() > 0) return halves.picture_light.Clone();
  Plane light(halves.width(), halves.height());
  const float share = 1.0f / (6.0f * halves.level);
  ForEachPixel(pool, light.width(), light.height(), [&](int x, int y) {
    for (size_t c = 0; c < 3; ++c)
      light.At(x, y) += share * (std::abs(picture.a[c].At(x, y)) + std::abs(picture.b[c].At(x, y)));
  });
  return light;
}

void MoveTowards(const Planes& towards, const Plane& share, TaskPool* pool, Planes* half) {
  for (size_t c = 0; c < half->size(); ++c) {
    ForEachPixel(pool, share.width(), share.height(), [&](int x, int y) {
      float& value = (*half)[c].At(x, y);
      value += share.At(x, y) * (towards[c].At(x, y) - value);
    });
  }
}

int ChoiceWindow(const ChoiceParams& params) {
  return params.widest_radius + kChoiceCell + params.blend_radius;
}

}  // namespace lumifold::filter
