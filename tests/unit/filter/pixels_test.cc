#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/image/mix_bits.h"
#include "filter/image/planes.h"
#include "filter/image/surface_key.h"
#include "filter/methods.h"

// The bits of every method's picture of one film. They are the same on every processor: the film is made of
// integers, and the filter promises its bits for any instruction set. A change of the method changes them on
// purpose: then the failing test prints the new table.
namespace lumifold::filter {
namespace {

constexpr int kPinnedWidth = 72;
constexpr int kPinnedHeight = 56;
constexpr int kPinnedEdgeColumn = 30;             // one surface ends within it
constexpr Rect kPinnedMirror = {44, 20, 66, 44};  // shows a level
constexpr float kHalfSamples = 3;                 // of each half

/// A number in [0, 1), fixed for each key.
float Uniform(uint64_t key) { return static_cast<float>(MixBits(key) >> 40) * 0x1p-24f; }

/// PinnedNoise of mean about 1 that is now and then large.
float PinnedNoise(uint64_t layer, int half, int x, int y) {
  const uint64_t key = ((layer * 2 + static_cast<uint64_t>(half)) * 4096 + static_cast<uint64_t>(y)) * 4096 +
                       static_cast<uint64_t>(x);
  const float u = Uniform(key);
  return u > 0.995f ? 12.0f : 0.4f + 1.2f * u;
}

void SetGraded(const ColorView& color, int x, int y, float value) {
  for (size_t c = 0; c < 3; ++c) color[c].At(x, y) = value * (1.0f - 0.25f * static_cast<float>(c));
}

void AddPinnedLayer(const std::string& layer, LayeredImage* film) {
  for (const std::string& name : {layer, layers::HalfA(layer), layers::HalfB(layer)}) film->AddColor(name);
}

/// Sets the noisy halves and the mean of a layer, and adds `factor` times them to C.
void SetLayer(const std::string& layer, uint64_t number, int x, int y, float light, float factor,
              LayeredImage* film) {
  float sum = 0;
  for (int half = 0; half < 2; ++half) {
    const auto name_of = half == 0 ? layers::HalfA : layers::HalfB;
    const float value = light * PinnedNoise(number, half, x, y);
    SetGraded(film->GetColor(name_of(layer)), x, y, value);
    for (size_t c = 0; c < 3; ++c)
      film->GetColor(name_of(layers::kNoisy))[c].At(x, y) +=
          factor * film->GetColor(name_of(layer))[c].At(x, y);
    sum += value;
  }
  SetGraded(film->GetColor(layer), x, y, 0.5f * sum);
  for (size_t c = 0; c < 3; ++c)
    film->GetColor(layers::kNoisy)[c].At(x, y) += factor * film->GetColor(layer)[c].At(x, y);
}

LayeredImage EmptyFilm(const layers::Level& level) {
  LayeredImage film(kPinnedWidth, kPinnedHeight);
  for (const std::string_view layer : layers::kHalved) AddPinnedLayer(std::string(layer), &film);
  for (const std::string_view layer : layers::kWhole) film.AddColor(layer);
  for (const std::string_view name :
       {layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance, layers::kObjectId,
        layers::kMask, layers::kRoughness, layers::kSamplesA, layers::kSamplesB})
    film.Add(name);
  for (const std::string_view layer : layers::kLevelHalved)
    AddPinnedLayer(layers::OfLevel(level, layer), &film);
  for (const std::string_view layer : layers::kLevelWhole) film.AddColor(layers::OfLevel(level, layer));
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB})
    film.Add(layers::OfLevel(level, name));
  for (const std::string& name : layers::LevelFeatureChannels(level)) film.Add(name);
  return film;
}

void SetMirror(const layers::Level& level, int x, int y, LayeredImage* film) {
  const auto channel = [&](std::string_view name) { return film->Get(layers::OfLevel(level, name)); };
  const bool is_left = x < 54;
  SetGraded(film->GetColor(layers::OfLevel(level, layers::kAlbedo)), x, y, 0.8f);
  SetLayer(layers::OfLevel(level, layers::kDirect), 4, x, y, is_left ? 1.0f : 0.3f, 0.8f, film);
  SetLayer(layers::OfLevel(level, layers::kIndirect), 5, x, y, 0.2f, 0.8f, film);
  channel(is_left ? layers::kNormalX : layers::kNormalY).At(x, y) = 1;
  channel(layers::kDistance).At(x, y) = is_left ? 5.0f : 7.0f;
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB})
    channel(name).At(x, y) = kHalfSamples;
  channel(layers::kMask).At(x, y) = 1;
}

/// Two walls that meet in a column of edge pixels, with a gloss of their own, and a mirror before the second.
EdgedImage PinnedFilm() {
  const layers::Level level = {layers::Branch::kReflection, 1};
  EdgedImage film{EmptyFilm(level), LayeredImage(kSubSamples, kPinnedHeight)};
  ForEachPixel(kPinnedWidth, kPinnedHeight, [&](int x, int y) {
    LayeredImage* pixels = &film.pixels;
    const bool is_right = x > kPinnedEdgeColumn || (x == kPinnedEdgeColumn && y % 2 == 0);
    const bool is_mirror = kPinnedMirror.Contains(x, y);
    const float albedo = is_mirror ? 0.0f : ((x / 9 + y / 9) % 2 == 0 ? 0.75f : 0.25f);
    const float shade = (y < 24 ? 1.0f : 0.25f) * (is_right ? 1.0f : 0.5f);
    SetGraded(pixels->GetColor(layers::kAlbedo), x, y, albedo);
    if (!is_mirror) {
      SetLayer(std::string(layers::kDirect), 1, x, y, shade, albedo, pixels);
      SetLayer(std::string(layers::kIndirect), 2, x, y, 0.3f, albedo, pixels);
    }
    SetGraded(pixels->GetColor(layers::kGlossyAlbedo), x, y, is_right ? 0.0625f : 0.0f);
    if (is_right) SetLayer(std::string(layers::kGlossy), 3, x, y, 0.4f, 0.0625f, pixels);
    pixels->Get(is_right ? layers::kNormalZ : layers::kNormalX).At(x, y) = 1;
    pixels->Get(layers::kDistance).At(x, y) = is_right ? 3.0f : 2.0f;
    pixels->Get(layers::kObjectId).At(x, y) = is_right ? 2.0f : 1.0f;
    pixels->Get(layers::kMask).At(x, y) = is_mirror ? 0.0f : 1.0f;
    pixels->Get(layers::kRoughness).At(x, y) = 0.5f;
    for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB})
      pixels->Get(name).At(x, y) = kHalfSamples;
    if (is_mirror) SetMirror(level, x, y, pixels);
  });
  for (const std::string& name : layers::EdgeChannels()) film.edges.Add(name);
  ForEachPixel(kSubSamples, kPinnedHeight, [&](int j, int y) {
    const bool is_right = j % 4 >= 2;
    film.edges.Get(layers::kPixelX).At(j, y) = kPinnedEdgeColumn;
    film.edges.Get(layers::kPixelY).At(j, y) = static_cast<float>(y);
    film.edges.Get(is_right ? layers::kNormalZ : layers::kNormalX).At(j, y) = 1;
    film.edges.Get(layers::kDistance).At(j, y) = is_right ? 3.0f : 2.0f;
    film.edges.Get(layers::kObjectId).At(j, y) = is_right ? 2.0f : 1.0f;
    film.edges.Get(layers::kMask).At(j, y) = 1;
    SetGraded(film.edges.GetColor(layers::kAlbedo), j, y, y / 9 % 2 == 0 ? 0.25f : 0.75f);
  });
  return film;
}

/// Both surfaces of the edge pixels of PinnedFilm(), with light of their own.
LayeredImage Fragments() {
  LayeredImage list(1, 2 * kPinnedHeight);
  for (const std::string& name : layers::FragmentChannels()) list.Add(name);
  for (int row = 0; row < list.height(); ++row) {
    const int y = row / 2;
    const bool is_right = row % 2 == 1;
    const auto set = [&](std::string_view name, float value) { list.Get(name).At(0, row) = value; };
    set(layers::kPixelX, kPinnedEdgeColumn);
    set(layers::kPixelY, static_cast<float>(y));
    set(is_right ? layers::kNormalZ : layers::kNormalX, 1);
    set(layers::kDistance, is_right ? 3.0f : 2.0f);
    set(layers::kSurface,
        SurfaceKey(is_right ? 2.0f : 1.0f, {is_right ? 0.0f : 1.0f, 0, is_right ? 1.0f : 0.0f},
                   is_right ? 3.0f : 2.0f));
    set(layers::kSamplesA, is_right ? 2 : 1);
    set(layers::kSamplesB, is_right ? 1 : 2);
    SetGraded(list.GetColor(layers::kAlbedo), 0, row, y / 9 % 2 == 0 ? 0.25f : 0.75f);
    SetGraded(list.GetColor(layers::kGlossyAlbedo), 0, row, is_right ? 0.5f : 0.0625f);
    set(layers::kRoughness, is_right ? 0.25f : 1.0f);
    for (int half = 0; half < 2; ++half) {
      const auto name_of = half == 0 ? layers::HalfA : layers::HalfB;
      SetGraded(list.GetColor(name_of(layers::kDirect)), 0, row,
                (is_right ? 1.0f : 0.5f) * PinnedNoise(6, half, row, y));
      SetGraded(list.GetColor(name_of(layers::kIndirect)), 0, row, 0.3f * PinnedNoise(7, half, row, y));
      SetGraded(list.GetColor(name_of(layers::kGlossy)), 0, row,
                (is_right ? 0.9f : 0.4f) * PinnedNoise(8, half, row, y));
    }
  }
  return list;
}

/// FNV-1a over the bits of all pixels.
uint64_t HashOf(const Picture& picture) {
  uint64_t hash = 0xcbf29ce484222325u;
  for (const Plane& plane : picture) {
    ForEachPixel(plane.width(), plane.height(), [&](int x, int y) {
      uint32_t bits = std::bit_cast<uint32_t>(plane.At(x, y));
      for (int byte = 0; byte < 4; ++byte, bits >>= 8) hash = (hash ^ (bits & 0xffu)) * 0x100000001b3u;
    });
  }
  return hash;
}

TEST(Pixels, KeepTheirBits) {
  const std::map<std::string, uint64_t> expected = {
      {"default", 0xe923dc423cabb763u},   {"paper", 0x9dfe019c5ea61582u},
      {"none", 0xc5f6e8174aa33802u},      {"manifolds-color", 0x5dfe43c596f5b4cbu},
      {"bilateral", 0xeec5475b4fc88194u}, {"cross-bilateral", 0xcf000612821a84e1u},
      {"a-trous", 0x676b655df5ae390eu},   {"a-trous-variance", 0xbd85f162d725d765u},
      {"guided", 0x4b87c4114438bc4eu},    {"nlm", 0x59dabbd786b39c6au},
      {"nfor", 0x642b8aacb2c58b6u},
  };
  const EdgedImage film = PinnedFilm();
  for (const MethodInfo& method : Methods()) {
    const absl::StatusOr<Picture> picture = FilterFilm(film.pixels, method.name, nullptr, &film.edges);
    ASSERT_TRUE(picture.ok()) << picture.status();
    const auto found = expected.find(method.name);
    const uint64_t hash = HashOf(*picture);
    EXPECT_TRUE(found != expected.end() && found->second == hash)
        << "{\"" << method.name << "\", 0x" << std::hex << hash << "u},";
  }
}

TEST(Pixels, KeepTheirBitsWithFragments) {
  const EdgedImage film = PinnedFilm();
  const LayeredImage fragments = Fragments();
  const absl::StatusOr<Picture> picture =
      FilterFilm(film.pixels, "default", nullptr, &film.edges, &fragments);
  ASSERT_TRUE(picture.ok()) << picture.status();
  EXPECT_EQ(HashOf(*picture), 0x7fa1f90895f77aafu) << "0x" << std::hex << HashOf(*picture) << "u";
}

}  // namespace
}  // namespace lumifold::filter
