#include "tests/unit/render/pictures.h"

#include <gtest/gtest.h>

#include <cstring>
#include <utility>

#include "filter/image/layers.h"

namespace lumifold::render {

RenderSettings SettingsOf(int width, int height, int max_bounces) {
  RenderSettings settings;
  settings.width = width;
  settings.height = height;
  settings.max_bounces = max_bounces;
  return settings;
}

std::unique_ptr<Renderer> MakeRenderer(scene::Scene scene, const RenderSettings& settings,
                                       LightStrategy strategy) {
  auto renderer = Renderer::Create(std::make_shared<scene::Scene>(std::move(scene)), settings);
  EXPECT_TRUE(renderer.ok()) << renderer.status();
  ChartsAccess::SetLightStrategy(strategy, renderer->get());
  return *std::move(renderer);
}

LayeredImage RenderAll(const Renderer& renderer, int width, int height, uint32_t spp) {
  RenderCounts counts;
  LayeredImage image = renderer.RenderPass({0, 0, width, height}, 0, {0, spp}, &counts).pixels;
  EXPECT_EQ(counts.samples, int64_t{width} * height * spp);
  EXPECT_EQ(counts.bad_samples, 0);
  return image;
}

LayeredImage RenderAllRadiance(const Renderer& renderer, int width, int height, uint32_t spp) {
  RenderCounts counts;
  const ChartsAccess access(renderer);
  LayeredImage image = access.RenderRadiance({0, 0, width, height}, 0, {0, spp}, &counts);
  EXPECT_EQ(counts.samples, int64_t{width} * height * spp);
  EXPECT_EQ(counts.bad_samples, 0);
  return image;
}

void ExpectSameBits(const LayeredImage& a, const LayeredImage& b) {
  ASSERT_EQ(a.bounds(), b.bounds());
  const Plane zeros(a.width(), a.height());
  for (const auto& [some, others] : {std::pair{&a, &b}, {&b, &a}}) {
    for (const LayeredImage::Channel& channel : some->channels()) {
      const ConstFloatView other =
          others->Has(channel.name) ? others->Get(channel.name) : ConstFloatView(zeros.view());
      for (int y = 0; y < a.height(); ++y) {
        const size_t bytes = sizeof(float) * static_cast<size_t>(a.width());
        ASSERT_EQ(std::memcmp(channel.plane.Row(y), other.Row(y), bytes), 0) << channel.name << " row " << y;
      }
    }
  }
}

LayeredImage Cut(const LayeredImage& image, const Rect& rect) {
  LayeredImage cut(rect.width(), rect.height());
  for (const LayeredImage::Channel& channel : image.channels())
    CopyPlane(channel.plane.view().Crop(rect), cut.Add(channel.name));
  return cut;
}

double MeanOf(const LayeredImage& sums, std::string_view layer, int component) {
  const ConstFloatView a = sums.GetColor(layers::HalfA(layer))[component];
  const ConstFloatView b = sums.GetColor(layers::HalfB(layer))[component];
  double total = 0;
  double count = 0;
  for (int y = 0; y < sums.height(); ++y) {
    for (int x = 0; x < sums.width(); ++x) {
      total += static_cast<double>(a.At(x, y)) + static_cast<double>(b.At(x, y));
      count +=
          static_cast<double>(sums.Get(layers::kSamplesA).At(x, y) + sums.Get(layers::kSamplesB).At(x, y));
    }
  }
  return total / count;
}

}  // namespace lumifold::render
