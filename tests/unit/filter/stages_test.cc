#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "are_equal.h"
#include "filter/denoise/denoise.h"
#include "filter/image/layers.h"
#include "filter/methods.h"
#include "is_finite.h"
#include "synthetic_film.h"

namespace lumifold::filter {
namespace {

/// The synthetic film with one firefly.
LayeredImage StagesFilm() {
  LayeredImage film = MakeSyntheticFilm(72, 48, 0.4f, 5).film;
  for (const char* channel : {"direct.R", "noisy.R"}) film.Get(channel).At(30, 30) += 40;
  for (const char* channel : {"direct_a.R", "noisy_a.R"}) film.Get(channel).At(30, 30) += 80;
  return film;
}

Picture Without(const LayeredImage& film, const SwitchedOff& off) {
  return Denoise(Frame(film), nullptr, {.off = off, .watch = {}});
}

TEST(Stages, AreTheDefaultMethod) {
  const LayeredImage film = StagesFilm();
  EXPECT_TRUE(AreEqual(Denoise(Frame(film), nullptr), *FilterFilm(film, "default", nullptr)));
}

TEST(TunedConstants, ThatGuideEveryLayerChangeThePicture) {
  const LayeredImage film = StagesFilm();
  const Picture whole = Denoise(Frame(film), nullptr);
  for (const TunedConstant& constant : TunedConstants()) {
    const bool is_of_special_pixels = constant.name.starts_with("single-") ||
                                      constant.name.starts_with("firefly-") ||
                                      constant.name.starts_with("mixed-") ||
                                      constant.name.starts_with("fit-") || constant.name == "sigma-roughness";
    if (is_of_special_pixels) continue;
    const auto changes = [&](float factor) {
      DenoiseOptions options;
      options.adjust = [&](Settings* adjusted) { constant.Set(adjusted, factor * constant.Get(*adjusted)); };
      return !AreEqual(Denoise(Frame(film), nullptr, options), whole);
    };
    EXPECT_TRUE(changes(2) || changes(0.5f)) << constant.name;
  }
}

TEST(Stages, HaveNamesOfTheirOwnAndSayWhatTheyDo) {
  std::vector<std::string_view> names;
  for (const StageInfo& stage : Stages()) {
    names.push_back(stage.name);
    for (const std::string_view text :
         {stage.name, stage.reads, stage.writes, stage.off_when, stage.source, stage.header})
      EXPECT_FALSE(text.empty()) << stage.name;
  }
  for (const GuideInfo& guide : Guides()) names.push_back(guide.name);
  std::sort(names.begin(), names.end());
  EXPECT_EQ(std::adjacent_find(names.begin(), names.end()), names.end());
}

/// The first cells of the table rows between <!-- name --> and <!-- /name --> in docs/method.md, and the
/// rows.
std::vector<std::pair<std::string, std::string>> RowsOfPage(const std::string& name) {
  std::ifstream page(std::string(LUMIFOLD_DOCS_DIR) + "/method.md");
  std::vector<std::pair<std::string, std::string>> rows;
  bool is_inside = false;
  for (std::string line; std::getline(page, line);) {
    if (line == "<!-- " + name + " -->") is_inside = true;
    if (line == "<!-- /" + name + " -->") break;
    if (!is_inside || line.rfind("| `", 0) != 0) continue;
    rows.emplace_back(line.substr(3, line.find('`', 3) - 3), line);
  }
  return rows;
}

TEST(Stages, AreListedInTheDocumentsAsTheyAre) {
  const auto rows = RowsOfPage("stages");
  ASSERT_EQ(rows.size(), Stages().size());
  for (size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(rows[i].first, Stages()[i].name);
    EXPECT_THAT(rows[i].second, testing::HasSubstr("(../" + std::string(Stages()[i].header) + ")"));
    EXPECT_THAT(rows[i].second, testing::HasSubstr("| " + std::string(Stages()[i].source) + " |"));
  }
  const auto guides = RowsOfPage("guides");
  ASSERT_EQ(guides.size(), Guides().size());
  for (size_t i = 0; i < guides.size(); ++i) EXPECT_EQ(guides[i].first, Guides()[i].name);
}

TEST(Stages, ChangeThePictureWhereTheyAreOff) {
  const LayeredImage film = StagesFilm();
  const Picture whole = Denoise(Frame(film), nullptr);
  for (const char* name :
       {"patches", "normals", "depth", "first-order", "fireflies", "firefly-energy", "first-filtering",
        "second-filtering", "choice", "noisy-choice", "remainder", "frame-choice"}) {
    const Picture without = Without(film, {name});
    EXPECT_TRUE(IsFinite(without)) << name;
    EXPECT_FALSE(AreEqual(whole, without)) << name;
  }
}

TEST(Stages, WithoutAnyOfThemThePictureIsC) {
  const LayeredImage film = StagesFilm();
  SwitchedOff off;
  for (const StageInfo& stage : Stages()) {
    if (!stage.is_required) off.emplace_back(stage.name);
  }
  const Picture picture = Without(film, off);
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < film.height(); ++y) {
      for (int x = 0; x < film.width(); ++x) ASSERT_NEAR(picture[c].At(x, y), noisy[c].At(x, y), 1e-5f);
    }
  }
}

TEST(Stages, RefuseNamesThatCannotBeSwitchedOff) {
  EXPECT_TRUE(CheckSwitchedOff({"regression", "depth"}).ok());
  EXPECT_THAT(CheckSwitchedOff({"gloss"}).message(), testing::HasSubstr("'gloss'"));
  EXPECT_FALSE(CheckSwitchedOff({"recombination"}).ok());
}

TEST(Stages, AreWatchedInTheirOrder) {
  const LayeredImage film = StagesFilm();
  std::vector<std::string> ended;
  const StageWatch watch = [&](std::string_view stage) { ended.emplace_back(stage); };
  EXPECT_TRUE(
      AreEqual(Denoise(Frame(film), nullptr, {.off = {}, .watch = watch}), Denoise(Frame(film), nullptr)));
  EXPECT_EQ(ended.front(), "layers");
  EXPECT_EQ(ended.back(), "recombination");
  for (const std::string& name : ended) {
    EXPECT_TRUE(std::any_of(Stages().begin(), Stages().end(), [&](const StageInfo& stage) {
      return stage.name == name;
    })) << name;
  }
}

TEST(Stages, TellWhatABlockHasToSeeBeyondItsCore) {
  EXPECT_EQ(BlurWindow(16), 60);  // 1/200 of the weight is left there
  EXPECT_EQ(DenoiseApron(), 60);  // of the widest second filtering
}

}  // namespace
}  // namespace lumifold::filter
