#include "filter/blocks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/methods.h"
#include "synthetic_film.h"

namespace lumifold::filter {
namespace {

constexpr BlockParams kSmall = {.core = 64, .margin = 64, .fade = 16, .whole = 0};

/// The picture of FilterFilmInRows, assembled from its rows.
LayeredImage InBlocks(FilmSource* film, const std::string& method, const BlockParams& params,
                      const std::vector<std::string>& passed_on = {}) {
  std::vector<LayeredImage> pieces;
  const absl::Status status = FilterFilmInRows(
      film, method, passed_on, nullptr,
      [&](const LayeredImage& rows) {
        pieces.push_back(rows.Crop(rows.bounds()));
        return absl::OkStatus();
      },
      params);
  EXPECT_TRUE(status.ok()) << status;
  return JoinRows(pieces);
}

bool SameBits(ConstFloatView a, ConstFloatView b) {
  if (a.width() != b.width() || a.height() != b.height()) return false;
  for (int y = 0; y < a.height(); ++y) {
    if (!std::equal(a.Row(y), a.Row(y) + a.width(), b.Row(y))) return false;
  }
  return true;
}

TEST(BlockAxis, SharesSumToOneExactlyOnAnyAxis) {
  for (const int size : {1, 63, 64, 65, 200, 321, 1000}) {
    const BlockAxis axis(size, kSmall);
    for (int p = 0; p < size; ++p) {
      float sum = 0;
      for (int i = 0; i < axis.count(); ++i) sum += axis.Weight(i, p);
      ASSERT_EQ(sum, 1.0f) << size << " " << p;
    }
  }
}

TEST(BlockAxis, CoresTileItAndNoneIsEmpty) {
  for (const int size : {1, 64, 65, 129, 1281, 2160, 16384}) {
    for (const BlockParams& params : {kSmall, BlockParams{}}) {
      const BlockAxis axis(size, params);
      int end = 0;
      for (int i = 0; i < axis.count(); ++i) {
        EXPECT_EQ(axis.Core(i).begin, end);
        EXPECT_GT(axis.Core(i).end, axis.Core(i).begin);
        EXPECT_LE(axis.Core(i).end - axis.Core(i).begin, params.core);
        end = axis.Core(i).end;
      }
      EXPECT_EQ(end, size);
    }
  }
}

TEST(BlockGrid, LeavesFramesUpToFullHighDefinitionWhole) {
  EXPECT_TRUE(BlockGrid(1920, 1080, {}).IsOneBlock());
  EXPECT_TRUE(BlockGrid(500, 4096, {}).IsOneBlock());
  EXPECT_TRUE(BlockGrid(0, 0, {}).IsOneBlock());
  EXPECT_FALSE(BlockGrid(3840, 2160, {}).IsOneBlock());
  EXPECT_EQ(BlockGrid(1920, 1080, {}).Input(0, 0), (Rect{0, 0, 1920, 1080}));
}

TEST(BlockGrid, DividesLongFramesHoweverThinTheyAre) {
  for (const auto& [width, height] : {std::pair(1, 200'000), std::pair(4097, 20)}) {
    const BlockGrid grid(width, height, {});
    for (int row = 0; row < grid.rows(); ++row) {
      for (int column = 0; column < grid.columns(); ++column) {
        EXPECT_LE(grid.Input(column, row).width(), 4096);
        EXPECT_LE(grid.Input(column, row).height(), 4096);
      }
    }
  }
}

TEST(BlockGrid, FactorsBlendTheBlocksOfARowOverOneAnother) {
  constexpr int kWidth = 200;
  constexpr int kHeight = 150;
  const BlockGrid grid(kWidth, kHeight, kSmall);
  for (const int y : {0, 70, kHeight - 1}) {
    // Each block is blended over those before it with its factor, so that a constant stays.
    std::vector<float> blended(kWidth, -1);
    for (int row = 0; row < grid.rows(); ++row) {
      for (int column = 0; column < grid.columns(); ++column) {
        const Rect output = grid.Output(column, row);
        if (y < output.y0 || y >= output.y1) continue;
        const std::vector<float> factors = grid.BlendFactors(column, row, y);
        ASSERT_EQ(factors.size(), static_cast<size_t>(output.x1 - output.x0));
        for (size_t i = 0; i < factors.size(); ++i) {
          EXPECT_TRUE(factors[i] >= 0 && factors[i] <= 1);
          float& value = blended[static_cast<size_t>(output.x0) + i];
          if (value < 0) {
            EXPECT_NEAR(factors[i], 1, 1e-6f) << "the first one there";
          }
          value = 1;
        }
      }
    }
    for (const float value : blended) EXPECT_EQ(value, 1);
  }
}

TEST(FilterInBlocks, PutsWhatNothingChangesTogetherToTheLastBit) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(211, 150, 0.3f, 5);
  FilmInMemory film(synthetic.film);
  const LayeredImage picture = InBlocks(&film, "none", kSmall, {"distance.Z"});
  for (const auto& [from, to] : {std::pair("noisy.R", "R"), std::pair("noisy.G", "G"),
                                 std::pair("noisy.B", "B"), std::pair("distance.Z", "distance.Z")}) {
    EXPECT_TRUE(SameBits(picture.Get(to), synthetic.film.Get(from))) << to;
  }
}

TEST(FilterInBlocks, LeavesNoSeamWhereCoresMeet) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(512, 128, 0.3f, 6);
  FilmInMemory film(synthetic.film);
  // No edge of the film lies on a border: there blocks differ more than elsewhere, wherever they meet.
  const BlockParams params = {.core = 192, .fade = 32, .whole = 0};
  const BlockGrid grid(512, 128, params);
  ASSERT_EQ(grid.Core(1, 0), (Rect{192, 0, 384, 128}));
  const LayeredImage picture = InBlocks(&film, "default", params);
  const auto whole = FilterFilm(synthetic.film, "default", nullptr);
  ASSERT_TRUE(whole.ok());
  double border = 0;
  double interior = 0;
  ForEachPixel(512, 128, [&](int x, int y) {
    const double off = std::abs(static_cast<double>(picture.Get("G").At(x, y) - (*whole)[1].At(x, y)));
    const bool is_border = (x >= 188 && x < 196) || (x >= 380 && x < 388);
    (is_border ? border : interior) += off;
  });
  EXPECT_GT(interior, 0);
  EXPECT_LT(border / (16 * 128), 2 * interior / (496 * 128));
}

TEST(FilterInBlocks, TakesOutAsMuchNoiseAsOneBlock) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(384, 256, 0.4f, 7);
  FilmInMemory film(synthetic.film);
  const LayeredImage picture =
      InBlocks(&film, "default", {.core = 128, .margin = 64, .fade = 32, .whole = 0});
  const auto whole = FilterFilm(synthetic.film, "default", nullptr);
  ASSERT_TRUE(whole.ok());
  double in_blocks = 0;
  double in_one = 0;
  ForEachPixel(384, 256, [&](int x, int y) {
    const float truth = synthetic.truth.Get("G").At(x, y);
    in_blocks += std::pow(static_cast<double>(picture.Get("G").At(x, y) - truth), 2);
    in_one += std::pow(static_cast<double>((*whole)[1].At(x, y) - truth), 2);
  });
  EXPECT_LT(in_blocks, 1.1 * in_one);
}

/// Crop `input` of the film, filtered by itself, has the bits of `picture` in `part`, both in the frame.
void ExpectSameBitsOfCrop(const LayeredImage& film, const Rect& input, const Rect& part,
                          const LayeredImage& picture) {
  const auto crop = FilterFilm(film.Crop(input), "default", nullptr);
  ASSERT_TRUE(crop.ok()) << crop.status();
  const ConstColorView whole = picture.GetColor("");
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_TRUE(SameBits((*crop)[c].view().Crop(SeenFrom(input.x0, input.y0, part)), whole[c].Crop(part)))
        << part.x0 << " " << part.y0 << " " << c;
  }
}

TEST(FilterInBlocks, ACropOfABlockWithItsOverlapHasTheSameBits) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(160, 128, 0.4f, 7);
  FilmInMemory film(synthetic.film);
  const LayeredImage picture = InBlocks(&film, "default", kSmall);
  const BlockGrid grid(160, 128, kSmall);
  ASSERT_EQ(grid.columns() * grid.rows(), 6);
  for (int row = 0; row < grid.rows(); ++row) {
    for (int column = 0; column < grid.columns(); ++column) {
      // Where no other block is blended in.
      const Rect core = grid.Core(column, row);
      const Rect alone = {core.x0 > 0 ? core.x0 + kSmall.fade : 0, core.y0 > 0 ? core.y0 + kSmall.fade : 0,
                          core.x1 < 160 ? core.x1 - kSmall.fade : 160,
                          core.y1 < 128 ? core.y1 - kSmall.fade : 128};
      ExpectSameBitsOfCrop(synthetic.film, grid.Input(column, row), alone, picture);
    }
  }
}

TEST(FilterInBlocks, TellsWhatIsMissingAndStopsWhereTheSinkRefuses) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(100, 200, 0.3f, 5);
  FilmInMemory film(synthetic.film);
  const absl::Status missing = FilterFilmInRows(
      &film, "none", {"no.Y"}, nullptr, [](const LayeredImage&) { return absl::OkStatus(); }, kSmall);
  EXPECT_EQ(missing.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(missing.message()), ::testing::HasSubstr("no.Y"));
  int calls = 0;
  const auto refuse = [&](const LayeredImage&) {
    ++calls;
    return absl::UnavailableError("full");
  };
  EXPECT_EQ(FilterFilmInRows(&film, "none", {}, nullptr, refuse, kSmall).code(),
            absl::StatusCode::kUnavailable);
  EXPECT_EQ(calls, 1);
}

TEST(FilterInBlocks, TellsTheShareThatIsDone) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(64, 128, 0.3f, 5);
  for (const BlockParams& params : {BlockParams(), kSmall}) {
    FilmInMemory film(synthetic.film);
    std::vector<double> shares;
    const absl::Status status = FilterFilmInRows(
        &film, "default", {}, nullptr, [](const LayeredImage&) { return absl::OkStatus(); }, params, nullptr,
        [&](double share) { shares.push_back(share); });
    ASSERT_TRUE(status.ok()) << status;
    EXPECT_GE(shares.size(), 2u);
    EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
    EXPECT_GT(shares.front(), 0);
    EXPECT_LT(shares.back(), 1);
  }
}

TEST(FilterInBlocks, BlocksThatAreReadyAreDone) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(64, 128, 0.3f, 5);
  FilmInMemory film(synthetic.film);
  std::vector<double> shares;
  const absl::Status status = FilterFilmInRows(
      &film, "default", {}, nullptr, [](const LayeredImage&) { return absl::OkStatus(); }, kSmall,
      [](int, int row) -> absl::StatusOr<std::optional<std::vector<Picture>>> {
        if (row > 0) return std::nullopt;
        std::vector<Picture> pictures;
        const Rect output = BlockGrid(64, 128, kSmall).Output(0, 0);
        pictures.push_back(MakePicture(output.width(), output.height()));
        return pictures;
      },
      [&](double share) { shares.push_back(share); });
  ASSERT_TRUE(status.ok()) << status;
  ASSERT_FALSE(shares.empty());
  EXPECT_GE(shares.front(), 0.5);
}

TEST(EdgesInside, KeepsThePixelsOfThePartAndCountsFromItsCorner) {
  LayeredImage edges(kSubSamples, 3);
  const FloatView x = edges.Add(layers::kPixelX);
  const FloatView y = edges.Add(layers::kPixelY);
  const FloatView id = edges.Add(layers::kObjectId);
  for (int row = 0; row < 3; ++row) {
    for (int s = 0; s < kSubSamples; ++s) {
      x.At(s, row) = static_cast<float>(10 * row);
      y.At(s, row) = static_cast<float>(5 * row);
      id.At(s, row) = static_cast<float>(row);
    }
  }
  const LayeredImage inside = EdgesInside(edges, {8, 4, 20, 20});
  ASSERT_EQ(inside.height(), 1);
  EXPECT_EQ(inside.Get(layers::kPixelX).At(15, 0), 2.0f);
  EXPECT_EQ(inside.Get(layers::kPixelY).At(15, 0), 1.0f);
  EXPECT_EQ(inside.Get(layers::kObjectId).At(15, 0), 1.0f);
  EXPECT_TRUE(EdgesInside(edges, {1, 0, 9, 20}).channels().empty());
}

}  // namespace
}  // namespace lumifold::filter
