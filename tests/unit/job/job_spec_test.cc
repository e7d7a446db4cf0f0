#include "server/job/job_spec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "server/job/limits.h"

namespace lumifold::job {
namespace {

using ::testing::HasSubstr;

v1::JobSpec GoodSpec() {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.mutable_scene()->mutable_file()->set_sha256(std::string(64, 'a'));
  spec.set_width(512);
  spec.set_height(384);
  spec.set_frame_count(1);
  spec.set_samples_per_pixel(64);
  spec.set_max_bounces(8);
  return spec;
}

/// Adds a valid environment map and its file.
v1::EnvironmentMap& AddEnvironment(v1::JobSpec& spec) {
  spec.mutable_scene()->add_dependencies()->set_uri("environment:sky.exr");
  spec.mutable_environment()->set_uri("environment:sky.exr");
  spec.mutable_environment()->set_scale(1);
  return *spec.mutable_environment();
}

TEST(JobSpec, TakesAnEnvironmentAndALens) {
  v1::JobSpec spec = GoodSpec();
  AddEnvironment(spec).set_rotate_degrees(-90);
  spec.mutable_lens()->set_f_stop(2.8f);
  spec.mutable_lens()->set_focus_metres(3);
  EXPECT_TRUE(NormaliseJobSpec(spec).ok());
}

TEST(JobSpec, FillsInWhatIsLeftOpen) {
  const absl::StatusOr<v1::JobSpec> spec = NormaliseJobSpec(GoodSpec());
  ASSERT_TRUE(spec.ok()) << spec.status();
  EXPECT_EQ(spec->tile_size(), 32);
  EXPECT_EQ(spec->pass_samples(), 64);
  EXPECT_EQ(spec->first_pass_samples(), 2);
  EXPECT_EQ(spec->frames_per_second(), 24);
  EXPECT_EQ(spec->filter().method(), "default");
}

TEST(JobSpec, LongPassesKeepTheirNumberSmall) {
  v1::JobSpec open = GoodSpec();
  open.set_samples_per_pixel(4112);
  const absl::StatusOr<v1::JobSpec> spec = NormaliseJobSpec(open);
  ASSERT_TRUE(spec.ok()) << spec.status();
  EXPECT_EQ(spec->pass_samples(), 258);  // 4112 / 16 = 257, made even
}

TEST(JobSpec, KeepsWhatIsGiven) {
  v1::JobSpec given = GoodSpec();
  given.set_tile_size(16);
  given.set_pass_samples(8);
  given.set_frames_per_second(29.97);
  given.mutable_filter()->set_method("none");
  absl::StatusOr<v1::JobSpec> spec = NormaliseJobSpec(given);
  ASSERT_TRUE(spec.ok());
  spec->clear_plan();
  EXPECT_EQ(spec->SerializeAsString(), given.SerializeAsString());
}

/// Adds files with long URIs until a normalised spec has `bytes`.
void FillUpTo(size_t bytes, v1::JobSpec& spec) {
  spec = *NormaliseJobSpec(spec);
  const auto add = [&spec](size_t uri_bytes) {
    std::string uri = std::to_string(spec.scene().dependencies_size());
    uri.resize(uri_bytes, 'x');
    spec.mutable_scene()->add_dependencies()->set_uri(uri);
  };
  constexpr size_t kMostAround = 64;  // what a message adds to the URI
  while (spec.ByteSizeLong() + 2 * (kMaxUriBytes + kMostAround) < bytes) add(kMaxUriBytes);
  add(kMaxUriBytes / 2);
  std::string& last = *spec.mutable_scene()->mutable_dependencies()->rbegin()->mutable_uri();
  add(kMaxUriBytes / 2);
  while (spec.ByteSizeLong() < bytes && last.size() < kMaxUriBytes) last.push_back('x');
  std::string& other = *spec.mutable_scene()->mutable_dependencies()->rbegin()->mutable_uri();
  while (spec.ByteSizeLong() < bytes) other.push_back('x');
}

TEST(JobSpec, WhatIsAtALimitIsTaken) {
  v1::JobSpec spec = GoodSpec();
  spec.set_camera(std::string(kMaxNameBytes, 'x'));
  spec.mutable_scene()->set_display_name(std::string(kMaxNameBytes, 'x'));
  spec.mutable_filter()->set_method(std::string(kMaxNameBytes, 'x'));
  for (int i = 0; i < kMaxDependencies; ++i)
    spec.mutable_scene()->add_dependencies()->set_uri(std::to_string(i));
  spec.mutable_scene()->mutable_dependencies(0)->set_uri(std::string(kMaxUriBytes, 'x'));
  EXPECT_TRUE(NormaliseJobSpec(spec).ok()) << NormaliseJobSpec(spec).status();
  spec = GoodSpec();
  FillUpTo(kMaxSpecBytes, spec);
  EXPECT_EQ(spec.ByteSizeLong(), kMaxSpecBytes);
  EXPECT_TRUE(NormaliseJobSpec(spec).ok()) << NormaliseJobSpec(spec).status();
}

TEST(JobSpec, EachBadFieldIsNamed) {
  struct Case {
    std::function<void(v1::JobSpec&)> spoil;
    const char* message;
  };
  const std::vector<Case> cases = {
      {[](auto& s) { s.set_width(0); }, "width is 0, not 1 to 16384"},
      {[](auto& s) { s.set_height(16385); }, "height is 16385"},
      {[](auto& s) { s.set_frame_count(0); }, "frame_count is 0"},
      {[](auto& s) { s.add_more_frames()->set_first(-3); }, "more_frames[0].first is -3, not "},
      {[](auto& s) { s.set_first_frame(2147483647); }, "first_frame is 2147483647"},
      {[](auto& s) { s.set_samples_per_pixel(-4); }, "samples_per_pixel is -4"},
      {[](auto& s) { s.set_samples_per_pixel(kMaxSamples + 1); }, "samples_per_pixel is 1048577"},
      {[](auto& s) { s.set_frame_count(kMaxFrames + 1); }, "frame_count is 100001"},
      {[](auto& s) { s.set_tile_size(kMaxTileSize + 1); }, "tile_size is 513"},
      {[](auto& s) { s.set_pass_samples(kMaxSamples + 2); }, "pass_samples is 1048578"},
      {[](auto& s) {
         s.set_width(kMaxEdge), s.set_height(kMaxEdge), s.set_samples_per_pixel(kMaxSamples);
         s.set_frame_count(4097);
       },
       "4097 frames with 281474976710656 camera samples each is more than"},
      {[](auto& s) { s.set_camera(std::string(kMaxNameBytes + 1, 'x')); },
       "camera has 256 bytes, more than 255"},
      {[](auto& s) { s.mutable_scene()->set_display_name(std::string(kMaxNameBytes + 1, 'x')); },
       "scene.display_name has 256 bytes"},
      {[](auto& s) { s.mutable_filter()->set_method(std::string(kMaxNameBytes + 1, 'x')); },
       "filter.method has 256 bytes"},
      {[](auto& s) { s.mutable_scene()->mutable_file()->set_uri(std::string(kMaxUriBytes + 1, 'x')); },
       "scene.file.uri has 4097 bytes"},
      {[](auto& s) { s.mutable_environment()->set_uri(std::string(kMaxUriBytes + 1, 'x')); },
       "environment.uri has 4097 bytes"},
      {[](auto& s) { s.mutable_scene()->add_dependencies()->set_uri(std::string(kMaxUriBytes + 1, 'x')); },
       "scene.dependencies[0].uri has 4097 bytes, more than 4096"},
      {[](auto& s) {
         for (int i = 0; i <= kMaxDependencies; ++i)
           s.mutable_scene()->add_dependencies()->set_uri(std::to_string(i));
       },
       "the number of scene.dependencies is 16385, not 0 to 16384"},
      {[](auto& s) { FillUpTo(kMaxSpecBytes + 1, s); }, "the spec has 4063233 bytes, more than 4063232"},
      {[](auto& s) { s.set_max_bounces(1025); }, "max_bounces is 1025"},
      {[](auto& s) { s.set_tile_size(7); }, "tile_size is 7"},
      {[](auto& s) { s.set_pass_samples(3); }, "pass_samples is 3, not even"},
      {[](auto& s) { s.set_pass_samples(8), s.set_first_pass_samples(3); },
       "first_pass_samples is 3, not even"},
      {[](auto& s) { s.set_pass_samples(8), s.set_first_pass_samples(10); },
       "first_pass_samples is 10, not 0 to 8"},
      {[](auto& s) { s.set_frames_per_second(-24); }, "frames_per_second is -24"},
      {[](auto& s) { s.set_frames_per_second(HUGE_VAL); }, "frames_per_second is inf"},
      {[](auto& s) {
         s.set_width(16384), s.set_height(16384), s.set_tile_size(8);
         s.set_samples_per_pixel(1 << 20), s.set_pass_samples(2);
       },
       "cuts a frame into"},
      {[](auto& s) { s.mutable_scene()->mutable_file()->set_size(kMaxAssetBytes + 1); }, "scene.file.size"},
      {[](auto& s) { s.mutable_scene()->add_dependencies(); }, "the uri is empty"},
      {[](auto& s) { AddEnvironment(s).set_uri("environment:x"); }, "'environment:x' is not among"},
      {[](auto& s) { AddEnvironment(s).set_scale(0); }, "environment.scale is 0"},
      {[](auto& s) { AddEnvironment(s).set_rotate_degrees(std::nanf("")); }, "environment.rotate_degrees"},
      {[](auto& s) { s.mutable_lens()->set_focus_metres(1); }, "lens.f_stop is 0"},
      {[](auto& s) { s.mutable_crop()->set_frame_width(64); }, "crop.frame_height is 0, not 1 to 16384"},
      {[](auto& s) { s.mutable_crop()->set_frame_width(16385); }, "crop.frame_width is 16385"},
      {[](auto& s) {
         s.mutable_crop()->set_frame_width(s.width() + 4), s.mutable_crop()->set_frame_height(s.height());
         s.mutable_crop()->set_x(5);
       },
       "crop.x is 5, not 0 to 4"},
      {[](auto& s) {
         s.mutable_crop()->set_frame_width(s.width()), s.mutable_crop()->set_frame_height(s.height());
         s.mutable_crop()->set_y(-1);
       },
       "crop.y is -1, not 0 to 0"},
      {[](auto& s) { s.set_background(v1::Background(2)); }, "background is 2, which is none"},
      {[](auto& s) { s.set_ground(v1::Ground(2)); }, "ground is 2, which is none"},
      {[](auto& s) { s.set_ground(v1::GROUND_SHADOW); }, "ground: a shadow needs a transparent background"},
      {[](auto& s) { s.mutable_pixel_filter()->set_width(0); },
       "pixel_filter.width is 0, not above 0 and at most 8"},
      {[](auto& s) { s.mutable_pixel_filter()->set_width(HUGE_VALF); }, "pixel_filter.width is inf"},
      {[](auto& s) {
         s.mutable_pixel_filter()->set_width(1), s.mutable_pixel_filter()->set_kind(v1::PixelFilterKind(3));
       },
       "pixel_filter.kind is 3, which is none"},
      {[](auto& s) { s.mutable_lens()->set_f_stop(2); }, "lens.focus_metres is 0"},
  };
  for (const Case& c : cases) {
    v1::JobSpec spec = GoodSpec();
    c.spoil(spec);
    const absl::StatusOr<v1::JobSpec> result = NormaliseJobSpec(spec);
    EXPECT_EQ(result.status().code(), absl::StatusCode::kInvalidArgument) << c.message;
    EXPECT_THAT(std::string(result.status().message()), HasSubstr(c.message));
  }
}

}  // namespace
}  // namespace lumifold::job
