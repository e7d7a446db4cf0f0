#include "tests/charts/error_map.h"

#include <cmath>
#include <initializer_list>
#include <string>
#include <utility>

#include "filter/image/color.h"
#include "filter/image/layers.h"

namespace lumifold::charts {
namespace {

constexpr float kLeastContrast = 0.02f;  // of albedo

class RegionMap {
 public:
  explicit RegionMap(const LayeredImage& film)
      : width_(film.width()), regions_(static_cast<size_t>(film.width() * film.height()), Region::kFlat) {}

  Region& At(int x, int y) { return regions_[static_cast<size_t>(y * width_ + x)]; }
  std::vector<Region> Take() { return std::move(regions_); }

 private:
  int width_;
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

void MarkMirrors(const LayeredImage& film, RegionMap* map) {
  for (const layers::Branch branch : {layers::Branch::kReflection, layers::Branch::kTransmission}) {
    const std::string name = layers::OfLevel({branch, 1}, layers::kDistance);
    if (!film.Has(name)) continue;
    const ConstFloatView distance = film.Get(name);
    for (int y = 0; y < film.height(); ++y) {
      for (int x = 0; x < film.width(); ++x) {
        if (distance.At(x, y) > 0) map->At(x, y) = Region::kMirror;
      }
    }
  }
}

void MarkEdges(const EdgedImage& film, RegionMap* map) {
  if (!film.edges.Has(layers::kPixelX)) return;
  const ConstFloatView xs = film.edges.Get(layers::kPixelX);
  const ConstFloatView ys = film.edges.Get(layers::kPixelY);
  for (int row = 0; row < film.edges.height(); ++row)
    map->At(static_cast<int>(xs.At(0, row)), static_cast<int>(ys.At(0, row))) = Region::kEdges;
}

double SquaredError(const ConstColorView& picture, const ConstColorView& reference, int x, int y) {
  double sum = 0;
  for (size_t c = 0; c < 3; ++c) {
    const double step = 255.0 * static_cast<double>(SrgbFromLinear(picture[c].At(x, y)) -
                                                    SrgbFromLinear(reference[c].At(x, y)));
    sum += step * step;
  }
  return sum / 3.0;
}

}  // namespace

std::vector<Region> RegionsOf(const EdgedImage& film) {
  RegionMap map(film.pixels);
  MarkTextures(film.pixels, &map);
  MarkMirrors(film.pixels, &map);
  MarkEdges(film, &map);
  return map.Take();
}

RegionMeans Mse255ByRegion(const ConstColorView& picture, const ConstColorView& reference,
                           const std::vector<Region>& regions) {
  RegionMeans means;
  std::array<int64_t, kRegionCount> counts = {};
  const int width = reference[0].width();
  for (int y = 0; y < reference[0].height(); ++y) {
    for (int x = 0; x < width; ++x) {
      const auto region = static_cast<size_t>(regions[static_cast<size_t>(y * width + x)]);
      const double error = SquaredError(picture, reference, x, y);
      means.whole += error;
      means.of_region[region] += error;
      ++counts[region];
    }
  }
  means.whole /= static_cast<double>(regions.size());
  for (size_t i = 0; i < kRegionCount; ++i) {
    if (counts[i] > 0) means.of_region[i] /= static_cast<double>(counts[i]);
  }
  return means;
}

}  // namespace lumifold::charts
