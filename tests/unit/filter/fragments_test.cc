#include "filter/layers/fragments.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/surface_key.h"
#include "filter/layers/layer_fragments.h"

namespace lumifold::filter {
namespace {

struct Surface {
  float id = 0;
  std::array<float, 3> normal = {};
  float distance = 0;
  float albedo = 0;
  float emission = 0;
  float glossy_albedo = 0;
  float roughness = 1;

  float key() const { return SurfaceKey(id, normal, distance); }
};

const Surface kFront = {1, {0, 0, 1}, 2, 0.8f, 0};
const Surface kBack = {2, {1, 0, 0}, 3, 0.2f, 0};
const Surface kLampSurface = {3, {0, 1, 0}, 4, 0, 5};

constexpr float kOwn = 16.0f / (16.0f + 256.0f);  // weight of 4 samples beside 16 sub-samples

void SetColor(const ColorView& color, int x, int y, float value) {
  for (const FloatView& channel : color) channel.At(x, y) = value;
}

/// A film of 4 x 1 pixels of 4 samples in each half, without edges yet.
EdgedImage Film() {
  EdgedImage film{LayeredImage(4, 1)};
  film.pixels.AddColor(layers::kEmission);
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB}) film.pixels.Add(name);
  for (int x = 0; x < 4; ++x) {
    for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB})
      film.pixels.Get(name).At(x, 0) = 4;
  }
  return film;
}

struct EdgePixel {
  int x;
  std::vector<std::pair<Surface, int>> sub_samples;  // how many hit each surface
};

void AddEdges(const std::vector<EdgePixel>& pixels, EdgedImage* film) {
  film->edges = LayeredImage(kSubSamples, static_cast<int>(pixels.size()));
  LayeredImage& edges = film->edges;
  for (const std::string& name : layers::EdgeChannels()) edges.Add(name);
  for (int row = 0; row < edges.height(); ++row) {
    const EdgePixel& pixel = pixels[static_cast<size_t>(row)];
    for (int j = 0; j < kSubSamples; ++j) edges.Get(layers::kPixelX).At(j, row) = static_cast<float>(pixel.x);
    int j = 0;
    for (const auto& [surface, count] : pixel.sub_samples) {
      for (int i = 0; i < count; ++i, ++j) {
        edges.Get(layers::kNormalX).At(j, row) = surface.normal[0];
        edges.Get(layers::kNormalY).At(j, row) = surface.normal[1];
        edges.Get(layers::kNormalZ).At(j, row) = surface.normal[2];
        edges.Get(layers::kDistance).At(j, row) = surface.distance;
        edges.Get(layers::kObjectId).At(j, row) = surface.id;
        SetColor(edges.GetColor(layers::kAlbedo), j, row, surface.albedo);
        SetColor(edges.GetColor(layers::kEmission), j, row, surface.emission);
      }
    }
  }
}

struct FilmFragment {
  int x;
  Surface surface;
  std::array<float, 2> samples;
  std::array<float, 2> direct = {};
  std::array<float, 2> glossy = {};
};

void AddFragments(const std::vector<FilmFragment>& fragments, EdgedImage* film) {
  film->fragments = LayeredImage(1, static_cast<int>(fragments.size()));
  LayeredImage& list = film->fragments;
  for (const std::string& name : layers::FragmentChannels()) list.Add(name);
  for (int row = 0; row < list.height(); ++row) {
    const FilmFragment& fragment = fragments[static_cast<size_t>(row)];
    list.Get(layers::kPixelX).At(0, row) = static_cast<float>(fragment.x);
    list.Get(layers::kSurface).At(0, row) = fragment.surface.key();
    list.Get(layers::kNormalX).At(0, row) = fragment.surface.normal[0];
    list.Get(layers::kNormalY).At(0, row) = fragment.surface.normal[1];
    list.Get(layers::kNormalZ).At(0, row) = fragment.surface.normal[2];
    list.Get(layers::kDistance).At(0, row) = fragment.surface.distance;
    list.Get(layers::kSamplesA).At(0, row) = fragment.samples[0];
    list.Get(layers::kSamplesB).At(0, row) = fragment.samples[1];
    SetColor(list.GetColor(layers::kAlbedo), 0, row, fragment.surface.albedo);
    SetColor(list.GetColor(layers::kEmission), 0, row, fragment.surface.emission);
    SetColor(list.GetColor(layers::kGlossyAlbedo), 0, row, fragment.surface.glossy_albedo);
    list.Get(layers::kRoughness).At(0, row) = fragment.surface.roughness;
    SetColor(list.GetColor(layers::HalfA(layers::kDirect)), 0, row, fragment.direct[0]);
    SetColor(list.GetColor(layers::HalfB(layers::kDirect)), 0, row, fragment.direct[1]);
    SetColor(list.GetColor(layers::HalfA(layers::kGlossy)), 0, row, fragment.glossy[0]);
    SetColor(list.GetColor(layers::HalfB(layers::kGlossy)), 0, row, fragment.glossy[1]);
  }
}

TEST(FragmentsOf, CoverByTheSquareOfCounts) {
  EdgedImage film = Film();
  AddEdges({{1, {{kFront, 8}, {kBack, 8}}}}, &film);
  AddFragments({{1, kFront, {3, 1}}, {1, kBack, {1, 3}}}, &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  ASSERT_EQ(set.pixels.size(), 1u);
  EXPECT_EQ(set.pixels[0].x, 1);
  ASSERT_EQ(set.fragments.size(), 2u);
  const Fragment& front = set.fragments[0];
  EXPECT_EQ(front.row, 0);
  EXPECT_EQ(front.share, (std::array<float, 2>{0.75f, 0.25f}));
  EXPECT_FLOAT_EQ(front.coverage[0], kOwn * 0.75f + (1 - kOwn) * 0.5f);
  EXPECT_FLOAT_EQ(front.coverage[1], kOwn * 0.25f + (1 - kOwn) * 0.5f);
  for (size_t h = 0; h < 2; ++h)
    EXPECT_FLOAT_EQ(set.fragments[0].coverage[h] + set.fragments[1].coverage[h], 1);
  EXPECT_FLOAT_EQ(front.albedo[1], 0.8f);
  EXPECT_FLOAT_EQ(front.normal[2], 1);
  EXPECT_FLOAT_EQ(front.distance, 2);
}

TEST(FragmentsOf, LieWhereTheirSubSamplesDo) {
  EdgedImage film = Film();
  AddEdges({{1, {{kFront, 8}, {kBack, 8}}}}, &film);  // the upper and the lower half
  AddFragments({{1, kFront, {3, 1}}, {1, kBack, {1, 3}}}, &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  ASSERT_EQ(set.fragments.size(), 2u);
  EXPECT_EQ(set.fragments[0].place, (std::array<float, 2>{1.0f / 32, -0.25f}));
  EXPECT_EQ(set.fragments[1].place, (std::array<float, 2>{-1.0f / 32, 0.25f}));
}

TEST(FragmentsOf, KeepSurfacesThatSubSamplesAloneHit) {
  EdgedImage film = Film();
  AddEdges({{2, {{kFront, 12}, {kBack, 4}}}}, &film);
  AddFragments({{2, kFront, {4, 4}}}, &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  ASSERT_EQ(set.fragments.size(), 2u);
  const Fragment& back = set.fragments[1];
  EXPECT_EQ(back.row, -1);
  EXPECT_EQ(back.share, (std::array<float, 2>{0, 0}));
  EXPECT_FLOAT_EQ(back.coverage[0], (1 - kOwn) * 0.25f);
  EXPECT_FLOAT_EQ(back.albedo[0], 0.2f);
}

TEST(FragmentsOf, KeepNamesApartThatAreNotTheSame) {
  Surface further = kFront;  // the other side of the same object
  for (float& n : further.normal) n = -n;
  EdgedImage film = Film();
  AddEdges({{0, {{further, 16}}}}, &film);
  AddFragments({{0, kFront, {4, 4}}}, &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  ASSERT_EQ(set.fragments.size(), 2u);
  EXPECT_FLOAT_EQ(set.fragments[0].coverage[0], kOwn);
  EXPECT_FLOAT_EQ(set.fragments[1].coverage[0], 1 - kOwn);
}

TEST(FragmentsOf, TellWhatSubSamplesChangeOfEmission) {
  EdgedImage film = Film();
  SetColor(film.pixels.GetColor(layers::kEmission), 1, 0, 2.5f);  // half of the samples hit the lamp
  AddEdges({{1, {{kFront, 12}, {kLampSurface, 4}}}}, &film);
  AddFragments({{1, kFront, {2, 2}}, {1, kLampSurface, {2, 2}}}, &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  constexpr float kOwnOfHalf = 16.0f / (16.0f + 256.0f * 256.0f);  // E of 16 sub-samples has 256 rays
  for (size_t h = 0; h < 2; ++h)
    EXPECT_FLOAT_EQ(set.pixels[0].emission_change[h][1], (1 - kOwnOfHalf) * (5.0f / 4 - 2.5f));
}

TEST(FragmentsOf, TellTheEmissionOfHalvesByTheSurfacesThatTheirSamplesHit) {
  EdgedImage film = Film();
  SetColor(film.pixels.GetColor(layers::kEmission), 1, 0, 2.5f);
  AddEdges({{1, {{kFront, 12}, {kLampSurface, 4}}}}, &film);
  AddFragments({{1, kFront, {1, 3}}, {1, kLampSurface, {3, 1}}}, &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  ASSERT_EQ(set.pixels.size(), 1u);
  const FragmentSet::Pixel& pixel = set.pixels[0];
  EXPECT_FLOAT_EQ(pixel.emission_of_half[0][2], 5 * 0.75f - 2.5f);
  EXPECT_FLOAT_EQ(pixel.emission_of_half[1][2], 5 * 0.25f - 2.5f);
  constexpr float kOwnOfHalf = 16.0f / (16.0f + 256.0f * 256.0f);  // E of 16 sub-samples has 256 rays
  EXPECT_FLOAT_EQ(pixel.emission_change[0][1], (1 - kOwnOfHalf) * (5.0f / 4 - 5 * 0.75f));
  EXPECT_FLOAT_EQ(pixel.emission_change[1][1], (1 - kOwnOfHalf) * (5.0f / 4 - 5 * 0.25f));
}

TEST(FragmentsOf, GiveWhatIsLeftOfEmissionToSamplesThatMissAllSurfaces) {
  EdgedImage film = Film();
  SetColor(film.pixels.GetColor(layers::kEmission), 1, 0, 3.0f);  // three of eight samples see a sky of 8
  AddEdges({{1, {{kFront, 10}}}}, &film);
  AddFragments({{1, kFront, {4, 1}}}, &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  ASSERT_EQ(set.pixels.size(), 1u);
  EXPECT_FLOAT_EQ(set.pixels[0].emission_of_half[0][0], -3);
  EXPECT_FLOAT_EQ(set.pixels[0].emission_of_half[1][0], 8 * 0.75f - 3);
}

TEST(FragmentsOf, WeighHalvesOfUnequalCountsByTheirSamples) {
  EdgedImage film = Film();
  film.pixels.Get(layers::kSamplesA).At(1, 0) = 6;
  film.pixels.Get(layers::kSamplesB).At(1, 0) = 2;
  AddEdges({{1, {{kFront, 12}, {kLampSurface, 4}}}}, &film);
  SetColor(film.pixels.GetColor(layers::kEmission), 1, 0, 2.5f);  // four of eight samples hit the lamp
  AddFragments({{1, kFront, {2, 2}}, {1, kLampSurface, {4, 0}}}, &film);
  const FragmentSet lamp = FragmentsOf(Frame(film));
  ASSERT_EQ(lamp.pixels.size(), 1u);
  EXPECT_FLOAT_EQ(lamp.pixels[0].emission_of_half[0][1], 5 * 4 / 6.0f - 2.5f);
  EXPECT_FLOAT_EQ(lamp.pixels[0].emission_of_half[1][1], -2.5f);
  constexpr float kOwnOf6 = 36.0f / (36.0f + 256.0f);
  constexpr float kOwnOf2 = 4.0f / (4.0f + 256.0f);
  EXPECT_FLOAT_EQ(lamp.fragments[0].coverage[0], kOwnOf6 / 3 + (1 - kOwnOf6) * 0.75f);
  EXPECT_FLOAT_EQ(lamp.fragments[0].coverage[1], kOwnOf2 + (1 - kOwnOf2) * 0.75f);
  constexpr float kRays = 256.0f * 256.0f;  // of E
  EXPECT_FLOAT_EQ(lamp.pixels[0].emission_change[0][1], kRays / (36 + kRays) * (1.25f - 5 * 4 / 6.0f));
  EXPECT_FLOAT_EQ(lamp.pixels[0].emission_change[1][1], kRays / (4 + kRays) * 1.25f);
  SetColor(film.pixels.GetColor(layers::kEmission), 1, 0, 5.0f);  // five see a sky of 8
  AddFragments({{1, kFront, {3, 0}}}, &film);
  const FragmentSet sky = FragmentsOf(Frame(film));
  EXPECT_FLOAT_EQ(sky.pixels[0].emission_of_half[0][2], 8 * 3 / 6.0f - 5);
  EXPECT_FLOAT_EQ(sky.pixels[0].emission_of_half[1][2], 8 * 2 / 2.0f - 5);
}

TEST(FragmentsOf, KnowNothingOfTheEmissionOfHalvesWithoutBoth) {
  EdgedImage film = Film();
  SetColor(film.pixels.GetColor(layers::kEmission), 1, 0, 3.75f);
  film.pixels.Get(layers::kSamplesB).At(1, 0) = 0;
  AddEdges({{1, {{kFront, 12}, {kLampSurface, 4}}}}, &film);
  AddFragments({{1, kFront, {1, 0}}, {1, kLampSurface, {3, 0}}}, &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  ASSERT_EQ(set.pixels.size(), 1u);
  EXPECT_EQ(set.pixels[0].emission_of_half, (std::array<std::array<float, 3>, 2>{}));
  EXPECT_LT(set.pixels[0].emission_change[0][0], -2);
}

TEST(FragmentsOf, TellEmissionAloneWhereTheFilmHasNone) {
  EdgedImage film = Film();  // of a scene in which no surface reflects diffusely
  SetColor(film.pixels.GetColor(layers::kEmission), 1, 0, 2.5f);
  AddEdges({{1, {{kFront, 12}, {kLampSurface, 4}}}}, &film);
  const FragmentSet without = FragmentsOf(Frame(film));
  AddFragments({{1, kFront, {2, 2}}, {1, kLampSurface, {2, 2}}}, &film);
  const FragmentSet with = FragmentsOf(Frame(film));
  ASSERT_EQ(without.pixels.size(), 1u);
  EXPECT_EQ(without.pixels[0].x, 1);
  EXPECT_EQ(without.pixels[0].emission_change, with.pixels[0].emission_change);
  EXPECT_NE(without.pixels[0].emission_change[0][0], 0);
  EXPECT_TRUE(without.fragments.empty());
}

TEST(FragmentsOf, KnowTheSliceOfALampThatAllSamplesMiss) {
  EdgedImage film = Film();
  AddEdges({{1, {{kFront, 16}}}, {2, {{kFront, 16}}}}, &film);
  SetColor(film.edges.GetColor(layers::kEmission), 3, 0, 8.0f);  // one of the cells, by its rays
  AddFragments({{1, kFront, {4, 4}}, {2, kFront, {4, 4}}}, &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  ASSERT_EQ(set.pixels.size(), 1u);
  EXPECT_EQ(set.pixels[0].x, 1);
  EXPECT_EQ(set.pixels[0].first, set.pixels[0].last);
  EXPECT_NEAR(set.pixels[0].emission_change[0][0], 0.5f, 1e-3f);
}

TEST(FragmentsOf, LeaveOutPixelsOfOneSurfaceAndRowsWithoutAnEdge) {
  EdgedImage film = Film();
  AddEdges({{1, {{kFront, 16}}}, {3, {{kFront, 8}, {kBack, 8}}}}, &film);
  AddFragments({{0, kBack, {4, 4}}, {1, kFront, {4, 4}}, {2, kLampSurface, {4, 4}}, {3, kBack, {4, 4}}},
               &film);
  const FragmentSet set = FragmentsOf(Frame(film));
  ASSERT_EQ(set.pixels.size(), 1u);
  EXPECT_EQ(set.pixels[0].x, 3);
  ASSERT_EQ(set.fragments.size(), 2u);
  EXPECT_EQ(set.fragments[0].row, 3);
}

TEST(FragmentsOf, NeedASampleAndAnEdgeSet) {
  EdgedImage film = Film();
  AddFragments({{1, kFront, {3, 1}}, {1, kBack, {1, 3}}}, &film);
  EXPECT_TRUE(FragmentsOf(Frame(film)).pixels.empty());
  AddEdges({{1, {{kFront, 8}, {kBack, 8}}}}, &film);
  EXPECT_EQ(FragmentsOf(Frame(film)).pixels.size(), 1u);
  film.pixels.Get(layers::kSamplesB).At(1, 0) = 0;
  EXPECT_EQ(FragmentsOf(Frame(film)).pixels.size(), 1u);
  film.pixels.Get(layers::kSamplesA).At(1, 0) = 0;
  EXPECT_TRUE(FragmentsOf(Frame(film)).pixels.empty());
}

TEST(LayerFragments, AreOfSurfacesThatReflectDiffuselyInTheBox) {
  EdgedImage film = Film();
  AddEdges({{1, {{kFront, 8}, {kLampSurface, 8}}}, {2, {{kFront, 4}, {kBack, 12}}}}, &film);
  AddFragments({{1, kFront, {4, 0}, {6, 0}}, {1, kLampSurface, {0, 4}}, {2, kFront, {4, 4}, {1, 2}}}, &film);
  const Frame frame(film);
  Product product;
  product.box = {1, 0, 2, 1};
  LayerFragments layer = LayerFragmentsOf(frame, FragmentsOf(frame), product, {});
  ASSERT_EQ(layer.pixels.size(), 1u);
  EXPECT_EQ(layer.pixels[0].x, 0) << "relative to the box";
  ASSERT_EQ(layer.places.size(), 1u) << "a lamp reflects nothing";
  EXPECT_EQ(layer.light[0], (std::vector<float>{6, 6, 6}));
  EXPECT_EQ(layer.light[1], (std::vector<float>{0, 0, 0})) << "half B has no sample of it";
  product.kind = Product::Kind::kTransmitted;
  EXPECT_TRUE(LayerFragmentsOf(frame, FragmentsOf(frame), product, {}).IsEmpty());
}

/// A black metal, which no diffuse light is reflected by.
constexpr Surface kMetal = {4, {0, 0, -1}, 2, 0, 0, 0.75f, 0.25f};

Product GlossyProduct() {
  Product product;
  product.kind = Product::Kind::kGlossy;
  product.box = {0, 0, 4, 1};
  return product;
}

TEST(LayerFragments, OfGlossyLightHaveSAndRoughnessOfTheirOwn) {
  EdgedImage film = Film();
  film.pixels.Add(layers::kRoughness);
  AddEdges({{1, {{kMetal, 8}, {kLampSurface, 8}}}}, &film);
  AddFragments({{1, kLampSurface, {1, 1}}, {1, kMetal, {3, 3}, {}, {5, 6}}}, &film);
  const Frame frame(film);
  const LayerFragments layer = LayerFragmentsOf(frame, FragmentsOf(frame), GlossyProduct(), {});
  ASSERT_EQ(layer.places.size(), 1u) << "the lamp has no glossy lobe";
  EXPECT_EQ(layer.factor[0], (std::array<float, 3>{0.75f, 0.75f, 0.75f}));
  EXPECT_EQ(layer.light[0], (std::vector<float>{5, 5, 5}));
  EXPECT_EQ(layer.light[1], (std::vector<float>{6, 6, 6}));
  ASSERT_EQ(layer.own_features, kGeometryFeatures + 1);
  EXPECT_FLOAT_EQ(layer.features[0], 0.25f / GeometryRanges().roughness);
  EXPECT_FLOAT_EQ(layer.features[3], -1 / kSigmaNormal);
}

TEST(LayerFragments, OfGlossyLightThatSubSamplesAloneHitHaveTheGlossOfTheirSurface) {
  EdgedImage film = Film();
  film.pixels.Add(layers::kRoughness);
  Surface bright = kMetal;
  bright.glossy_albedo = 0.5f;
  bright.roughness = 0.5f;
  AddEdges({{0, {{kMetal, 8}, {kLampSurface, 8}}},
            {1, {{kMetal, 8}, {kLampSurface, 8}}},
            {2, {{kMetal, 4}, {kLampSurface, 12}}}},
           &film);
  AddFragments({{0, kLampSurface, {2, 2}},
                {0, kMetal, {2, 2}, {}, {5, 6}},
                {1, kLampSurface, {3, 3}},
                {1, bright, {1, 1}, {}, {1, 1}},
                {2, kLampSurface, {4, 4}}},
               &film);
  const Frame frame(film);
  const LayerFragments layer = LayerFragmentsOf(frame, FragmentsOf(frame), GlossyProduct(), {});
  ASSERT_EQ(layer.places.size(), 3u);
  EXPECT_EQ(layer.places[2][0], 2);
  EXPECT_FLOAT_EQ(layer.factor[2][0], (4 * 0.75f + 2 * 0.5f) / 6);
  EXPECT_FLOAT_EQ(layer.features[2 * layer.own_features],
                  (4 * 0.25f + 2 * 0.5f) / 6 / GeometryRanges().roughness);
  EXPECT_EQ(layer.share[0][2], 0);
  EXPECT_FLOAT_EQ(layer.coverage[0][2], (1 - kOwn) * 0.25f);
}

/// One pixel of three points.
LayerFragments ThreePoints() {
  LayerFragments f;
  f.pixels = {{1, 0, 0, 3}};
  f.places = {{1, 0}, {1, 0}, {1, 0}};
  f.own_features = 2;
  f.features = {1, 2, 3, 4, 5, 6};
  f.factor.resize(3);
  f.share = {{{0.5f, 0.5f, 0}, {0, 0, 0}}};
  f.coverage = {{{0.25f, 0.5f, 0.25f}, {0.25f, 0.375f, 0.375f}}};
  f.light = {{{2, 2, 2, 8, 8, 8, 0, 0, 0}, std::vector<float>(9, 0.0f)}};
  return f;
}

TEST(LayerFragments, PixelsAreMeansOverTheirPointsByCoverage) {
  LayerFragments fragments = ThreePoints();
  Halves halves;
  halves.a = MakePlanes(3, 2, 1);
  halves.b = MakePlanes(3, 2, 1);
  for (Plane* plane : {&halves.weight_a, &halves.weight_b, &halves.weight}) *plane = MakePlane(2, 1, 1.0f);
  halves.scale = 2;
  UseFragments(&fragments, &halves);
  EXPECT_EQ(fragments.light[0][3], 4) << "in the halves' unit";
  EXPECT_FLOAT_EQ(halves.a[0].At(1, 0), (0.25f * 1 + 0.5f * 4) / 0.75f);
  EXPECT_FLOAT_EQ(halves.weight_a.At(1, 0), 0.75f);
  EXPECT_EQ(halves.b[0].At(1, 0), halves.a[0].At(1, 0)) << "a half without a sample takes the other's value";
  EXPECT_EQ(halves.weight_b.At(1, 0), 0);
  EXPECT_FLOAT_EQ(halves.weight.At(1, 0), 0.75f);
  EXPECT_EQ(halves.a[0].At(0, 0), 0);
  EXPECT_EQ(halves.weight.At(0, 0), 1);
}

TEST(LayerFragments, TheSurfaceThatCoversMostGivesThePixelItsFeatures) {
  Planes geometry = MakePlanes(2, 2, 1);
  UseDominantFeatures(ThreePoints(), &geometry);
  EXPECT_EQ(geometry[0].At(1, 0), 3);
  EXPECT_EQ(geometry[1].At(1, 0), 4);
  EXPECT_EQ(geometry[0].At(0, 0), 0);
}

}  // namespace
}  // namespace lumifold::filter
