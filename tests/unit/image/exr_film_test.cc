#include "filter/image/exr_film.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfTiledOutputFile.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "filter/image/exr_io.h"
#include "filter/image/exr_row_writer.h"
#include "filter/image/file_io.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "tests/support/temp_folder.h"

namespace lumifold {
namespace {

using ::testing::HasSubstr;

constexpr int kFilmWidth = 75;
constexpr int kFilmHeight = 53;

/// A picture whose values all differ.
LayeredImage SamplePicture(int width = kFilmWidth, int height = kFilmHeight) {
  LayeredImage image(width, height);
  float value = 0;
  for (const char* name : {"R", "noisy.G"}) {
    const FloatView view = image.Add(name);
    ForEachPixel(width, height, [&](int x, int y) { view.At(x, y) = value += 0.25f; });
  }
  image.metadata()["lumifold:job"] = "j-1";
  return image;
}

/// An edge set of every seventh pixel, in the order of rows.
LayeredImage SampleEdges() {
  constexpr int kRows = kFilmWidth * kFilmHeight / 7;
  LayeredImage edges(kSubSamples, kRows);
  const FloatView x = edges.Add(layers::kPixelX);
  const FloatView y = edges.Add(layers::kPixelY);
  for (int row = 0; row < kRows; ++row) {
    const int column = 7 * row % kFilmWidth;
    const int line = 7 * row / kFilmWidth;
    for (int s = 0; s < kSubSamples; ++s) {
      x.At(s, row) = static_cast<float>(column);
      y.At(s, row) = static_cast<float>(line);
    }
  }
  return edges;
}

/// Two fragments of each pixel of the edge set.
LayeredImage SampleFragments() {
  const LayeredImage edges = SampleEdges();
  LayeredImage fragments(1, 2 * edges.height());
  for (const std::string_view place : {layers::kPixelX, layers::kPixelY}) {
    const FloatView out = fragments.Add(place);
    for (int row = 0; row < fragments.height(); ++row) out.At(0, row) = edges.Get(place).At(0, row / 2);
  }
  const FloatView surface = fragments.Add(layers::kSurface);
  for (int row = 0; row < fragments.height(); ++row) surface.At(0, row) = static_cast<float>(row % 5 + 1);
  return fragments;
}

void ExpectSame(const LayeredImage& a, const LayeredImage& b) {
  ASSERT_EQ(a.bounds(), b.bounds());
  ASSERT_EQ(a.channels().size(), b.channels().size());
  for (const LayeredImage::Channel& channel : a.channels()) {
    ASSERT_TRUE(b.Has(channel.name)) << channel.name;
    for (int y = 0; y < a.height(); ++y) {
      const float* row = channel.plane.Row(y);
      ASSERT_TRUE(std::equal(row, row + a.width(), b.Get(channel.name).Row(y))) << channel.name << " " << y;
    }
  }
}

void WriteTiled(const std::string& path, const LayeredImage& image) {
  Imf::Header header(image.width(), image.height());
  header.setTileDescription(Imf::TileDescription(16, 24, Imf::ONE_LEVEL));
  Imf::FrameBuffer frame;
  for (const LayeredImage::Channel& channel : image.channels()) {
    header.channels().insert(channel.name, Imf::Channel(Imf::FLOAT));
    const ConstFloatView view = channel.plane.view();
    char* base = reinterpret_cast<char*>(const_cast<float*>(view.Row(0)));
    frame.insert(channel.name, Imf::Slice(Imf::FLOAT, base, sizeof(float),
                                          static_cast<size_t>(view.stride()) * sizeof(float)));
  }
  Imf::TiledOutputFile file(path.c_str(), header);
  file.setFrameBuffer(frame);
  file.writeTiles(0, file.numXTiles() - 1, 0, file.numYTiles() - 1);
}

/// Parts in the order of blocks, then some that go back, and some that need no scratch file.
const std::vector<Rect> kParts = {{0, 0, 40, 30},         {30, 0, 75, 30},
                                  {0, 20, 40, 53},        {30, 20, 75, 53},
                                  {5, 3, 6, 4},           {70, 50, 75, 53},
                                  {0, 7, kFilmWidth, 29}, {0, 0, 1, 1},
                                  {74, 52, 75, 53},       {0, 0, kFilmWidth, kFilmHeight}};

class ExrFilmTest : public testing::Test {
 protected:
  std::unique_ptr<ExrFilm> Open(const std::string& path) {
    absl::StatusOr<std::unique_ptr<ExrFilm>> film = ExrFilm::Open(path, folder_.path());
    EXPECT_TRUE(film.ok()) << film.status();
    return film.ok() ? *std::move(film) : nullptr;
  }

  TempFolder folder_;
};

TEST_F(ExrFilmTest, ReadsAnyPartOfScanLinesAndTiles) {
  const LayeredImage picture = SamplePicture();
  ASSERT_TRUE(WriteExr(folder_.PathOf("lines.exr"), picture).ok());
  WriteTiled(folder_.PathOf("tiles.exr"), picture);
  for (const char* name : {"lines.exr", "tiles.exr"}) {
    const std::unique_ptr<ExrFilm> film = Open(folder_.PathOf(name));
    EXPECT_EQ(film->width(), kFilmWidth);
    EXPECT_EQ(film->height(), kFilmHeight);
    for (const Rect& part : kParts) {
      const absl::StatusOr<EdgedImage> read = film->Read(part);
      ASSERT_TRUE(read.ok()) << read.status();
      ExpectSame(read->pixels, picture.Crop(part));
      EXPECT_TRUE(read->edges.channels().empty());
    }
  }
}

TEST_F(ExrFilmTest, GivesAPartItsLists) {
  std::vector<EdgedImage> films;
  films.push_back({SamplePicture(), SampleEdges()});
  films.push_back({SamplePicture(), SampleEdges(), SampleFragments()});
  films.push_back({SamplePicture(), {}, SampleFragments()});
  for (const EdgedImage& film : films) {
    ASSERT_TRUE(WriteExr(folder_.PathOf("film.exr"), film).ok());
    const std::unique_ptr<ExrFilm> source = Open(folder_.PathOf("film.exr"));
    for (const Rect& part : kParts) {
      const absl::StatusOr<EdgedImage> read = source->Read(part);
      ASSERT_TRUE(read.ok()) << read.status();
      ExpectSame(read->pixels, film.pixels.Crop(part));
      ExpectSame(read->edges, EdgesInside(film.edges, part));
      ExpectSame(read->fragments, EdgesInside(film.fragments, part));
    }
  }
}

TEST_F(ExrFilmTest, GivesAPartListsLargerThanAPieceOfTheScratchFile) {
  EdgedImage film{SamplePicture(), SampleEdges()};
  float value = 0;
  for (int c = 0; c < 40; ++c) {
    const FloatView view = film.edges.Add(absl::StrCat("channel", c));
    ForEachPixel(kSubSamples, film.edges.height(), [&](int x, int y) { view.At(x, y) = value += 0.25f; });
  }
  ASSERT_TRUE(WriteExr(folder_.PathOf("film.exr"), film).ok());
  const std::unique_ptr<ExrFilm> source = Open(folder_.PathOf("film.exr"));
  for (const Rect& part : kParts) {
    const absl::StatusOr<EdgedImage> read = source->Read(part);
    ASSERT_TRUE(read.ok()) << read.status();
    ExpectSame(read->edges, EdgesInside(film.edges, part));
  }
}

TEST_F(ExrFilmTest, TellsItsChannelsWithoutReadingPixels) {
  ASSERT_TRUE(WriteExr(folder_.PathOf("a.exr"), SamplePicture()).ok());
  const LayeredImage outline = Open(folder_.PathOf("a.exr"))->Outline();
  EXPECT_TRUE(outline.Has("noisy.G"));
  EXPECT_EQ(outline.width(), 0);
  EXPECT_EQ(outline.metadata().at("lumifold:job"), "j-1");
}

TEST_F(ExrFilmTest, LeavesNoScratchFileBehind) {
  ASSERT_TRUE(WriteExr(folder_.PathOf("a.exr"), SamplePicture()).ok());
  const std::unique_ptr<ExrFilm> film = Open(folder_.PathOf("a.exr"));
  ASSERT_TRUE(film->Read({0, 0, 9, 9}).ok());
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1);
}

TEST_F(ExrFilmTest, NamesWhatIsWrongWithAFile) {
  const std::string path = folder_.PathOf("a.exr");
  EXPECT_EQ(ExrFilm::Open(path, folder_.path()).status().code(), absl::StatusCode::kNotFound);
  ASSERT_TRUE(WriteFileAtomically(path, "text").ok());
  EXPECT_EQ(ExrFilm::Open(path, folder_.path()).status().code(), absl::StatusCode::kInvalidArgument);
  ASSERT_TRUE(WriteExr(path, SamplePicture()).ok());
  const std::string bytes = ReadFile(path, 1 << 24).value();
  ASSERT_TRUE(WriteFileAtomically(path, bytes.substr(0, bytes.size() - 9)).ok());
  const absl::StatusOr<EdgedImage> cut = Open(path)->Read({0, 40, 9, kFilmHeight});
  EXPECT_EQ(cut.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(cut.status().message()), HasSubstr(path));
}

TEST_F(ExrFilmTest, RefusesAnEdgeSetInAnotherOrderOrWithoutPlaces) {
  EdgedImage film{SamplePicture(), SampleEdges()};
  film.edges.Get(layers::kPixelY).At(0, 1) = 50;
  ASSERT_TRUE(WriteExr(folder_.PathOf("disorder.exr"), film).ok());
  EXPECT_THAT(std::string(Open(folder_.PathOf("disorder.exr"))->Read({0, 0, 40, 30}).status().message()),
              HasSubstr("not in the order"));
  LayeredImage placeless(kSubSamples, 4);
  placeless.Add("id.Y");
  film.edges = std::move(placeless);
  ASSERT_TRUE(WriteExr(folder_.PathOf("placeless.exr"), film).ok());
  EXPECT_THAT(std::string(Open(folder_.PathOf("placeless.exr"))->Read({0, 0, 40, 30}).status().message()),
              HasSubstr("pixel.X"));
}

TEST_F(ExrFilmTest, SaysWhereItsScratchFileCannotBe) {
  ASSERT_TRUE(WriteExr(folder_.PathOf("a.exr"), SamplePicture()).ok());
  const absl::StatusOr<std::unique_ptr<ExrFilm>> film =
      ExrFilm::Open(folder_.PathOf("a.exr"), folder_.PathOf("missing"));
  ASSERT_TRUE(film.ok());
  EXPECT_TRUE((*film)->Read({0, 0, kFilmWidth, kFilmHeight}).ok());  // this read needs no scratch file
  const absl::Status status = (*film)->Read({0, 0, 9, 9}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr(folder_.PathOf("missing")));
}

TEST_F(ExrFilmTest, RowsGiveTheSameFileHoweverTheyArePortioned) {
  const EdgedImage film{SamplePicture(), SampleEdges(), SampleFragments()};
  ASSERT_TRUE(WriteExr(folder_.PathOf("whole.exr"), film).ok());
  const auto layout = [](const LayeredImage& image) {
    ExrLayout result{image.width(), image.height(), {}, image.metadata()};
    for (const LayeredImage::Channel& channel : image.channels()) result.channels.push_back(channel.name);
    return result;
  };
  absl::StatusOr<ExrRowWriter> writer = ExrRowWriter::Create(folder_.PathOf("rows.exr"), layout(film.pixels),
                                                             {layout(film.edges), layout(film.fragments)});
  ASSERT_TRUE(writer.ok()) << writer.status();
  for (int y = 0; y < kFilmHeight; y += 10)
    ASSERT_TRUE(writer->Append(film.pixels.Crop({0, y, kFilmWidth, std::min(y + 10, kFilmHeight)})).ok());
  EXPECT_FALSE(std::filesystem::exists(folder_.PathOf("rows.exr")));
  ASSERT_TRUE(writer->AppendEdges(film.edges).ok());
  const Rect all = film.fragments.bounds();
  for (int y = 0; y < all.y1; y += 7)
    ASSERT_TRUE(writer->AppendFragments(film.fragments.Crop({0, y, 1, std::min(y + 7, all.y1)})).ok());
  ASSERT_TRUE(writer->Finish().ok());
  EXPECT_EQ(ReadFile(folder_.PathOf("rows.exr"), 1 << 24).value(),
            ReadFile(folder_.PathOf("whole.exr"), 1 << 24).value());
}

TEST_F(ExrFilmTest, AnyNumberOfThreadsGivesTheSameFileAndPicture) {
  const EdgedImage film{SamplePicture(300, 200), SampleEdges()};
  std::vector<std::string> files;
  for (const int threads : {1, 2, 5}) {
    SetExrThreads(threads);
    const std::string path = folder_.PathOf(absl::StrCat(threads, ".exr"));
    ASSERT_TRUE(WriteExr(path, film).ok());
    files.push_back(ReadFile(path, 1 << 24).value());
    const absl::StatusOr<LayeredImage> read = ReadExr(path);
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_TRUE(files.back() == files[0]) << threads;
    ExpectSame(*read, film.pixels);
  }
  SetExrThreads(1);
}

/// A file of two parts off the origin, with attributes of several types, as compositors write it: "rgba" with
/// R and G in half floats, and "diffuse" with R and B.
void WriteTwoParts(const std::string& path) {
  Imf::Header picture({{0, 0}, {99, 79}}, {{10, 20}, {12, 21}});
  Imf::addOwner(picture, "the studio");
  Imf::addTimeCode(picture, Imf::TimeCode(1, 2, 3, 4));
  Imf::addChromaticities(picture, Imf::Chromaticities({0.7f, 0.3f}));
  picture.compression() = Imf::ZIPS_COMPRESSION;
  Imf::Header diffuse = picture;
  for (const char* name : {"R", "G"}) picture.channels().insert(name, Imf::Channel(Imf::HALF));
  for (const char* name : {"R", "B"}) diffuse.channels().insert(name, Imf::Channel(Imf::FLOAT));
  picture.setName("rgba");
  diffuse.setName("diffuse");
  for (Imf::Header* header : {&picture, &diffuse}) header->setType(Imf::SCANLINEIMAGE);
  const Imf::Header headers[] = {picture, diffuse};
  Imf::MultiPartOutputFile file(path.c_str(), headers, 2);
  const std::vector<half> halves(6, half(0.5f));
  const std::vector<float> floats = {1, 2, 3, 4, 5, 6};
  const auto write = [&](int number, Imf::PixelType type, const void* values, size_t bytes) {
    Imf::FrameBuffer frame;
    for (auto it = headers[number].channels().begin(); it != headers[number].channels().end(); ++it)
      frame.insert(it.name(), Imf::Slice::Make(type, values, headers[number].dataWindow(), bytes, 3 * bytes));
    Imf::OutputPart part(file, number);
    part.setFrameBuffer(frame);
    part.writePixels(2);
  };
  write(0, Imf::HALF, halves.data(), sizeof(half));
  write(1, Imf::FLOAT, floats.data(), sizeof(float));
}

TEST_F(ExrFilmTest, AFileOfSeveralPartsIsOnePicture) {
  WriteTwoParts(folder_.PathOf("parts.exr"));
  const auto film = ExrFilm::Open(folder_.PathOf("parts.exr"), folder_.path());
  ASSERT_TRUE(film.ok()) << film.status();
  const absl::StatusOr<EdgedImage> read = (*film)->Read({1, 0, 3, 2});
  ASSERT_TRUE(read.ok()) << read.status();
  const absl::StatusOr<LayeredImage> whole = ReadExr(folder_.PathOf("parts.exr"));
  ASSERT_TRUE(whole.ok()) << whole.status();
  for (const LayeredImage* image : {&read->pixels, &*whole}) {
    const int x = image->width() - 1;
    ASSERT_EQ(image->channels().size(), 4u);
    EXPECT_EQ(image->Get("G").At(x, 1), 0.5f);
    EXPECT_EQ(image->Get("diffuse.R").At(x, 0), 3);
    EXPECT_EQ(image->Get("diffuse.B").At(x, 1), 6);
  }
}

TEST_F(ExrFilmTest, WhatIsMadeOfAFileKeepsItsWindowsAndAttributes) {
  WriteTwoParts(folder_.PathOf("parts.exr"));
  const auto film = ExrFilm::Open(folder_.PathOf("parts.exr"), folder_.path());
  ASSERT_TRUE(film.ok()) << film.status();
  ExrLayout layout{3, 2, {"R"}, {{"owner", "us"}, {"lumifold.method", "none"}}};
  layout.origin = (*film)->origin();
  auto writer = ExrRowWriter::Create(folder_.PathOf("made.exr"), layout);
  ASSERT_TRUE(writer.ok()) << writer.status();
  LayeredImage rows(3, 2);
  rows.Add("R").At(2, 1) = 7;
  ASSERT_TRUE(writer->Append(rows).ok());
  ASSERT_TRUE(writer->Finish().ok());
  Imf::InputFile made(folder_.PathOf("made.exr").c_str());
  const Imf::Header& header = made.header();
  EXPECT_EQ(header.displayWindow(), Imath::Box2i({0, 0}, {99, 79}));
  EXPECT_EQ(header.dataWindow(), Imath::Box2i({10, 20}, {12, 21}));
  EXPECT_EQ(header.compression(), Imf::ZIP_COMPRESSION);
  EXPECT_EQ(Imf::timeCode(header).hours(), 1);
  EXPECT_EQ(Imf::chromaticities(header).red.x, 0.7f);
  EXPECT_EQ(Imf::owner(header), "us") << "what the writer says counts more";
  EXPECT_FALSE(header.hasName());
  const absl::StatusOr<LayeredImage> read = ReadExr(folder_.PathOf("made.exr"));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->Get("R").At(2, 1), 7);
}

TEST_F(ExrFilmTest, AWriterRefusesOtherRowsAndLeavesNothingUnfinished) {
  {
    absl::StatusOr<ExrRowWriter> writer =
        ExrRowWriter::Create(folder_.PathOf("a.exr"), {kFilmWidth, kFilmHeight, {"R", "G"}, {}});
    ASSERT_TRUE(writer.ok());
    EXPECT_FALSE(writer->Append(SamplePicture()).ok());       // no G
    EXPECT_FALSE(writer->Append(SamplePicture(8, 8)).ok());   // too narrow
    EXPECT_FALSE(writer->AppendEdges(SamplePicture()).ok());  // the layout has none
    EXPECT_FALSE(writer->AppendFragments(SamplePicture()).ok());
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

}  // namespace
}  // namespace lumifold
