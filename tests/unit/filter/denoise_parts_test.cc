#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "filter/denoise/denoise.h"
#include "filter/image/layers.h"
#include "filter/methods.h"
#include "is_finite.h"
#include "synthetic_film.h"

namespace lumifold::filter {
namespace {

using Picture = std::array<Plane, 3>;

/// The synthetic film with one firefly.
LayeredImage Film() {
  LayeredImage film = MakeSyntheticFilm(72, 48, 0.4f, 5).film;
  for (const char* channel : {"direct.R", "noisy.R"}) film.Get(channel).At(30, 30) += 40;
  for (const char* channel : {"direct_a.R", "noisy_a.R"}) film.Get(channel).At(30, 30) += 80;
  return film;
}

bool AreEqual(const Picture& a, const Picture& b) {
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < a[c].height(); ++y) {
      if (!std::equal(a[c].Row(y), a[c].Row(y) + a[c].width(), b[c].Row(y))) return false;
    }
  }
  return true;
}

TEST(DenoiseParts, AllOfThemAreTheDefaultMethod) {
  const LayeredImage film = Film();
  EXPECT_TRUE(AreEqual(Denoise(film, nullptr, nullptr), *FilterFilm(film, "default", nullptr)));
}

TEST(DenoiseParts, EachChangesThePictureWhereItIsOff) {
  const LayeredImage film = Film();
  const Picture whole = Denoise(film, nullptr, nullptr);
  for (bool DenoiseParts::*part :
       {&DenoiseParts::patches, &DenoiseParts::normals, &DenoiseParts::depth, &DenoiseParts::fireflies,
        &DenoiseParts::first_order, &DenoiseParts::second_pass, &DenoiseParts::choice}) {
    DenoiseParts parts;
    parts.*part = false;
    const Picture without = Denoise(film, nullptr, nullptr, parts);
    EXPECT_TRUE(IsFinite(without));
    EXPECT_FALSE(AreEqual(whole, without));
  }
}

// With the choice on nothing is left for it to do in a film as plain as this.
TEST(DenoiseParts, ConvergenceMattersWhereTheFilterIsWrong) {
  const LayeredImage film = MakeSyntheticFilm(72, 48, 0.05f, 5).film;
  EXPECT_FALSE(
      AreEqual(Denoise(film, nullptr, nullptr, {.patches = false, .choice = false}),
               Denoise(film, nullptr, nullptr, {.patches = false, .choice = false, .convergence = false})));
}

TEST(DenoiseParts, AreWatchedStepByStep) {
  const LayeredImage film = Film();
  std::vector<DenoiseStep> steps;
  DenoiseParts parts;
  parts.watch = [&](DenoiseStep step) { steps.push_back(step); };
  EXPECT_TRUE(AreEqual(Denoise(film, nullptr, nullptr, parts), Denoise(film, nullptr, nullptr)));
  EXPECT_TRUE(std::is_sorted(steps.begin(), steps.end()));
  EXPECT_EQ(steps.front(), DenoiseStep::kSetUp);
  EXPECT_EQ(steps.back(), DenoiseStep::kConvergence);
}

}  // namespace
}  // namespace lumifold::filter
