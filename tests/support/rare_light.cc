#include "tests/support/rare_light.h"

#include <utility>

#include "tests/support/analytic_scenes.h"

namespace lumifold::testing {

using scene::Scene;

namespace {

constexpr float kHalf = 2;

scene::Camera CameraOf() { return LookAt({0, 0, 1.9f}, {0, -0.01f, 0}, 1.2f); }

}  // namespace

Scene CausticRoom(const scene::Material& ball) {
  Scene scene;
  scene.materials = {Lambert({0.5f, 0.5f, 0.5f}), Emitter({60, 60, 60}), ball};
  PlaceBoxInside(&scene, kHalf, {0, 0, 0, 0, 0, 0});
  Place(&scene, QuadMesh({-0.2f, 1.9f, -0.2f}, {0.4f, 0, 0}, {0, 0, 0.4f}, 1));
  Place(&scene, SphereMesh(0.5f, 12, 2));
  scene.instances.back().world_from_object.origin = {0.6f, -1.4f, -0.4f};
  scene.cameras = {CameraOf()};
  return scene;
}

Scene KeyholeRoom(float hole, const scene::Material& rear) {
  Scene scene;
  scene::Material wall = Lambert({0.5f, 0.5f, 0.5f});
  wall.double_sided = true;
  scene.materials = {std::move(wall), Emitter({20, 20, 20}), rear};
  PlaceBoxInside(&scene, kHalf, {2, 2, 2, 0, 2, 2});
  const float edge = hole / 2;
  const float side = kHalf - edge;
  Place(&scene, QuadMesh({-kHalf, -kHalf, 0}, {side, 0, 0}, {0, 2 * kHalf, 0}, 0));
  Place(&scene, QuadMesh({edge, -kHalf, 0}, {side, 0, 0}, {0, 2 * kHalf, 0}, 0));
  Place(&scene, QuadMesh({-edge, -kHalf, 0}, {hole, 0, 0}, {0, side, 0}, 0));
  Place(&scene, QuadMesh({-edge, edge, 0}, {hole, 0, 0}, {0, side, 0}, 0));
  Place(&scene, QuadMesh({-1.5f, -0.3f, -1.8f}, {3, 0, 0}, {0, 0.6f, 0}, 1));
  scene.cameras = {CameraOf()};
  return scene;
}

}  // namespace lumifold::testing
