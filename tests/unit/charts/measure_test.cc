#include "tests/charts/measure.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/layers.h"

namespace lumifold::charts {
namespace {

constexpr int kWidth = 16;
constexpr int kHeight = 12;

/// A film of one grey value, with halves that differ by `spread`.
EdgedImage GreyFilm(float value, float spread) {
  EdgedImage film;
  film.pixels = LayeredImage(kWidth, kHeight);
  const std::string noisy(layers::kNoisy);
  for (const auto& [layer, level] :
       {std::pair(noisy, value), std::pair(layers::HalfA(noisy), value + spread / 2),
        std::pair(layers::HalfB(noisy), value - spread / 2)}) {
    for (const FloatView& channel : film.pixels.AddColor(layer)) {
      for (int y = 0; y < kHeight; ++y) std::fill_n(channel.Row(y), kWidth, level);
    }
  }
  return film;
}

/// A method that fills the picture with one value and counts its calls.
Method Painter(int* calls) {
  Method method{{"painter", "", "", {{"value", "", 0.5f, {0.25f, 0.5f, 1}, 0, 1}}}, false, false, {}};
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

class MeterTest : public testing::Test {
 protected:
  MeterTest() { std::filesystem::create_directories(folder_); }
  ~MeterTest() override { std::filesystem::remove_all(folder_); }

  std::vector<Row> Measure(const Method& method, double most_grid_seconds, double most_run_seconds = 1e9) {
    RowStore store = *RowStore::Open(folder_ + "/rows.txt");
    const absl::StatusOr<FilmSource> source = FilmSource::Create("cornell-box", folder_);
    Subject subject;
    subject.scene = "cornell-box";
    subject.source = &*source;
    subject.settings = {kWidth, kHeight, 4, 1};
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
      testing::TempDir() + "/" + testing::UnitTest::GetInstance()->current_test_info()->name();
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
  EXPECT_EQ(first, 2 * 3 + 2);  // two films, three points, and the two films of the fingerprint
  Measure(painter, 100);
  EXPECT_EQ(calls, first + 2);  // the fingerprint, to detect a change of the method
}

TEST_F(MeterTest, LeavesOutAGridThatCostsTooMuch) {
  int calls = 0;
  EXPECT_EQ(Measure(Painter(&calls), 9).size(), 1u);  // two points of 5 s in addition to the default
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
  EXPECT_GT(reference.noise.whole, 0);
  // A picture whose error equals the noise of the reference has an error of about 0.
  const Plane same = [&] {
    Plane plane(kWidth, kHeight);
    plane.Fill(0.25f);
    return plane;
  }();
  const Errors errors = Judge({same.view(), same.view(), same.view()}, reference, true);
  EXPECT_NEAR(errors.mse255.whole, -reference.noise.whole, 1e-9);
  EXPECT_EQ(errors.flip, 0);
}

}  // namespace
}  // namespace lumifold::charts
