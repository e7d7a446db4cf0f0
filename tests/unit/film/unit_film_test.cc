#include "server/film/unit_film.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "proto/rpc/image_codec.h"
#include "tests/support/film_of_units.h"
#include "tests/support/shuffling_pool.h"

namespace lumifold::film {
namespace {

using job::FrameUnits;
using job::UnitKey;
using ::testing::HasSubstr;

v1::JobSpec Spec(int samples) {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(21);
  spec.set_height(10);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(samples);
  spec.set_pass_samples(4);
  return spec;
}

std::string FilmBytes(const absl::StatusOr<EdgedImage>& film) {
  return rpc::BytesFromImage(film->pixels) + rpc::BytesFromImage(film->edges) +
         rpc::BytesFromImage(film->fragments);
}

class UnitFilmTest : public ::testing::Test {
 protected:
  absl::StatusOr<EdgedImage> Read(const UnitKey& key) const {
    return RandomUnit(key, units_.tiles().RectOf(key.tile), units_.SamplesOf(key), 9);
  }
  absl::StatusOr<EdgedImage> Assemble(TaskPool* pool) const {
    return WholeFilm(spec_, 0, RandomUnitsOf(spec_, 9), pool);
  }
  /// Sum of a channel at a pixel over the passes of its tile, in pass order.
  double Sum(const std::string& channel, int x, int y) const {
    double sum = 0.0;
    for (int tile = 0; tile < units_.tiles().count(); ++tile) {
      const Rect rect = units_.tiles().RectOf(tile);
      if (!rect.Contains(x, y)) continue;
      for (int pass = 0; pass < units_.pass_count(); ++pass) {
        const LayeredImage unit = (*Read({0, tile, pass, v1::UNIT_KIND_PASS})).pixels;
        if (unit.Has(channel)) sum += unit.Get(channel).At(x - rect.x0, y - rect.y0);
      }
    }
    return sum;
  }

  const v1::JobSpec spec_ = Spec(18);
  const FrameUnits units_{spec_};
};

TEST_F(UnitFilmTest, EqualsTheDirectSumInPassOrder) {
  const absl::StatusOr<EdgedImage> film = Assemble(nullptr);
  ASSERT_TRUE(film.ok()) << film.status();
  for (int y = 0; y < spec_.height(); ++y) {
    for (int x = 0; x < spec_.width(); ++x) {
      const double n_a = Sum("samples_a.Y", x, y);
      const double n_b = Sum("samples_b.Y", x, y);
      ASSERT_EQ(n_a + n_b, 18.0);
      for (const char* layer : {"noisy", "direct", "indirect", "glossy"}) {
        const double a = Sum(std::string(layer) + "_a.G", x, y);
        const double b = Sum(std::string(layer) + "_b.G", x, y);
        ASSERT_EQ(film->pixels.Get(std::string(layer) + ".G").At(x, y),
                  static_cast<float>((a + b) / (n_a + n_b)));
        ASSERT_EQ(film->pixels.Get(std::string(layer) + "_a.G").At(x, y), static_cast<float>(a / n_a));
        ASSERT_EQ(film->pixels.Get(std::string(layer) + "_b.G").At(x, y), static_cast<float>(b / n_b));
      }
      ASSERT_EQ(film->pixels.Get("albedo.B").At(x, y), static_cast<float>(Sum("albedo.B", x, y) / 18.0));
      ASSERT_EQ(film->pixels.Get("emission.R").At(x, y), static_cast<float>(Sum("emission.R", x, y) / 18.0));
    }
  }
}

TEST_F(UnitFilmTest, ALevelsLightIsAMeanOverTheSamplesThatReachedIt) {
  const absl::StatusOr<EdgedImage> film = Assemble(nullptr);
  ASSERT_TRUE(film.ok()) << film.status();
  for (int y = 0; y < spec_.height(); ++y) {
    for (int x = 0; x < spec_.width(); ++x) {
      const double n_a = Sum("reflection1_samples_a.Y", x, y);
      const double n_b = Sum("reflection1_samples_b.Y", x, y);
      const double a = Sum("reflection1_direct_a.G", x, y);
      const double b = Sum("reflection1_direct_b.G", x, y);
      const auto mean = [](double sum, double n) { return n > 0 ? static_cast<float>(sum / n) : 0.0f; };
      ASSERT_EQ(film->pixels.Get("reflection1_direct.G").At(x, y), mean(a + b, n_a + n_b));
      ASSERT_EQ(film->pixels.Get("reflection1_direct_a.G").At(x, y), mean(a, n_a));
      ASSERT_EQ(film->pixels.Get("reflection1_direct_b.G").At(x, y), mean(b, n_b));
      ASSERT_EQ(film->pixels.Get("reflection1_samples_a.Y").At(x, y), static_cast<float>(n_a));
      ASSERT_EQ(film->pixels.Get("reflection1_albedo.R").At(x, y),
                static_cast<float>(Sum("reflection1_albedo.R", x, y) / 18.0));
      ASSERT_EQ(film->pixels.Get("transmission2_emission.B").At(x, y),
                static_cast<float>(Sum("transmission2_emission.B", x, y) / 18.0));
    }
  }
  EXPECT_FALSE(film->pixels.Has("reflection2_direct.G"));  // no tile has it
}

TEST_F(UnitFilmTest, EdgesComeInTheOrderOfTheFramesRows) {
  const absl::StatusOr<EdgedImage> film = Assemble(nullptr);
  const LayeredImage& edges = film->edges;
  ASSERT_EQ(edges.width(), kSubSamples);
  ASSERT_EQ(edges.height(), 2 * 6);  // two for each tile
  for (int row = 1; row < edges.height(); ++row) {
    const auto place = [&](int r) {
      return std::pair(edges.Get(layers::kPixelY).At(0, r), edges.Get(layers::kPixelX).At(0, r));
    };
    EXPECT_LT(place(row - 1), place(row));
  }
  const LayeredImage tile = (*Read({0, 4, 0, v1::UNIT_KIND_GEOMETRY})).edges;
  int found = 0;
  for (int row = 0; row < edges.height(); ++row) {
    if (edges.Get(layers::kPixelX).At(0, row) != tile.Get(layers::kPixelX).At(0, 1) ||
        edges.Get(layers::kPixelY).At(0, row) != tile.Get(layers::kPixelY).At(0, 1))
      continue;
    ++found;
    for (int i = 0; i < kSubSamples; ++i)
      EXPECT_EQ(edges.Get("emission.G").At(i, row), tile.Get("emission.G").At(i, 1));
  }
  EXPECT_EQ(found, 1);
}

/// Pixel and surface of a row of fragments.
std::array<float, 3> PlaceOf(const LayeredImage& fragments, int row) {
  return {fragments.Get(layers::kPixelY).At(0, row), fragments.Get(layers::kPixelX).At(0, row),
          fragments.Get(layers::kSurface).At(0, row)};
}

TEST_F(UnitFilmTest, FragmentsOfOneSurfaceAreSummedInPassOrder) {
  const absl::StatusOr<EdgedImage> film = Assemble(nullptr);
  const LayeredImage& fragments = film->fragments;
  ASSERT_EQ(fragments.width(), 1);
  ASSERT_GT(fragments.height(), 3 * 2 * 2) << "the surfaces of the passes differ";
  for (int row = 0; row < fragments.height(); ++row) {
    if (row > 0) {
      EXPECT_LT(PlaceOf(fragments, row - 1), PlaceOf(fragments, row));
    }
    std::map<std::string, double> sums;
    for (int tile = 0; tile < units_.tiles().count(); ++tile) {
      for (int pass = 0; pass < units_.pass_count(); ++pass) {
        const LayeredImage unit = (*Read({0, tile, pass, v1::UNIT_KIND_PASS})).fragments;
        for (int i = 0; i < unit.height(); ++i) {
          if (PlaceOf(unit, i) != PlaceOf(fragments, row)) continue;
          for (const LayeredImage::Channel& channel : unit.channels())
            sums[channel.name] += channel.plane.At(0, i);
        }
      }
    }
    const double a = sums["samples_a.Y"];
    const double b = sums["samples_b.Y"];
    const auto expect = [&](const std::string& name, double samples) {
      EXPECT_EQ(fragments.Get(name).At(0, row), static_cast<float>(samples > 0 ? sums[name] / samples : 0))
          << name;
    };
    EXPECT_EQ(fragments.Get("samples_a.Y").At(0, row), a);
    EXPECT_EQ(fragments.Get("samples_b.Y").At(0, row), b);
    for (const char* name : {"direct_a.R", "indirect_a.G"}) expect(name, a);
    for (const char* name : {"direct_b.R", "indirect_b.G"}) expect(name, b);
    for (const char* name : {"N.X", "N.Z", "distance.Z", "albedo.G"}) expect(name, a + b);
  }
}

TEST_F(UnitFilmTest, RefusesFragmentsThatAreNotOfTheirTile) {
  const absl::StatusOr<EdgedImage> film =
      WholeFilm(spec_, 0, UnitsOfFunction([&](const UnitKey& key) -> absl::StatusOr<EdgedImage> {
                  EdgedImage unit = *Read(key);
                  if (key.tile == 2 && unit.fragments.height() > 0)
                    unit.fragments.Get(layers::kPixelX).At(0, 0) = 3;
                  return unit;
                }),
                nullptr);
  EXPECT_EQ(film.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(film.status().message()), HasSubstr("row 0 is surface 7 of the pixel 3,0"));
}

TEST_F(UnitFilmTest, RefusesAnEdgeThatIsNotOfItsTile) {
  const absl::StatusOr<EdgedImage> film =
      WholeFilm(spec_, 0, UnitsOfFunction([&](const UnitKey& key) -> absl::StatusOr<EdgedImage> {
                  EdgedImage unit = *Read(key);
                  if (key.tile == 1 && unit.edges.height() > 0) unit.edges.Get(layers::kPixelX).At(0, 0) = 3;
                  return unit;
                }),
                nullptr);
  EXPECT_EQ(film.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(film.status().message()), HasSubstr("the pixel 3,0 of row 0"));
}

TEST_F(UnitFilmTest, GeometryIsTakenAsItIs) {
  const absl::StatusOr<EdgedImage> film = Assemble(nullptr);
  const Rect rect = units_.tiles().RectOf(4);
  const LayeredImage geometry = (*Read({0, 4, 0, v1::UNIT_KIND_GEOMETRY})).pixels;
  for (const std::string& name : GeometryChannels()) {
    for (int y = 0; y < rect.height(); ++y) {
      for (int x = 0; x < rect.width(); ++x) {
        ASSERT_EQ(film->pixels.Get(name).At(rect.x0 + x, rect.y0 + y), geometry.Get(name).At(x, y)) << name;
      }
    }
  }
}

TEST_F(UnitFilmTest, IsTheSameForAnyOrderOfTiles) {
  const std::string expected = FilmBytes(Assemble(nullptr));
  for (uint32_t seed = 0; seed < 5; ++seed) {
    ShufflingPool pool(seed);
    EXPECT_EQ(FilmBytes(Assemble(&pool)), expected);
  }
  EXPECT_EQ(FilmBytes(Assemble(MakeTaskPool(4).get())), expected);
}

TEST_F(UnitFilmTest, AnEmptyHalfIsZeroAndNotNan) {
  const v1::JobSpec spec = Spec(1);
  const FrameUnits units(spec);
  const absl::StatusOr<EdgedImage> film =
      WholeFilm(spec, 0, UnitsOfFunction([&](const UnitKey& key) -> absl::StatusOr<EdgedImage> {
                  EdgedImage unit = RandomUnit(key, units.tiles().RectOf(key.tile), units.SamplesOf(key), 3);
                  if (key.kind == v1::UNIT_KIND_PASS) unit.pixels.GetColor("direct_b")[0].At(0, 0) = 0.0f;
                  return unit;
                }),
                nullptr);
  ASSERT_TRUE(film.ok());
  EXPECT_EQ(film->pixels.Get("samples_a.Y").At(0, 0), 1.0f);
  EXPECT_EQ(film->pixels.Get("samples_b.Y").At(0, 0), 0.0f);
  EXPECT_EQ(film->pixels.Get("direct_b.R").At(0, 0), 0.0f);
  EXPECT_EQ(film->pixels.Get("direct.R").At(0, 0), film->pixels.Get("direct_a.R").At(0, 0));
}

TEST_F(UnitFilmTest, NeverTurnsFewSamplesIntoNan) {
  const absl::StatusOr<EdgedImage> film =
      WholeFilm(spec_, 0, UnitsOfFunction([&](const UnitKey& key) -> absl::StatusOr<EdgedImage> {
                  EdgedImage unit = *Read(key);
                  for (LayeredImage::Channel& channel : unit.pixels.channels())
                    channel.plane.Fill(0.0f);  // no sample is finite
                  return unit;
                }),
                nullptr);
  ASSERT_TRUE(film.ok());
  for (const LayeredImage::Channel& channel : film->pixels.channels()) {
    EXPECT_EQ(channel.plane.At(20, 9), 0.0f) << channel.name;
  }
}

TEST_F(UnitFilmTest, TellsTheErrorOfTheLowestTile) {
  ShufflingPool pool(1);
  const absl::StatusOr<EdgedImage> film =
      WholeFilm(spec_, 0, UnitsOfFunction([&](const UnitKey& key) -> absl::StatusOr<EdgedImage> {
                  if (key.tile >= 2) return absl::DataLossError("tile " + std::to_string(key.tile));
                  return Read(key);
                }),
                &pool);
  EXPECT_EQ(film.status(), absl::DataLossError("tile 2"));
}

TEST_F(UnitFilmTest, RefusesAUnitOfTheWrongShape) {
  const absl::StatusOr<EdgedImage> film =
      WholeFilm(spec_, 0, UnitsOfFunction([&](const UnitKey& key) {
                  return absl::StatusOr<EdgedImage>(RandomUnit(key, {0, 0, 3, 3}, {0, 4}, 1));
                }),
                nullptr);
  EXPECT_EQ(film.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(film.status().message()), HasSubstr("size 3x3"));
}

TEST_F(UnitFilmTest, APartIsWhatTheWholeHasThere) {
  const EdgedImage whole = *Assemble(nullptr);
  FilmInMemory expected(whole.pixels, &whole.edges, &whole.fragments);
  const UnitsOfFunction units = RandomUnitsOf(spec_, 9);
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(2);
  absl::StatusOr<UnitFilm> film = UnitFilm::Open(spec_, 0, &units, pool.get());
  ASSERT_TRUE(film.ok()) << film.status();
  for (const Rect& rect : {Rect{0, 0, 21, 10}, Rect{3, 2, 19, 9}, Rect{8, 0, 16, 8}, Rect{0, 7, 21, 8},
                           Rect{9, 1, 11, 3}, Rect{20, 9, 21, 10}}) {
    const absl::StatusOr<EdgedImage> part = film->Read(rect);
    ASSERT_TRUE(part.ok()) << part.status();
    const absl::StatusOr<EdgedImage> there = expected.Read(rect);
    EXPECT_EQ(rpc::LayoutOf(part->pixels).SerializeAsString(),
              rpc::LayoutOf(there->pixels).SerializeAsString());
    EXPECT_EQ(FilmBytes(part), FilmBytes(there));
  }
}

TEST_F(UnitFilmTest, OnlyTheUnitsOfTheTilesThereAreRead) {
  std::vector<int32_t> read;
  const UnitsOfFunction units([&](const UnitKey& key) {
    read.push_back(key.tile);
    return Read(key);
  });
  absl::StatusOr<UnitFilm> film = UnitFilm::Open(spec_, 0, &units, nullptr);
  read.clear();
  ASSERT_TRUE(film->Read({8, 0, 17, 3}).ok());
  ASSERT_EQ(read.size(), 2u * static_cast<size_t>(units_.pass_count() + 1));
  EXPECT_EQ(std::count(read.begin(), read.end(), 1), units_.pass_count() + 1);
  EXPECT_EQ(std::count(read.begin(), read.end(), 2), units_.pass_count() + 1);
}

TEST_F(UnitFilmTest, TheOutlineIsThatOfTheWholeFilm) {
  const EdgedImage whole = *Assemble(nullptr);
  const UnitsOfFunction units = RandomUnitsOf(spec_, 9);
  const absl::StatusOr<UnitFilm> film = UnitFilm::Open(spec_, 0, &units, nullptr);
  const LayeredImage outline = film->Outline();
  ASSERT_EQ(outline.channels().size(), whole.pixels.channels().size());
  for (size_t i = 0; i < outline.channels().size(); ++i)
    EXPECT_EQ(outline.channels()[i].name, whole.pixels.channels()[i].name);
  EXPECT_EQ(film->edge_rows(), whole.edges.height());
  EXPECT_EQ(*film->CountFragments(), whole.fragments.height());
  ASSERT_EQ(film->FragmentChannels().size(), whole.fragments.channels().size());
  for (const LayeredImage::Channel& channel : whole.fragments.channels())
    EXPECT_THAT(film->FragmentChannels(), ::testing::Contains(channel.name));
}

TEST_F(UnitFilmTest, BandsEndWithTheTiles) {
  const UnitsOfFunction units = RandomUnitsOf(spec_, 9);
  const absl::StatusOr<UnitFilm> film = UnitFilm::Open(spec_, 0, &units, nullptr);
  EXPECT_EQ(film->BandEnd(0), 8);
  EXPECT_EQ(film->BandEnd(5), 8);
  EXPECT_EQ(film->BandEnd(8), 10);
}

/// A unit cut from one picture of the whole frame.
EdgedImage UnitOfFrame(const UnitKey& key, const Rect& rect) {
  const Rect frame = {0, 0, 21, 10};
  const UnitKey whole = {0, 4, key.pass, key.kind};  // tile 4 has a level and fragments
  const auto first = static_cast<uint32_t>(4 * key.pass);
  const EdgedImage unit = RandomUnit(whole, frame, {first, first + 4}, 5);
  EdgedImage part = {unit.pixels.Crop(rect), EdgesInside(unit.edges, rect),
                     EdgesInside(unit.fragments, rect)};
  for (LayeredImage* list : {&part.edges, &part.fragments}) MovePlaces(rect.x0, rect.y0, list);
  return part;
}

TEST_F(UnitFilmTest, IsTheSameForAnyTiles) {
  std::string expected;
  for (const int tile_size : {32, 8, 9}) {
    v1::JobSpec spec = Spec(16);
    spec.set_tile_size(tile_size);
    const FrameUnits units(spec);
    const absl::StatusOr<EdgedImage> film =
        WholeFilm(spec, 0, UnitsOfFunction([&](const UnitKey& key) -> absl::StatusOr<EdgedImage> {
                    return UnitOfFrame(key, units.tiles().RectOf(key.tile));
                  }));
    ASSERT_TRUE(film.ok()) << film.status();
    EXPECT_EQ(film->edges.height(), 2);
    EXPECT_GE(film->fragments.height(), 4);
    if (expected.empty()) expected = FilmBytes(film);
    EXPECT_EQ(FilmBytes(film), expected) << tile_size;
  }
}

TEST_F(UnitFilmTest, OfLayersThatThePlanLeavesOutTheFilterNeedsZeros) {
  v1::JobSpec planned = spec_;
  for (const char* name : {"indirect", "glossy"}) {
    v1::PlanDecision* decision = planned.mutable_plan()->add_decisions();
    decision->set_name(name);
    decision->set_value(0);
  }
  const UnitsOfFunction units([this](const UnitKey& key) {
    absl::StatusOr<EdgedImage> unit = Read(key);
    for (LayeredImage* image : {&unit->pixels, &unit->fragments}) {
      std::erase_if(image->channels(), [](const LayeredImage::Channel& channel) {
        return channel.name.starts_with("indirect_") || channel.name.starts_with("glossy");
      });
    }
    std::erase_if(unit->fragments.channels(), [](const LayeredImage::Channel& channel) {
      return channel.name == layers::kRoughness;  // of glossy light
    });
    return unit;
  });
  EXPECT_FALSE(WholeFilm(spec_, 0, units, nullptr).ok());
  const absl::StatusOr<EdgedImage> film = WholeFilm(planned, 0, units, nullptr);
  ASSERT_TRUE(film.ok()) << film.status();
  const absl::StatusOr<EdgedImage> full = Assemble(nullptr);
  for (const char* name : {"glossy.R", "glossy_a.G", "glossy_albedo.B"}) {
    EXPECT_FALSE(film->pixels.Has(name)) << name;
    EXPECT_FALSE(film->fragments.Has(name)) << name;
  }
  EXPECT_EQ(film->fragments.Get("indirect_a.R").At(0, 1), 0);
  EXPECT_EQ(film->fragments.Get("direct_a.R").At(0, 1),
            Assemble(nullptr)->fragments.Get("direct_a.R").At(0, 1));
  for (int x = 0; x < spec_.width(); ++x) {
    for (const char* name : {"indirect.R", "indirect_a.G", "indirect_b.B"})
      EXPECT_EQ(film->pixels.Get(name).At(x, 3), 0) << name;
    EXPECT_EQ(film->pixels.Get("direct_a.R").At(x, 3), full->pixels.Get("direct_a.R").At(x, 3));
  }
}

}  // namespace
}  // namespace lumifold::film
