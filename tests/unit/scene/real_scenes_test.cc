// Scenes by other authors, which cannot be shipped: LUMIFOLD_SCENES_DIR names their folder.

#include <gtest/gtest.h>

#include <cstdlib>

#include "worker/scene/gltf_loader.h"

namespace lumifold::scene {
namespace {

class RealScenes : public testing::Test {
 protected:
  void SetUp() override {
    const char* folder = std::getenv("LUMIFOLD_SCENES_DIR");
    if (folder == nullptr)
      GTEST_SKIP() << "set LUMIFOLD_SCENES_DIR to the folder of staircase.glb and living-room.glb";
    folder_ = folder;
  }

  Scene MustLoad(const std::string& file) {
    auto scene = LoadGltfFile(folder_ + "/" + file);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene.ok() ? *std::move(scene) : Scene{};
  }

  std::string folder_;
};

size_t TriangleCount(const Scene& scene) {
  size_t corners = 0;
  for (const Mesh& mesh : scene.meshes) corners += mesh.triangles.size();
  return corners / 3;
}

TEST_F(RealScenes, StaircaseLoads) {
  const Scene scene = MustLoad("staircase.glb");
  EXPECT_EQ(TriangleCount(scene), 262663u - 155) << "155 of its triangles have no area";
  EXPECT_EQ(scene.materials.size(), 26u);
  EXPECT_EQ(scene.images.size(), 9u);
  ASSERT_EQ(scene.cameras.size(), 1u);
  EXPECT_NEAR(scene.cameras[0].yfov, 1.021785f, 1e-6);
  EXPECT_NEAR(scene.cameras[0].aspect, 0.5625f, 1e-6);
}

TEST_F(RealScenes, LivingRoomLoads) {
  const Scene scene = MustLoad("living-room.glb");
  EXPECT_EQ(TriangleCount(scene), 143163u - 190) << "190 of its triangles have no area";
  EXPECT_EQ(scene.materials.size(), 19u);
  EXPECT_EQ(scene.images.size(), 4u);
  ASSERT_EQ(scene.cameras.size(), 1u);
  EXPECT_NEAR(scene.cameras[0].aspect, 16.0f / 9, 1e-6);
}

}  // namespace
}  // namespace lumifold::scene
