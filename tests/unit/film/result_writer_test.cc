#include "server/film/result_writer.h"

#include <gtest/gtest.h>

#include "filter/image/exr_io.h"
#include "tests/support/film_of_units.h"
#include "tests/support/same_image.h"
#include "tests/support/temp_folder.h"

namespace lumifold::film {
namespace {

constexpr int kWidth = 21;
constexpr int kHeight = 22;

v1::JobSpec Spec(bool save_film) {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(kWidth);
  spec.set_height(kHeight);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(8);
  spec.set_pass_samples(4);
  spec.mutable_filter()->set_method("none");
  spec.set_save_film(save_film);
  return spec;
}

/// Rows [y0, y1) of an arbitrary picture.
std::array<Plane, 3> PictureToWrite(int y0, int y1) {
  std::array<Plane, 3> picture;
  for (size_t c = 0; c < picture.size(); ++c) {
    picture[c] = Plane(kWidth, y1 - y0);
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < kWidth; ++x)
        picture[c].At(x, y - y0) = static_cast<float>(100 * y + x) + 0.25f * static_cast<float>(c);
    }
  }
  return picture;
}

/// Writes a file in bands of rows that end at `ends`, and reads it.
EdgedImage WrittenInRows(const v1::JobSpec& spec, const UnitSource& units, const std::vector<int>& ends) {
  const TempFolder folder;
  UnitFilm film = *UnitFilm::Open(spec, 0, &units, nullptr);
  ResultWriter writer =
      *ResultWriter::Create(folder.PathOf("rows.exr"), film, {.spec = spec, .frame = 0, .numeric_class = ""});
  int y = 0;
  for (const int end : ends) {
    EXPECT_TRUE(writer.Append(*film.Read({0, y, kWidth, end}), PictureToWrite(y, end)).ok());
    y = end;
  }
  EXPECT_TRUE(writer.Finish().ok());
  return *ReadEdgedExr(folder.PathOf("rows.exr"));
}

TEST(ResultWriter, RowsMakeTheFileThatTheWholeMakes) {
  for (const bool save_film : {false, true}) {
    const v1::JobSpec spec = Spec(save_film);
    const UnitsOfFunction units = RandomUnitsOf(spec, 1);
    const EdgedImage expected = BuildResult(*WholeFilm(spec, 0, units), PictureToWrite(0, kHeight),
                                            {.spec = spec, .frame = 0, .numeric_class = ""});
    for (const std::vector<int>& ends : {std::vector<int>{kHeight}, {8, 16, kHeight}, {1, 9, 11, kHeight}}) {
      const EdgedImage written = WrittenInRows(spec, units, ends);
      ExpectSameImage(written.pixels, expected.pixels);
      EXPECT_EQ(written.pixels.metadata(), expected.pixels.metadata());
      EXPECT_EQ(written.edges.height(), save_film ? 2 * 9 : 0);
      ExpectSameImage(written.edges, expected.edges);
      EXPECT_EQ(written.fragments.height() > 5 * 2 * 2, save_film);
      ExpectSameImage(written.fragments, expected.fragments);
    }
  }
}

TEST(ResultWriter, AFilmWithoutEdgesIsAFileOfOnePart) {
  const v1::JobSpec spec = Spec(true);
  const UnitsOfFunction random = RandomUnitsOf(spec, 1);
  const UnitsOfFunction units([&](const job::UnitKey& key) -> absl::StatusOr<EdgedImage> {
    return EdgedImage{std::move(random.Read(key)->pixels), {}};
  });
  const EdgedImage written = WrittenInRows(spec, units, {8, 16, kHeight});
  EXPECT_TRUE(written.pixels.Has("direct_a.R"));
  EXPECT_TRUE(written.edges.channels().empty());
  EXPECT_TRUE(written.fragments.channels().empty());
}

}  // namespace
}  // namespace lumifold::film
