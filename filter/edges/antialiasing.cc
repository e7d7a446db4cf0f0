#include "filter/edges/antialiasing.h"

#include <algorithm>
#include <cmath>

#include "filter/edges/edge_pixels.h"
#include "filter/edges/edge_views.h"
#include "filter/edges/trust.h"
#include "filter/image/color.h"
#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/layers/features.h"

namespace lumifold::filter {
namespace {

constexpr size_t kSamples = kSubSamples;
constexpr float kLargestFit = 2;

void AddPixel(const EdgeViews& views, int row, float sigma_normal, EdgePoints* out) {
  out->rows.push_back(row);
  out->points.pixels.push_back({static_cast<int>(views.x.At(0, row)), static_cast<int>(views.y.At(0, row))});
  std::array<std::array<float, kGeometryFeatures>, kSamples> features = {};
  for (size_t j = 0; j < kSamples; ++j) {
    const int sample = static_cast<int>(j);
    const bool lit = views.IsLit(sample, row);
    out->is_lit.push_back(lit ? 1 : 0);
    if (!lit) continue;
    features[j] = GeometryFeature(
        {views.normal[0].At(sample, row), views.normal[1].At(sample, row), views.normal[2].At(sample, row)},
        views.distance.At(sample, row), sigma_normal);
  }
  for (size_t k = 0; k < kGeometryFeatures; ++k) {
    for (size_t j = 0; j < kSamples; ++j) out->points.features.push_back(features[j][k]);
  }
}

/// What the sub-samples of a pixel add up to.
struct PixelMean {
  std::array<float, 3> light = {0, 0, 0};
  float direct = 0;  // brightness of what D and I give of it
  float indirect = 0;
  int found = 0;
};

PixelMean MeanOf(const EdgeViews& views, const EdgePoints& points, size_t pixel, const FilteredPoints& direct,
                 const FilteredPoints& indirect) {
  PixelMean mean;
  const int row = points.rows[pixel];
  for (size_t j = 0; j < kSamples; ++j) {
    const int sample = static_cast<int>(j);
    const size_t point = pixel * kSamples + j;
    const bool lit = points.is_lit[point] != 0;
    if (lit && (direct.weights[point] <= 0 || indirect.weights[point] <= 0)) continue;
    ++mean.found;
    std::array<float, 3> d = {0, 0, 0};
    std::array<float, 3> i = {0, 0, 0};
    for (size_t c = 0; c < 3; ++c) {
      if (lit) {
        const float albedo = views.albedo[c].At(sample, row);
        d[c] = direct.values[(pixel * 3 + c) * kSamples + j] * albedo;
        i[c] = indirect.values[(pixel * 3 + c) * kSamples + j] * albedo;
      }
      mean.light[c] += d[c] + i[c] + views.emission[c].At(sample, row);
    }
    mean.direct += std::abs(Luminance(d[0], d[1], d[2]));
    mean.indirect += std::abs(Luminance(i[0], i[1], i[2]));
  }
  if (mean.found == 0) return mean;
  for (float& light : mean.light) light /= static_cast<float>(mean.found);
  return mean;
}

/// How much of the pixel's light was left as it was.
float RawShare(const PixelMean& mean, float direct_raw, float indirect_raw) {
  const float brightness = mean.direct + mean.indirect;
  return brightness > 0 ? (direct_raw * mean.direct + indirect_raw * mean.indirect) / brightness : 0.0f;
}

}  // namespace

EdgePoints EdgePointsOf(const LayeredImage& film, const LayeredImage& edges, float max_glossy_albedo,
                        float most_samples, float sigma_normal) {
  EdgePoints out;
  out.points.samples = kSamples;
  out.points.own_features = kGeometryFeatures;
  if (edges.channels().empty()) return out;
  const EdgeViews views(edges);
  const UnknownPixels unknown(film, max_glossy_albedo);
  const ConstFloatView n_a = film.Get(layers::kSamplesA);
  const ConstFloatView n_b = film.Get(layers::kSamplesB);
  ForEachEdgePixel(&edges, film.bounds(), [&](int row, int x, int y) {
    if (n_a.At(x, y) + n_b.At(x, y) > most_samples || unknown.Contain(x, y)) return;
    if (views.IsPlain(row)) AddPixel(views, row, sigma_normal, &out);
  });
  return out;
}

void FitToPixels(const SlicePoints& points, const Planes& planes, FilteredPoints* at_points) {
  const size_t samples = points.samples;
  for (size_t pixel = 0; pixel < points.pixels.size(); ++pixel) {
    const auto [x, y] = points.pixels[pixel];
    float own = 0;
    float sum = 0;
    float count = 0;
    for (size_t c = 0; c < 3; ++c) {
      own += planes[c].At(x, y);
      for (size_t j = 0; j < samples; ++j) {
        if (at_points->weights[pixel * samples + j] <= 0) continue;
        sum += at_points->values[(pixel * 3 + c) * samples + j];
        count += 1;
      }
    }
    if (!(sum > 0 && own > 0)) continue;
    const float ratio = std::clamp(own * count / (3 * sum), 1 / kLargestFit, kLargestFit);
    for (size_t i = pixel * 3 * samples; i < (pixel + 1) * 3 * samples; ++i) at_points->values[i] *= ratio;
  }
}

void AntialiasEdges(const LayeredImage& film, const LayeredImage& edges, const EdgePoints& points,
                    const FilteredPoints& direct, const FilteredPoints& indirect, const Planes& rest,
                    TaskPool* pool, std::array<Plane, 3>* picture) {
  if (points.rows.empty()) return;
  const EdgeViews views(edges);
  Planes values = MakePlanes(3, film.width(), film.height());
  Plane filtered(film.width(), film.height());  // the share of the pixel's light that was filtered
  for (size_t pixel = 0; pixel < points.rows.size(); ++pixel) {
    const PixelMean mean = MeanOf(views, points, pixel, direct, indirect);
    if (mean.found <= kSubSamples / 2) continue;
    const auto [x, y] = points.points.pixels[pixel];
    filtered.At(x, y) = 1.0f - RawShare(mean, direct.raw[pixel], indirect.raw[pixel]);
    for (size_t c = 0; c < 3; ++c) values[c].At(x, y) = mean.light[c] + rest[c].At(x, y);
  }
  const Plane trust = TrustIn(values, filtered, film, {}, pool);
  for (const auto& [x, y] : points.points.pixels) {
    const float share = filtered.At(x, y) * trust.At(x, y);
    for (size_t c = 0; c < 3; ++c) {
      float& out = (*picture)[c].At(x, y);
      if (share > 0 && std::isfinite(values[c].At(x, y))) out += share * (values[c].At(x, y) - out);
    }
  }
}

}  // namespace lumifold::filter
