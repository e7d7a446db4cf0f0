// Five tiny scenes that need one part of the model each, for the chart of plans. The room is 4 m wide (x), 4
// m long (z) and 3 m high; its front is open, and the camera stands before it.

#include <array>
#include <utility>

#include "tests/scenes/materials.h"
#include "tests/scenes/mesh_builder.h"
#include "tests/scenes/scenes.h"
#include "tests/scenes/textures.h"

namespace lumifold::scenes {
namespace {

constexpr double kHalf = 2, kHeight = 3;
constexpr Vec3 kWhite = {1, 1, 1};
constexpr Vec3 kLampRadiance = {14, 13, 11};

struct Quad {
  Vec3 corner, edge_u, edge_v;
};

constexpr Quad kFloor = {{-kHalf, 0, kHalf}, {2 * kHalf, 0, 0}, {0, 0, -2 * kHalf}};
constexpr Quad kCeiling = {{-kHalf, kHeight, -kHalf}, {2 * kHalf, 0, 0}, {0, 0, 2 * kHalf}};
constexpr Quad kBackWall = {{-kHalf, 0, -kHalf}, {2 * kHalf, 0, 0}, {0, kHeight, 0}};
constexpr Quad kLeftWall = {{-kHalf, 0, kHalf}, {0, 0, -2 * kHalf}, {0, kHeight, 0}};
constexpr Quad kRightWall = {{kHalf, 0, -kHalf}, {0, 0, 2 * kHalf}, {0, kHeight, 0}};
constexpr Quad kLamp = {{-0.6, kHeight - 0.02, -0.6}, {1.2, 0, 0}, {0, 0, 1.2}};

void Place(const char* name, const Quad& quad, MaterialId material, SceneDescription* scene) {
  Mesh mesh;
  AddQuad(mesh, quad.corner, quad.edge_u, quad.edge_v);
  scene->PlaceOnce(name, {{mesh, material}});
}

/// The materials of floor, ceiling, back, left and right wall.
using Walls = std::array<MaterialId, 5>;

void PlaceWalls(const Walls& walls, SceneDescription* scene) {
  Place("floor", kFloor, walls[0], scene);
  Place("ceiling", kCeiling, walls[1], scene);
  Place("back wall", kBackWall, walls[2], scene);
  Place("left wall", kLeftWall, walls[3], scene);
  Place("right wall", kRightWall, walls[4], scene);
}

void PlaceBoxAndBall(MaterialId box_material, MaterialId ball_material, SceneDescription* scene) {
  Mesh box;
  AddBox(box, {-0.8, 0.5, -0.6}, {1, 1, 1});
  scene->PlaceOnce("box", {{box, box_material}});
  Mesh ball;
  AddSphere(ball, {0.8, 0.6, 0.1}, 0.6, 24);
  scene->PlaceOnce("ball", {{ball, ball_material}});
}

void PlaceLamp(SceneDescription* scene) {
  Place("light", kLamp, scene->Add(Emitter("light", kLampRadiance)), scene);
}

SceneDescription EmptyScene(const char* name) {
  return {.name = name, .camera = {Transform::LookingAt({0, 1.6, 6.2}, {0, 1.3, 0}), 36}};
}

}  // namespace

SceneDescription BuildTinyDiffuse() {
  SceneDescription scene = EmptyScene("tiny-diffuse");
  const MaterialId white = scene.Add(Matte("white", {0.73, 0.72, 0.69}));
  const MaterialId blue = scene.Add(Matte("blue", {0.12, 0.21, 0.52}));
  const MaterialId ochre = scene.Add(Matte("ochre", {0.6, 0.4, 0.12}));
  PlaceWalls({white, white, white, ochre, blue}, &scene);
  PlaceBoxAndBall(ochre, white, &scene);
  PlaceLamp(&scene);
  return scene;
}

SceneDescription BuildTinyMirror() {
  SceneDescription scene = EmptyScene("tiny-mirror");
  const MaterialId silver = scene.Add(Metal("silver", {0.92, 0.91, 0.89}, 0));
  const MaterialId copper = scene.Add(Metal("copper", {0.93, 0.6, 0.48}, 0));
  PlaceWalls({silver, silver, copper, scene.Add(Emitter("amber panel", {0.9, 0.5, 0.15})),
              scene.Add(Emitter("blue panel", {0.15, 0.35, 0.8}))},
             &scene);
  PlaceBoxAndBall(copper, silver, &scene);
  PlaceLamp(&scene);
  return scene;
}

SceneDescription BuildTinyUnlit() {
  SceneDescription scene = EmptyScene("tiny-unlit");
  const TextureId wallpaper =
      scene.Add(Wallpaper({0.91, 0.89, 0.82}, {0.83, 0.84, 0.77}, {0.70, 0.75, 0.66}));
  const MaterialId walls = scene.Add(Textured(Unlit("wallpaper", kWhite), wallpaper, {1, 1}));
  const MaterialId floor = scene.Add(Unlit("floor", {0.32, 0.24, 0.2}));
  const MaterialId ceiling = scene.Add(Unlit("ceiling", {0.86, 0.86, 0.84}));
  PlaceWalls({floor, ceiling, walls, walls, walls}, &scene);
  PlaceBoxAndBall(scene.Add(Unlit("box", {0.62, 0.13, 0.1})), scene.Add(Unlit("ball", {0.1, 0.36, 0.3})),
                  &scene);
  return scene;
}

SceneDescription BuildTinyEmitter() {
  SceneDescription scene = EmptyScene("tiny-emitter");
  const auto add = [&scene](const char* name, Vec3 radiance) { return scene.Add(Emitter(name, radiance)); };
  PlaceWalls(
      {add("floor", {0.1, 0.12, 0.1}), add("ceiling", {0.9, 0.92, 1}), add("back wall", {0.3, 0.35, 0.5}),
       add("left wall", {0.7, 0.25, 0.1}), add("right wall", {0.15, 0.5, 0.3})},
      &scene);
  Place("upright card", {{-1.3, 0.2, -0.5}, {0.9, 0, 0}, {0, 1.6, 0}}, add("upright card", {2, 1.7, 1}),
        &scene);
  Place("tilted card", {{0.3, 0.4, 0.2}, {1, 0.35, 0}, {-0.3, 0.9, 0}}, add("tilted card", {0.8, 0.1, 0.4}),
        &scene);
  return scene;
}

SceneDescription BuildTinyTextured() {
  SceneDescription scene = EmptyScene("tiny-textured");
  const auto add = [&scene](const char* name, Texture texture, Vec2 size_m) {
    return scene.Add(Textured(Matte(name, kWhite), scene.Add(std::move(texture)), size_m));
  };
  const MaterialId floor = add("slabs", StoneSlabs({0.75, 0.72, 0.65}, {0.35, 0.33, 0.32}), {1, 1});
  const MaterialId ceiling = add("boards", WoodBoards({{0.80, 0.62, 0.42}, {0.56, 0.38, 0.24}}), {2, 1});
  const MaterialId back = add("landscape", Landscape(), {2 * kHalf, kHeight});
  const MaterialId left = add("stripes", StripedCloth({0.80, 0.74, 0.62}, {0.60, 0.25, 0.17}), {0.4, 0.4});
  const MaterialId right = add("stones", StoneBlocks({0.7, 0.66, 0.58}), {1.5, 1.5});
  PlaceWalls({floor, ceiling, back, left, right}, &scene);
  PlaceBoxAndBall(add("page", PrintedPage(), {0.5, 0.5}),
                  add("carpet", Carpet({0.25, 0.3, 0.45}), {0.6, 0.6}), &scene);
  PlaceLamp(&scene);
  return scene;
}

}  // namespace lumifold::scenes
