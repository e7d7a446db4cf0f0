#include "filter/image/exr_copy.h"

#include <ImfChannelList.h>
#include <ImfHeader.h>
#include <ImfMultiPartInputFile.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "filter/image/exr_io.h"
#include "filter/image/file_io.h"
#include "tests/support/same_image.h"
#include "tests/support/temp_folder.h"

namespace lumifold {
namespace {

/// A picture of more rows than are copied at a time, with lists.
EdgedImage CopiedPicture() {
  EdgedImage image{LayeredImage(5, 150), LayeredImage(16, 3)};
  for (const char* name : {"R", "G", "B", "A", "noisy.R", "noisy.G", "noisy.B", "N.X", "N.Y", "N.Z", "id.Y",
                           "CryptoObject00.R", "CryptoObject00.G", "CryptoObject00.B", "CryptoObject00.A"}) {
    const FloatView view = image.pixels.Add(name);
    for (int y = 0; y < 150; ++y) {
      for (int x = 0; x < 5; ++x)
        view.At(x, y) = std::sin(static_cast<float>(x + 7 * y) + static_cast<float>(name[0])) + 2;
    }
  }
  image.pixels.metadata()["lumifold.scene"] = "room.glb";
  for (const char* name : {"pixel.X", "id.Y"}) image.edges.Add(name).At(2, 1) = 7;
  image.fragments = LayeredImage(1, 130);
  for (const char* name : {"pixel.X", "surface.Y"}) image.fragments.Add(name).At(0, 129) = 12345;
  return image;
}

class ExrCopy : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_EQ(WriteExr(Path("from.exr"), CopiedPicture()), absl::OkStatus()); }
  std::string Path(const std::string& name) const { return folder_.PathOf(name); }
  absl::Status Copy(const ExrCopyOptions& options) {
    return CopyExr(Path("from.exr"), Path("to.exr"), options);
  }
  EdgedImage Copied() const { return *ReadEdgedExr(Path("to.exr")); }
  int Parts() const { return Imf::MultiPartInputFile(Path("to.exr").c_str()).parts(); }

 private:
  TempFolder folder_;
};

TEST_F(ExrCopy, AddsAttributesAndKeepsEveryBit) {
  ASSERT_EQ(Copy({.texts = {{"owner", "ann"}}, .numbers = {{"renderTime", 2.5f}}}), absl::OkStatus());
  const EdgedImage copy = Copied();
  EXPECT_EQ(copy.pixels.metadata().at("owner"), "ann");
  EXPECT_EQ(copy.pixels.metadata().at("lumifold.scene"), "room.glb");
  ExpectSameImage(copy.pixels, CopiedPicture().pixels);
  ExpectSameImage(copy.edges, CopiedPicture().edges);
  ExpectSameImage(copy.fragments, CopiedPicture().fragments);
  EXPECT_EQ(Parts(), 3);
}

TEST_F(ExrCopy, LosslessCompressionsKeepEveryBit) {
  for (const char* compression : {"none", "zips", "zip", "piz"}) {
    ASSERT_EQ(Copy({.compression = compression}), absl::OkStatus()) << compression;
    ExpectSameImage(Copied().pixels, CopiedPicture().pixels);
    ExpectSameImage(Copied().edges, CopiedPicture().edges);
    ExpectSameImage(Copied().fragments, CopiedPicture().fragments);
  }
}

TEST_F(ExrCopy, ALeanCopyHasWhatCompositorsUse) {
  EdgedImage bright = CopiedPicture();
  bright.pixels.Get("R").At(1, 140) = 1e9f;
  bright.pixels.Get("G").At(1, 140) = -1e9f;
  ASSERT_EQ(WriteExr(Path("from.exr"), bright), absl::OkStatus());
  ASSERT_EQ(Copy({.is_lean = true}), absl::OkStatus());
  EXPECT_EQ(Parts(), 1);
  const Imf::MultiPartInputFile file(Path("to.exr").c_str());
  const Imf::ChannelList& channels = file.header(0).channels();
  std::vector<std::string> halves;
  std::vector<std::string> floats;
  for (auto it = channels.begin(); it != channels.end(); ++it)
    (it.channel().type == Imf::HALF ? halves : floats).emplace_back(it.name());
  EXPECT_EQ(halves, (std::vector<std::string>{"A", "B", "G", "N.X", "N.Y", "N.Z", "R"}));
  EXPECT_EQ(floats, (std::vector<std::string>{"CryptoObject00.A", "CryptoObject00.B", "CryptoObject00.G",
                                              "CryptoObject00.R", "id.Y"}));
  const EdgedImage lean = Copied();
  const LayeredImage full = CopiedPicture().pixels;
  for (int y = 0; y < 150; ++y) {
    EXPECT_NEAR(lean.pixels.Get("B").At(3, y), full.Get("B").At(3, y), 1e-3f);
    EXPECT_EQ(lean.pixels.Get("CryptoObject00.R").At(3, y), full.Get("CryptoObject00.R").At(3, y));
    EXPECT_EQ(lean.pixels.Get("id.Y").At(3, y), full.Get("id.Y").At(3, y));
  }
  EXPECT_EQ(lean.pixels.Get("R").At(1, 140), 65504);
  EXPECT_EQ(lean.pixels.Get("G").At(1, 140), -65504);
  EXPECT_EQ(lean.pixels.metadata().at("lumifold.scene"), "room.glb");
}

TEST_F(ExrCopy, ALeanCopyHasLayersAsPartsAndLosesAsLittleWithDwaa) {
  ASSERT_EQ(Copy({.compression = "dwaa", .layers_as_parts = true, .is_lean = true}), absl::OkStatus());
  EXPECT_EQ(Parts(), 4) << "rgba, CryptoObject00, N, id";
  EXPECT_NEAR(Copied().pixels.Get("G").At(2, 99), CopiedPicture().pixels.Get("G").At(2, 99), 0.05f);
}

TEST_F(ExrCopy, LayersBecomePartsAndAreReadBack) {
  ASSERT_EQ(Copy({.layers_as_parts = true}), absl::OkStatus());
  EXPECT_EQ(Parts(), 7) << "rgba, CryptoObject00, N, id, noisy, edges and fragments";
  const EdgedImage copy = Copied();
  const LayeredImage picture = CopiedPicture().pixels;
  for (const LayeredImage::Channel& channel : picture.channels()) {
    ASSERT_TRUE(copy.pixels.Has(channel.name)) << channel.name;
    for (int y = 0; y < 150; ++y)
      ASSERT_EQ(copy.pixels.Get(channel.name).At(3, y), channel.plane.view().At(3, y));
  }
  ExpectSameImage(copy.edges, CopiedPicture().edges);
  ExpectSameImage(copy.fragments, CopiedPicture().fragments);
}

TEST_F(ExrCopy, DwaaLosesOnlyColours) {
  ASSERT_EQ(Copy({.compression = "dwaa"}), absl::OkStatus());
  const EdgedImage copy = Copied();
  const LayeredImage picture = CopiedPicture().pixels;
  for (const char* name : {"N.X", "id.Y", "CryptoObject00.R", "CryptoObject00.B"}) {
    for (int y = 0; y < 150; ++y)
      ASSERT_EQ(copy.pixels.Get(name).At(1, y), picture.Get(name).At(1, y)) << name;
  }
  double worst = 0;
  for (int y = 0; y < 150; ++y) {
    const double difference =
        std::fabs(static_cast<double>(copy.pixels.Get("noisy.G").At(2, y) - picture.Get("noisy.G").At(2, y)));
    worst = std::max(worst, difference);
  }
  EXPECT_GT(worst, 0);
  EXPECT_LT(worst, 0.5);
}

TEST_F(ExrCopy, SaysWhatIsWrong) {
  EXPECT_TRUE(absl::IsNotFound(CopyExr(Path("none.exr"), Path("to.exr"), {})));
  ASSERT_EQ(WriteFileAtomically(Path("text.exr"), "hello"), absl::OkStatus());
  EXPECT_TRUE(absl::IsInvalidArgument(CopyExr(Path("text.exr"), Path("to.exr"), {})));
  EXPECT_TRUE(absl::IsUnavailable(CopyExr(Path("from.exr"), Path("none/to.exr"), {})));
  EXPECT_FALSE(ReadExr(Path("to.exr")).ok()) << "nothing is left of a copy that failed";
}

}  // namespace
}  // namespace lumifold
