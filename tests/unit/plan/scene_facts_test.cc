#include "worker/plan/scene_facts.h"

#include <gtest/gtest.h>

#include "tests/support/analytic_scenes.h"

namespace lumifold::plan {
namespace {

using scene::Scene;
using scene::Vec3;

/// Two triangles with no vertex in common, in a plane through the origin whose axes are x and y turned `turn`
/// times.
scene::Mesh TwoTriangles(int turn, int material) {
  scene::Mesh mesh;
  mesh.material = material;
  for (const Vec3 p :
       {Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{4, 4, 0}, Vec3{5, 4, 0}, Vec3{4, 6, 0}}) {
    mesh.triangles.push_back(static_cast<uint32_t>(mesh.positions.size()));
    mesh.positions.push_back({p[turn], p[(turn + 1) % 3], p[(turn + 2) % 3]});
  }
  return mesh;
}

TEST(SceneFacts, OneVertexOutOfThePlaneIsEnough) {
  for (int turn = 0; turn < 3; ++turn) {
    Scene scene;
    scene.materials = {testing::Lambert({1, 1, 1})};
    testing::Place(&scene, TwoTriangles(turn, 0));
    EXPECT_TRUE(FactsOf(scene, false).in_one_plane) << turn;
    scene.animated = true;
    EXPECT_FALSE(FactsOf(scene, false).in_one_plane) << "it may move";
    scene.animated = false;
    for (Vec3& vertex : scene.meshes[0].positions) {
      for (const float off : {-0.01f, 0.01f}) {
        const Vec3 before = vertex;
        (turn == 0 ? vertex.z : turn == 1 ? vertex.y : vertex.x) += off;
        EXPECT_FALSE(FactsOf(scene, false).in_one_plane) << turn << " " << off;
        vertex = before;
      }
    }
    scene.instances.push_back({0, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.1f, 0.1f, 0.1f}}, ""});
    EXPECT_FALSE(FactsOf(scene, false).in_one_plane) << "of another instance";
  }
}

TEST(SceneFacts, OfMirrorsTheirOwnPlaneCounts) {
  Scene scene;
  scene.materials = {testing::Lambert({1, 1, 1}), {}};
  scene.materials[1].base.roughness = 0;
  scene.materials[1].name = "mirror";
  testing::Place(&scene, TwoTriangles(0, 1));
  testing::Place(&scene, TwoTriangles(1, 0));
  const SceneFacts facts = FactsOf(scene, false);
  EXPECT_FALSE(facts.in_one_plane);
  EXPECT_TRUE(facts.delta_in_one_plane);
  EXPECT_EQ(facts.surfaces, 2);
  EXPECT_EQ(facts.delta_material, "material 'mirror'");
  EXPECT_EQ(facts.glossy_material, "material 'mirror'");
  scene.meshes[1].material = 1;
  EXPECT_FALSE(FactsOf(scene, false).delta_in_one_plane);
}

TEST(SceneFacts, CountsSurfacesThatAreOpaqueDespiteTheirSettings) {
  Scene scene;
  scene.materials = {testing::Lambert({1, 1, 1}), testing::Lambert({1, 1, 1})};
  scene.materials[1].alpha_mode = scene::AlphaMode::kMask;
  for (const float alpha : {0.4f, 0.6f, 0.7f}) {
    scene::Mesh mesh = TwoTriangles(0, 1);
    mesh.colors.assign(mesh.positions.size(), {1, 1, 1, 1});
    mesh.colors.back().w = alpha;
    testing::Place(&scene, mesh);
  }
  testing::Place(&scene, TwoTriangles(0, 0));
  const SceneFacts facts = FactsOf(scene, false);
  EXPECT_EQ(facts.surfaces, 4);
  EXPECT_EQ(facts.alpha_surfaces, 3);
  EXPECT_EQ(facts.opaque_surfaces, 2);
}

}  // namespace
}  // namespace lumifold::plan
