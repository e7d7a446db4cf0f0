#include "worker/units/unit_renderer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/synchronization/notification.h"
#include "filter/image/decisions.h"
#include "filter/image/layers.h"
#include "proto/rpc/limits.h"
#include "tests/support/gltf_fixture.h"
#include "tests/unit/worker/fake_assets.h"
#include "worker/units/job_plan.h"

namespace lumifold::worker {
namespace {

constexpr int kSize = 16;

/// An emissive square that fills the picture of an orthographic camera. If animated, it moves out of the
/// picture to the right within a second.
std::string ShiningSquare(bool animated, int unknown_extensions = 0) {
  scene::GltfFixture gltf;
  gltf.json["extensionsUsed"] = nlohmann::json::array({"KHR_materials_unlit"});
  for (int i = 0; i < unknown_extensions; ++i)
    gltf.json["extensionsUsed"].push_back("X_" + std::to_string(i) + std::string(1000, 'x'));
  gltf.json["materials"] = {{{"extensions", {{"KHR_materials_unlit", nlohmann::json::object()}}}}};
  gltf.AddTriangles({-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, -1, 0, 1, 1, 0, -1, 1, 0}, {{"material", 0}});
  gltf.json["cameras"] = {
      {{"type", "orthographic"}, {"orthographic", {{"xmag", 1}, {"ymag", 1}, {"znear", 0.1}, {"zfar", 9}}}}};
  gltf.AddNode({{"camera", 0}, {"translation", {0, 0, 5}}});
  gltf.json["scenes"] = nlohmann::json::array({{{"nodes", {0, 1}}}});
  if (animated) {
    const int times = gltf.AddFloats({0, 1}, "SCALAR");
    const int places = gltf.AddFloats({0, 0, 0, 2, 0, 0}, "VEC3");
    gltf.json["animations"] = {
        {{"samplers", {{{"input", times}, {"output", places}}}},
         {"channels", {{{"sampler", 0}, {"target", {{"node", 0}, {"path", "translation"}}}}}}}};
  }
  return gltf.Glb();
}

v1::JobSpec SpecAt(double frames_per_second) {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(kSize);
  spec.set_height(kSize);
  spec.set_frames_per_second(frames_per_second);
  spec.mutable_scene()->set_display_name("square.glb");
  return spec;
}

v1::Lease LeaseOf(int frame) {
  v1::Lease lease;
  lease.mutable_unit()->set_job_id("j");
  lease.mutable_unit()->set_frame(frame);
  lease.mutable_unit()->set_kind(v1::UNIT_KIND_PASS);
  lease.mutable_rect()->set_x1(kSize);
  lease.mutable_rect()->set_y1(kSize);
  lease.set_last_sample(2);
  return lease;
}

/// The share of the picture covered by the square in a frame.
double Coverage(UnitRenderer& renderer, const v1::JobSpec& spec, int frame) {
  UnitControl control;
  const absl::StatusOr<RenderedUnit> unit = renderer.Render(spec, LeaseOf(frame), &control);
  EXPECT_TRUE(unit.ok()) << unit.status();
  if (!unit.ok()) return -1;
  double sum = 0;
  const ConstFloatView red = unit->image.pixels.GetColor(layers::kEmission)[0];
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) sum += static_cast<double>(red.At(x, y));
  }
  return sum / (2.0 * kSize * kSize);
}

TEST(UnitRenderer, AFrameShowsTheSceneAtItsTime) {
  FakeAssets assets{ShiningSquare(true)};
  UnitRenderer renderer(&assets);
  EXPECT_EQ(Coverage(renderer, SpecAt(4), 0), 1);
  EXPECT_EQ(Coverage(renderer, SpecAt(4), 1), 0.75);  // 0.25 s: a quarter of the way
  EXPECT_EQ(Coverage(renderer, SpecAt(4), 3), 0.25);
  EXPECT_EQ(Coverage(renderer, SpecAt(4), 4), 0);
  EXPECT_EQ(Coverage(renderer, SpecAt(4), 400), 0);  // the position of the last keyframe
}

TEST(UnitRenderer, AStudioLightsWhatHasNoLight) {
  scene::GltfFixture fixture;
  fixture.AddTriangles(scene::kTriangle);
  FakeAssets assets{fixture.Glb()};
  v1::JobSpec spec = SpecAt(4);
  v1::Lease lease = LeaseOf(0);
  lease.mutable_unit()->set_kind(v1::UNIT_KIND_GEOMETRY);
  lease.set_last_sample(0);
  UnitControl control;
  for (const bool keep_dark : {false, true}) {
    spec.set_keep_dark(keep_dark);
    UnitRenderer renderer(&assets, 2);
    const absl::StatusOr<RenderedUnit> geometry = renderer.Render(spec, lease, &control);
    ASSERT_TRUE(geometry.ok()) << geometry.status();
    EXPECT_EQ(geometry->stats.environment(), keep_dark ? "" : "studio");
    EXPECT_THAT(
        geometry->stats.warnings(),
        testing::Contains(testing::HasSubstr(keep_dark ? "the picture is black" : "a neutral studio")));
    const absl::StatusOr<RenderedUnit> pass = renderer.Render(spec, LeaseOf(0), &control);
    ASSERT_TRUE(pass.ok()) << pass.status();
    const ConstFloatView red = std::as_const(pass->image.pixels).GetColor(layers::kEmission)[0];
    EXPECT_EQ(red.At(0, 0) > 0, !keep_dark) << "the studio is behind the triangle, too";
  }
}

TEST(UnitRenderer, FramesOfAnAnimationShareTheEnvironment) {
  // A Radiance file of one pixel, (1, 1, 1).
  FakeAssets assets{ShiningSquare(true), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n\x80\x80\x80\x81"};
  UnitRenderer renderer(&assets);
  v1::JobSpec spec = SpecAt(4);
  spec.mutable_environment()->set_uri("environment:sky.hdr");
  spec.mutable_environment()->set_scale(1);
  *spec.mutable_scene()->add_dependencies() = [] {
    v1::AssetRef sky;
    sky.set_uri("environment:sky.hdr");
    sky.set_sha256("sky");
    return sky;
  }();
  for (const int frame : {0, 1, 2}) EXPECT_GE(Coverage(renderer, spec, frame), 0);
  EXPECT_EQ(assets.fetches(), 3 + 1);
}

TEST(UnitRenderer, APlanUnitLeavesItsSceneToTheNextUnit) {
  FakeAssets assets{ShiningSquare(false)};
  UnitRenderer renderer(&assets);
  v1::JobSpec spec = SpecAt(0);
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_AUTO);
  spec.set_samples_per_pixel(2);
  v1::Lease lease = LeaseOf(0);
  lease.mutable_unit()->set_kind(v1::UNIT_KIND_PLAN);
  lease.set_last_sample(0);
  UnitControl control;
  const absl::StatusOr<RenderedUnit> planned = renderer.Render(spec, lease, &control);
  ASSERT_TRUE(planned.ok()) << planned.status();
  ASSERT_TRUE(planned->plan.has_value());
  EXPECT_EQ(planned->plan->decisions_size(), 13);
  EXPECT_GT(planned->plan->probe_rays(), 0);
  EXPECT_EQ(assets.fetches(), 1);
  *spec.mutable_plan() = *planned->plan;
  EXPECT_EQ(Coverage(renderer, spec, 0), 1);
  EXPECT_EQ(assets.fetches(), 1);
  const absl::StatusOr<RenderedUnit> again = renderer.Render(spec, lease, &control);
  EXPECT_EQ(again->plan->SerializeAsString(), planned->plan->SerializeAsString());
}

TEST(UnitRenderer, ObeysThePlanOfTheJob) {
  FakeAssets assets{ShiningSquare(false)};
  UnitRenderer renderer(&assets);
  v1::JobSpec spec = SpecAt(0);
  v1::PlanDecision* direct = spec.mutable_plan()->add_decisions();
  direct->set_name("direct");
  direct->set_value(0);
  UnitControl control;
  const absl::StatusOr<RenderedUnit> unit = renderer.Render(spec, LeaseOf(0), &control);
  ASSERT_TRUE(unit.ok()) << unit.status();
  EXPECT_FALSE(unit->image.pixels.Has("direct_a.R"));
  EXPECT_TRUE(unit->image.pixels.Has("indirect_a.R"));
}

TEST(UnitRenderer, AJobWithoutASpeedStandsStill) {
  FakeAssets assets{ShiningSquare(true)};
  UnitRenderer renderer(&assets);
  EXPECT_EQ(Coverage(renderer, SpecAt(0), 3), 1);
}

TEST(UnitRenderer, AMovingSceneIsLoadedOnceAFrame) {
  FakeAssets assets{ShiningSquare(true)};
  UnitRenderer renderer(&assets);
  for (const int frame : {0, 0, 1, 0, 1, 2, 1, 2})
    Coverage(renderer, SpecAt(4), frame);  // units of two frames alternate at the end of a frame
  EXPECT_EQ(assets.fetches(), 3);
  EXPECT_EQ(renderer.loads().scenes, 3);
  EXPECT_GT(renderer.loads().time, absl::ZeroDuration());
  Coverage(renderer, SpecAt(4), 0);  // the least recently used scene was unloaded
  EXPECT_EQ(assets.fetches(), 4);
}

TEST(UnitRenderer, AStillSceneIsLoadedOnceAJob) {
  FakeAssets assets{ShiningSquare(false)};
  UnitRenderer renderer(&assets);
  for (const int frame : {0, 5, 1, 7}) EXPECT_EQ(Coverage(renderer, SpecAt(24), frame), 1);
  EXPECT_EQ(assets.fetches(), 1);
}

TEST(UnitRenderer, ThreadsShareWhatIsBeingLoaded) {
  for (const bool animated : {false, true}) {
    FakeAssets assets{ShiningSquare(animated)};
    assets.SetOpen(false);
    UnitRenderer renderer(&assets);
    std::vector<std::thread> threads;
    threads.reserve(8);
    for (int i = 0; i < 8; ++i)
      threads.emplace_back([&renderer, i] { Coverage(renderer, SpecAt(4), i % 2); });
    assets.AwaitFetches(1);
    assets.SetOpen(true);
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(assets.fetches(), animated ? 2 : 1);
  }
}

/// Refuses the first fetch, once it may.
class RefusingAssets final : public AssetSource {
 public:
  absl::StatusOr<AssetContent> Fetch(const std::string& job_id, const v1::AssetRef& asset) override {
    if (!refused_.exchange(true)) {
      begun.Notify();
      may_refuse.WaitForNotification();
      return absl::PermissionDeniedError("no lease of the job");
    }
    return assets_.Fetch(job_id, asset);
  }
  absl::Notification begun;
  absl::Notification may_refuse;

 private:
  std::atomic<bool> refused_ = false;
  FakeAssets assets_{ShiningSquare(false)};
};

// The first unit's lease was that of a connection that broke; the second one's is valid.
TEST(UnitRenderer, ASceneThatWasRefusedToOneLeaseIsLoadedForAnother) {
  RefusingAssets assets;
  UnitRenderer renderer(&assets);
  UnitControl control;
  std::thread first([&] {
    EXPECT_EQ(renderer.Render(SpecAt(24), LeaseOf(0), &control).status().code(),
              absl::StatusCode::kPermissionDenied);
  });
  assets.begun.WaitForNotification();
  std::thread second([&] { EXPECT_EQ(Coverage(renderer, SpecAt(24), 0), 1); });
  assets.may_refuse.Notify();
  first.join();
  second.join();
}

TEST(UnitRenderer, WarningsOfAUnitAreBoundedAndTheRestIsCounted) {
  FakeAssets assets{ShiningSquare(/*animated=*/false, /*unknown_extensions=*/1000)};
  UnitRenderer renderer(&assets);
  v1::Lease lease = LeaseOf(0);
  lease.mutable_unit()->set_kind(v1::UNIT_KIND_GEOMETRY);
  UnitControl control;
  const absl::StatusOr<RenderedUnit> unit = renderer.Render(SpecAt(24), lease, &control);
  ASSERT_TRUE(unit.ok()) << unit.status();
  const auto& warnings = unit->stats.warnings();
  ASSERT_EQ(warnings.size(), static_cast<int>(rpc::kMaxUnitWarnings));
  for (const std::string& line : warnings) EXPECT_LE(line.size(), rpc::kMaxWarningBytes);
  EXPECT_EQ(warnings[0].substr(0, 14), "extension X_0x");
  EXPECT_EQ(warnings.rbegin()->substr(3), " further warnings are left out");
}

TEST(ApplyPlan, ChangesOnlyWhatThePlanDecides) {
  v1::JobSpec spec;
  render::RenderSettings settings;
  settings.max_bounces = 7;
  ApplyPlan(spec, &settings);
  spec.mutable_plan();
  ApplyPlan(spec, &settings);
  EXPECT_EQ(settings.max_bounces, 7);
  v1::PlanDecision& bounces = *spec.mutable_plan()->add_decisions();
  bounces.set_name(std::string(decisions::kBounces));
  bounces.set_value(2);
  ApplyPlan(spec, &settings);
  EXPECT_EQ(settings.max_bounces, 2);
}

}  // namespace
}  // namespace lumifold::worker
