#include "client/pictures/output_file.h"

#include <gtest/gtest.h>

#include "filter/image/exr_io.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

TEST(PictureFormatOf, RefusesEveryOtherName) {
  for (const char* name : {"", "out", "out.gif", "exr", "out.exr.bak"}) {
    EXPECT_EQ(PictureFormatOf(name).status(),
              absl::InvalidArgumentError("expected a name that ends in .exr, .png or .jpg; got '" +
                                         std::string(name) + "'"));
  }
}

TEST(PictureFormatOf, GoesByTheLastLetters) {
  EXPECT_EQ(PictureFormatOf("a.exr").value(), PictureFormat::kExr);
  EXPECT_EQ(PictureFormatOf("dir.exr/a.PNG").value(), PictureFormat::kPng);
  EXPECT_EQ(PictureFormatOf("a.Jpg").value(), PictureFormat::kJpeg);
  EXPECT_EQ(PictureFormatOf("a.jpeg").value(), PictureFormat::kJpeg);
}

TEST(CheckOutput, FindsWhatIsInTheWay) {
  const ScratchFolder folder;
  folder.Write("file", "");
  folder.Write("folder.exr/file", "");
  const std::string missing = folder.File("none/a.exr");
  EXPECT_EQ(CheckOutput(missing), absl::NotFoundError("cannot write " + missing + ": folder " +
                                                      folder.File("none") + " does not exist"));
  const std::string under_file = folder.File("file/a.exr");
  EXPECT_EQ(CheckOutput(under_file), absl::InvalidArgumentError("cannot write " + under_file + ": " +
                                                                folder.File("file") + " is not a folder"));
  const std::string is_folder = folder.File("folder.exr");
  EXPECT_EQ(CheckOutput(is_folder),
            absl::InvalidArgumentError("cannot write " + is_folder + ": it is a folder"));
  EXPECT_EQ(CheckOutput(folder.File("new.exr")), absl::OkStatus());
  EXPECT_EQ(CheckOutput(folder.File("file")), absl::OkStatus());
  EXPECT_EQ(CheckOutput("here.exr"), absl::OkStatus());
}

TEST(WriteLayer, NamesTheLayerThatIsMissing) {
  const ScratchFolder folder;
  LayeredImage image(4, 3);
  image.AddColor("");
  const std::string exr = folder.File("a.exr");
  ASSERT_EQ(WriteExr(exr, image), absl::OkStatus());
  EXPECT_EQ(WriteLayer(exr, "noisy", {}, folder.File("a.png")),
            absl::NotFoundError(exr + ": has no colour layer 'noisy'; it has the picture itself"));
  EXPECT_EQ(WriteLayer(exr, "", {}, folder.File("a.png")), absl::OkStatus());
  EXPECT_EQ(folder.Read("a.png").substr(1, 3), "PNG");
}

TEST(WriteLayer, NamesAFileThatIsNoPicture) {
  const ScratchFolder folder;
  const std::string exr = folder.Write("a.exr", "hello");
  const absl::Status status = WriteLayer(exr, "", {}, folder.File("a.png"));
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
  EXPECT_NE(status.message().find(exr), std::string::npos) << status;
  EXPECT_EQ(folder.FileCount(), 1);
}

}  // namespace
}  // namespace lumifold::client
