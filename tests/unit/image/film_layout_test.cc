#include "filter/image/film_layout.h"

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <string_view>
#include <utility>

#include "filter/image/layers.h"
#include "filter/image/planes.h"

namespace lumifold {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr int kWidth = 3;
constexpr int kHeight = 2;

void Fill(FloatView view, float value) {
  ForEachPixel(view.width(), view.height(), [&](int x, int y) { view.At(x, y) = value; });
}

void AddFilled(const std::string& layer, float value, LayeredImage* image) {
  for (const FloatView& channel : image->AddColor(layer)) Fill(channel, value);
}

/// A picture as Blender writes it, with a different value in each layer.
LayeredImage CyclesPicture(const std::string& prefix) {
  LayeredImage image(kWidth, kHeight);
  float value = 1;
  for (const char* layer : {"Combined", "DiffDir", "DiffInd", "DiffCol", "GlossDir", "Emit", "Env"})
    AddFilled(prefix + layer, value++, &image);
  AddFilled(prefix + "GlossInd", 20, &image);
  AddFilled(prefix + "GlossCol", 0.25f, &image);
  for (const char* layer : {"TransDir", "TransInd", "TransCol"}) AddFilled(prefix + layer, 0.5f, &image);
  Fill(image.Add(prefix + "Combined.A"), 0.5f);
  for (const char* axis : {"X", "Y", "Z"}) Fill(image.Add(prefix + "Normal." + axis), value++);
  Fill(image.Add(prefix + "Depth.Z"), value);
  return image;
}

ForeignFilm ReadCycles(const LayeredImage& file) {
  absl::StatusOr<ForeignFilm> film = ReadForeignFilm("in.exr", file, *FindFilmLayout("cycles"));
  EXPECT_TRUE(film.ok()) << film.status();
  return film.ok() ? *std::move(film) : ForeignFilm{};
}

TEST(FilmLayout, FindsThePassesOfCyclesBehindAnyViewLayer) {
  for (const char* prefix : {"", "ViewLayer.", "Hall.Left."}) {
    const ForeignFilm read = ReadCycles(CyclesPicture(prefix));
    EXPECT_THAT(read.notes, IsEmpty()) << prefix;
    const LayeredImage& film = read.film;
    EXPECT_EQ(film.GetColor(layers::kNoisy)[0].At(0, 0), 1);
    EXPECT_EQ(film.GetColor(layers::kDirect)[1].At(2, 1), 2);
    EXPECT_EQ(film.GetColor(layers::kIndirect)[2].At(2, 1), 3);
    EXPECT_EQ(film.GetColor(layers::kAlbedo)[0].At(1, 0), 4);
    EXPECT_EQ(film.GetColor(layers::kEmission)[0].At(1, 0), 6 + 7) << "Emit + Env";
    EXPECT_EQ(film.GetColor(layers::kGlossy)[1].At(1, 0), 5 + 20) << "GlossDir + GlossInd";
    EXPECT_EQ(film.GetColor(layers::kGlossyAlbedo)[1].At(1, 0), 0.25f);
    EXPECT_EQ(film.GetColor(layers::kTransmitted)[1].At(1, 0), 1);
    EXPECT_EQ(film.GetColor(layers::kTransmittance)[1].At(1, 0), 0.5f);
    EXPECT_EQ(film.Get(layers::kNormalY).At(1, 0), 9);
    EXPECT_EQ(film.Get(layers::kDistance).At(1, 0), 11);
    EXPECT_EQ(film.Get(layers::kMask).At(1, 0), 1);
    EXPECT_EQ(film.Get(layers::kAlpha).At(1, 0), 0.5f);
  }
}

TEST(FilmLayout, FindsThePassesByTheNamesOfBlender5) {
  LayeredImage file(kWidth, kHeight);
  float value = 1;
  for (const char* layer : {"Combined", "Diffuse Direct", "Diffuse Indirect", "Diffuse Color", "Emission",
                            "Environment", "Glossy Direct", "Glossy Indirect", "Glossy Color",
                            "Transmission Direct", "Transmission Indirect", "Transmission Color"})
    AddFilled(absl::StrCat("ViewLayer.", layer), value++, &file);
  const ForeignFilm read = ReadCycles(file);
  EXPECT_THAT(read.notes, SizeIs(2)) << "normal and depth";
  const std::pair<std::string_view, float> all_expected[] = {{layers::kDirect, 2},
                                                             {layers::kIndirect, 3},
                                                             {layers::kAlbedo, 4},
                                                             {layers::kEmission, 5 + 6},
                                                             {layers::kGlossy, 7 + 8},
                                                             {layers::kGlossyAlbedo, 9},
                                                             {layers::kTransmitted, 10 + 11},
                                                             {layers::kTransmittance, 12}};
  for (const auto& [layer, expected] : all_expected)
    EXPECT_EQ(read.film.GetColor(layer)[0].At(1, 1), expected) << layer;
}

TEST(FilmLayout, TakesAnInfiniteDepthForSkyAndNoAlbedoForNoDiffuseSurface) {
  LayeredImage file = CyclesPicture("");
  file.Get("Depth.Z").At(0, 0) = 1e10f;
  file.Get("Depth.Z").At(1, 0) = std::numeric_limits<float>::infinity();
  file.Get("Depth.Z").At(2, 0) = std::numeric_limits<float>::quiet_NaN();
  for (const FloatView& channel : file.GetColor("DiffCol")) channel.At(0, 1) = 0;
  const LayeredImage film = ReadCycles(file).film;
  for (int x = 0; x < kWidth; ++x) EXPECT_EQ(film.Get(layers::kDistance).At(x, 0), 0) << x;
  EXPECT_EQ(film.Get(layers::kDistance).At(0, 1), 11);
  EXPECT_EQ(film.Get(layers::kMask).At(0, 1), 0);
  EXPECT_EQ(film.Get(layers::kMask).At(1, 1), 1);
}

TEST(FilmLayout, SaysWhatIsMissing) {
  LayeredImage file(kWidth, kHeight);
  AddFilled("ViewLayer.Combined", 1, &file);
  AddFilled("ViewLayer.DiffDir", 1, &file);
  const ForeignFilm read = ReadCycles(file);
  EXPECT_THAT(read.notes, SizeIs(9));
  EXPECT_THAT(read.notes, testing::Contains(HasSubstr("no indirect (no layer ViewLayer.DiffInd)")));
  EXPECT_THAT(read.notes, testing::Contains(HasSubstr("no depth (no layer ViewLayer.Depth)")));
  EXPECT_EQ(read.film.Get(layers::kDistance).At(0, 0), 1) << "without depth nothing is sky";
  EXPECT_EQ(read.film.Get(layers::kAlpha).At(0, 0), 1);
}

TEST(FilmLayout, TakesNoGlossyLightWithoutItsFactor) {
  const LayeredImage whole = CyclesPicture("");
  LayeredImage file(kWidth, kHeight);
  for (const LayeredImage::Channel& channel : whole.channels()) {
    if (channel.name != "GlossCol.G") file.Add(channel.name, channel.plane.Clone());
  }
  const ForeignFilm read = ReadCycles(file);
  EXPECT_THAT(read.notes, ElementsAre(HasSubstr("no glossy_albedo (no layer GlossCol)")));
  EXPECT_FALSE(read.film.HasColor(layers::kGlossy));
  EXPECT_TRUE(read.film.HasColor(layers::kTransmitted));
}

TEST(FilmLayout, RefusesAFileWithoutTheCombinedLayer) {
  LayeredImage file(kWidth, kHeight);
  AddFilled("ViewLayer.DiffDir", 1, &file);
  EXPECT_THAT(ReadForeignFilm("in.exr", file, *FindFilmLayout("cycles")).status().message(),
              HasSubstr("in.exr: has no colour layer 'Combined'"));
  file.Add("ViewLayer.Combined.R");
  EXPECT_THAT(ReadForeignFilm("in.exr", file, *FindFilmLayout("cycles")).status().message(),
              HasSubstr("in.exr: the layer 'ViewLayer.Combined' lacks R, G or B"));
}

std::string GuessOf(const std::vector<std::string>& colours) {
  LayeredImage file(1, 1);
  for (const std::string& colour : colours) AddFilled(colour, 1, &file);
  const auto guess = GuessFilmLayout("in.exr", file);
  return guess.ok() ? *guess : std::string(guess.status().message());
}

TEST(FilmLayout, IsFoundByTheLayersOfTheFile) {
  EXPECT_EQ(GuessOf({"", "noisy", "direct"}), "lumifold");
  EXPECT_EQ(GuessOf({"ViewLayer.Combined"}), "cycles");
  EXPECT_EQ(GuessOf({"", "diffuse_direct"}), "arnold");
  EXPECT_EQ(GuessOf({"", "rawLight", "diffuse"}), "vray");
  EXPECT_EQ(GuessOf({"", "albedo"}), "plain");
  EXPECT_EQ(GuessOf({"beauty"}), "plain");
  EXPECT_THAT(GuessOf({"motion"}), HasSubstr("in.exr: has no colour that looks like a picture"));
}

TEST(FilmLayout, DividesTheLightOfArnoldByTheAlbedo) {
  LayeredImage file(kWidth, kHeight);
  AddFilled("", 3, &file);
  AddFilled("diffuse_direct", 1, &file);
  AddFilled("diffuse_indirect", 0.5f, &file);
  AddFilled("diffuse_albedo", 0.25f, &file);
  AddFilled("N", 0.5f, &file);
  Fill(file.Add("A"), 0.75f);
  Fill(file.Add("Z"), 6);
  file.GetColor("diffuse_albedo")[0].At(1, 1) = 0;
  const auto read = ReadForeignFilm("in.exr", file, *FindFilmLayout("arnold"));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->film.GetColor(layers::kNoisy)[0].At(0, 0), 3);
  EXPECT_EQ(read->film.GetColor(layers::kDirect)[0].At(0, 0), 4);
  EXPECT_EQ(read->film.GetColor(layers::kIndirect)[2].At(0, 0), 2);
  EXPECT_EQ(read->film.GetColor(layers::kDirect)[0].At(1, 1), 0);
  EXPECT_EQ(read->film.Get(layers::kNormalZ).At(0, 0), 0.5f) << "a normal in R, G and B";
  EXPECT_EQ(read->film.Get(layers::kDistance).At(0, 0), 6) << "a depth without a layer";
  EXPECT_EQ(read->film.Get(layers::kAlpha).At(0, 0), 0.75f);
}

TEST(FilmLayout, ReadsALayoutOfTheUsers) {
  const auto layout = ParseFilmLayout("my.layout",
                                      "# of our own renderer\n"
                                      "combined = beauty\n"
                                      "  emission=glow + sky # both\r\n"
                                      "\n"
                                      "glossy = sharp + rough\n"
                                      "albedo = diffuse color\n");
  ASSERT_TRUE(layout.ok()) << layout.status();
  EXPECT_THAT(layout->sources[FilmLayout::kCombined], ElementsAre("beauty"));
  EXPECT_THAT(layout->sources[FilmLayout::kEmission], ElementsAre("glow", "sky"));
  EXPECT_THAT(layout->sources[FilmLayout::kAlbedo], ElementsAre("diffuse color"));
  EXPECT_THAT(layout->sources[FilmLayout::kGlossy], ElementsAre("sharp", "rough"));
  EXPECT_THAT(layout->sources[FilmLayout::kDepth], IsEmpty());
}

TEST(FilmLayout, NamesTheLineThatIsWrong) {
  const auto error = [](const char* text) {
    return std::string(ParseFilmLayout("my.layout", text).status().message());
  };
  EXPECT_EQ(error("combined = C\nbeauty"), "my.layout: line 2: expected ROLE = LAYER");
  EXPECT_EQ(error("\nbeauty = C"), "my.layout: line 2: no role is named 'beauty'");
  EXPECT_EQ(error("depth = Z\ndepth = Y"), "my.layout: line 2: depth is given twice");
  EXPECT_EQ(error("emission = glow +"), "my.layout: line 1: a layer's name is missing");
  EXPECT_EQ(error("depth = Z"), "my.layout: says nothing of the combined layer");
}

TEST(FilmLayout, JoinsTwoHalves) {
  LayeredImage a = ReadCycles(CyclesPicture("")).film;
  LayeredImage b = ReadCycles(CyclesPicture("")).film;
  for (const FloatView& channel : b.GetColor(layers::kDirect)) Fill(channel, 4);
  for (const std::string_view factor : {layers::kAlbedo, layers::kEmission, layers::kGlossyAlbedo}) {
    for (const FloatView& channel : a.GetColor(factor)) Fill(channel, 2);
    for (const FloatView& channel : b.GetColor(factor)) Fill(channel, 3);
  }
  const auto film = JoinHalves(a, b);
  ASSERT_TRUE(film.ok()) << film.status();
  EXPECT_EQ(film->GetColor(layers::kDirect)[0].At(1, 1), 3);
  EXPECT_EQ(film->GetColor(layers::HalfA(layers::kDirect))[0].At(1, 1), 2);
  EXPECT_EQ(film->GetColor(layers::HalfB(layers::kDirect))[0].At(1, 1), 4);
  EXPECT_EQ(film->Get(layers::kSamplesA).At(0, 0), film->Get(layers::kSamplesB).At(0, 0));
  EXPECT_GT(film->Get(layers::kSamplesA).At(0, 0), 0);
  EXPECT_EQ(film->GetColor(layers::HalfB(layers::kGlossy))[0].At(1, 1), 25);
  for (const std::string_view factor : {layers::kAlbedo, layers::kEmission, layers::kGlossyAlbedo}) {
    EXPECT_EQ(film->GetColor(factor)[0].At(1, 1), 2.5f) << factor;
    EXPECT_EQ(film->GetColor(layers::HalfA(factor))[0].At(1, 1), 2) << factor;
    EXPECT_EQ(film->GetColor(layers::HalfB(factor))[0].At(1, 1), 3) << factor;
  }
}

TEST(FilmLayout, LeavesOutWhatOneHalfAloneHas) {
  const LayeredImage a = ReadCycles(CyclesPicture("")).film;
  LayeredImage plain(kWidth, kHeight);
  AddFilled("Combined", 1, &plain);
  const auto film = JoinHalves(a, ReadCycles(plain).film);
  ASSERT_TRUE(film.ok()) << film.status();
  EXPECT_FALSE(film->HasColor(layers::kGlossy));
  EXPECT_TRUE(film->HasColor(layers::HalfA(layers::kDirect)));
}

TEST(FilmLayout, RefusesHalvesOfTwoSizes) {
  EXPECT_THAT(JoinHalves(LayeredImage(2, 2), LayeredImage(2, 3)).status().message(),
              HasSubstr("2x2 and 2x3"));
}

}  // namespace
}  // namespace lumifold
