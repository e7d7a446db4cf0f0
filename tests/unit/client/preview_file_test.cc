#include "client/pictures/preview_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "absl/time/clock.h"
#include "filter/image/exr_io.h"
#include "proto/rpc/image_codec.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/client/fake_farm.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using ::testing::HasSubstr;

class PreviewFileTest : public ::testing::Test {
 protected:
  PreviewFileTest() {
    LayeredImage picture(2, 1);
    for (const char* name : {"R", "G", "B"}) picture.Add(name).At(1, 0) = 0.5f;
    Answer(picture);
  }
  void Answer(const LayeredImage& picture) {
    rpc::EncodedPicture encoded = rpc::EncodePicture(picture);
    farm_.preview.set_units(3);
    *farm_.preview.mutable_layout() = std::move(encoded.layout);
    farm_.preview.set_planes(std::move(encoded.bytes));
  }
  /// Follows a frame until it has one preview.
  absl::Status Follow(const std::string& path) {
    const size_t calls = farm_.calls().size();
    PreviewFile file(ConnectTo({.coordinators = {farm_.address()},
                                .time = time_.Environment(),
                                .interrupted = [] { return false; }}),
                     {.job_id = "job-1", .path = path});
    while (farm_.calls().size() == calls) absl::SleepFor(absl::Milliseconds(1));
    return file.Stop();
  }

  FakeFarm farm_;
  FakeTime time_;
  const TempFolder folder_;
};

TEST_F(PreviewFileTest, WritesWhatTheFarmShows) {
  const std::string path = folder_.PathOf("picture.exr");
  EXPECT_EQ(Follow(path), absl::OkStatus());
  const absl::StatusOr<LayeredImage> picture = ReadExr(path);
  ASSERT_TRUE(picture.ok()) << picture.status();
  EXPECT_EQ(picture->Get("G").At(1, 0), 0.5f);
  EXPECT_FALSE(std::filesystem::exists(path + ".part"));
}

TEST_F(PreviewFileTest, SaysWhyAFileCannotBeWritten) {
  EXPECT_THAT(std::string(Follow(folder_.PathOf("none/picture.png")).message()),
              HasSubstr("none/picture.png.part.png"));
}

TEST_F(PreviewFileTest, RefusesAPictureThatIsNone) {
  const std::string path = folder_.PathOf("picture.png");
  farm_.preview.mutable_planes()->resize(3);
  EXPECT_FALSE(Follow(path).ok());
  farm_.preview.mutable_layout()->set_width(1 << 20);
  EXPECT_FALSE(Follow(path).ok());
  LayeredImage grey(2, 1);
  grey.Add("Y");
  Answer(grey);
  EXPECT_FALSE(Follow(path).ok());
  EXPECT_FALSE(std::filesystem::exists(path));
}

}  // namespace
}  // namespace lumifold::client
