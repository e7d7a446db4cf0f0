#include "filter/layers/choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "filter/kernels/box_mean.h"
#include "filter/layers/error_weight.h"

namespace lumifold::filter {
namespace {

constexpr float kMixedKind = 1;
constexpr float kPointKind = 2;
/// Terms that are summed: numerator n and denominator d of t, n^2, n d, d^2, and d times the relative
/// variance of a half.
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

/// Variance of t = sum(n) / sum(d) from the residuals n - t d, as for a regression through 0 with unequal
/// variances. A pixel of leverage h, its part of sum(d), draws t towards itself, which makes residuals too
/// small by 1 - h, and without it t may be smaller by h t: what a single pixel alone asks for, such as a
/// firefly that both halves have hit, is not significant. For all leverages stands their mean. `mean(k)`: of
/// the terms over `cells` cells. With `by_pixel` leverage counts as far as the halves may have agreed by
/// chance: many samples tell by themselves what one pixel shows. They do not tell of others, so that leverage
/// counts in full over windows wider than what looks alike.
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

/// n, d, and d times the relative variance of a half, of one pixel or point.
struct Choice::Terms {
  float numerator = 0;
  float denominator = 0;
  float variance = 0;

  /// Of one channel of F, G - F and N, by half.
  void AddChannel(float fa, float fb, float da, float db, float a, float b) {
    numerator += da * (b - fa) + db * (a - fb) + 0.5f * (da - db) * (fa - fb);
    denominator += 0.5f * (da + db) * (da + db);
    variance += (a - b) * (a - b);
  }

  /// Weighs all of them. The halves may agree by chance; n samples that vary by as much as their mean have
  /// relative variance 1 / n.
  void Weigh(float weight, float samples) {
    numerator *= weight;
    denominator *= weight;
    variance = weight * variance + 2 * denominator / samples;
  }

  void Add(const Terms& other) {
    numerator += other.numerator;
    denominator += other.denominator;
    variance += other.variance;
  }
};

Choice::Choice(const Halves& halves, const Plane& light, const ChoiceParams& params,
               const ChoicePoints* points, TaskPool* pool)
    : halves_(halves),
      params_(params),
      points_(points),
      weight_(BothHalvesMask(halves)),
      kind_(halves.width(), halves.height()) {
  ForEachPixel(pool, halves.width(), halves.height(), [&](int x, int y) {
    float& weight = weight_.At(x, y);
    if (weight > 0) weight = ErrorWeight(light.At(x, y), params.dim);
    if (halves.is_mixed.width() > 0 && halves.is_mixed.At(x, y) > 0) kind_.At(x, y) = kMixedKind;
  });
  if (halves.is_mixed.width() > 0) kinds_ = static_cast<size_t>(kMixedKind) + 1;
  if (points_ == nullptr || points_->places.empty()) return;
  kinds_ = static_cast<size_t>(kPointKind) + 1;
  for (const auto& [x, y] : points_->places) {
    kind_.At(x, y) = kPointKind;
    weight_.At(x, y) = ErrorWeight(light.At(x, y), params.dim);
  }
}

Choice::Terms Choice::TermsOfPixel(const Candidate& f, const Candidate& g, int x, int y) const {
  Terms terms;
  terms.variance = halves_.expected_difference.width() > 0 ? halves_.expected_difference.At(x, y) : 0.0f;
  for (size_t c = 0; c < 3; ++c) {
    const float fa = f.a[c].At(x, y);
    const float fb = f.b[c].At(x, y);
    terms.AddChannel(fa, fb, g.a[c].At(x, y) - fa, g.b[c].At(x, y) - fb, halves_.a[c].At(x, y),
                     halves_.b[c].At(x, y));
  }
  terms.Weigh(weight_.At(x, y), halves_.samples.At(x, y));
  return terms;
}

Choice::Terms Choice::TermsOfPoint(const Candidate& f, const Candidate& g, size_t point) const {
  Terms terms;
  for (size_t k = 3 * point; k < 3 * point + 3; ++k) {
    const float fa = f.points[0][k];
    const float fb = f.points[1][k];
    terms.AddChannel(fa, fb, g.points[0][k] - fa, g.points[1][k] - fb, points_->noisy[0][k],
                     points_->noisy[1][k]);
  }
  const auto& [x, y] = points_->places[point];
  terms.Weigh(weight_.At(x, y) * points_->weights[point], points_->samples[point]);
  return terms;
}

Planes Choice::AllTerms(const Candidate& f, const Candidate& g, TaskPool* pool) const {
  Planes planes = MakePlanes(kinds_ * kTerms, halves_.width(), halves_.height());
  const auto set = [&](int x, int y, const Terms& terms) {
    const float n = terms.numerator;
    const float d = terms.denominator;
    const std::array<float, kTerms> values = {n, d, n * n, n * d, d * d, terms.variance};
    for (size_t k = 0; k < kTerms; ++k) planes[KindOf(x, y) * kTerms + k].At(x, y) = values[k];
  };
  ForEachPixel(pool, halves_.width(), halves_.height(), [&](int x, int y) {
    if (kind_.At(x, y) != kPointKind && weight_.At(x, y) > 0) set(x, y, TermsOfPixel(f, g, x, y));
  });
  const size_t points = points_ != nullptr ? points_->places.size() : 0;
  for (size_t i = 0; i < points;) {  // the points of a pixel follow each other
    const std::array<int, 2> place = points_->places[i];
    Terms terms;
    for (; i < points && points_->places[i] == place; ++i) {
      if (points_->weights[i] > 0) terms.Add(TermsOfPoint(f, g, i));
    }
    set(place[0], place[1], terms);
  }
  return planes;
}

void Choice::Refine(const Planes& terms, int cell, int radius, TaskPool* pool, Plane* t) const {
  const int width = terms[0].width();
  const int height = terms[0].height();
  const Planes means = BoxMeans(terms, MakePlane(width, height, 1.0f).view(), radius, pool);
  ForEachPixel(pool, t->width(), t->height(), [&](int x, int y) {
    const int cx = x / cell;
    const int cy = y / cell;
    const size_t first = KindOf(x, y) * kTerms;
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
  Plane smooth(halves_.width(), halves_.height());
  for (size_t kind = 0; kind < kinds_; ++kind) {
    Plane weights(halves_.width(), halves_.height());
    ForEachPixel(pool, halves_.width(), halves_.height(), [&](int x, int y) {
      if (KindOf(x, y) == kind) weights.At(x, y) = halves_.weight.At(x, y);
    });
    const Planes means = BoxMeans(share, weights.view(), params_.blend_radius, pool);
    ForEachPixel(pool, halves_.width(), halves_.height(), [&](int x, int y) {
      if (KindOf(x, y) == kind) smooth.At(x, y) = means[0].At(x, y);
    });
  }
  return smooth;
}

Plane Choice::ShareOf(const Candidate& f, const Candidate& g, TaskPool* pool) const {
  const Planes terms = AllTerms(f, g, pool);
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
