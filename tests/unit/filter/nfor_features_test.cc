#include "filter/baselines/nfor_features.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

#include "edge_films.h"
#include "filter/baselines/standardise.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"

namespace lumifold::filter {
namespace {

constexpr size_t kNormalXPlane = 0;
constexpr size_t kAlbedoPlane = 4;

/// Values of a plane in one column, as the mean and the mean squared deviation from it.
struct Spread {
  float mean = 0;
  float variance = 0;
};

Spread SpreadOf(const Plane& plane, int x) {
  Spread spread;
  for (int y = 0; y < plane.height(); ++y) spread.mean += plane.At(x, y) / static_cast<float>(plane.height());
  for (int y = 0; y < plane.height(); ++y) {
    const float off = plane.At(x, y) - spread.mean;
    spread.variance += off * off / static_cast<float>(plane.height());
  }
  return spread;
}

/// The edge film with T that alternates along the edge, as noise of 64 samples may.
LayeredImage FilmOfNoisyAlbedo() {
  LayeredImage film = EdgeFilm();
  for (int y = 0; y < kHeight; ++y) {
    Set(film.GetColor(layers::kAlbedo), kEdgeColumn, y, y % 2 == 0 ? 0.49f : 0.61f);
    for (const std::string_view samples : {layers::kSamplesA, layers::kSamplesB})
      std::fill_n(film.Get(samples).Row(y), kWidth, 32.0f);
  }
  return film;
}

/// The edge set, with one sub-sample of half B on the right surface instead of the left one in every other
/// row.
LayeredImage EdgeSetOfUnequalHalves() {
  LayeredImage edges = EdgeSet();
  const FloatView normal[2] = {edges.Get(layers::kNormalX), edges.Get(layers::kNormalY)};
  for (int y = 0; y < kHeight; y += 2) {
    normal[0].At(1, y) = 0;
    SetSide(normal, edges.Get(layers::kDistance), 1, y, 1);
  }
  return edges;
}

TEST(PrefilteredFeatures, KeepFeaturesWithoutAnEdgeSet) {
  const LayeredImage film = FilmOfNoisyAlbedo();
  const CrossFeatures features = PrefilteredFeatures({film}, nullptr);
  ASSERT_EQ(features.a.size(), 7u);
  Planes albedo;
  albedo.push_back(Clone(film.GetColor(layers::kAlbedo)[0]));
  Plane everywhere = MakePlane(kWidth, kHeight, 1.0f);
  const StandardPlanes standard = Standardise(albedo, everywhere.view(), true, nullptr);
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    for (const Planes* planes : {&features.a, &features.b, &features.mean})
      ASSERT_EQ((*planes)[kAlbedoPlane].At(x, y), standard.planes[0].At(x, y)) << x << "," << y;
  });
}

TEST(PrefilteredFeatures, AverageNoisyEdgePixelsAlongTheEdge) {
  const LayeredImage film = FilmOfNoisyAlbedo();
  const LayeredImage edges = EdgeSet();
  const CrossFeatures noisy = PrefilteredFeatures({film}, nullptr);
  const CrossFeatures clean = PrefilteredFeatures({film, &edges}, nullptr);
  const Spread before = SpreadOf(noisy.a[kAlbedoPlane], kEdgeColumn);
  const Spread after = SpreadOf(clean.a[kAlbedoPlane], kEdgeColumn);
  EXPECT_LT(after.variance, 0.05f * before.variance);
  EXPECT_NEAR(after.mean, before.mean, 0.02f);
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    if (x != kEdgeColumn) {
      ASSERT_NEAR(clean.mean[kAlbedoPlane].At(x, y), noisy.mean[kAlbedoPlane].At(x, y), 1e-4f)
          << x << "," << y;
    }
  });
}

TEST(PrefilteredFeatures, HaveHalvesOfAlternateSubSamples) {
  const LayeredImage film = EdgeFilm();
  const LayeredImage edges = EdgeSetOfUnequalHalves();
  const CrossFeatures features = PrefilteredFeatures({film, &edges}, nullptr);
  const Planes plain = std::move(PrefilteredFeatures({film}, nullptr).a);
  const Plane& normal_x = plain[kNormalXPlane];
  const float scale = normal_x.At(0, 0) - normal_x.At(kWidth - 1, 0);  // of a normal from 1 to 0
  const Spread a = SpreadOf(features.a[kNormalXPlane], kEdgeColumn);
  const Spread b = SpreadOf(features.b[kNormalXPlane], kEdgeColumn);
  // The halves of every other row differ by 1/8. Averaged along the edge, half of that is left in every row.
  EXPECT_NEAR(a.mean - b.mean, scale / 16, scale / 100);
  EXPECT_LT(std::sqrt(a.variance), 0.25f * scale / 32);
  EXPECT_LT(std::sqrt(b.variance), 0.25f * scale / 32);
  EXPECT_NEAR(SpreadOf(features.mean[kNormalXPlane], kEdgeColumn).mean, normal_x.At(kEdgeColumn, 0),
              scale / 100);
}

TEST(Standardise, SaysWhatItSubtractsAndScalesBy) {
  Planes planes = MakePlanes(2, 2, 1);
  planes[0].At(0, 0) = 3;
  planes[0].At(1, 0) = 7;
  planes[1].Fill(5);
  Plane everywhere = MakePlane(2, 1, 1.0f);
  const StandardPlanes standard = Standardise(planes, everywhere.view(), true, nullptr);
  EXPECT_EQ(standard.means, (std::vector<float>{5, 5}));
  EXPECT_EQ(standard.scales, (std::vector<float>{0.5f, 0}));
  EXPECT_EQ(standard.planes[0].At(1, 0), 1);
  EXPECT_EQ(standard.planes[1].At(1, 0), 0);
}

}  // namespace
}  // namespace lumifold::filter
