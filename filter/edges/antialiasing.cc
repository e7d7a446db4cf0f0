#include "filter/edges/antialiasing.h"

#include <algorithm>
#include <cmath>

#include "filter/edges/non_diffuse_pixels.h"
#include "filter/edges/trust.h"
#include "filter/image/color.h"
#include "filter/image/edged_image.h"
#include "filter/layers/features.h"

namespace lumifold::filter {
namespace {

constexpr size_t kSamples = kSubSamples;
constexpr float kMaxScale = 2;  // of the points of one pixel

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

/// Mean over the sub-samples of a pixel.
struct PixelMean {
  std::array<float, 3> light = {0, 0, 0};
  float direct = 0;    // luminance of D T, summed over the sub-samples
  float indirect = 0;  // of I T
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

/// Share of the pixel's light that the choice left noisy.
float RawShare(const PixelMean& mean, float direct_raw, float indirect_raw) {
  const float luminance = mean.direct + mean.indirect;
  return luminance > 0 ? (direct_raw * mean.direct + indirect_raw * mean.indirect) / luminance : 0.0f;
}

}  // namespace

EdgePoints EdgePointsOf(const Frame& frame, float max_glossy_albedo, float max_samples, float sigma_normal) {
  EdgePoints out;
  out.points.samples = kSamples;
  out.points.own_features = kGeometryFeatures;
  if (!frame.edges.has_value()) return out;
  const NonDiffusePixels non_diffuse(frame, max_glossy_albedo);
  frame.edges->ForEachPixel(frame.bounds(), [&](int row, int x, int y) {
    if (frame.samples.At(x, y) > max_samples || non_diffuse.Contain(x, y)) return;
    if (frame.edges->IsPlain(row)) AddPixel(*frame.edges, row, sigma_normal, &out);
  });
  return out;
}

SlicePoints RelativeTo(const Rect& box, const SlicePoints& points) {
  SlicePoints moved = points;
  for (auto& [x, y] : moved.pixels) {
    x -= box.x0;
    y -= box.y0;
  }
  return moved;
}

FilteredPoints BlackPoints(const SlicePoints& points, float raw) {
  const size_t count = points.pixels.size() * points.samples;
  return {std::vector<float>(3 * count, 0.0f), std::vector<float>(count, 1.0f),
          std::vector<float>(points.pixels.size(), raw)};
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
    const float ratio = std::clamp(own * count / (3 * sum), 1 / kMaxScale, kMaxScale);
    for (size_t i = pixel * 3 * samples; i < (pixel + 1) * 3 * samples; ++i) at_points->values[i] *= ratio;
  }
}

void AntialiasEdges(const Frame& frame, const EdgePoints& points, const FilteredPoints& direct,
                    const FilteredPoints& indirect, const Planes& glossy, TaskPool* pool, Picture* picture) {
  if (points.rows.empty()) return;
  Planes values = MakePlanes(3, frame.width, frame.height);
  Plane filtered(frame.width, frame.height);  // share of the pixel's light that was filtered
  for (size_t pixel = 0; pixel < points.rows.size(); ++pixel) {
    const PixelMean mean = MeanOf(*frame.edges, points, pixel, direct, indirect);
    if (mean.found <= kSubSamples / 2) continue;
    const auto [x, y] = points.points.pixels[pixel];
    filtered.At(x, y) = 1.0f - RawShare(mean, direct.raw[pixel], indirect.raw[pixel]);
    for (size_t c = 0; c < 3; ++c) values[c].At(x, y) = mean.light[c] + glossy[c].At(x, y);
  }
  Plane share = TrustIn(values, filtered, frame, {}, pool);
  ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) { share.At(x, y) *= filtered.At(x, y); });
  Follow(values, share, pool, picture);
}

}  // namespace lumifold::filter
