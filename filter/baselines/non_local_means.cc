#include "filter/baselines/non_local_means.h"

#include <algorithm>
#include <vector>

#include "filter/baselines/noisy_halves.h"
#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

constexpr int kStripRows = 16;
constexpr float kLeastVariance = 1e-7f;
constexpr float kMostTerm = 1e4f;

/// The plane with its edge pixels repeated `apron` pixels outwards.
Plane Pad(const Plane& plane, int apron) {
  Plane padded(plane.width() + 2 * apron, plane.height() + 2 * apron);
  for (int y = 0; y < padded.height(); ++y) {
    const float* row = plane.Row(std::clamp(y - apron, 0, plane.height() - 1));
    for (int x = 0; x < padded.width(); ++x)
      padded.At(x, y) = row[std::clamp(x - apron, 0, plane.width() - 1)];
  }
  return padded;
}

Planes Pad(const Planes& planes, int apron) {
  Planes padded;
  for (const Plane& plane : planes) padded.push_back(Pad(plane, apron));
  return padded;
}

/// Rows [y0, y1) of the result, which one task computes for all offsets of the search window: squared
/// differences of pixels, their sums over patches (along rows, then down columns), and weights.
class Strip {
 public:
  Strip(const Planes& guide, const Planes& variance, const Planes& signals, const NonLocalMeansParams& params,
        int y0, int y1)
      : guide_(guide),
        variance_(variance),
        signals_(signals),
        params_(params),
        y0_(y0),
        y1_(y1),
        width_(signals[0].width()),
        terms_(width_ + 2 * params.patch_radius, y1 - y0 + 2 * params.patch_radius),
        row_sums_(width_, y1 - y0 + 2 * params.patch_radius),
        sums_(MakePlanes(signals.size() + 1, width_, y1 - y0)) {}

  void AddOffset(int dx, int dy) {
    CompareTo(dx, dy);
    SumRows();
    const int height = signals_[0].height();
    for (int y = std::max(y0_, -dy); y < std::min(y1_, height - dy); ++y) AddRow(y, dx, dy);
  }

  void Write(Planes* out) const {
    for (size_t c = 0; c < signals_.size(); ++c) {
      for (int y = y0_; y < y1_; ++y) {
        for (int x = 0; x < width_; ++x)  // the weight of the pixel itself is above 0
          (*out)[c].At(x, y) = sums_[c].At(x, y - y0_) / sums_.back().At(x, y - y0_);
      }
    }
  }

 private:
  void CompareTo(int dx, int dy) {
    terms_.Fill(0.0f);
    const float k2 = params_.strength * params_.strength;
    for (int y = 0; y < terms_.height(); ++y) {
      const int from = y0_ + y + params_.search_radius;
      for (size_t c = 0; c < guide_.size(); ++c) {
        const float* __restrict u = guide_[c].Row(from) + params_.search_radius;
        const float* __restrict other = guide_[c].Row(from + dy) + params_.search_radius + dx;
        const float* __restrict v = variance_[c].Row(from) + params_.search_radius;
        const float* __restrict other_v = variance_[c].Row(from + dy) + params_.search_radius + dx;
        float* __restrict term = terms_.Row(y);
        for (int x = 0; x < terms_.width(); ++x) {
          const float difference = u[x] - other[x];
          const float noise = v[x] + std::min(v[x], other_v[x]);
          const float excess =
              (difference * difference - noise) / (kLeastVariance + k2 * (v[x] + other_v[x]));
          term[x] += std::min(excess, kMostTerm);
        }
      }
    }
  }

  void SumRows() {
    for (int y = 0; y < row_sums_.height(); ++y) {
      const float* __restrict term = terms_.Row(y);
      float* __restrict sum = row_sums_.Row(y);
      for (int x = 0; x < width_; ++x) sum[x] = 0.0f;
      for (int i = 0; i <= 2 * params_.patch_radius; ++i) {
        for (int x = 0; x < width_; ++x) sum[x] += term[x + i];
      }
    }
  }

  void AddRow(int y, int dx, int dy) {
    const int side = 2 * params_.patch_radius + 1;
    const float norm = 1.0f / static_cast<float>(static_cast<int>(guide_.size()) * side * side);
    std::vector<float> weights(static_cast<size_t>(width_));
    float* __restrict w = weights.data();
    for (int i = 0; i < side; ++i) {
      const float* __restrict sum = row_sums_.Row(y - y0_ + i);
      for (int x = 0; x < width_; ++x) w[x] += sum[x];
    }
    for (int x = 0; x < width_; ++x) w[x] = Exp(-std::max(0.0f, w[x] * norm));
    const int x0 = std::max(0, -dx);
    const int x1 = std::min(width_, width_ - dx);
    for (size_t c = 0; c < signals_.size(); ++c) {
      const float* __restrict f = signals_[c].Row(y + dy) + dx;
      float* __restrict sum = sums_[c].Row(y - y0_);
      for (int x = x0; x < x1; ++x) sum[x] += w[x] * f[x];
    }
    float* __restrict total = sums_.back().Row(y - y0_);
    for (int x = x0; x < x1; ++x) total[x] += w[x];
  }

  const Planes& guide_;     // padded by both radii
  const Planes& variance_;  // padded by both radii
  const Planes& signals_;
  const NonLocalMeansParams& params_;
  int y0_;
  int y1_;
  int width_;
  Plane terms_;
  Plane row_sums_;
  Planes sums_;
};

Picture FilterColor(const FilmView& film, absl::Span<const float> values, TaskPool* pool) {
  const Halves halves = NoisyHalves(film.pixels, pool);
  NonLocalMeansParams params;
  params.strength = values[0];
  params.patch_radius = static_cast<int>(values[1]);
  params.search_radius = static_cast<int>(values[2]);
  const Planes variance = HalfVariance(halves, pool);
  const Planes a = NonLocalMeans(halves.a, halves.b, variance, params, pool);
  const Planes b = NonLocalMeans(halves.b, halves.a, variance, params, pool);
  return FinitePicture(Combine(a, b, halves.share_a.view(), pool), halves.scale);
}

}  // namespace

Planes NonLocalMeans(const Planes& signals, const Planes& guide, const Planes& variance,
                     const NonLocalMeansParams& params, TaskPool* pool) {
  const int apron = params.search_radius + params.patch_radius;
  const Planes padded_guide = Pad(guide, apron);
  const Planes padded_variance = Pad(variance, apron);
  const int height = signals[0].height();
  Planes out = MakePlanes(signals.size(), signals[0].width(), height);
  ParallelFor(pool, (height + kStripRows - 1) / kStripRows, [&](int64_t strip) {
    const int y0 = static_cast<int>(strip) * kStripRows;
    Strip rows(padded_guide, padded_variance, signals, params, y0, std::min(y0 + kStripRows, height));
    for (int dy = -params.search_radius; dy <= params.search_radius; ++dy) {
      for (int dx = -params.search_radius; dx <= params.search_radius; ++dx) rows.AddOffset(dx, dy);
    }
    rows.Write(&out);
  });
  return out;
}

Baseline NonLocalMeansBaseline() {
  return {.info = {.name = "nlm",
                   .summary = "non-local means on the finished colours, by the halves' variance",
                   .source = "Buades et al. 2005; Rousselle et al. 2012",
                   .parameters = {{"k",
                                   "strength: standard deviations that similar patches may differ by",
                                   0.5f,
                                   {0.25f, 0.5f, 1, 2},
                                   0.01f,
                                   100},
                                  {"patch", "radius of patches in pixels", 3, {1, 3}, 0, 8},
                                  {"search", "radius of the search in pixels", 9, {9}, 0, 32}}},
          .filter = FilterColor};
}

}  // namespace lumifold::filter
