// The Cornell box: measurements from Cornell University's Program of Computer Graphics,
// https://www.graphics.cornell.edu/online/box/data.html, in centimetres as published there.
// Its measured spectra are given here as the linear RGB approximations in common use.

#include <array>
#include <initializer_list>
#include <utility>

#include "tests/scenes/materials.h"
#include "tests/scenes/mesh_builder.h"
#include "tests/scenes/scenes.h"

namespace lumifold::scenes {
namespace {

using Polygon = std::array<Vec3, 4>;

constexpr std::array<Vec3, 4> kLight = {
    {{343, 548.8, 227}, {343, 548.8, 332}, {213, 548.8, 332}, {213, 548.8, 227}}};
constexpr std::array<Vec3, 4> kCeiling = {
    {{556, 548.8, 0}, {556, 548.8, 559.2}, {0, 548.8, 559.2}, {0, 548.8, 0}}};
constexpr Polygon kFloor = {{{552.8, 0, 0}, {0, 0, 0}, {0, 0, 559.2}, {549.6, 0, 559.2}}};
constexpr Polygon kBackWall = {{{549.6, 0, 559.2}, {0, 0, 559.2}, {0, 548.8, 559.2}, {556, 548.8, 559.2}}};
constexpr Polygon kGreenWall = {{{0, 0, 559.2}, {0, 0, 0}, {0, 548.8, 0}, {0, 548.8, 559.2}}};
constexpr Polygon kRedWall = {{{552.8, 0, 0}, {549.6, 0, 559.2}, {556, 548.8, 559.2}, {556, 548.8, 0}}};
// The blocks by their tops; the sides go straight down to the floor.
constexpr Polygon kShortBlock = {{{130, 165, 65}, {82, 165, 225}, {240, 165, 272}, {290, 165, 114}}};
constexpr Polygon kTallBlock = {{{423, 330, 247}, {265, 330, 296}, {314, 330, 456}, {472, 330, 406}}};

// The colour of the common (17, 12, 4), twice as strong: a well exposed picture at exposure 1.
constexpr Vec3 kLightRadiance = {34, 24, 8};

Vec3 Metres(Vec3 centimetres) { return centimetres * 0.01; }

void AddPolygon(Mesh& mesh, Polygon polygon) {
  for (Vec3& p : polygon) p = Metres(p);
  AddFlatPolygon(mesh, polygon);
}

Mesh MeshOf(std::initializer_list<Polygon> polygons) {
  Mesh mesh;
  for (const Polygon& polygon : polygons) AddPolygon(mesh, polygon);
  return mesh;
}

/// The ceiling with a hole the size of the light: the published light lies in the ceiling's own plane.
Mesh CeilingMesh() {
  Mesh mesh;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t next = (i + 1) % 4;
    AddPolygon(mesh, {{kCeiling[i], kCeiling[next], kLight[next], kLight[i]}});
  }
  return mesh;
}

Mesh BlockMesh(const Polygon& top) {
  const auto foot = [](Vec3 p) { return Vec3{p.x, 0, p.z}; };
  Mesh mesh = MeshOf({top});
  for (std::size_t i = 0; i < 4; ++i) {
    const Vec3 a = top[i], b = top[(i + 1) % 4];
    AddPolygon(mesh, {{foot(b), foot(a), a, b}});
  }
  return mesh;
}

}  // namespace

SceneDescription BuildCornellBox() {
  SceneDescription scene{.name = "cornell-box"};
  const MaterialId white = scene.Add(Matte("white", {0.725, 0.71, 0.68}));
  const MaterialId red = scene.Add(Matte("red", {0.63, 0.065, 0.05}));
  const MaterialId green = scene.Add(Matte("green", {0.14, 0.45, 0.091}));
  Material lamp = Emitter("light", kLightRadiance);
  lamp.base_color = {0.78, 0.78, 0.78};
  const MaterialId light = scene.Add(std::move(lamp));

  scene.PlaceOnce("floor", {{MeshOf({kFloor}), white}});
  scene.PlaceOnce("ceiling", {{CeilingMesh(), white}});
  scene.PlaceOnce("back wall", {{MeshOf({kBackWall}), white}});
  scene.PlaceOnce("red wall", {{MeshOf({kRedWall}), red}});
  scene.PlaceOnce("green wall", {{MeshOf({kGreenWall}), green}});
  scene.PlaceOnce("short block", {{BlockMesh(kShortBlock), white}});
  scene.PlaceOnce("tall block", {{BlockMesh(kTallBlock), white}});
  scene.PlaceOnce("light", {{MeshOf({kLight}), light}});

  // Focal length 0.035 and film height 0.025: 2 * atan(0.0125 / 0.035).
  constexpr double kFovDegrees = 39.3076;
  scene.camera = {Transform::LookingAt(Metres({278, 273, -800}), Metres({278, 273, 0})), kFovDegrees};
  return scene;
}

}  // namespace lumifold::scenes
