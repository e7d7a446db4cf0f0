#include "filter/denoise/layer_stages.h"

#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace lumifold::filter {
namespace {

constexpr int kSide = 24;
constexpr float kLight = 3;

/// Two surfaces in each of three pixels: one like all around, and one whose geometry is like no other's,
/// which thus finds nothing on the manifolds. The layer's light is kLight everywhere.
LayerFragments FragmentsLikeNoOther(bool has_b) {
  LayerFragments fragments;
  fragments.own_features = 1;
  for (const std::array<int, 2> place : {std::array{2, 3}, std::array{12, 12}, std::array{23, 20}}) {
    const size_t first = fragments.places.size();
    fragments.pixels.push_back({place[0], place[1], first, first + 2});
    for (const float feature : {1e4f, 0.0f}) {
      fragments.places.push_back(place);
      fragments.features.push_back(feature);
      fragments.factor.push_back({1, 1, 1});
      for (size_t h = 0; h < 2; ++h) {
        const bool has_half = h == 0 || has_b;
        fragments.share[h].push_back(has_half ? 0.5f : 0);
        fragments.coverage[h].push_back(0.5f);
        for (auto* light : {&fragments.light[h], &fragments.noisy[h]})
          light->insert(light->end(), 3, has_half ? kLight : 0);
      }
    }
  }
  return fragments;
}

TEST(LayerStages, EqualLightStaysAlsoOnSurfacesLikeNoOther) {
  Planes light = MakePlanes(3, kSide, kSide);
  for (Plane& plane : light) plane.Fill(kLight);
  const Plane counts = MakePlane(kSide, kSide, 4);
  const Plane none(kSide, kSide);
  const ConstColorView view = {light[0].view(), light[1].view(), light[2].view()};
  for (const bool has_b : {true, false}) {
    Product product;
    product.mean = view;
    product.factor = view;
    product.halves = {view, view, counts.view(), has_b ? counts.view() : none.view()};
    product.box = {0, 0, kSide, kSide};
    product.validity = MakePlane(kSide, kSide, 1);
    product.geometry.emplace_back(kSide, kSide);
    const LayerSettings settings;
    const LayerFragments fragments = FragmentsLikeNoOther(has_b);
    const SwitchedOff all_but_filtering = {"fireflies", "firefly-energy", "choice", "light-regression",
                                           "noisy-choice"};
    const FilteredLayer filtered =
        RunLayer(DefaultLayerStages(), settings, product, fragments, all_but_filtering, {}, nullptr);
    for (const LayerFragments::Pixel& pixel : fragments.pixels) {
      EXPECT_NEAR(filtered.light.a[1].At(pixel.x, pixel.y), kLight, 1e-4f) << has_b << " " << pixel.x;
      for (size_t point = pixel.first; point < pixel.last; ++point)
        EXPECT_NEAR(filtered.light.points[0][3 * point + 1], kLight, 1e-4f) << has_b << " " << point;
    }
  }
}

}  // namespace
}  // namespace lumifold::filter
