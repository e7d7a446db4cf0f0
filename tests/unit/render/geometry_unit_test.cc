#include "worker/render/geometry/geometry_unit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "filter/image/layers.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/levels.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/geometry/edge_set.h"
#include "worker/render/renderer.h"

namespace lumifold::render {
namespace {

using layers::OfLevel;
using scene::Material;

Material Mirror() {
  Material mirror;
  mirror.base.roughness = 0;
  return mirror;
}

Material Pane() {
  Material pane = Mirror();
  pane.base.metallic = 0;
  pane.transmission.factor = 1;
  return pane;
}

/// The camera at the origin looks along -z at a plane of material `front` 3 m ahead. There are walls 5 m
/// ahead of the camera and 2 m behind it.
scene::Scene PlaneBetweenWalls(const Material& front) {
  scene::Scene scene;
  scene.materials = {front, testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&scene, testing::QuadMesh({-2, -2, -3}, {4, 0, 0}, {0, 4, 0}, 0));
  testing::Place(&scene, testing::QuadMesh({-9, -9, 2}, {0, 18, 0}, {18, 0, 0}, 1));
  testing::Place(&scene, testing::QuadMesh({-9, -9, -5}, {18, 0, 0}, {0, 18, 0}, 1));
  scene.cameras = {testing::LookAt({0, 0, 0}, {0, 0, -1}, 0.1f)};
  return scene;
}

EdgedImage GeometryOf(scene::Scene scene, int width, int height) {
  return MakeRenderer(std::move(scene), SettingsOf(width, height))->RenderGeometry({0, 0, width, height}, 0);
}

/// The values of the edge set by pixel.
using PixelValues = std::map<std::pair<float, float>, std::vector<float>>;

void Collect(const LayeredImage& edges, PixelValues* out) {
  for (int row = 0; row < edges.height(); ++row) {
    std::vector<float>& values =
        (*out)[{edges.Get(layers::kPixelY).At(0, row), edges.Get(layers::kPixelX).At(0, row)}];
    EXPECT_TRUE(values.empty()) << "the pixel of row " << row << " is there twice";
    for (const LayeredImage::Channel& channel : edges.channels())
      values.insert(values.end(), channel.plane.Row(row), channel.plane.Row(row) + kSubSamples);
  }
}

TEST(GeometryUnit, AMirrorIsEquivalentToAWindow) {
  const LayeredImage geometry = GeometryOf(PlaneBetweenWalls(Mirror()), 9, 9).pixels;
  EXPECT_EQ(geometry.Get(layers::kMask).At(4, 4), 0);
  EXPECT_LT(geometry.Get(layers::kRoughness).At(4, 4), 1e-3f);
  // The normal of the wall behind the camera is -z, that of its mirror image +z.
  EXPECT_NEAR(geometry.Get(OfLevel(kReflection1, layers::kNormalZ)).At(4, 4), 1, 1e-5);
  EXPECT_NEAR(geometry.Get(OfLevel(kReflection1, layers::kDistance)).At(4, 4), 3 + 5, 1e-2);
  EXPECT_EQ(geometry.Get(OfLevel(kReflection1, layers::kMask)).At(4, 4), 1);
  EXPECT_EQ(geometry.Get(OfLevel(kReflection1, layers::kObjectId)).At(4, 4), 2);
  EXPECT_FALSE(geometry.Has(OfLevel(kReflection2, layers::kMask)));
  EXPECT_FALSE(geometry.Has(OfLevel(kTransmission1, layers::kMask)));
}

TEST(GeometryUnit, APaneHasAReflectionAndATransmissionLevel) {
  const LayeredImage geometry = GeometryOf(PlaneBetweenWalls(Pane()), 9, 9).pixels;
  EXPECT_NEAR(geometry.Get(OfLevel(kTransmission1, layers::kNormalZ)).At(4, 4), 1, 1e-5);
  EXPECT_NEAR(geometry.Get(OfLevel(kTransmission1, layers::kDistance)).At(4, 4), 5, 1e-2);
  EXPECT_EQ(geometry.Get(OfLevel(kTransmission1, layers::kObjectId)).At(4, 4), 3);
  EXPECT_EQ(geometry.Get(OfLevel(kReflection1, layers::kObjectId)).At(4, 4), 2);
}

TEST(GeometryUnit, ASolidBallIsTracedThroughBothFaces) {
  scene::Scene scene = PlaneBetweenWalls(Pane());
  scene.materials[0].volume.is_solid = true;
  scene.meshes[0] = testing::SphereMesh(1, 24, 0);
  scene.instances[0].world_from_object.origin = {0, 0, -3};
  const LayeredImage geometry = GeometryOf(std::move(scene), 9, 9).pixels;
  EXPECT_EQ(geometry.Get(OfLevel(kTransmission1, layers::kMask)).At(4, 4), 0);
  EXPECT_EQ(geometry.Get(OfLevel(kTransmission1, layers::kObjectId)).At(4, 4), 1);
  EXPECT_EQ(geometry.Get(OfLevel(kTransmission2, layers::kMask)).At(4, 4), 1);
  EXPECT_EQ(geometry.Get(OfLevel(kTransmission2, layers::kObjectId)).At(4, 4), 3);
  EXPECT_NEAR(geometry.Get(OfLevel(kTransmission2, layers::kDistance)).At(4, 4), 5, 2e-2);
}

TEST(GeometryUnit, IsIndependentOfTiles) {
  constexpr int kWidth = 45;
  constexpr int kHeight = 33;
  scene::Scene room = testing::SmallRoom();
  room.materials[5] = Pane();
  room.materials[5].volume.is_solid = true;
  room.materials[1] = Mirror();
  const auto renderer = MakeRenderer(std::move(room), SettingsOf(kWidth, kHeight));
  const EdgedImage whole = renderer->RenderGeometry({0, 0, kWidth, kHeight}, 0);
  PixelValues expected;
  Collect(whole.edges, &expected);
  ASSERT_GT(expected.size(), 50u);
  ASSERT_LT(expected.size(), kWidth * kHeight * 0.7);
  for (const int tile : {1, 8, 13, 32}) {
    PixelValues edges;
    for (int y = 0; y < kHeight; y += tile) {
      for (int x = 0; x < kWidth; x += tile) {
        const Rect rect = {x, y, std::min(x + tile, kWidth), std::min(y + tile, kHeight)};
        const EdgedImage part = renderer->RenderGeometry(rect, 0);
        ExpectSameBits(part.pixels, Cut(whole.pixels, rect));
        Collect(part.edges, &edges);
      }
    }
    EXPECT_EQ(edges, expected) << tile;
  }
}

/// Root mean square of what sub-samples' E at the rim of a lamp of this slope and radiance says of its share
/// of a pixel, less the true share.
double ErrorOfShares(float slope, float radiance) {
  constexpr int kSize = 24;
  constexpr uint32_t kSamples = 4096;
  scene::Scene scene;
  scene.materials = {testing::Emitter({radiance, radiance, radiance})};
  // A long strip, so that no corner is in the picture.
  testing::Place(&scene,
                 testing::QuadMesh({-40, -40 * slope - 0.311f, -3}, {80, 80 * slope, 0}, {0, 0.6f, 0}, 0));
  scene.cameras = {testing::LookAt({0, 0, 0}, {0, 0, -1}, 0.4f)};
  const auto renderer = MakeRenderer(std::move(scene), SettingsOf(kSize, kSize));
  const LayeredImage sums = RenderAll(*renderer, kSize, kSize, kSamples);
  const LayeredImage edges = renderer->RenderGeometry({0, 0, kSize, kSize}, 0).edges;
  double squares = 0;
  int rims = 0;
  for (int row = 0; row < edges.height(); ++row) {
    const auto x = static_cast<int>(edges.Get(layers::kPixelX).At(0, row));
    const auto y = static_cast<int>(edges.Get(layers::kPixelY).At(0, row));
    const auto share_of = [radiance](float emission) { return static_cast<double>(emission / radiance); };
    const double truth = share_of(sums.GetColor(layers::kEmission)[0].At(x, y)) / kSamples;
    if (!(truth > 0 && truth < 1)) continue;
    double share = 0;
    for (int i = 0; i < kSubSamples; ++i)
      share += share_of(edges.GetColor(layers::kEmission)[0].At(i, row)) / kSubSamples;
    squares += (share - truth) * (share - truth);
    ++rims;
  }
  EXPECT_GT(rims, 2 * kSize - 10) << slope;
  return std::sqrt(squares / rims);
}

TEST(GeometryUnit, SubSamplesBesideALampHaveItsShareOfThePixelWhateverTheSlopeOfItsRim) {
  for (const float slope : {0.0f, 0.25f, 1.0f, 3.0f}) {
    EXPECT_LT(ErrorOfShares(slope, 4), 0.006) << slope;
    EXPECT_LT(ErrorOfShares(slope, 16), 0.0025) << slope << ", where more rays are worth it";
  }
}

TEST(GeometryUnit, AFlatFloorHasNoEdgesAtGrazingAngles) {
  scene::Scene scene;
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&scene, testing::QuadMesh({-5e3f, 0, -5e3f}, {0, 0, 1e4f}, {1e4f, 0, 0}, 0));
  scene.cameras = {testing::LookAt({0, 1, 0}, {0, 0.7f, -1}, 0.5f)};  // the upper rows look 3 degrees down
  EXPECT_EQ(GeometryOf(scene, 24, 32).edges.height(), 0);
  // A step in it is an edge, although both parts are one object and have one normal.
  scene.meshes[0] = testing::QuadMesh({-5e3f, 0, -3}, {0, 0, 1e4f}, {1e4f, 0, 0}, 0);
  scene::Mesh lower = testing::QuadMesh({-5e3f, -1, -5e3f}, {0, 0, 1e4f}, {1e4f, 0, 0}, 0);
  for (const uint32_t corner : lower.triangles) scene.meshes[0].triangles.push_back(corner + 4);
  scene.meshes[0].positions.insert(scene.meshes[0].positions.end(), lower.positions.begin(),
                                   lower.positions.end());
  for (int i = 0; i < 4; ++i) scene.meshes[0].uvs[0].push_back({0, 0});
  const int edges = GeometryOf(scene, 24, 32).edges.height();
  EXPECT_GE(edges, 2 * 24);
  EXPECT_LE(edges, 4 * 24);
}

TEST(GeometryUnit, AnEdgePixelIsTheMeanOfItsSubSamples) {
  scene::Scene scene = PlaneBetweenWalls(testing::Lambert({0.25f, 0.5f, 0.75f}));
  scene.materials[0].emission.radiance = {2, 0, 0};
  scene.cameras = {testing::LookAt({2.05f, 0, 0}, {2.05f, 0, -1}, 0.5f)};  // the plane's right end ahead
  const EdgedImage geometry = GeometryOf(std::move(scene), 9, 9);
  ASSERT_GE(geometry.edges.height(), 9);
  EXPECT_EQ(geometry.edges.width(), kSubSamples);
  int mixed = 0;
  for (int row = 0; row < geometry.edges.height(); ++row) {
    const int x = static_cast<int>(geometry.edges.Get(layers::kPixelX).At(5, row));
    const int y = static_cast<int>(geometry.edges.Get(layers::kPixelY).At(5, row));
    float distance = 0;
    int on_plane = 0;
    for (int i = 0; i < kSubSamples; ++i) {
      distance += geometry.edges.Get(layers::kDistance).At(i, row) / kSubSamples;
      const bool is_on_plane = geometry.edges.Get(layers::kObjectId).At(i, row) == 1;
      EXPECT_EQ(geometry.edges.Get("emission.R").At(i, row), is_on_plane ? 2 : 0);
      EXPECT_EQ(geometry.edges.Get("albedo.B").At(i, row), is_on_plane ? 0.75f : 0.5f);
      EXPECT_EQ(geometry.edges.Get(layers::kMask).At(i, row), 1);
      on_plane += is_on_plane ? 1 : 0;
    }
    EXPECT_NEAR(geometry.pixels.Get(layers::kDistance).At(x, y), distance, 1e-4);
    EXPECT_EQ(geometry.pixels.Get(layers::kObjectId).At(x, y), on_plane >= 8 ? 1 : 3);
    mixed += on_plane > 0 && on_plane < kSubSamples ? 1 : 0;
  }
  EXPECT_EQ(mixed, 9);  // one column of pixels lies across the plane's end
}

/// A camera whose pixels are 0.1 m wide on the plane z = -5, and a lamp there from `from` pixels below the
/// picture's middle downwards, over its whole width.
scene::Scene LampBelow(float from) {
  scene::Scene scene;
  scene.materials = {testing::Emitter({900, 1000, 1100}), testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&scene, testing::QuadMesh({-5, -5, -5}, {10, 0, 0}, {0, 5 - 0.1f * from, 0}, 0));
  testing::Place(&scene, testing::QuadMesh({-9, -9, -6}, {18, 0, 0}, {0, 18, 0}, 1));
  scene.cameras = {testing::LookAt({0, 0, 0}, {0, 0, -1}, 2 * std::atan(0.1f))};  // 1 m high
  return scene;
}

float MeanOfSubSamples(const LayeredImage& edges, std::string_view channel, int x, int y) {
  for (int row = 0; row < edges.height(); ++row) {
    if (edges.Get(layers::kPixelX).At(0, row) != static_cast<float>(x) ||
        edges.Get(layers::kPixelY).At(0, row) != static_cast<float>(y))
      continue;
    float sum = 0;
    for (int i = 0; i < kSubSamples; ++i) sum += edges.Get(channel).At(i, row);
    return sum / kSubSamples;
  }
  ADD_FAILURE() << "no edge pixel " << x << ',' << y;
  return 0;
}

// The lamp covers a slice of the pixels of row 4 that is thinner than the distance of the sub-samples from
// the border.
TEST(GeometryUnit, AThinSliceOfALampHasItsShareOfThePixel) {
  for (const float slice : {0.02f, 0.1f, 0.2f, 0.9f}) {
    const LayeredImage edges = GeometryOf(LampBelow(-slice), 10, 10).edges;
    for (const int x : {1, 5, 8})
      EXPECT_NEAR(MeanOfSubSamples(edges, "emission.G", x, 4), 1000 * slice, 100 * slice) << slice;
  }
}

TEST(GeometryUnit, OnlyEIsRefined) {
  const EdgedImage bright = GeometryOf(LampBelow(-0.02f), 10, 10);
  scene::Scene scene = LampBelow(-0.02f);
  scene.materials[0] = testing::Emitter({0.5f, 0.5f, 0.5f});
  const EdgedImage dim = GeometryOf(std::move(scene), 10, 10);
  ExpectSameBits(bright.pixels, dim.pixels);
  ASSERT_EQ(bright.edges.height(), dim.edges.height());
  for (const char* name : {"pixel.X", "pixel.Y", "N.X", "N.Z", "distance.Z", "id.Y", "mask.Y", "albedo.R"}) {
    for (int row = 0; row < dim.edges.height(); ++row) {
      for (int i = 0; i < kSubSamples; ++i)
        ASSERT_EQ(bright.edges.Get(name).At(i, row), dim.edges.Get(name).At(i, row)) << name;
    }
  }
  EXPECT_EQ(MeanOfSubSamples(dim.edges, "emission.G", 5, 4), 0) << "a dim lamp is not refined";
}

}  // namespace
}  // namespace lumifold::render
