#include "filter/layers/single_picture.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <utility>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/mix_bits.h"
#include "filter/image/planes.h"
#include "filter/image/portable_math.h"
#include "filter/kernels/box_mean.h"
#include "filter/layers/frame.h"
#include "filter/layers/remainder.h"

namespace lumifold::filter {
namespace {

constexpr float kSameNormal = 0.9f;  // least cosine between the normals of one surface
constexpr float kSameDepth = 0.05f;  // largest relative change of depth within a 3x3 window of it
constexpr int kEstimateRadius = 7;   // 15x15 window
constexpr float kResponse =
    6.0f;  // standard deviation of the second difference of white noise of deviation 1
/// Times every other pixel within kEstimateRadius that a single one is brighter to be an outlier.
constexpr float kOutlier = 4;
constexpr float kMeanToSigma =
    1.2533141f;  // sqrt(pi / 2): from mean magnitude to deviation, for a normal variable

/// The guides that tell whether two pixels show one surface.
struct Guides {
  ConstFloatView normal[3];
  ConstFloatView distance;

  explicit Guides(const LayeredImage& film)
      : normal{film.Get(layers::kNormalX), film.Get(layers::kNormalY), film.Get(layers::kNormalZ)},
        distance(film.Get(layers::kDistance)) {}

  bool SameSurface(int x0, int y0, int x1, int y1) const {
    const float z = distance.At(x0, y0);
    if (std::abs(distance.At(x1, y1) - z) > kSameDepth * z) return false;
    float dot = 0;
    float square = 0;
    for (const ConstFloatView& n : normal) {
      dot += n.At(x0, y0) * n.At(x1, y1);
      square += n.At(x0, y0) * n.At(x0, y0);
    }
    return square == 0 || dot >= kSameNormal;
  }
};

/// 1 where all of a pixel's 3x3 window shows one surface.
Plane UniformMask(const LayeredImage& film, TaskPool* pool) {
  const Guides guides(film);
  Plane mask(film.width(), film.height());
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (int y = std::max(y0, 1); y < std::min(y1, film.height() - 1); ++y) {
      for (int x = 1; x + 1 < film.width(); ++x) {
        bool uniform = true;
        for (int i = 0; i < 9; ++i)
          uniform = uniform && guides.SameSurface(x, y, x - 1 + i % 3, y - 1 + i / 3);
        mask.At(x, y) = uniform ? 1.0f : 0.0f;
      }
    }
  });
  return mask;
}

/// Magnitude of the second difference along both axes, (1 -2 1) times (1 -2 1): 0 for a plane.
Plane Roughness(ConstFloatView channel, const Plane& mask, TaskPool* pool) {
  Plane roughness(channel.width(), channel.height());
  const auto across = [&](int x, int y) {
    return channel.At(x - 1, y) - 2 * channel.At(x, y) + channel.At(x + 1, y);
  };
  ForEachPixel(pool, channel.width(), channel.height(), [&](int x, int y) {
    if (mask.At(x, y) == 0) return;
    roughness.At(x, y) = UsableOr0(std::abs(across(x, y - 1) - 2 * across(x, y) + across(x, y + 1)));
  });
  return roughness;
}

/// A nearly normal number of mean 0 and variance 1 (the sum of 12 uniform ones), fixed for each (layer,
/// pixel). The channels of a pixel share it, as they share the paths that make noise.
float NormalNumber(uint64_t layer, int x, int y) {
  const uint64_t key = MixBits((layer << 56) ^ (static_cast<uint64_t>(static_cast<uint32_t>(y)) << 28) ^
                               static_cast<uint64_t>(static_cast<uint32_t>(x)));
  float sum = 0;
  for (uint64_t word = 0; word < 3; ++word) {
    const uint64_t bits = MixBits(key + (word + 1) * 0x9e3779b97f4a7c15u);
    for (int i = 0; i < 4; ++i) sum += static_cast<float>((bits >> (16 * i)) & 0xffffu) + 0.5f;
  }
  return sum * 0x1p-16f - 6.0f;
}

/// Makes e of a layer: 3 planes.
struct PseudoNoise {
  const Plane& uniform;  // UniformMask
  int x0;                // of the film's first pixel in the picture
  int y0;
  TaskPool* pool;

  Planes operator()(uint64_t layer, const ConstColorView& color) const;
};

Planes PseudoNoise::operator()(uint64_t layer, const ConstColorView& color) const {
  Planes roughness;
  for (const ConstFloatView& channel : color) roughness.push_back(Roughness(channel, uniform, pool));
  Planes noise = BoxMeans(roughness, uniform.view(), kEstimateRadius, pool);
  for (Plane& plane : noise) {
    ForEachPixel(plane.width(), plane.height(), [&](int x, int y) {
      plane.At(x, y) *= kMeanToSigma / kResponse * NormalNumber(layer, x0 + x, y0 + y);
    });
  }
  return noise;
}

/// Adds the halves X + e and X - e of a layer.
void AddHalves(std::string_view layer, const Planes& noise, LayeredImage* film) {
  const ColorView half_a = film->AddColor(layers::HalfA(layer));
  const ColorView half_b = film->AddColor(layers::HalfB(layer));
  const ConstColorView mean = std::as_const(*film).GetColor(layer);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(film->width(), film->height(), [&](int x, int y) {
      half_a[c].At(x, y) = mean[c].At(x, y) + noise[c].At(x, y);
      half_b[c].At(x, y) = mean[c].At(x, y) - noise[c].At(x, y);
    });
  }
}

/// A layer of light by name, its mean and the layer that multiplies it.
struct LightLayer {
  std::string_view name;
  ColorView light;
  ColorView factor;
};

std::vector<LightLayer> LightLayersOf(LayeredImage* film) {
  const ColorView albedo = film->GetColor(layers::kAlbedo);
  std::vector<LightLayer> all = {{layers::kDirect, film->GetColor(layers::kDirect), albedo},
                                 {layers::kIndirect, film->GetColor(layers::kIndirect), albedo}};
  for (const layers::LobeLayer& lobe : layers::kLobeLayers) {
    if (film->HasColor(lobe.light) && film->HasColor(lobe.factor))
      all.push_back({lobe.light, film->GetColor(lobe.light), film->GetColor(lobe.factor)});
  }
  return all;
}

/// The largest channel's magnitude; unusable values count as 0.
template <typename Color>
float MagnitudeAt(const Color& color, int x, int y) {
  float most = 0;
  for (size_t c = 0; c < 3; ++c) most = std::max(most, std::abs(UsableOr0(color[c].At(x, y))));
  return most;
}

/// That of the brightest other pixel within a radius.
template <typename Color>
float BrightestOther(const Color& color, int radius, int x, int y) {
  float most = 0;
  for (int j = std::max(y - radius, 0); j <= std::min(y + radius, color[0].height() - 1); ++j) {
    for (int i = std::max(x - radius, 0); i <= std::min(x + radius, color[0].width() - 1); ++i) {
      if (i != x || j != y) most = std::max(most, MagnitudeAt(color, i, j));
    }
  }
  return most;
}

/// Whether a value is no more than noise may make of light like that of the pixels around (x, y).
template <typename Color>
bool IsOutlier(float magnitude, const Color& around, int x, int y) {
  // The next pixels tell of nearly all.
  return magnitude > kOutlier * BrightestOther(around, 1, x, y) &&
         magnitude > kOutlier * BrightestOther(around, kEstimateRadius, x, y);
}

/// Makes outliers as bright as the brightest pixel around them.
void CutOutliers(const ColorView& layer, TaskPool* pool) {
  Planes cut = ClonePlanes({layer[0], layer[1], layer[2]});
  ForEachPixel(pool, layer[0].width(), layer[0].height(), [&](int x, int y) {
    const float magnitude = MagnitudeAt(layer, x, y);
    if (!IsOutlier(magnitude, layer, x, y)) return;
    const float keep = BrightestOther(layer, kEstimateRadius, x, y) / magnitude;
    for (Plane& plane : cut) plane.At(x, y) *= keep;
  });
  for (size_t c = 0; c < 3; ++c) CopyPlane(cut[c].view(), layer[c]);
}

/// sum += sign * light * factor; unusable values count as 0.
template <typename Light>
void AddProduct(float sign, const Light& light, const ColorView& factor, Planes* sum) {
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(light[c].width(), light[c].height(), [&](int x, int y) {
      (*sum)[c].At(x, y) += sign * UsableOr0(light[c].At(x, y) * factor[c].At(x, y));
    });
  }
}

/// `rest` without the products of light.
Planes Remaining(const Planes& rest, const std::vector<LightLayer>& lights) {
  Planes left = Clone(rest);
  for (const LightLayer& layer : lights) AddProduct(-1, layer.light, layer.factor, &left);
  return left;
}

/// The mean of the pixels next to (x, y); unusable values count as 0.
float MeanAround(const Plane& plane, int x, int y) {
  float sum = 0;
  int count = 0;
  for (int j = std::max(y - 1, 0); j <= std::min(y + 1, plane.height() - 1); ++j) {
    for (int i = std::max(x - 1, 0); i <= std::min(x + 1, plane.width() - 1); ++i) {
      if (i == x && j == y) continue;
      sum += UsableOr0(plane.At(i, j));
      ++count;
    }
  }
  return count > 0 ? sum / static_cast<float>(count) : 0.0f;
}

/// Takes single pixels that are far too bright in any layer out of it and of C: nothing tells without halves
/// whether such light is noise, and each window that sees it would take all its light for noise. Result: what
/// the other layers leave of C.
Planes TakeOutliers(const std::vector<LightLayer>& lights, TaskPool* pool, LayeredImage* film) {
  const ColorView noisy = film->GetColor(layers::kNoisy);
  const ColorView emission = film->GetColor(layers::kEmission);
  const Frame frame(std::as_const(*film));
  const Planes reflected = WithoutEmission(frame, frame.combined.mean, pool);
  for (const LightLayer& layer : lights) CutOutliers(layer.factor, pool);
  const Planes whole = Remaining(reflected, lights);
  for (const LightLayer& layer : lights) CutOutliers(layer.light, pool);
  Planes rest = Remaining(reflected, lights);
  const Planes cut = Clone(rest);
  const Planes before = ClonePlanes(frame.combined.mean);
  ForEachPixel(pool, film->width(), film->height(), [&](int x, int y) {
    const bool is_in_both = MagnitudeAt(whole, x, y) < MagnitudeAt(rest, x, y);
    const Planes& left = is_in_both ? whole : rest;
    const bool is_outlier = IsOutlier(MagnitudeAt(left, x, y), reflected, x, y);
    if (!is_in_both && !is_outlier) return;
    const bool is_wrong = is_in_both || IsOutlier(MagnitudeAt(before, x, y), before, x, y);
    for (size_t c = 0; c < 3; ++c) {
      const float of_lights = reflected[c].At(x, y) - rest[c].At(x, y);
      rest[c].At(x, y) = is_outlier ? MeanAround(cut[c], x, y) : left[c].At(x, y);
      const float least = std::min(0.0f, UsableOr0(before[c].At(x, y)));  // rounding makes no light negative
      if (is_wrong)
        noisy[c].At(x, y) = std::max(least, of_lights + UsableOr0(emission[c].At(x, y)) + rest[c].At(x, y));
      else  // C is as bright as around: E is wrong
        emission[c].At(x, y) = std::max(0.0f, noisy[c].At(x, y) - of_lights - rest[c].At(x, y));
    }
  });
  return rest;
}

}  // namespace

void SplitIntoHalves(LayeredImage* film, TaskPool* pool, int x0, int y0) {
  const Plane uniform = UniformMask(*film, pool);
  const PseudoNoise noise_of{uniform, x0, y0, pool};
  const std::vector<LightLayer> light_layers = LightLayersOf(film);  // its planes stay where they are
  Planes noisy = noise_of(0, ViewOf(TakeOutliers(light_layers, pool, film)));
  uint64_t number = 0;
  for (const LightLayer& layer : light_layers) {
    const Planes noise = noise_of(++number, {layer.light[0], layer.light[1], layer.light[2]});
    AddProduct(1, noise, layer.factor, &noisy);
    AddHalves(layer.name, noise, film);
  }
  AddHalves(layers::kNoisy, noisy, film);
  for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB}) {
    Plane ones(film->width(), film->height());
    ones.Fill(1);
    film->Add(count, std::move(ones));
  }
}

}  // namespace lumifold::filter
