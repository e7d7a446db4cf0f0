#include "worker/render/textures/texture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "filter/image/color.h"
#include "filter/image/layers.h"
#include "filter/image/mix_bits.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"

namespace lumifold::render {
namespace {

using scene::Vec2;
using scene::Vec4;

scene::ImageData RandomImage(int width, int height) {
  scene::ImageData image;
  image.width = width;
  image.height = height;
  for (int i = 0; i < width * height * 4; ++i)
    image.rgba.push_back(static_cast<uint8_t>(MixBits(static_cast<uint64_t>(i))));
  return image;
}

/// A checkerboard of `cells` x `cells` fields of four texels each.
scene::ImageData Checker(int cells) {
  scene::ImageData image;
  image.width = image.height = 2 * cells;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const auto value = static_cast<uint8_t>((x / 2 + y / 2) % 2 == 0 ? 255 : 0);
      image.rgba.insert(image.rgba.end(), {value, value, value, 255});
    }
  }
  return image;
}

/// One material that uses the image as colour and as data.
scene::Scene SceneOf(scene::ImageData image) {
  scene::Scene scene;
  scene.images = {std::make_shared<const scene::ImageData>(std::move(image))};
  scene.textures = {{.image = 0}};
  scene.materials = {testing::Lambert({1, 1, 1})};
  scene.materials[0].base.color_texture.texture = 0;
  scene.materials[0].specular.factor_texture.texture = 0;
  return scene;
}

Footprint SquareOf(float side) {
  Footprint footprint;
  footprint.diameter[0][0] = {side, 0};
  footprint.diameter[0][1] = {0, side};
  return footprint;
}

float MeanLight(const scene::ImageData& image, const TransferTable& code, int channel) {
  double sum = 0;
  for (size_t i = static_cast<size_t>(channel); i < image.rgba.size(); i += 4)
    sum += static_cast<double>(code.Decode(image.rgba[i]));
  return static_cast<float>(sum / (image.width * image.height));
}

TEST(MipChain, PreservesTheLinearMeanForAnySize) {
  const TransferTable srgb(true);
  const TransferTable linear(false);
  for (const auto& [width, height] : {std::pair{64, 64}, {37, 51}, {5, 3}, {1, 9}, {128, 2}}) {
    const scene::ImageData image = RandomImage(width, height);
    const auto chain = MakeMipChain(image, srgb, linear);
    ASSERT_FALSE(chain.empty());
    EXPECT_EQ(chain.back().width, 1);
    EXPECT_EQ(chain.back().height, 1);
    for (const scene::ImageData& level : chain) {
      EXPECT_NEAR(MeanLight(level, srgb, 1), MeanLight(image, srgb, 1), 0.01f) << width << "x" << height;
      EXPECT_NEAR(MeanLight(level, linear, 3), MeanLight(image, linear, 3), 0.01f) << width << "x" << height;
    }
  }
}

TEST(MipChain, TakesAThirdOfThePicturesMemory) {
  const TransferTable code(false);
  size_t bytes = 0;
  for (const scene::ImageData& level : MakeMipChain(RandomImage(100, 60), code, code))
    bytes += level.rgba.size();
  EXPECT_LE(bytes, 100u * 60 * 4 / 3);
}

TEST(TransferTable, EncodesToTheNearestLinearValue) {
  for (const bool srgb : {false, true}) {
    const TransferTable code(srgb);
    const auto encode = [&code](float linear) {
      uint8_t byte = 0;
      code.Encode(linear, &byte);
      return byte;
    };
    for (int i = 0; i < 256; ++i) {
      const auto byte = static_cast<uint8_t>(i);
      EXPECT_EQ(encode(code.Decode(byte)), byte);
    }
    for (int i = 0; i <= 5000; ++i) {
      const float linear = static_cast<float>(i) / 5000;
      const float off = std::abs(code.Decode(encode(linear)) - linear);
      for (int other = 0; other < 256; ++other)
        EXPECT_LE(off, std::abs(code.Decode(static_cast<uint8_t>(other)) - linear)) << linear;
    }
    EXPECT_EQ(encode(-1), 0);
    EXPECT_EQ(encode(2), 255);
  }
}

TEST(TransferTable, HasAllCodesOfSixteenBits) {
  for (const bool srgb : {false, true}) {
    const TransferTable code(srgb);
    for (int i = 0; i < 65536; ++i) {
      const auto wide = static_cast<uint16_t>(i);
      uint16_t back = 0;
      code.Encode(code.Decode(wide), &back);
      ASSERT_EQ(back, wide);
      const float narrow = code.Decode(static_cast<uint8_t>(i / 257));
      ASSERT_GE(code.Decode(wide), narrow - 1e-6f);
      if (i % 257 == 0) {
        ASSERT_LE(code.Decode(wide), narrow + 1e-6f);
      }
    }
  }
}

TEST(Texture, KeepsSixteenBits) {
  // A ramp of a 256th of the whole range, which has one code of 8 bits.
  scene::Scene scene;
  scene::ImageData image;
  image.width = 64;
  image.height = 1;
  for (int i = 0; i < 64; ++i)
    image.rgba16.insert(image.rgba16.end(), 4, static_cast<uint16_t>(32000 + 4 * i));
  scene.images.push_back(std::make_shared<const scene::ImageData>(image));
  scene.textures.push_back({.image = 0, .wrap_s = scene::Wrap::kClamp});
  scene.materials.emplace_back().normal_map.texture.texture = 0;
  scene.materials[0].base.color_texture.texture = 0;
  const scene::TextureRef ref = {.texture = 0};
  const TextureSampler sampler(scene);
  for (int i = 0; i < 64; ++i) {
    const scene::Vec2 uv[2] = {{(static_cast<float>(i) + 0.5f) / 64, 0.5f}, {}};
    const float value = static_cast<float>(32000 + 4 * i) / 65535;
    EXPECT_NEAR(sampler.Sample(ref, uv, false).x, value, 1e-6f);
    EXPECT_NEAR(sampler.Sample(ref, uv, true).y, LinearFromSrgb(value), 1e-6f);
    EXPECT_NEAR(SampleAlpha(scene, ref, uv[0]), value, 1e-6f);
  }
  const scene::Vec2 middle[2] = {{0.5f, 0.5f}, {}};
  const float mean = (32000 + 126.0f) / 65535;
  EXPECT_NEAR(sampler.Sample(ref, middle, SquareOf(1), false).x, mean, 1e-5f) << "from mip levels";
  EXPECT_NEAR(sampler.Mean(ref, false).x, mean, 1e-6f);
}

TEST(TextureSampler, MagnifiesBilinearlyWhateverTheFootprint) {
  const scene::Scene scene = SceneOf(RandomImage(16, 16));
  const TextureSampler textures(scene);
  const scene::TextureRef& ref = scene.materials[0].base.color_texture;
  for (uint64_t i = 0; i < 100; ++i) {
    const Vec2 uv[2] = {{static_cast<float>(MixBits(i) >> 40) * 0x1p-24f, static_cast<float>(i) * 0.01f}, {}};
    const Vec4 point = textures.Sample(ref, uv, /*srgb=*/true);
    const Vec4 small = textures.Sample(ref, uv, SquareOf(0.9f / 16), /*srgb=*/true);
    EXPECT_EQ(point.x, small.x);
    EXPECT_EQ(point.y, small.y);
    EXPECT_EQ(point.w, small.w);
  }
}

TEST(TextureSampler, ReturnsTheMeanOverTheFootprint) {
  const scene::Scene scene = SceneOf(RandomImage(32, 32));
  const TextureSampler textures(scene);
  const Vec2 uv[2] = {{0.3f, 0.6f}, {}};
  for (const bool srgb : {false, true}) {
    const scene::TextureRef& ref = scene.materials[0].base.color_texture;
    const scene::Vec3 mean = textures.Mean(ref, srgb);
    for (const float side : {1.0f, 50.0f, 1e30f}) {
      const Vec4 seen = textures.Sample(ref, uv, SquareOf(side), srgb);
      EXPECT_NEAR(seen.x, mean.x, 0.01f) << side;
      EXPECT_NEAR(seen.z, mean.z, 0.01f) << side;
    }
  }
}

TEST(TextureSampler, LongFootprintsDoNotBlurAcross) {
  scene::ImageData stripes;  // left half black, right half white
  stripes.width = stripes.height = 64;
  for (int i = 0; i < 64 * 64; ++i) {
    const auto value = static_cast<uint8_t>(i % 64 < 32 ? 0 : 255);
    stripes.rgba.insert(stripes.rgba.end(), {value, value, value, 255});
  }
  const scene::Scene scene = SceneOf(stripes);
  const TextureSampler textures(scene);
  Footprint tall;
  tall.diameter[0][0] = {1.0f / 64, 0};
  tall.diameter[0][1] = {0, 7.5f / 64};
  const Vec2 uv[2] = {{0.45f, 0.5f}, {}};
  EXPECT_LT(textures.Sample(scene.materials[0].base.color_texture, uv, tall, true).x, 0.01f);
  const Vec2 other[2] = {{0.55f, 0.5f}, {}};
  EXPECT_GT(textures.Sample(scene.materials[0].base.color_texture, other, tall, true).x, 0.99f);
}

/// A picture whose texels are `value(x, y)` in all channels.
template <typename Value>
scene::ImageData ImageOf(int width, int height, const Value& value) {
  scene::ImageData image;
  image.width = width;
  image.height = height;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.rgba.insert(image.rgba.end(), 4, static_cast<uint8_t>(value(x, y)));
  }
  return image;
}

TEST(TextureSampler, WrapsBothAxesOnBothSidesByTheirOwnModes) {
  // The texel that stands for each of -4 to 6 on an axis of three.
  constexpr int kFirst = -4;
  const std::vector<std::pair<scene::Wrap, std::array<int, 11>>> modes = {
      {scene::Wrap::kRepeat, {2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0}},
      {scene::Wrap::kMirror, {2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0}},
      {scene::Wrap::kClamp, {0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2}}};
  scene::Scene scene = SceneOf(ImageOf(3, 3, [](int x, int y) { return 10 * x + 70 * y; }));
  const scene::TextureRef& ref = scene.materials[0].base.color_texture;
  const TextureSampler textures(scene);
  const auto sampled = [&](float x, float y) {
    const Vec2 uv[2] = {{(x + 0.5f) / 3, (y + 0.5f) / 3}, {}};
    const float color = textures.Sample(ref, uv, /*srgb=*/false).y;
    EXPECT_NEAR(SampleAlpha(scene, ref, uv[0]), color, 1e-6f);
    return 255 * color;
  };
  for (const auto& [wrap_s, columns] : modes) {
    for (const auto& [wrap_t, rows] : modes) {
      scene.textures[0].wrap_s = wrap_s;
      scene.textures[0].wrap_t = wrap_t;
      for (size_t i = 0; i + 1 < columns.size(); ++i) {
        const size_t j = (3 * i) % (rows.size() - 1);
        // clang before 16 captures structured bindings only so.
        const auto texel = [&columns = columns, &rows = rows](size_t column, size_t row) {
          return static_cast<float>(10 * columns[column] + 70 * rows[row]);
        };
        const float x = static_cast<float>(i) + kFirst;
        const float y = static_cast<float>(j) + kFirst;
        EXPECT_NEAR(sampled(x, y), texel(i, j), 1e-3f) << x << " " << y;
        EXPECT_NEAR(sampled(x + 0.25f, y), 0.75f * texel(i, j) + 0.25f * texel(i + 1, j), 1e-3f) << x;
        EXPECT_NEAR(sampled(x, y + 0.25f), 0.75f * texel(i, j) + 0.25f * texel(i, j + 1), 1e-3f) << y;
      }
    }
  }
}

/// A step from black to white across the middle of an axis of 128 texels; the other one has 8.
struct Step {
  static constexpr float kSize = 128;
  scene::Scene scene;
  TextureSampler textures;
  bool is_in_v;  // else in u

  explicit Step(bool in_v)
      : scene(SceneOf(ImageOf(in_v ? 8 : 128, in_v ? 128 : 8,
                              [in_v](int x, int y) { return (in_v ? y : x) < 64 ? 0 : 255; }))),
        textures(scene),
        is_in_v(in_v) {
    scene.textures[0].wrap_s = scene.textures[0].wrap_t = scene::Wrap::kClamp;
  }
  Vec2 Along(float across_step, float other) const {
    return is_in_v ? Vec2{other, across_step} : Vec2{across_step, other};
  }
  /// The value `offset` texels after the step, over diameters of so many texels; the other axis' are smaller.
  /// `longer_is`: which of the two diameters runs across the step.
  float At(float offset, float across_step, float other, size_t longer_is, int uv_set) {
    scene::TextureRef& ref = scene.materials[0].base.color_texture;
    ref.uv_set = uv_set;
    ref.row_u = {0, 2};  // the surface's axes are swapped, and half as long
    ref.row_v = {2, 0};
    ref.offset = Along(-0.25f, 0.125f);
    const auto on_surface = [](Vec2 v) { return Vec2{v.y / 2, v.x / 2}; };
    Vec2 uv[2];
    uv[uv_set] = on_surface(Along(0.75f + offset / kSize, 0.375f));
    Footprint footprint;
    footprint.diameter[uv_set][longer_is] = on_surface(Along(across_step / kSize, 0));
    footprint.diameter[uv_set][1 - longer_is] = on_surface(Along(0, other / 8));
    return textures.Sample(ref, uv, footprint, /*srgb=*/false).x;
  }
};

TEST(TextureSampler, ALongFootprintIsTheMeanOverAllOfItsLength) {
  for (const bool in_v : {false, true}) {
    Step step(in_v);
    for (const size_t longer_is : {0u, 1u}) {
      for (const int uv_set : {0, 1}) {
        for (int offset = -5; offset <= 5; ++offset) {
          // 8 probes of a texel; then of four, which are one texel of a mip level.
          const float share = std::clamp(0.5f + static_cast<float>(offset) / 8, 0.0f, 1.0f);
          EXPECT_NEAR(step.At(static_cast<float>(offset), 8, 1, longer_is, uv_set), share, 1e-5f) << offset;
          EXPECT_NEAR(step.At(4 * static_cast<float>(offset), 32, 1, longer_is, uv_set), share, 1e-5f)
              << offset;
        }
      }
    }
  }
}

TEST(TextureSampler, BetweenMipLevelsBothCount) {
  Step step(/*in_v=*/false);
  // A texel after the step the level of 2 texels is white, and that of 4 three quarters white.
  EXPECT_NEAR(step.At(1, 2, 2, 0, 0), 1, 1e-5f);
  EXPECT_NEAR(step.At(1, 2.5f, 2.5f, 0, 0), 0.9375f, 1e-5f);
  EXPECT_NEAR(step.At(1, 3, 3, 0, 0), 0.875f, 1e-5f);
  EXPECT_NEAR(step.At(1, 4, 4, 0, 0), 0.75f, 1e-5f);
}

/// A checkered floor up to the horizon at one sample per pixel: T is grey where fields are far smaller than
/// pixels.
TEST(Renderer, DistantTexturesDoNotAlias) {
  scene::Scene scene = SceneOf(Checker(2));
  scene.materials.push_back(testing::Emitter({1, 1, 1}));
  scene::Mesh floor = testing::QuadMesh({-500, 0, -1000}, {0, 0, 1000}, {1000, 0, 0}, 0);
  for (Vec2& uv : floor.uvs[0]) uv = uv * 1000;
  testing::Place(&scene, std::move(floor));
  testing::Place(&scene, testing::QuadMesh({-1, 50, -1}, {2, 0, 0}, {0, 0, 2}, 1));
  scene.cameras = {testing::LookAt({0, 1, 0}, {0, 0.9f, -1}, 0.5f)};
  constexpr int kSize = 96;
  const LayeredImage image = RenderAll(*MakeRenderer(scene, SettingsOf(kSize, kSize, 0)), kSize, kSize, 1);
  const ConstFloatView albedo = image.GetColor(layers::kAlbedo)[1];
  double sum = 0;
  double squares = 0;
  int count = 0;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const auto t = static_cast<double>(albedo.At(x, y));
      const double below_horizon = (y + 0.5 - kSize / 2.0) / kSize * 2 * std::tan(0.25) + std::tan(0.0997);
      if (below_horizon < 0.005 || below_horizon > 0.03) continue;  // 33 m to 200 m away
      sum += t;
      squares += t * t;
      ++count;
    }
  }
  ASSERT_GT(count, 100);
  const double mean = sum / count;
  EXPECT_NEAR(mean, 0.5, 0.02);
  EXPECT_LT(squares / count - mean * mean, 0.01);  // point samples of black and white have 0.25
}

}  // namespace
}  // namespace lumifold::render
