#include "worker/render/geometry/fragments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/surface_key.h"
#include "tests/support/analytic_scenes.h"
#include "tests/support/shuffling_pool.h"
#include "tests/unit/render/pictures.h"

namespace lumifold::render {
namespace {

constexpr int kListedWidth = 40;
constexpr int kListedHeight = 26;
constexpr Rect kListedFrame = {0, 0, kListedWidth, kListedHeight};
constexpr SampleRange kListedSamples = {3, 11};

/// A closed room with a mirror, a pane and a lamp.
scene::Scene Room() {
  scene::Scene room = testing::SmallRoom();
  room.materials[1].base.roughness = 0;
  room.materials[1].base.metallic = 1;
  room.materials[5].base.roughness = 0;
  room.materials[5].transmission.factor = 1;
  room.materials[5].volume.is_solid = true;
  return room;
}

EdgedImage PassOf(const Renderer& renderer, const Rect& rect, SampleRange samples = kListedSamples,
                  RenderCounts* counts = nullptr) {
  RenderCounts own;
  return renderer.RenderPass(rect, 0, samples, counts == nullptr ? &own : counts);
}

/// A row of fragments: its pixel and surface, and the values of all channels.
using Fragment = std::pair<std::array<float, 3>, std::vector<float>>;

std::vector<Fragment> FragmentsOf(const LayeredImage& list) {
  std::vector<Fragment> fragments;
  for (int row = 0; row < list.height(); ++row) {
    Fragment fragment;
    fragment.first = {list.Get(layers::kPixelY).At(0, row), list.Get(layers::kPixelX).At(0, row),
                      list.Get(layers::kSurface).At(0, row)};
    for (const LayeredImage::Channel& channel : list.channels())
      fragment.second.push_back(channel.plane.At(0, row));
    fragments.push_back(std::move(fragment));
  }
  return fragments;
}

std::set<std::pair<float, float>> PixelsOf(const LayeredImage& list) {
  std::set<std::pair<float, float>> pixels;
  for (int row = 0; row < list.height(); ++row)
    pixels.emplace(list.Get(layers::kPixelY).At(0, row), list.Get(layers::kPixelX).At(0, row));
  return pixels;
}

TEST(Fragments, ThePixelsAreThoseOfTheEdgeSet) {
  const auto renderer = MakeRenderer(Room(), SettingsOf(kListedWidth, kListedHeight));
  const EdgedImage pass = PassOf(*renderer, kListedFrame);
  const std::set<std::pair<float, float>> edges = PixelsOf(renderer->RenderGeometry(kListedFrame, 0).edges);
  ASSERT_GT(edges.size(), 50u);
  EXPECT_EQ(PixelsOf(pass.fragments), edges);
  EXPECT_GT(pass.fragments.height(), static_cast<int>(edges.size()) * 5 / 4);
  EXPECT_TRUE(pass.edges.channels().empty());
  ASSERT_EQ(pass.fragments.channels().size(), layers::FragmentChannels().size());
  for (size_t i = 0; i < layers::FragmentChannels().size(); ++i)
    EXPECT_EQ(pass.fragments.channels()[i].name, layers::FragmentChannels()[i]);
  const std::vector<Fragment> fragments = FragmentsOf(pass.fragments);
  EXPECT_TRUE(std::is_sorted(fragments.begin(), fragments.end()));
}

TEST(Fragments, AddUpToTheirPixel) {
  const auto renderer = MakeRenderer(Room(), SettingsOf(kListedWidth, kListedHeight));
  const EdgedImage pass = PassOf(*renderer, kListedFrame);
  const LayeredImage& list = pass.fragments;
  for (const char* name : {"direct_a.R", "direct_b.G", "indirect_a.B", "glossy_a.R", "glossy_b.B", "albedo.G",
                           "emission.R", "glossy_albedo.G", "samples_a.Y", "samples_b.Y"}) {
    std::map<std::pair<int, int>, double> sums;
    for (int row = 0; row < list.height(); ++row) {
      sums[{static_cast<int>(list.Get(layers::kPixelX).At(0, row)),
            static_cast<int>(list.Get(layers::kPixelY).At(0, row))}] += list.Get(name).At(0, row);
    }
    for (const auto& [pixel, sum] : sums) {
      const float of_pixel = pass.pixels.Get(name).At(pixel.first, pixel.second);
      ASSERT_NEAR(sum, of_pixel, 1e-5 * std::max(1.0f, of_pixel)) << name;
    }
  }
}

TEST(Fragments, AreTheSumsOfTheSamplesThatHitTheirSurface) {
  const auto renderer = MakeRenderer(Room(), SettingsOf(kListedWidth, kListedHeight));
  std::map<std::array<float, 3>, FragmentSums> expected;
  ChartsAccess(*renderer).TraceSamples(kListedFrame, 0, kListedSamples, [&](const SampleRecord& sample) {
    const GeometrySample& g = sample.geometry;
    const float surface =
        SurfaceKey(static_cast<float>(g.instance + 1), {g.normal.x, g.normal.y, g.normal.z}, g.distance);
    const auto y = sample.pixel / kListedWidth;
    const auto x = sample.pixel % kListedWidth;
    FragmentSums& sums = expected[{static_cast<float>(y), static_cast<float>(x), surface}];
    sums.Add(sample.layers, sample.index & 1);
  });
  const LayeredImage list = PassOf(*renderer, kListedFrame).fragments;
  ASSERT_GT(list.height(), 0);
  for (int row = 0; row < list.height(); ++row) {
    const auto get = [&](std::string_view name) { return list.Get(name).At(0, row); };
    const auto found = expected.find({get("pixel.Y"), get("pixel.X"), get("surface.Y")});
    ASSERT_NE(found, expected.end()) << "the geometry of a camera ray gives the key of its sample";
    const FragmentSums& sums = found->second;
    EXPECT_EQ(get("N.X"), sums.normal.x);
    EXPECT_EQ(get("N.Z"), sums.normal.z);
    EXPECT_EQ(get("distance.Z"), sums.distance);
    EXPECT_EQ(get("roughness.Y"), sums.roughness);
    EXPECT_EQ(get("direct_a.R"), sums.halved[0][0].x);
    EXPECT_EQ(get("direct_b.G"), sums.halved[1][0].y);
    EXPECT_EQ(get("indirect_a.B"), sums.halved[0][1].z);
    EXPECT_EQ(get("glossy_b.R"), sums.halved[1][2].x);
    EXPECT_EQ(get("albedo.G"), sums.whole[0].y);
    EXPECT_EQ(get("emission.B"), sums.whole[1].z);
    EXPECT_EQ(get("glossy_albedo.B"), sums.whole[2].z);
    EXPECT_EQ(get("samples_a.Y"), sums.count[0]);
    EXPECT_EQ(get("samples_b.Y"), sums.count[1]);
  }
}

TEST(Fragments, TheFirstHitOfASampleIsThatOfItsGeometry) {
  const auto renderer = MakeRenderer(Room(), SettingsOf(kListedWidth, kListedHeight));
  int hits = 0;
  ChartsAccess(*renderer).TraceSamples(kListedFrame, 0, {0, 4}, [&](const SampleRecord& sample) {
    const FirstHit& first = sample.layers.first;
    ASSERT_EQ(first.instance, sample.geometry.instance);
    ASSERT_EQ(first.normal, sample.geometry.normal);
    ASSERT_EQ(first.distance, sample.geometry.distance);
    ASSERT_EQ(first.roughness, sample.geometry.roughness);
    hits += sample.geometry.hit ? 1 : 0;
  });
  EXPECT_EQ(hits, 4 * kListedWidth * kListedHeight);
}

TEST(Fragments, SamplesThatHitNothingAreInNone) {
  scene::Scene scene;
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f}), testing::Emitter({2, 2, 2})};
  testing::Place(&scene, testing::QuadMesh({0.02f, -9, -3.0f}, {9, 0, 0}, {0, 18, 0}, 0));  // on the right
  testing::Place(&scene, testing::QuadMesh({-9, 5, -9}, {18, 0, 0}, {0, 0, 18}, 1));
  scene.cameras = {testing::LookAt({0, 0, 0}, {0, 0, -1}, 0.5f)};
  const EdgedImage pass = PassOf(*MakeRenderer(std::move(scene), SettingsOf(9, 9)), {0, 0, 9, 9}, {0, 16});
  const LayeredImage& list = pass.fragments;
  int partly = 0;
  for (int row = 0; row < list.height(); ++row) {
    EXPECT_GE(list.Get(layers::kPixelX).At(0, row), 4);
    const float count = list.Get(layers::kSamplesA).At(0, row) + list.Get(layers::kSamplesB).At(0, row);
    EXPECT_GT(count, 0);
    if (count < 16) ++partly;
  }
  EXPECT_EQ(partly, 9) << "one pixel of each row";
}

LayerSample SampleOn(int instance, float direct) {
  LayerSample sample;
  sample.Clear();
  sample.first = {instance, {0, 0, 1}, 2};
  sample.direct = {direct, direct, direct};
  return sample;
}

TEST(Fragments, FurtherSurfacesBelongToTheLastOne) {
  PixelFragments pixel;
  for (int instance = 0; instance < 20; ++instance) pixel.Add(SampleOn(instance, 1), instance % 2);
  pixel.Add(SampleOn(3, 1), 0);
  LayerSample miss;
  miss.Clear();
  pixel.Add(miss, 0);
  const auto fragments = pixel.Sorted();
  ASSERT_EQ(fragments.size(), static_cast<size_t>(kMaxFragments));
  const auto key = [](int instance) { return SurfaceKey(static_cast<float>(instance + 1), {0, 0, 1}, 2); };
  float samples = 0;
  for (size_t i = 0; i < fragments.size(); ++i) {
    const FragmentSums& f = fragments[i];
    if (i > 0) {
      EXPECT_LT(fragments[i - 1].surface, f.surface);
    }
    const float count = f.count[0] + f.count[1];
    samples += count;
    EXPECT_EQ(f.halved[0][0].x + f.halved[1][0].x, count);
    const float expected = f.surface == key(3) ? 2.0f : f.surface == key(kMaxFragments - 1) ? 13.0f : 1.0f;
    EXPECT_EQ(count, expected);
  }
  EXPECT_EQ(samples, 21);
}

TEST(Fragments, HaveTheLayersOfThePlan) {
  RenderSettings settings = SettingsOf(kListedWidth, kListedHeight);
  settings.plan.layers.indirect = false;
  const LayeredImage list = PassOf(*MakeRenderer(Room(), settings), kListedFrame).fragments;
  EXPECT_TRUE(list.Has("direct_b.B"));
  EXPECT_TRUE(list.Has("albedo.R"));
  EXPECT_FALSE(list.Has("indirect_a.R"));
  const LayeredImage all =
      PassOf(*MakeRenderer(Room(), SettingsOf(kListedWidth, kListedHeight)), kListedFrame).fragments;
  for (int row = 0; row < list.height(); ++row)
    ASSERT_EQ(list.Get("direct_b.B").At(0, row), all.Get("direct_b.B").At(0, row));
  settings.plan.layers.glossy = false;
  const LayeredImage diffuse = PassOf(*MakeRenderer(Room(), settings), kListedFrame).fragments;
  for (const char* name : {"glossy_a.R", "glossy_albedo.G", "roughness.Y"}) {
    EXPECT_TRUE(list.Has(name)) << name;
    EXPECT_FALSE(diffuse.Has(name)) << name;
  }
  settings.plan.layers.direct = false;
  EXPECT_TRUE(PassOf(*MakeRenderer(Room(), settings), kListedFrame).fragments.channels().empty());
}

TEST(Fragments, AreIndependentOfTilesThreadsOrderAndOfWhatWasRenderedBefore) {
  const std::vector<Fragment> expected = FragmentsOf(
      PassOf(*MakeRenderer(Room(), SettingsOf(kListedWidth, kListedHeight)), kListedFrame).fragments);
  const std::unique_ptr<TaskPool> four = MakeTaskPool(4);
  ShufflingPool shuffled(5);
  const auto used = MakeRenderer(Room(), SettingsOf(kListedWidth, kListedHeight));
  for (const int size : {1, 7, 16}) {
    std::vector<Rect> tiles;
    for (int y = 0; y < kListedHeight; y += size) {
      for (int x = 0; x < kListedWidth; x += size)
        tiles.push_back({x, y, std::min(x + size, kListedWidth), std::min(y + size, kListedHeight)});
    }
    for (TaskPool* pool : {four.get(), static_cast<TaskPool*>(&shuffled)}) {
      std::vector<LayeredImage> lists(tiles.size());
      pool->Run(static_cast<int64_t>(tiles.size()), [&](int64_t i) {
        const auto tile = static_cast<size_t>(i);
        if (i % 3 == 0) used->RenderGeometry(tiles[tile], 0);
        if (i % 3 == 1) PassOf(*used, tiles[tile], {0, 2});
        lists[tile] = PassOf(*used, tiles[tile]).fragments;
      });
      std::vector<Fragment> all = FragmentsOf(JoinRows(lists));
      std::sort(all.begin(), all.end());
      EXPECT_EQ(all, expected) << size;
    }
  }
}

TEST(Fragments, AreOfThePixelsOfTheEdgeSetAlsoNextToALamp) {
  scene::Scene room = Room();
  testing::Place(&room, testing::QuadMesh({-0.3f, -0.3f, 0.3f}, {0.6f, 0, 0}, {0, 0.6f, 0}, 3));
  const RenderSettings settings = SettingsOf(kListedWidth, kListedHeight);
  const LayeredImage edges = MakeRenderer(room, settings)->RenderGeometry(kListedFrame, 0).edges;
  const LayeredImage fragments = PassOf(*MakeRenderer(room, settings), kListedFrame).fragments;
  const auto pixels_of = [](const LayeredImage& list) {
    std::set<std::pair<float, float>> pixels;
    for (int row = 0; row < list.height(); ++row)
      pixels.emplace(list.Get(layers::kPixelX).At(0, row), list.Get(layers::kPixelY).At(0, row));
    return pixels;
  };
  EXPECT_EQ(pixels_of(edges), pixels_of(fragments));
  int of_lamp = 0;
  const ConstFloatView red = edges.GetColor(layers::kEmission)[0];
  for (int row = 0; row < edges.height(); ++row) {
    const auto values = std::span(red.Row(row), static_cast<size_t>(kSubSamples));
    of_lamp += std::any_of(values.begin(), values.end(), [](float value) { return value > 1; }) ? 1 : 0;
  }
  EXPECT_GT(of_lamp, 20);
}

TEST(Fragments, TheRaysThatFindEdgesAreNotCounted) {
  const auto renderer = MakeRenderer(Room(), SettingsOf(kListedWidth, kListedHeight));
  std::array<RenderCounts, 2> counts;
  for (RenderCounts& count : counts) PassOf(*renderer, kListedFrame, kListedSamples, &count);
  EXPECT_EQ(counts[0].rays, counts[1].rays) << "the second pass remembers the edge pixels";
}

TEST(EdgeMask, TheCacheForgetsTheOldest) {
  EdgeMaskCache cache;
  const auto tile = [](int number) { return Rect{number * 2048, 0, (number + 1) * 2048, 2048}; };
  for (int i = 0; i < 6; ++i) {
    auto mask = std::make_shared<EdgeMask>(tile(i));
    mask->Set(i * 2048 + 1, i, true);
    cache.Keep(std::move(mask));
  }
  EXPECT_EQ(cache.Find(tile(1)), nullptr);
  ASSERT_NE(cache.Find(tile(2)), nullptr);
  EXPECT_TRUE(cache.Find(tile(5))->Has(5 * 2048 + 1, 5));
  EXPECT_FALSE(cache.Find(tile(5))->Has(5 * 2048 + 2, 5));
  EXPECT_EQ(cache.Find({0, 0, 1, 1}), nullptr);
}

TEST(EdgeMask, AStoppedUnitIsNotRemembered) {
  const auto renderer = MakeRenderer(Room(), SettingsOf(kListedWidth, kListedHeight));
  const std::atomic<bool> stop = true;
  RenderCounts stopped;
  stopped.stop = &stop;
  PassOf(*renderer, kListedFrame, kListedSamples, &stopped);
  renderer->RenderGeometry(kListedFrame, 0, &stop);
  EXPECT_GT(PassOf(*renderer, kListedFrame).fragments.height(), 0);
}

}  // namespace
}  // namespace lumifold::render
