// Damaged and hostile documents: for any bytes, loading returns a valid Scene or an error.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/support/gltf_samples.h"
#include "tests/support/scene_flaw.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold::scene {
namespace {

using testing::HasSubstr;

/// Counts loaded and refused documents: a test with only one kind would be too weak.
struct Outcomes {
  int loaded = 0;
  int refused = 0;

  void Add(const std::string& bytes) {
    const auto scene = LoadGltf(bytes, "test.glb", NoFiles);
    if (scene.ok()) {
      ++loaded;
      EXPECT_EQ(FirstFlaw(*scene), "");
    } else {
      ++refused;
      EXPECT_EQ(scene.status().message().find('\n'), absl::string_view::npos) << scene.status();
    }
  }
};

TEST(HostileInput, TheUndamagedDocumentsLoad) {
  for (const auto& [name, fixture] : SampleDocuments()) {
    const auto scene = fixture.Load();
    ASSERT_TRUE(scene.ok()) << name << ": " << scene.status();
    EXPECT_FALSE(scene->instances.empty()) << name;
    EXPECT_EQ(FirstFlaw(*scene), "") << name;
  }
}

TEST(HostileInput, EveryTruncationIsAnError) {
  for (const auto& [name, fixture] : SampleDocuments()) {
    const std::string glb = fixture.Glb();
    for (size_t n = 0; n < glb.size(); ++n) {
      EXPECT_FALSE(LoadGltf(glb.substr(0, n), "test.glb", NoFiles).ok()) << name << " cut to " << n;
    }
  }
}

TEST(HostileInput, TruncationsWithAMatchingHeaderAreHandled) {
  for (const auto& [name, fixture] : SampleDocuments()) {
    const std::string glb = fixture.Glb();
    for (size_t n = 12; n < glb.size(); ++n) {
      std::string cut = glb.substr(0, n);
      for (int byte = 0; byte < 4; ++byte) cut[8 + byte] = static_cast<char>(n >> (8 * byte));
      EXPECT_FALSE(LoadGltf(cut, "test.glb", NoFiles).ok()) << name << " cut to " << n;
    }
  }
}

TEST(HostileInput, FlippedBytesAreHandled) {
  std::mt19937 random(20240607);
  Outcomes outcomes;
  for (const auto& [name, fixture] : SampleDocuments()) {
    SCOPED_TRACE(name);
    const std::string glb = fixture.Glb();
    for (int attempt = 0; attempt < 1000; ++attempt) {
      std::string damaged = glb;
      const int flips = 1 + attempt % 4;
      for (int i = 0; i < flips; ++i) damaged[random() % damaged.size()] = static_cast<char>(random());
      outcomes.Add(damaged);
    }
  }
  EXPECT_GT(outcomes.loaded, 200);
  EXPECT_GT(outcomes.refused, 500);
}

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

/// Loads `fixture` with each number of its JSON replaced by each of several others.
void ChangeNumbers(const GltfFixture& fixture, Outcomes* outcomes) {
  const std::string text = fixture.FullJson().dump();
  for (size_t i = 1; i < text.size(); ++i) {
    if (!IsDigit(text[i]) || IsDigit(text[i - 1])) continue;
    size_t end = i;
    while (IsDigit(text[end])) ++end;
    for (const char* number : {"-1", "9", "99", "1e9", "1e39", "0.5", "null", "[]", "{}", "\"\""}) {
      std::string damaged = text;
      damaged.replace(i, end - i, number);
      outcomes->Add(MakeGlb(damaged, fixture.binary));
    }
  }
}

TEST(HostileInput, ChangedNumbersAreHandled) {
  Outcomes outcomes;
  for (const auto& [name, fixture] : SampleDocuments()) {
    SCOPED_TRACE(name);
    ChangeNumbers(fixture, &outcomes);
  }
  EXPECT_GT(outcomes.loaded, 500);
  EXPECT_GT(outcomes.refused, 500);
}

absl::Status StatusOf(const GltfFixture& fixture) { return fixture.Load().status(); }

TEST(HostileInput, RefusesNodesThatAreTheirOwnJoints) {
  GltfFixture fixture = SkinnedDocument();
  fixture.json["nodes"][1]["children"] = {2};  // the upper joint becomes the parent of its own parent
  EXPECT_EQ(StatusOf(fixture).code(), absl::StatusCode::kInvalidArgument);
}

TEST(HostileInput, SpendsNoTimeOnTargetsOfWeightZero) {
  GltfFixture fixture = MorphedDocument();
  auto& targets = fixture.json["meshes"][0]["primitives"][0]["targets"];
  while (targets.size() < 1000) targets.push_back(targets[0]);
  fixture.json["meshes"][0]["weights"] = std::vector<double>(1000, 0);
  fixture.json.erase("animations");
  LoadOptions options;
  options.limits.max_vertices = 3;
  EXPECT_TRUE(fixture.Load(options).ok());
  fixture.json["meshes"][0]["weights"][7] = 1;
  EXPECT_EQ(fixture.Load(options).status().code(), absl::StatusCode::kResourceExhausted);
}

TEST(HostileInput, CountsEveryShapeOfAMeshAgainstTheLimits) {
  GltfFixture fixture = MorphedDocument();
  fixture.json.erase("animations");
  for (int i = 1; i <= 9; ++i) fixture.AddNode({{"mesh", 0}, {"weights", {i, 0}}});
  LoadOptions options;
  options.limits.max_triangles = 10;
  EXPECT_TRUE(fixture.Load(options).ok());
  options.limits.max_triangles = 9;
  EXPECT_EQ(fixture.Load(options).status().code(), absl::StatusCode::kResourceExhausted);
}

TEST(HostileInput, RefusesDracoDataThatClaimsMoreThanItsBytesCanHold) {
  GltfFixture fixture = DracoDocument(false);
  const size_t faces = fixture.binary.find("DRACO") + 11;
  fixture.binary.replace(faces, 1, "\xff\xff\xff\x7f");  // a larger count of the same length
  const absl::Status status = StatusOf(fixture);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("claims 268435455 triangles, but has only"));
}

TEST(HostileInput, RefusesMoreKeyframesThanTheLimit) {
  LoadOptions options;
  options.limits.max_keyframes = 1;
  EXPECT_EQ(MorphedDocument().Load(options).status().code(), absl::StatusCode::kResourceExhausted);
}

}  // namespace
}  // namespace lumifold::scene
