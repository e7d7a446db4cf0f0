#include "tests/charts/measure.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/metrics/metrics.h"

namespace lumifold::charts {
namespace {

constexpr int kMeasuredWidth = 16;
constexpr int kMeasuredHeight = 12;

/// A film of one grey value, with halves that differ by `spread`.
EdgedImage GreyFilm(float value, float spread) {
  EdgedImage film;
  film.pixels = LayeredImage(kMeasuredWidth, kMeasuredHeight);
  const std::string noisy(layers::kNoisy);
  for (const auto& [layer, level] :
       {std::pair(noisy, value), std::pair(layers::HalfA(noisy), value + spread / 2),
        std::pair(layers::HalfB(noisy), value - spread / 2)}) {
    for (const FloatView& channel : film.pixels.AddColor(layer)) {
      for (int y = 0; y < kMeasuredHeight; ++y) std::fill_n(channel.Row(y), kMeasuredWidth, level);
    }
  }
  return film;
}

/// A method that fills the picture with one value and counts its calls.
Method Painter(int* calls) {
  Method method{
      {"painter", "", "", {{"value", "", 0.5f, {0.25f, 0.5f, 1}, 0, 1}}}, false, false, Probe::kFilm, {}};
  method.make = [calls](Subject* subject, absl::Span<const float> values, TaskPool*) {
    ++*calls;
    MadePicture made;
    const LayeredImage& film = subject->rendered.film.pixels;
    for (Plane& plane : made.picture) {
      plane = Plane(film.width(), film.height());
      plane.Fill(values[0]);
    }
    made.seconds = 5;
    return absl::StatusOr<MadePicture>(std::move(made));
  };
  return method;
}

class MeterTest : public ::testing::Test {
 protected:
  MeterTest() { std::filesystem::create_directories(folder_); }
  ~MeterTest() override { std::filesystem::remove_all(folder_); }

  std::vector<Row> Measure(const Method& method, double most_grid_seconds, double most_run_seconds = 1e9) {
    RowStore store = *RowStore::Open(folder_ + "/rows.txt");
    const absl::StatusOr<FilmSource> source = FilmSource::Create("cornell-box", folder_);
    Subject subject;
    subject.scene = "cornell-box";
    subject.source = &*source;
    subject.settings = {kMeasuredWidth, kMeasuredHeight, 4, 1};
    subject.rendered.film = GreyFilm(0.5f, 0);
    const Reference reference = *MakeReference("truth", GreyFilm(0.25f, 0));
    Meter meter({{&method}, {}, most_grid_seconds, most_run_seconds}, &store, folder_, nullptr);
    for (int i = 0; i < 2; ++i) {  // the cost of the first film is known for the second
      absl::StatusOr<std::vector<Row>> rows = meter.Measure(&subject, reference);
      EXPECT_TRUE(rows.ok()) << rows.status();
      rows_ = *std::move(rows);
      subject.settings.samples *= 4;
    }
    return rows_;
  }

  const std::string folder_ =
      ::testing::TempDir() + "/" + ::testing::UnitTest::GetInstance()->current_test_info()->name();
  std::vector<Row> rows_;
};

TEST_F(MeterTest, MarksTheBestOfTheGrid) {
  int calls = 0;
  const std::vector<Row> rows = Measure(Painter(&calls), 100);
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_TRUE(rows[0].is_default);
  EXPECT_FALSE(rows[0].is_best);
  EXPECT_EQ(rows[1].parameters, "value=0.25");
  EXPECT_TRUE(rows[1].is_best);
  EXPECT_EQ(rows[1].errors.mse255.whole, 0);
}

TEST_F(MeterTest, ComputesNothingTwice) {
  int calls = 0;
  const Method painter = Painter(&calls);
  Measure(painter, 100);
  const int first = calls;
  EXPECT_EQ(first, 2 * 3);  // two films, three points; the default's picture is the fingerprint
  Measure(painter, 100);
  EXPECT_EQ(calls, first + 2);  // the fingerprints, to detect a change of the method
}

TEST_F(MeterTest, MeasuresAgainWhatChangedAtTheSizeCharted) {
  int calls = 0;
  Method painter = Painter(&calls);
  Measure(painter, 100);
  const auto as_before = painter.make;
  painter.make = [&](Subject* subject, absl::Span<const float> values, TaskPool* pool) {
    absl::StatusOr<MadePicture> made = as_before(subject, values, pool);
    if (subject->rendered.film.pixels.width() == kMeasuredWidth)
      made->picture[0].At(kMeasuredWidth - 1, 0) += 0.125f;
    return made;
  };
  calls = 0;
  Measure(painter, 100);
  EXPECT_EQ(calls, 2 * 3);
}

TEST_F(MeterTest, LeavesOutPointsThatCostTooMuch) {
  int calls = 0;
  EXPECT_EQ(Measure(Painter(&calls), 4).size(), 1u);  // a point takes 5 s
}

TEST_F(MeterTest, TakesThePointsThatFitWithTheBestOfTheFilmBeforeFirst) {
  int calls = 0;
  Method painter = Painter(&calls);
  painter.info.parameters[0].grid = {1, 0.5f, 0.25f};
  EXPECT_EQ(Measure(painter, 9)[1].parameters,
            "value=1");  // the first of two points in addition to the default
  painter.info.parameters[0].grid = {0.25f, 0.5f, 1};
  EXPECT_EQ(Measure(painter, 9).size(), 2u);  // the stored point counts
  const std::vector<Row> rows = Measure(painter, 10);
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_TRUE(rows[2].is_best);
}

TEST_F(MeterTest, TakesAGridThatIsKeptWhateverItCost) {
  int calls = 0;
  const Method painter = Painter(&calls);
  Measure(painter, 100);
  EXPECT_EQ(Measure(painter, 9).size(), 3u);
}

TEST_F(MeterTest, DoesNotRunWhatWouldTakeTooLong) {
  int calls = 0;
  const std::vector<Row> rows = Measure(Painter(&calls), 100, 4);
  ASSERT_EQ(rows.size(), 1u);
  EXPECT_EQ(rows[0].not_run, "cost: 5 s");
}

TEST(Reference, KnowsItsOwnNoise) {
  const Reference reference = *MakeReference("truth", GreyFilm(0.25f, 0.02f));
  EXPECT_TRUE(reference.has_halves);
  EXPECT_GT(reference.noise, 0);
  // A picture that equals the mean lies between the halves, so its error is negative.
  const Plane same = [&] {
    Plane plane(kMeasuredWidth, kMeasuredHeight);
    plane.Fill(0.25f);
    return plane;
  }();
  const Errors errors = Judge({same.view(), same.view(), same.view()}, reference, true);
  const LayeredImage& pixels = reference.film.pixels;
  const ConstColorView a = pixels.GetColor(layers::HalfA(layers::kNoisy));
  const ConstColorView b = pixels.GetColor(layers::HalfB(layers::kNoisy));
  const ConstColorView picture = {same.view(), same.view(), same.view()};
  const double product =  // of x and y, from their squares and that of x - y
      (metrics::Mse255(picture, a) + metrics::Mse255(picture, b) - metrics::Mse255(a, b)) / 2;
  EXPECT_LT(product, 0);
  EXPECT_NEAR(errors.mse255.whole, product, 1e-9);
  EXPECT_FALSE(errors.ssim.has_value());
  EXPECT_FALSE(errors.flip.has_value());
}

TEST(Reference, HidesStructureWithMoreThanATenthOfTheError) {
  EXPECT_FALSE(HidesStructure(1, 10));
  EXPECT_TRUE(HidesStructure(1.01, 10));
  EXPECT_TRUE(HidesStructure(0.5, 0));
  EXPECT_TRUE(HidesStructure(0.5, -0.5));
  EXPECT_FALSE(HidesStructure(0, 0));  // exact, or its noise is not known
}

TEST(Judge, LeavesOutScoresThatWouldMeasureTheReference) {
  const auto judge = [](float value, float spread) {
    const EdgedImage picture = GreyFilm(value, 0);
    return Judge(picture.pixels.GetColor(layers::kNoisy), *MakeReference("truth", GreyFilm(0.25f, spread)),
                 true);
  };
  const Errors plain = judge(0.5f, 0.02f);
  EXPECT_GT(*plain.flip, 0);
  EXPECT_TRUE(plain.ssim.has_value());
  const Errors hidden = judge(0.251f, 0.02f);
  EXPECT_FALSE(hidden.flip.has_value());
  EXPECT_FALSE(hidden.ssim.has_value());
  EXPECT_EQ(judge(0.25f, 0).flip, 0);  // equal to an exact reference
}

TEST(AddRendering, ChargesAuxiliaryDataToThoseWhoUseThem) {
  const RenderRates rates = {.radiance = 2, .layered = 3, .geometry = 5};
  Row row;
  row.samples = 10;
  AddRendering(rates, {.name = "", .summary = "", .source = "", .parameters = {}}, &row);
  EXPECT_EQ(row.render_seconds, 20);
  EXPECT_EQ(row.auxiliary_seconds, 15);
  Row plain;
  plain.samples = 10;
  AddRendering(rates, {.name = "", .summary = "", .source = "", .parameters = {}, .uses_auxiliary = false},
               &plain);
  EXPECT_EQ(plain.render_seconds, 20);
  EXPECT_EQ(plain.auxiliary_seconds, 0);
}

TEST(Methods, ThatWorkOnThePlainPictureAreKnown) {
  std::vector<std::string> plain;
  for (const Method& method : AllMethods()) {
    if (!method.info.uses_auxiliary && !method.renders) plain.push_back(method.info.name);
  }
  EXPECT_THAT(plain, ::testing::ElementsAre("none", "manifolds-color", "bilateral", "epanechnikov"));
}

TEST(Fingerprint, IsOfThePictureItself) {
  int calls = 0;
  Subject subject;
  subject.rendered.film = GreyFilm(0.5f, 0);
  Method painter = Painter(&calls);
  const Fingerprint half = *FingerprintOf(painter, &subject, "", nullptr);
  ASSERT_TRUE(half.made.has_value());
  EXPECT_EQ(half.made->picture[0].At(0, 0), 0.5f);
  EXPECT_EQ(FingerprintOf(painter, &subject, "", nullptr)->hash, half.hash);
  painter.info.parameters[0].default_value = 1;
  EXPECT_NE(FingerprintOf(painter, &subject, "", nullptr)->hash, half.hash);
}

TEST(Fingerprint, IsOfTheMiddleWhereTheWholeTakesLong) {
  Subject subject;
  subject.rendered.film.pixels = LayeredImage(300, 200);
  Method method{{"slow", "", "", {}}, false, false, Probe::kCrop, {}};
  method.make = [](Subject* part, absl::Span<const float>, TaskPool*) {
    EXPECT_EQ(part->rendered.film.pixels.width(), 128);
    EXPECT_EQ(part->rendered.film.pixels.height(), 96);
    MadePicture made;
    made.picture = MakePicture(128, 96);
    return absl::StatusOr<MadePicture>(std::move(made));
  };
  EXPECT_FALSE(FingerprintOf(method, &subject, "", nullptr)->made.has_value());
}

}  // namespace
}  // namespace lumifold::charts
