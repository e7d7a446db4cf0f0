// The bits do not depend on tiles, threads, order or passes.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "tests/support/analytic_scenes.h"
#include "tests/support/shuffling_pool.h"
#include "tests/unit/render/pictures.h"

namespace lumifold::render {
namespace {

constexpr int kPinnedWidth = 40;
constexpr int kPinnedHeight = 26;
constexpr int kPinnedFrame = 3;
constexpr SampleRange kPinnedSamples = {6, 10};

std::vector<Rect> Tiles(int size) {
  std::vector<Rect> tiles;
  for (int y = 0; y < kPinnedHeight; y += size) {
    for (int x = 0; x < kPinnedWidth; x += size) {
      tiles.push_back({x, y, std::min(x + size, kPinnedWidth), std::min(y + size, kPinnedHeight)});
    }
  }
  return tiles;
}

/// The pass and geometry units of one frame, rendered by tiles and assembled.
struct RenderedFrame {
  LayeredImage pass{kPinnedWidth, kPinnedHeight};
  LayeredImage geometry{kPinnedWidth, kPinnedHeight};
};

void Paste(const LayeredImage& tile, const Rect& rect, LayeredImage* frame) {
  for (const LayeredImage::Channel& channel : tile.channels()) {
    if (!frame->Has(channel.name)) frame->Add(channel.name);
    CopyPlane(channel.plane.view(), frame->Get(channel.name).Crop(rect));
  }
}

RenderedFrame RenderFrame(const Renderer& renderer, int tile_size, TaskPool& pool) {
  const std::vector<Rect> tiles = Tiles(tile_size);
  std::vector<LayeredImage> passes(tiles.size());
  std::vector<LayeredImage> geometries(tiles.size());
  pool.Run(static_cast<int64_t>(tiles.size()), [&](int64_t i) {
    RenderCounts counts;
    passes[i] = renderer.RenderPass(tiles[i], kPinnedFrame, kPinnedSamples, &counts).pixels;
    geometries[i] = renderer.RenderGeometry(tiles[i], kPinnedFrame).pixels;
  });
  RenderedFrame frame;
  for (size_t i = 0; i < tiles.size(); ++i) {
    Paste(passes[i], tiles[i], &frame.pass);
    Paste(geometries[i], tiles[i], &frame.geometry);
  }
  return frame;
}

void ExpectSameChannels(const LayeredImage& a, const LayeredImage& b) {
  ASSERT_EQ(a.channels().size(), b.channels().size());
  for (const LayeredImage::Channel& channel : a.channels()) {
    const ConstFloatView other = b.Get(channel.name);
    for (int y = 0; y < a.height(); ++y) {
      ASSERT_EQ(std::memcmp(channel.plane.Row(y), other.Row(y), sizeof(float) * kPinnedWidth), 0)
          << channel.name << " row " << y;
    }
  }
}

TEST(Determinism, IsIndependentOfTileSizeThreadsAndOrder) {
  const auto renderer = MakeRenderer(testing::SmallRoom(), SettingsOf(kPinnedWidth, kPinnedHeight));
  const std::unique_ptr<TaskPool> alone = MakeTaskPool(1);
  const std::unique_ptr<TaskPool> four = MakeTaskPool(4);
  ShufflingPool shuffled(5);
  const RenderedFrame expected = RenderFrame(*renderer, 64, *alone);
  for (const int tile_size : {1, 7, 16, 64}) {
    for (TaskPool* pool : {four.get(), static_cast<TaskPool*>(&shuffled)}) {
      const RenderedFrame frame = RenderFrame(*renderer, tile_size, *pool);
      ExpectSameChannels(frame.pass, expected.pass);
      ExpectSameChannels(frame.geometry, expected.geometry);
    }
  }
}

TEST(Determinism, APassIsIndependentOfEarlierPasses) {
  const auto used = MakeRenderer(testing::SmallRoom(), SettingsOf(kPinnedWidth, kPinnedHeight));
  const auto fresh = MakeRenderer(testing::SmallRoom(), SettingsOf(kPinnedWidth, kPinnedHeight));
  const Rect rect = {8, 4, 24, 20};
  RenderCounts counts;
  for (const SampleRange before : {SampleRange{0, 4}, SampleRange{10, 20}, kPinnedSamples})
    used->RenderPass(rect, kPinnedFrame, before, &counts);
  const LayeredImage late = used->RenderPass(rect, kPinnedFrame, kPinnedSamples, &counts).pixels;
  const LayeredImage first = fresh->RenderPass(rect, kPinnedFrame, kPinnedSamples, &counts).pixels;
  RenderedFrame a;
  RenderedFrame b;
  Paste(late, rect, &a.pass);
  Paste(first, rect, &b.pass);
  ExpectSameChannels(a.pass, b.pass);
}

/// FNV-1a over the bits of all channels.
uint64_t HashOf(const LayeredImage& image) {
  uint64_t hash = 0xcbf29ce484222325u;
  for (const LayeredImage::Channel& channel : image.channels()) {
    ForEachPixel(image.width(), image.height(), [&](int x, int y) {
      uint32_t bits = std::bit_cast<uint32_t>(channel.plane.At(x, y));
      for (int byte = 0; byte < 4; ++byte, bits >>= 8) hash = (hash ^ (bits & 0xffu)) * 0x100000001b3u;
    });
  }
  return hash;
}

/// The class without the hash of the sources, so that bits are compared over their changes.
std::string ClassOfMachine() {
  std::string name = NumericClass();
  const size_t last = name.rfind('-');
  const size_t hash = name.rfind('-', last - 1);
  EXPECT_EQ(last - hash, 9u) << name;
  return name.erase(hash, last - hash);
}

// A change of the renderer changes these bits on purpose: then the failing test prints the new ones.
TEST(Determinism, KeepsTheBitsOfItsNumericClass) {
  const std::map<std::string, uint64_t> expected = {
      {"lumifold-0.1.0/embree3-avx2-b5e4", 0xac3cf5ea1cf7e3bcu},
      {"lumifold-0.1.0/embree4-avx2-b5e4", 0xac3cf5ea1cf7e3bcu}};
  const auto renderer = MakeRenderer(testing::SmallRoom(), SettingsOf(kPinnedWidth, kPinnedHeight));
  const std::unique_ptr<TaskPool> alone = MakeTaskPool(1);
  const RenderedFrame frame = RenderFrame(*renderer, 64, *alone);
  const uint64_t hash = HashOf(frame.pass) ^ HashOf(frame.geometry);
  const auto found = expected.find(ClassOfMachine());
  if (found == expected.end())
    GTEST_SKIP() << "no bits are written down for " << ClassOfMachine() << "; here they are 0x" << std::hex
                 << hash;
  EXPECT_EQ(found->second, hash) << "{\"" << ClassOfMachine() << "\", 0x" << std::hex << hash << "u}";
}

}  // namespace
}  // namespace lumifold::render
