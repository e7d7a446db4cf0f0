// Two scenes for a lens: what is out of focus in them has fine texture, thin edges and small bright lamps.

#include <array>
#include <cmath>
#include <span>
#include <string>

#include "tests/scenes/materials.h"
#include "tests/scenes/mesh_builder.h"
#include "tests/scenes/noise.h"
#include "tests/scenes/scenes.h"
#include "tests/scenes/textures.h"

namespace lumifold::scenes {
namespace {

constexpr double kSquare = 0.05;  // of the board

/// Where a piece stands, in squares from the middle of the board.
struct Place {
  double x, z;
};

Mesh PieceMesh() {
  constexpr std::array<Vec2, 12> kProfile = {{{0.02, 0},
                                              {0.02, 0.008},
                                              {0.016, 0.014},
                                              {0.009, 0.024},
                                              {0.0075, 0.045},
                                              {0.013, 0.05},
                                              {0.008, 0.054},
                                              {0.0125, 0.062},
                                              {0.014, 0.07},
                                              {0.0115, 0.079},
                                              {0.006, 0.084},
                                              {0, 0.085}}};
  Mesh piece;
  AddLathe(piece, {}, kProfile, 24);
  return piece;
}

void PlacePieces(std::span<const Place> places, MaterialId material, const std::string& name,
                 SceneDescription* scene) {
  const MeshId mesh = scene->Add(name, {{PieceMesh(), material}});
  for (const Place& place : places)
    scene->Place(name, mesh, {.translation = {kSquare * place.x, 0, kSquare * place.z}});
}

/// Small lamps in a row on the wall behind the board, which shine towards the camera.
void PlaceFairyLights(SceneDescription* scene) {
  const MaterialId glow = scene->Add(Emitter("fairy light", {20, 14, 6}));
  std::array<Vec3, 8> corners;
  for (size_t i = 0; i < corners.size(); ++i) {
    const double turn = Radians(45 * static_cast<double>(i));
    corners[i] = Vec3{std::cos(turn), std::sin(turn), 0} * 0.012;
  }
  Mesh bulb;
  AddFlatPolygon(bulb, corners);
  const MeshId mesh = scene->Add("fairy light", {{bulb, glow}});
  for (int i = 0; i < 14; ++i) {
    const double sag = 0.05 * std::sin(0.9 * i);
    scene->Place("fairy light", mesh, {.translation = {-0.78 + 0.12 * i, 0.24 + sag, -0.98}});
  }
}

void PlaceQuad(const std::string& name, Vec3 corner, Vec3 edge_u, Vec3 edge_v, MaterialId material,
               SceneDescription* scene) {
  Mesh mesh;
  AddQuad(mesh, corner, edge_u, edge_v);
  scene->PlaceOnce(name, {{mesh, material}});
}

/// A leaf of two triangles about its stem, which begins at the origin and goes along z.
Mesh LeafMesh(double length, double width) {
  Mesh leaf;
  const Vec3 base = {0, 0, 0}, tip = {0, 0, length};
  const Vec3 left = {-0.5 * width, 0.12 * width, 0.45 * length};
  const Vec3 right = {0.5 * width, 0.12 * width, 0.45 * length};
  AddFlatPolygon(leaf, std::array<Vec3, 3>{base, tip, left});
  AddFlatPolygon(leaf, std::array<Vec3, 3>{base, right, tip});
  return leaf;
}

/// Leaves all over a bush, which is a ball about `center`.
void AddBush(Vec3 center, double radius, int leaves, unsigned seed, Mesh* mesh) {
  const Mesh leaf = LeafMesh(0.4 * radius, 0.2 * radius);
  for (int i = 0; i < leaves; ++i) {
    const auto random = [&](int k) { return HashNoise(i, k, seed); };
    const double turn = 360 * random(0);
    const double height = 2 * random(1) - 1;
    const double side = std::sqrt(1 - height * height);
    const double reach = radius * (0.5 + 0.5 * random(2));
    const Vec3 place =
        center + Vec3{side * std::sin(Radians(turn)), height, side * std::cos(Radians(turn))} * reach;
    const Rotation tilt = Rotation::AboutAxis({1, 0, 0}, 140 * random(3) - 70);
    const Rotation roll = Rotation::AboutAxis({0, 0, 1}, 180 * random(4) - 90);
    AddMoved(*mesh, leaf, {.translation = place, .rotation = Rotation::Yaw(360 * random(5)) * tilt * roll});
  }
}

/// Blades of grass: leaves that stand.
void AddGrass(int blades, unsigned seed, Mesh* mesh) {
  const Mesh blade = LeafMesh(0.13, 0.012);
  for (int i = 0; i < blades; ++i) {
    const auto random = [&](int k) { return HashNoise(i, k, seed); };
    const Rotation upright = Rotation::AboutAxis({1, 0, 0}, -60 - 40 * random(0));
    AddMoved(*mesh, blade,
             {.translation = {3 * random(1) - 1.5, 0, 1.2 - 3 * random(2)},
              .rotation = Rotation::Yaw(360 * random(3)) * upright});
  }
}

}  // namespace

SceneDescription BuildChessBoard() {
  SceneDescription scene{.name = "chess-board"};
  const TextureId squares = scene.Add(StoneSlabs({0.82, 0.76, 0.66}, {0.2, 0.12, 0.09}));
  const TextureId wood = scene.Add(WoodBoards({{0.62, 0.42, 0.26}, {0.4, 0.24, 0.14}}));
  const TextureId paper = scene.Add(Wallpaper({0.55, 0.6, 0.62}, {0.4, 0.47, 0.52}, {0.75, 0.7, 0.55}));
  const MaterialId board =
      scene.Add(Textured(Glossy("board", {1, 1, 1}, 0.35), squares, {4 * kSquare, 4 * kSquare}));
  const MaterialId table = scene.Add(Textured(Matte("table", {1, 1, 1}), wood, {0.6, 0.3}));
  const MaterialId wall = scene.Add(Textured(Matte("wall", {1, 1, 1}), paper, {0.3, 0.3}));
  const double half = 4 * kSquare;
  PlaceQuad("board", {-half, 0, half}, {2 * half, 0, 0}, {0, 0, -2 * half}, board, &scene);
  PlaceQuad("table", {-1.2, -0.01, 1}, {2.4, 0, 0}, {0, 0, -2}, table, &scene);
  PlaceQuad("wall", {-1.2, -0.01, -1}, {2.4, 0, 0}, {0, 1.4, 0}, wall, &scene);
  PlaceQuad("lamp", {-0.5, 1.3, -0.3}, {0.6, 0, 0}, {0, 0, 0.6}, scene.Add(Emitter("lamp", {9, 8.5, 7.5})),
            &scene);
  PlaceFairyLights(&scene);
  constexpr std::array<Place, 6> kWhite = {
      {{-2.5, 2.5}, {-0.5, 1.5}, {1.5, 2.5}, {0.5, -0.5}, {3.5, 0.5}, {-3.5, -1.5}}};
  constexpr std::array<Place, 6> kBlack = {
      {{-1.5, -2.5}, {1.5, -3.5}, {-3.5, -3.5}, {3.5, -2.5}, {-1.5, 0.5}, {2.5, 1.5}}};
  constexpr std::array<Place, 2> kSilver = {{{0.5, 3.5}, {-0.5, -1.5}}};
  PlacePieces(kWhite, scene.Add(Glossy("ivory", {0.8, 0.74, 0.6}, 0.3)), "white piece", &scene);
  PlacePieces(kBlack, scene.Add(Glossy("ebony", {0.06, 0.05, 0.045}, 0.25)), "black piece", &scene);
  PlacePieces(kSilver, scene.Add(Metal("silver", {0.92, 0.91, 0.89}, 0)), "silver piece", &scene);
  scene.camera = {Transform::LookingAt({0.12, 0.17, 0.42}, {0, 0.045, -0.05}), 40};
  return scene;
}

SceneDescription BuildFoliage() {
  SceneDescription scene{.name = "foliage"};
  const auto leaf = [&](const char* name, Vec3 color) {
    return scene.Add(DoubleSided(Glossy(name, color, 0.5)));
  };
  const MaterialId green = leaf("green leaf", {0.13, 0.32, 0.06});
  const MaterialId yellow = leaf("yellow leaf", {0.5, 0.42, 0.08});
  const MaterialId red = leaf("red leaf", {0.5, 0.12, 0.06});
  Mesh near_bush, middle_bush, far_bush, grass;
  AddBush({-0.42, 0.34, 0.75}, 0.3, 90, 1, &near_bush);
  AddBush({0.2, 0.42, -0.1}, 0.4, 260, 2, &middle_bush);
  AddBush({-0.9, 0.7, -1.6}, 0.8, 420, 3, &far_bush);
  AddBush({1.2, 0.6, -2}, 0.7, 320, 4, &far_bush);
  AddGrass(700, 5, &grass);
  scene.PlaceOnce("near bush", {{near_bush, red}});
  scene.PlaceOnce("middle bush", {{middle_bush, green}});
  scene.PlaceOnce("far bushes", {{far_bush, yellow}});
  scene.PlaceOnce("grass", {{grass, green}});
  PlaceQuad("soil", {-4, 0, 2}, {8, 0, 0}, {0, 0, -6}, scene.Add(Matte("soil", {0.24, 0.17, 0.1})), &scene);
  PlaceQuad("horizon", {-6, 0, -4}, {12, 0, 0}, {0, 3.2, 0}, scene.Add(Emitter("horizon", {0.9, 1.1, 1.4})),
            &scene);
  PlaceQuad("zenith", {-4, 3.2, -4}, {8, 0, 0}, {0, 0, 6}, scene.Add(Emitter("zenith", {0.8, 1, 1.4})),
            &scene);
  PlaceQuad("sun", {1.5, 3, 0.8}, {0.5, 0, 0}, {0, 0, 0.5}, scene.Add(Emitter("sun", {220, 195, 160})),
            &scene);
  scene.camera = {Transform::LookingAt({0.1, 0.55, 1.75}, {0, 0.42, -0.2}), 42};
  return scene;
}

}  // namespace lumifold::scenes
