#include "tests/support/analytic_scenes.h"

#include <array>
#include <cmath>
#include <utility>

namespace lumifold::testing {

using scene::Material;
using scene::Mesh;
using scene::Scene;
using scene::Vec3;

Mesh QuadMesh(Vec3 origin, Vec3 a, Vec3 b, int material) {
  Mesh mesh;
  mesh.positions = {origin, origin + a, origin + a + b, origin + b};
  mesh.uvs[0] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  mesh.triangles = {0, 1, 2, 0, 2, 3};
  mesh.material = material;
  return mesh;
}

Mesh SphereMesh(float radius, int n, int material) {
  Mesh mesh;
  mesh.material = material;
  const int columns = 4 * n;
  const int rows = 2 * n;
  for (int row = 0; row <= rows; ++row) {
    const double theta = M_PI * row / rows;
    for (int column = 0; column < columns; ++column) {
      const double phi = 2 * M_PI * column / columns;
      const Vec3 normal = {static_cast<float>(std::sin(theta) * std::cos(phi)),
                           static_cast<float>(std::cos(theta)),
                           static_cast<float>(std::sin(theta) * std::sin(phi))};
      mesh.positions.push_back(normal * radius);
      mesh.normals.push_back(normal);
    }
  }
  const auto index = [&](int row, int column) {
    return static_cast<uint32_t>(row * columns + column % columns);
  };
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const std::array<uint32_t, 4> c = {index(row, column), index(row, column + 1),
                                         index(row + 1, column + 1), index(row + 1, column)};
      if (row > 0) mesh.triangles.insert(mesh.triangles.end(), {c[0], c[1], c[2]});
      if (row + 1 < rows) mesh.triangles.insert(mesh.triangles.end(), {c[0], c[2], c[3]});
    }
  }
  return mesh;
}

Material Lambert(Vec3 albedo) {
  Material material;
  material.base.color = albedo;
  material.base.metallic = 0;
  material.specular.factor = 0;
  return material;
}

Material Emitter(Vec3 radiance) {
  Material material = Lambert({0, 0, 0});
  material.emission.radiance = radiance;
  return material;
}

void Place(Scene* scene, Mesh mesh) {
  scene->meshes.push_back(std::move(mesh));
  scene::Instance instance;
  instance.mesh = static_cast<int>(scene->meshes.size()) - 1;
  scene->instances.push_back(instance);
}

scene::Camera LookAt(Vec3 from, Vec3 to, float yfov) {
  scene::Camera camera;
  camera.yfov = yfov;
  const Vec3 back = Normalize(from - to);
  const Vec3 up = std::abs(back.y) > 0.999f ? Vec3{0, 0, 1} : Vec3{0, 1, 0};
  camera.world_from_camera.x = Normalize(Cross(up, back));
  camera.world_from_camera.y = Cross(back, camera.world_from_camera.x);
  camera.world_from_camera.z = back;
  camera.world_from_camera.origin = from;
  return camera;
}

void PlaceBoxInside(Scene* scene, float h, const std::array<int, 6>& materials) {
  const float d = 2 * h;
  Place(scene, QuadMesh({-h, -h, -h}, {0, 0, d}, {d, 0, 0}, materials[0]));  // floor
  Place(scene, QuadMesh({-h, h, -h}, {d, 0, 0}, {0, 0, d}, materials[1]));   // ceiling
  Place(scene, QuadMesh({-h, -h, -h}, {d, 0, 0}, {0, d, 0}, materials[2]));  // back
  Place(scene, QuadMesh({-h, -h, h}, {0, d, 0}, {d, 0, 0}, materials[3]));   // front
  Place(scene, QuadMesh({-h, -h, -h}, {0, d, 0}, {0, 0, d}, materials[4]));  // left
  Place(scene, QuadMesh({h, -h, -h}, {0, 0, d}, {0, d, 0}, materials[5]));   // right
}

Scene Scaled(Scene scene, float factor) {
  for (Mesh& mesh : scene.meshes) {
    for (Vec3& position : mesh.positions) position *= factor;
  }
  for (scene::Instance& instance : scene.instances) instance.world_from_object.origin *= factor;
  for (scene::Camera& camera : scene.cameras) camera.world_from_camera.origin *= factor;
  return scene;
}

Scene Furnace(const Material& material) {
  Scene scene;
  scene.materials = {material, Emitter({1, 1, 1})};
  Place(&scene, SphereMesh(1, 24, 0));
  PlaceBoxInside(&scene, 20, {1, 1, 1, 1, 1, 1});
  scene.cameras = {LookAt({0, 0, 4}, {0, 0, 0}, 0.3f)};
  return scene;
}

Scene SmallRoom() {
  Scene scene;
  Material glossy = Lambert({0.6f, 0.3f, 0.2f});
  glossy.specular.factor = 1;
  glossy.base.roughness = 0.3f;
  Material mirror;
  mirror.base.color = {0.9f, 0.9f, 0.9f};
  mirror.base.roughness = 0;
  scene.materials = {Lambert({0.7f, 0.7f, 0.7f}),
                     Lambert({0.6f, 0.1f, 0.1f}),
                     Lambert({0.1f, 0.5f, 0.1f}),
                     Emitter({12, 11, 9}),
                     glossy,
                     mirror};
  PlaceBoxInside(&scene, 2, {0, 0, 0, 0, 1, 2});
  Place(&scene, QuadMesh({-0.5f, 1.95f, -0.5f}, {1, 0, 0}, {0, 0, 1}, 3));
  const int sphere = static_cast<int>(scene.meshes.size());
  scene.meshes.push_back(SphereMesh(0.6f, 12, 4));
  scene.meshes.push_back(SphereMesh(0.6f, 12, 5));
  const auto place = [&](int mesh, Vec3 where) {
    scene::Instance instance;
    instance.mesh = mesh;
    instance.world_from_object.origin = where;
    scene.instances.push_back(instance);
  };
  place(sphere, {-0.9f, -1.4f, -0.6f});
  place(sphere, {0.1f, -1.4f, 0.9f});  // the same mesh twice: an instance
  place(sphere + 1, {0.9f, -1.4f, -0.5f});
  scene.cameras = {LookAt({0, 0, 1.9f}, {0, -0.3f, 0}, 1.2f)};
  return scene;
}

}  // namespace lumifold::testing
