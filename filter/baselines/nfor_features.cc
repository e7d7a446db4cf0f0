#include "filter/baselines/nfor_features.h"

#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "filter/baselines/non_local_means.h"
#include "filter/baselines/standardise.h"
#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/layers/edge_views.h"

namespace lumifold::filter {
namespace {

constexpr std::array<std::string_view, 4> kGeometry = {layers::kNormalX, layers::kNormalY, layers::kNormalZ,
                                                       layers::kDistance};

/// Features of 1e6 and more are taken for defects of the film.
constexpr float kLargestFeature = 999999.9375f;

constexpr NonLocalMeansParams kCrossPrefilter = {.search_radius = 5, .patch_radius = 3, .strength = 0.5f};
constexpr NonLocalMeansParams kMeanPrefilter = {.search_radius = 2, .patch_radius = 3, .strength = 0.5f};

/// The parts of each pixel that show the first surface and the surfaces seen in it. A part without a diffuse
/// lobe counts to the first surface.
struct ShownParts {
  Plane first;
  std::vector<std::pair<layers::Level, Plane>> levels;
};

ShownParts PartsOf(const LayeredImage& film) {
  Plane rest = MakePlane(film.width(), film.height(), 1.0f);
  const auto take = [&](ConstFloatView mask) {
    Plane part(film.width(), film.height());
    ForEachPixel(film.width(), film.height(), [&](int x, int y) {
      const float share = UsableOr0(mask.At(x, y), kLargestFeature);
      part.At(x, y) = std::clamp(share, 0.0f, std::max(0.0f, rest.At(x, y)));
      rest.At(x, y) -= part.At(x, y);
    });
    return part;
  };
  ShownParts parts{take(film.Get(layers::kMask)), {}};
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    const layers::Level level = layers::Level::Of(i);
    const std::string mask = layers::OfLevel(level, layers::kMask);
    if (film.Has(mask)) parts.levels.emplace_back(level, take(film.Get(mask)));
  }
  ForEachPixel(film.width(), film.height(), [&](int x, int y) { parts.first.At(x, y) += rest.At(x, y); });
  return parts;
}

Plane SeenGeometry(const LayeredImage& film, const ShownParts& parts, std::string_view channel) {
  Plane seen(film.width(), film.height());
  const auto add = [&](ConstFloatView value, const Plane& part) {
    ForEachPixel(film.width(), film.height(), [&](int x, int y) {
      seen.At(x, y) += part.At(x, y) * UsableOr0(value.At(x, y), kLargestFeature);
    });
  };
  add(film.Get(channel), parts.first);
  for (const auto& [level, part] : parts.levels) add(film.Get(layers::OfLevel(level, channel)), part);
  return seen;
}

/// The sum of T of the first surface and of the surfaces seen in it.
Plane SeenAlbedo(const LayeredImage& film, size_t component) {
  Plane seen(film.width(), film.height());
  const auto add = [&](ConstFloatView albedo) {
    ForEachPixel(film.width(), film.height(),
                 [&](int x, int y) { seen.At(x, y) += UsableOr0(albedo.At(x, y), kLargestFeature); });
  };
  add(film.GetColor(layers::kAlbedo)[component]);
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    const std::string layer = layers::OfLevel(layers::Level::Of(i), layers::kAlbedo);
    if (film.HasColor(layer)) add(film.GetColor(layer)[component]);
  }
  return seen;
}

/// What the sub-samples of an edge pixel that hit a surface tell about the noise of a feature.
struct SubSampleNoise {
  float half_difference = 0;  // half of mean A - mean B
  float variance = 0;         // of one sub-sample
  float count = 0;
};

SubSampleNoise NoiseOf(ConstFloatView channel, ConstFloatView id, int row) {
  std::array<float, 2> sums = {};
  std::array<float, 2> counts = {};
  float squares = 0;
  for (int i = 0; i < channel.width(); ++i) {
    if (id.At(i, row) == 0) continue;
    const size_t half = static_cast<size_t>(i + i / 4) % 2;
    const float value = UsableOr0(channel.At(i, row), kLargestFeature);
    sums[half] += value;
    squares += value * value;
    counts[half] += 1;
  }
  SubSampleNoise noise;
  noise.count = counts[0] + counts[1];
  if (counts[0] == 0 || counts[1] == 0) return noise;
  noise.half_difference = 0.5f * (sums[0] / counts[0] - sums[1] / counts[1]);
  const float mean = (sums[0] + sums[1]) / noise.count;
  noise.variance = std::max(0.0f, squares - noise.count * mean * mean) / (noise.count - 1);
  return noise;
}

/// Noise of features, each a plane: half A is the feature plus `half_difference`, half B the feature minus
/// it; `variance` is that of the feature.
struct FeatureNoise {
  Planes half_difference;
  Planes variance;
};

FeatureNoise NoiseOfFeatures(const FilmView& film, const ShownParts& parts) {
  const LayeredImage& pixels = film.pixels;
  const size_t count = kGeometry.size() + 3;
  FeatureNoise noise = {MakePlanes(count, pixels.width(), pixels.height()),
                        MakePlanes(count, pixels.width(), pixels.height())};
  if (film.edges == nullptr || film.edges->channels().empty()) return noise;
  const EdgeViews edges(*film.edges);
  const ConstFloatView samples_a = pixels.Get(layers::kSamplesA);
  const ConstFloatView samples_b = pixels.Get(layers::kSamplesB);
  edges.ForEachPixel(pixels.bounds(), [&](int row, int x, int y) {
    for (size_t i = 0; i < kGeometry.size(); ++i) {
      const SubSampleNoise found = NoiseOf(film.edges->Get(kGeometry[i]), edges.id, row);
      const float part = parts.first.At(x, y);
      noise.half_difference[i].At(x, y) = part * found.half_difference;
      noise.variance[i].At(x, y) = part * part * found.variance / found.count;
    }
    const float samples = samples_a.At(x, y) + samples_b.At(x, y);
    for (size_t c = 0; c < 3; ++c) {
      const SubSampleNoise found = NoiseOf(edges.albedo[c], edges.id, row);
      noise.variance[kGeometry.size() + c].At(x, y) = found.variance / std::max(1.0f, UsableOr0(samples));
    }
  });
  return noise;
}

bool IsZero(const Plane& plane) {
  for (int y = 0; y < plane.height(); ++y) {
    for (int x = 0; x < plane.width(); ++x) {
      if (plane.At(x, y) != 0) return false;
    }
  }
  return true;
}

/// value + factor * change, pixel by pixel.
Plane Shifted(const Plane& value, const Plane& change, float factor) {
  Plane shifted(value.width(), value.height());
  ForEachPixel(value.width(), value.height(),
               [&](int x, int y) { shifted.At(x, y) = value.At(x, y) + factor * change.At(x, y); });
  return shifted;
}

Planes Only(Plane plane) {
  Planes planes;
  planes.push_back(std::move(plane));
  return planes;
}

/// Prefilters one feature. `variance` is that of the feature.
void Prefilter(const Plane& feature, const Plane& half_difference, const Plane& variance, TaskPool* pool,
               CrossFeatures* out) {
  const Planes a = Only(Shifted(feature, half_difference, 1));
  const Planes b = Only(Shifted(feature, half_difference, -1));
  const Planes half_variance = Only(Shifted(variance, variance, 1));
  out->a.push_back(std::move(NonLocalMeans(a, b, half_variance, kCrossPrefilter, pool)[0]));
  out->b.push_back(std::move(NonLocalMeans(b, a, half_variance, kCrossPrefilter, pool)[0]));
  const Plane& half_a = out->a.back();
  const Plane& half_b = out->b.back();
  Plane mean(feature.width(), feature.height());
  Plane residual(feature.width(), feature.height());
  ForEachPixel(feature.width(), feature.height(), [&](int x, int y) {
    const float difference = half_a.At(x, y) - half_b.At(x, y);
    mean.At(x, y) = 0.5f * (half_a.At(x, y) + half_b.At(x, y));
    residual.At(x, y) = 0.25f * difference * difference;
  });
  const Planes combined = Only(std::move(mean));
  const Planes residual_variance = Only(std::move(residual));
  out->mean.push_back(
      std::move(NonLocalMeans(combined, combined, residual_variance, kMeanPrefilter, pool)[0]));
}

}  // namespace

CrossFeatures PrefilteredFeatures(const FilmView& film, TaskPool* pool) {
  const LayeredImage& pixels = film.pixels;
  const ShownParts parts = PartsOf(pixels);
  Planes features;
  for (const std::string_view channel : kGeometry) features.push_back(SeenGeometry(pixels, parts, channel));
  for (size_t c = 0; c < 3; ++c) features.push_back(SeenAlbedo(pixels, c));
  Plane everywhere = MakePlane(pixels.width(), pixels.height(), 1.0f);
  const StandardPlanes standard = Standardise(features, everywhere.view(), true, pool);
  const FeatureNoise noise = NoiseOfFeatures(film, parts);
  CrossFeatures out;
  for (size_t i = 0; i < features.size(); ++i) {
    const Plane& feature = standard.planes[i];
    if (IsZero(noise.variance[i])) {
      for (Planes* planes : {&out.a, &out.b, &out.mean}) planes->push_back(feature.Clone());
      continue;
    }
    const float scale = standard.scales[i];
    Plane zero(feature.width(), feature.height());
    Prefilter(feature, Shifted(zero, noise.half_difference[i], scale),
              Shifted(zero, noise.variance[i], scale * scale), pool, &out);
  }
  return out;
}

}  // namespace lumifold::filter
