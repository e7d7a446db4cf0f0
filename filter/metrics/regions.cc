#include "filter/metrics/regions.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <string>
#include <utility>

#include "filter/image/color.h"
#include "filter/image/layers.h"
#include "filter/image/level_mask.h"
#include "filter/image/planes.h"
#include "filter/metrics/mean.h"

namespace lumifold::metrics {
namespace {

constexpr float kLeastContrast = 0.02f;  // of albedo
/// Direct light that changes by this fraction of its local mean over kShadowReach pixels marks a shadow band,
/// which includes the kBandMargin pixels around it.
constexpr float kLeastShadowStep = 0.25f;
constexpr int kShadowReach = 2;
constexpr int kBandMargin = 2;
constexpr float kLeastCosine = 0.95f;  // between normals of one surface

class RegionMap {
 public:
  explicit RegionMap(const LayeredImage& film)
      : width_(static_cast<size_t>(film.width())),
        regions_(width_ * static_cast<size_t>(film.height()), Region::kFlat) {}

  Region& At(int x, int y) { return regions_[static_cast<size_t>(y) * width_ + static_cast<size_t>(x)]; }
  std::vector<Region> Take() { return std::move(regions_); }

 private:
  size_t width_;
  std::vector<Region> regions_;
};

void MarkTextures(const LayeredImage& film, RegionMap* map) {
  if (!film.HasColor(layers::kAlbedo)) return;
  for (const ConstFloatView& albedo : film.GetColor(layers::kAlbedo)) {
    for (int y = 0; y + 1 < film.height(); ++y) {
      for (int x = 0; x + 1 < film.width(); ++x) {
        const float here = albedo.At(x, y);
        const bool differs = std::abs(here - albedo.At(x + 1, y)) > kLeastContrast ||
                             std::abs(here - albedo.At(x, y + 1)) > kLeastContrast;
        if (differs) map->At(x, y) = Region::kTextured;
      }
    }
  }
}

/// Decides whether two pixels show the same surface.
class Surfaces {
 public:
  explicit Surfaces(const EdgedImage& film)
      : film_(film.pixels), on_edge_(film.pixels.width(), film.pixels.height()) {
    has_id_ = film_.Has(layers::kObjectId);
    has_normal_ = film_.Has(layers::kNormalX) && film_.Has(layers::kNormalY) && film_.Has(layers::kNormalZ);
    if (!film.edges.Has(layers::kPixelX)) return;
    const ConstFloatView xs = film.edges.Get(layers::kPixelX);
    const ConstFloatView ys = film.edges.Get(layers::kPixelY);
    for (int row = 0; row < film.edges.height(); ++row)
      on_edge_.At(static_cast<int>(xs.At(0, row)), static_cast<int>(ys.At(0, row))) = 1;
  }

  bool IsOnEdge(int x, int y) const { return on_edge_.At(x, y) > 0; }

  bool AreOne(int x0, int y0, int x1, int y1) const {
    if (IsOnEdge(x0, y0) || IsOnEdge(x1, y1)) return false;
    if (has_id_ && film_.Get(layers::kObjectId).At(x0, y0) != film_.Get(layers::kObjectId).At(x1, y1))
      return false;
    if (!has_normal_) return true;
    float cosine = 0;
    for (const std::string_view name : {layers::kNormalX, layers::kNormalY, layers::kNormalZ})
      cosine += film_.Get(name).At(x0, y0) * film_.Get(name).At(x1, y1);
    return cosine > kLeastCosine;
  }

 private:
  const LayeredImage& film_;
  Plane on_edge_;
  bool has_id_ = false;
  bool has_normal_ = false;
};

/// Luminance of direct light.
Plane DirectLight(const LayeredImage& film) {
  const ConstColorView direct = film.GetColor(layers::kDirect);
  Plane light(film.width(), film.height());
  ForEachPixel(film.width(), film.height(),
               [&](int x, int y) { light.At(x, y) = LuminanceAt(direct, x, y); });
  return light;
}

void MarkShadows(const EdgedImage& film, RegionMap* map) {
  if (!film.pixels.HasColor(layers::kDirect)) return;
  const Plane light = DirectLight(film.pixels);
  const Surfaces surfaces(film);
  const auto dark =
      static_cast<float>(0.1 * MeanOf(light.view()));  // changes within near-black areas are ignored
  const auto changes = [&](int x0, int y0, int x1, int y1) {
    if (x1 >= light.width() || y1 >= light.height() || !surfaces.AreOne(x0, y0, x1, y1)) return false;
    const float a = light.At(x0, y0);
    const float b = light.At(x1, y1);
    return std::abs(a - b) > kLeastShadowStep * (0.5f * (a + b) + dark);
  };
  const auto mark = [&](int x, int y) {
    for (int v = std::max(y - kBandMargin, 0); v <= std::min(y + kBandMargin, light.height() - 1); ++v) {
      for (int u = std::max(x - kBandMargin, 0); u <= std::min(x + kBandMargin, light.width() - 1); ++u) {
        if (surfaces.AreOne(x, y, u, v)) map->At(u, v) = Region::kShadow;
      }
    }
  };
  ForEachPixel(light.width(), light.height(), [&](int x, int y) {
    const int right = x + kShadowReach;
    const int below = y + kShadowReach;
    if (changes(x, y, right, y)) mark((x + right) / 2, y);
    if (changes(x, y, x, below)) mark(x, (y + below) / 2);
  });
}

void MarkMirrors(const LayeredImage& film, RegionMap* map) {
  const Plane mask = LevelMask(film);
  ForEachPixel(film.width(), film.height(), [&](int x, int y) {
    if (mask.At(x, y) > 0) map->At(x, y) = Region::kMirror;
  });
}

void MarkEdges(const EdgedImage& film, RegionMap* map) {
  const Surfaces surfaces(film);
  ForEachPixel(film.pixels.width(), film.pixels.height(), [&](int x, int y) {
    if (surfaces.IsOnEdge(x, y)) map->At(x, y) = Region::kEdges;
  });
}

/// Product of a pixel's differences to two references, mean over the channels, in squared 8-bit steps.
double ErrorProduct(const ConstColorView& picture, const ConstColorView& a, const ConstColorView& b, int x,
                    int y, float exposure) {
  double sum = 0;
  for (size_t c = 0; c < 3; ++c) {
    const auto shown = [&](const ConstColorView& color) {
      return 255.0 * static_cast<double>(SrgbFromLinear(exposure * color[c].At(x, y)));
    };
    const double value = shown(picture);
    sum += (value - shown(a)) * (value - shown(b));
  }
  return sum / 3.0;
}

}  // namespace

std::vector<Region> RegionsOf(const EdgedImage& film) {
  RegionMap map(film.pixels);
  MarkTextures(film.pixels, &map);
  MarkShadows(film, &map);
  MarkMirrors(film.pixels, &map);
  MarkEdges(film, &map);
  return map.Take();
}

RegionMeans Mse255ByRegion(const ConstColorView& picture, const ConstColorView& reference,
                           const std::vector<Region>& regions, float exposure) {
  return Mse255ToHalves(picture, reference, reference, regions, exposure);
}

RegionMeans Mse255ToHalves(const ConstColorView& picture, const ConstColorView& half_a,
                           const ConstColorView& half_b, const std::vector<Region>& regions, float exposure) {
  RegionMeans means;
  std::array<int64_t, kRegionCount> counts = {};
  const int width = picture[0].width();
  auto next = regions.begin();
  ForEachPixel(width, picture[0].height(), [&](int x, int y) {
    const auto region = static_cast<size_t>(*next++);
    const double error = ErrorProduct(picture, half_a, half_b, x, y, exposure);
    means.whole += error;
    means.of_region[region] += error;
    ++counts[region];
  });
  means.whole /= static_cast<double>(regions.size());
  for (size_t i = 0; i < kRegionCount; ++i) {
    if (counts[i] > 0) means.of_region[i] /= static_cast<double>(counts[i]);
    means.share[i] = static_cast<double>(counts[i]) / static_cast<double>(regions.size());
  }
  return means;
}

}  // namespace lumifold::metrics
