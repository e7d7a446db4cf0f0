#include "client/pictures/view_transform.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "filter/image/color.h"
#include "filter/image/file_io.h"
#include "tests/support/temp_folder.h"

namespace lumifold::pictures {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;

/// What the view makes of a grey value.
float Shown(const std::string& view, float value) {
  const absl::StatusOr<ViewTransform> transform = ViewTransform::Create(view);
  EXPECT_TRUE(transform.ok()) << transform.status();
  std::array<float, 3> rgb = {value, value, value};
  transform->Apply(absl::MakeSpan(rgb));
  EXPECT_NEAR(rgb[0], rgb[2], 1e-3f);
  return rgb[0];
}

TEST(ViewTransform, StandardIsTheCurveOfSrgb) {
  for (const float value : {0.0f, 0.001f, 0.0031308f, 0.18f, 0.5f, 1.0f})
    EXPECT_NEAR(Shown("standard", value), SrgbFromLinear(value), 2e-4f) << value;
  EXPECT_GE(Shown("standard", 100), 1);
}

TEST(ViewTransform, FilmicKeepsDetailInBrightLight) {
  EXPECT_NEAR(Shown("filmic", 0), 0, 1e-6f);
  EXPECT_NEAR(Shown("filmic", 5.6f), 1, 2e-3f);
  float last = 0;
  for (const float value : {0.01f, 0.1f, 0.5f, 1.0f, 2.0f, 4.0f, 5.5f}) {
    EXPECT_GT(Shown("filmic", value), last) << value;
    EXPECT_LT(Shown("filmic", value), 1) << value;
    last = Shown("filmic", value);
  }
}

std::array<float, 3> ShownColor(const std::string& view, std::array<float, 3> rgb) {
  ViewTransform::Create(view).value().Apply(absl::MakeSpan(rgb));
  return rgb;
}

TEST(ViewTransform, AgXFadesBrightColoursToWhite) {
  EXPECT_NEAR(Shown("agx", 0.18f), 0.5f, 0.01f) << "middle grey is in the middle";
  EXPECT_NEAR(Shown("agx", 0), 0, 1e-3f);
  EXPECT_LE(Shown("agx", 1e6f), 1);
  const std::array<float, 3> dim = ShownColor("agx", {0, 0, 0.2f}), bright = ShownColor("agx", {0, 0, 500});
  EXPECT_LT(dim[0], 0.5f * dim[2]);
  EXPECT_GT(bright[0], 0.75f * bright[2]);
}

TEST(ViewTransform, NeutralKeepsTheColoursOfMaterials) {
  for (const float value : {0.1f, 0.4f, 0.75f})
    EXPECT_NEAR(Shown("neutral", value), SrgbFromLinear(value - 0.04f), 1e-3f) << value;
  EXPECT_NEAR(Shown("neutral", 0), 0, 1e-6f);
  const std::array<float, 3> red = ShownColor("neutral", {0.6f, 0.1f, 0.1f});
  EXPECT_NEAR(red[0], SrgbFromLinear(0.56f), 1e-3f);
  EXPECT_NEAR(red[1], SrgbFromLinear(0.06f), 1e-3f);
  float last = 0;
  for (const float value : {0.8f, 1.0f, 2.0f, 8.0f, 100.0f}) {
    EXPECT_GT(Shown("neutral", value), last) << value;
    last = Shown("neutral", value);
    EXPECT_LE(last, 1);
  }
}

TEST(ViewTransform, RawKeepsValuesAndANumberThatIsNoneIsBlack) {
  EXPECT_EQ(Shown("raw", 0.25f), 0.25f);
  for (const char* view : {"standard", "filmic", "agx", "neutral", "raw"})
    EXPECT_NEAR(Shown(view, std::numeric_limits<float>::quiet_NaN()), 0, 1e-6f) << view;
}

TEST(ViewTransform, NamesTheViewsThatThereAre) {
  const absl::Status status = ViewTransform::Create("cinematic").status();
  EXPECT_TRUE(absl::IsInvalidArgument(status));
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("expected standard, filmic, agx, neutral, raw; got 'cinematic'"));
}

/// A studio's configuration, named by the environment.
class StudioConfiguration : public ::testing::Test {
 protected:
  void Use(const std::string& text) {
    ASSERT_EQ(WriteFileAtomically(folder_.PathOf("config.ocio"), text), absl::OkStatus());
    setenv("OCIO", folder_.PathOf("config.ocio").c_str(), /*overwrite=*/1);
  }
  void TearDown() override { unsetenv("OCIO"); }

 private:
  TempFolder folder_;
};

TEST_F(StudioConfiguration, AddsItsViews) {
  Use(R"(ocio_profile_version: 2
roles: {scene_linear: lin, default: lin}
file_rules:
  - !<Rule> {name: Default, colorspace: lin}
displays:
  wall:
    - !<View> {name: half, colorspace: halved}
colorspaces:
  - !<ColorSpace> {name: lin}
  - !<ColorSpace>
    name: halved
    from_scene_reference: !<MatrixTransform> {matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]}
)");
  EXPECT_THAT(ViewTransform::Views(), Contains("half"));
  EXPECT_THAT(ViewTransform::Views(), Contains("wall/half"));
  EXPECT_EQ(Shown("half", 3), 1.5f);
  EXPECT_EQ(Shown("wall/half", 3), 1.5f);
  EXPECT_NEAR(Shown("standard", 0.18f), SrgbFromLinear(0.18f), 2e-4f);
}

TEST_F(StudioConfiguration, ThatCannotBeReadIsAnErrorForItsViewsOnly) {
  Use("this is no configuration");
  EXPECT_TRUE(absl::IsInvalidArgument(ViewTransform::Create("half").status()));
  EXPECT_TRUE(ViewTransform::Create("filmic").ok());
}

}  // namespace
}  // namespace lumifold::pictures
