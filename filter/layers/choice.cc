#include "filter/layers/choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "filter/kernels/box_mean.h"
#include "filter/kernels/window_sums.h"
#include "filter/layers/error_weight.h"

namespace lumifold::filter {
namespace {

/// Terms that are summed: numerator n and denominator d of t, n^2, n d, d^2, and d times the relative
/// variance of a half.
constexpr size_t kTerms = 6;

int CellsIn(int pixels) { return (pixels + kChoiceCell - 1) / kChoiceCell; }

/// Means over a window, in the order of the terms.
using MeanTerms = std::array<float, kTerms>;

/// Variance of t = sum(n) / sum(d) from the residuals n - t d, as for a regression through 0 with unequal
/// variances. A pixel of leverage h, its part of sum(d), draws t towards itself, which makes residuals too
/// small by 1 - h, and without it t may be smaller by h t: what a single pixel alone asks for, such as a
/// firefly that both halves have hit, is not significant. For all leverages stands their mean. `mean`: over
/// `cells` cells. With `by_pixel` leverage counts as far as the halves may have agreed by chance: many
/// samples tell by themselves what one pixel shows. They do not tell of others, so that leverage counts in
/// full over windows wider than what looks alike.
template <bool by_pixel>
float VarianceOf(float t, const MeanTerms& mean, float cells) {
  const float residuals = std::max(0.0f, mean[2] - t * (2 * mean[3] - t * mean[4]));
  const float squared = mean[1] * mean[1] * cells;
  const float chance = by_pixel ? std::min(1.0f, std::sqrt(mean[5] / mean[1])) : 1.0f;
  const float leverage = chance * std::min(mean[4] / squared, kMostLeverage);
  return residuals / (squared * (1.0f - leverage) * (1.0f - leverage)) + leverage * leverage * t * t;
}

/// t, moved towards that of the window as far as the difference is significant. Without branches, so that
/// loops over it become vectors.
template <bool by_pixel>
float Refined(float t, const MeanTerms& mean, float cells, float significance) {
  const float of_window = mean[0] / mean[1];
  const float difference = of_window - t;
  const float least = significance * VarianceOf<by_pixel>(of_window, mean, cells);
  const float square = difference * difference;
  const float moved = t + (1.0f - least / square) * difference;
  return mean[1] > 0 && square > least ? moved : t;
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

Planes Choice::TermsOf(const Candidate& f, const Candidate& g, TaskPool* pool) const {
  Planes planes = MakeUninitializedPlanes(3, halves_.width(), halves_.height());
  const Plane& expected = halves_.expected_difference;
  const std::vector<float> none(static_cast<size_t>(halves_.width()));
  ForEachBand(pool, halves_.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      const auto rows = [&](const Planes& of) {
        return std::array{of[0].Row(y), of[1].Row(y), of[2].Row(y)};
      };
      const auto fa = rows(f.a), fb = rows(f.b), ga = rows(g.a), gb = rows(g.b);
      const auto a = rows(halves_.a), b = rows(halves_.b);
      const float* weight = weight_.Row(y);
      const float* kind = kind_.Row(y);
      const float* samples = halves_.samples.Row(y);
      const float* variance = expected.width() > 0 ? expected.Row(y) : none.data();
      float* __restrict out[] = {planes[0].Row(y), planes[1].Row(y), planes[2].Row(y)};
      for (int x = 0; x < halves_.width(); ++x) {
        Terms terms;
        terms.variance = variance[x];
        for (size_t c = 0; c < 3; ++c)
          terms.AddChannel(fa[c][x], fb[c][x], ga[c][x] - fa[c][x], gb[c][x] - fb[c][x], a[c][x], b[c][x]);
        terms.Weigh(weight[x], samples[x]);
        const bool counts = kind[x] != kPointKind && weight[x] > 0;
        out[0][x] = counts ? terms.numerator : 0.0f;
        out[1][x] = counts ? terms.denominator : 0.0f;
        out[2][x] = counts ? terms.variance : 0.0f;
      }
    }
  });
  const size_t points = points_ != nullptr ? points_->places.size() : 0;
  for (size_t i = 0; i < points;) {  // the points of a pixel follow each other
    const std::array<int, 2> place = points_->places[i];
    Terms terms;
    for (; i < points && points_->places[i] == place; ++i) {
      if (points_->weights[i] > 0) terms.Add(TermsOfPoint(f, g, i));
    }
    planes[0].At(place[0], place[1]) = terms.numerator;
    planes[1].At(place[0], place[1]) = terms.denominator;
    planes[2].At(place[0], place[1]) = terms.variance;
  }
  return planes;
}

Planes Choice::CellSums(const Planes& terms, TaskPool* pool) const {
  Planes cells = MakePlanes(kinds_ * kTerms, CellsIn(halves_.width()), CellsIn(halves_.height()));
  ParallelFor(pool, cells[0].height(), [&](int64_t row) {
    const int cy = static_cast<int>(row);
    for (int cx = 0; cx < cells[0].width(); ++cx) {
      const Rect cell = {cx * kChoiceCell, cy * kChoiceCell, (cx + 1) * kChoiceCell, (cy + 1) * kChoiceCell};
      std::array<MeanTerms, kMostKinds> sums = {};
      const Rect pixels = Intersect(cell, {0, 0, halves_.width(), halves_.height()});
      for (int y = pixels.y0; y < pixels.y1; ++y) {
        for (int x = pixels.x0; x < pixels.x1; ++x) {
          const float n = terms[0].At(x, y);
          const float d = terms[1].At(x, y);
          const MeanTerms values = {n, d, n * n, n * d, d * d, terms[2].At(x, y)};
          for (size_t k = 0; k < kTerms; ++k) sums[KindOf(x, y)][k] += values[k];
        }
      }
      for (size_t i = 0; i < cells.size(); ++i) cells[i].At(cx, cy) = sums[i / kTerms][i % kTerms];
    }
  });
  return cells;
}

Plane Choice::ShareByCells(const Planes& cells, TaskPool* pool) const {
  const int width = cells[0].width();
  const int height = cells[0].height();
  const Plane ones = MakePlane(width, height, 1.0f);
  Planes of_kind = MakePlanes(kinds_, width, height);
  for (const int pixels : {params_.widest_radius, params_.wide_radius}) {
    const int radius = pixels / kChoiceCell;
    const Planes means = BoxMeans(cells, ones.view(), radius, pool);
    for (size_t kind = 0; kind < kinds_; ++kind) {
      ForEachPixel(pool, width, height, [&](int cx, int cy) {
        MeanTerms mean;
        for (size_t k = 0; k < kTerms; ++k) mean[k] = means[kind * kTerms + k].At(cx, cy);
        const int count = CellsInWindow(cx, radius, width) * CellsInWindow(cy, radius, height);
        float& t = of_kind[kind].At(cx, cy);
        t = Refined<false>(t, mean, static_cast<float>(count), params_.significance);
      });
    }
  }
  Plane share = Plane::Uninitialized(halves_.width(), halves_.height());
  ForEachPixel(pool, share.width(), share.height(), [&](int x, int y) {
    share.At(x, y) = of_kind[KindOf(x, y)].At(x / kChoiceCell, y / kChoiceCell);
  });
  return share;
}

template <size_t terms, typename Load, typename Use>
void Choice::ForEachWindow(int radius, const Plane& marked, TaskPool* pool, const Load& load,
                           const Use& use) const {
  const Rect picture = {0, 0, marked.width(), marked.height()};
  ForEachBand(pool, picture.y1, [&](int, int y0, int y1) {
    WindowSums<terms> window(radius);
    for (Rect block = {0, y0, 0, y1}; block.x0 < picture.x1; block.x0 = block.x1) {
      block.x1 = std::min(block.x0 + window.kColumns, picture.x1);
      for (size_t kind = 0; kind < kinds_; ++kind) {
        const float of_kind = static_cast<float>(kind);
        if (!IsMarked(marked, Inflate(block, radius, picture), of_kind)) continue;
        window.Take(block, picture, [&](int y, int x0, int x1, const auto& rows) {
          load(y, x0, x1, rows);
          const float* kinds = kind_.Row(y) + x0;
          for (float* __restrict row : rows) {
            for (int i = 0; i < x1 - x0; ++i) row[i] = kinds[i] == of_kind ? row[i] : 0.0f;
          }
        });
        for (int y = y0; y < y1; ++y) use(y, block.x0, block.x1, of_kind, window.Row(y));
      }
    }
  });
}

bool Choice::IsMarked(const Plane& marked, const Rect& block, float kind) const {
  bool is_any = false;
  for (int y = block.y0; y < block.y1 && !is_any; ++y) {
    const float* marks = marked.Row(y);
    const float* kinds = kind_.Row(y);
    for (int x = block.x0; x < block.x1; ++x) is_any |= kinds[x] == kind && marks[x] > 0;
  }
  return is_any;
}

void Choice::RefineByPixels(const Planes& terms, TaskPool* pool, Plane* t) const {
  const int radius = params_.narrow_radius;
  const auto load = [&](int y, int x0, int x1, const auto& rows) {
    const float* n = terms[0].Row(y) + x0;
    const float* d = terms[1].Row(y) + x0;
    std::copy_n(terms[2].Row(y) + x0, x1 - x0, rows[5]);
    float* __restrict out[] = {rows[0], rows[1], rows[2], rows[3], rows[4]};
    for (int i = 0; i < x1 - x0; ++i) {
      out[0][i] = n[i];
      out[1][i] = d[i];
      out[2][i] = n[i] * n[i];
      out[3][i] = n[i] * d[i];
      out[4][i] = d[i] * d[i];
    }
  };
  ForEachWindow<kTerms>(
      radius, terms[1], pool, load, [&](int y, int x0, int x1, float kind, const auto& sums) {
        const int in_column = CellsInWindow(y, radius, t->height());
        const float* kinds = kind_.Row(y) + x0;
        float* __restrict share = t->Row(y) + x0;
        for (int i = 0; i < x1 - x0; ++i) {
          const float cells = static_cast<float>(in_column * CellsInWindow(x0 + i, radius, t->width()));
          MeanTerms mean;
          for (size_t k = 0; k < kTerms; ++k) mean[k] = sums[k][i] / cells;
          const float refined = Refined<true>(share[i], mean, cells, params_.significance);
          share[i] = kinds[i] == kind ? refined : share[i];
        }
      });
}

Plane Choice::Smooth(const Plane& share, TaskPool* pool) const {
  Plane smooth(share.width(), share.height());
  const auto load = [&](int y, int x0, int x1, const auto& rows) {
    const float* weight = halves_.weight.Row(y) + x0;
    const float* t = share.Row(y) + x0;
    float* __restrict out[] = {rows[0], rows[1]};
    for (int i = 0; i < x1 - x0; ++i) {
      out[0][i] = weight[i] * std::clamp(t[i], 0.0f, 1.0f);
      out[1][i] = weight[i];
    }
  };
  ForEachWindow<2>(params_.blend_radius, share, pool, load,
                   [&](int y, int x0, int x1, float kind, const auto& sums) {
                     const float* kinds = kind_.Row(y) + x0;
                     float* __restrict out = smooth.Row(y) + x0;
                     for (int i = 0; i < x1 - x0; ++i) {
                       const float mean = sums[1][i] > 0 ? sums[0][i] / sums[1][i] : 0.0f;
                       out[i] = kinds[i] == kind ? mean : out[i];
                     }
                   });
  return smooth;
}

Plane Choice::ShareOf(const Candidate& f, const Candidate& g, TaskPool* pool) const {
  const Planes terms = TermsOf(f, g, pool);
  Plane t = ShareByCells(CellSums(terms, pool), pool);
  RefineByPixels(terms, pool, &t);
  return Smooth(t, pool);
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
