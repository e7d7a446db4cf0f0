// A court after the Sponza palace in Dubrovnik: two storeys of arcades around an open court, cloth between
// the columns, sun through the open roof. The court is 24 m long (z), 9 m wide (x); an aisle runs around it.
// Few meshes, many nodes: nearly all of it is instanced.

#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "tests/scenes/interior_parts.h"
#include "tests/scenes/materials.h"
#include "tests/scenes/scenes.h"
#include "tests/scenes/textures.h"

namespace lumifold::scenes {
namespace {

constexpr double kBay = 3.0;
constexpr int kLongBays = 8, kShortBays = 3;
constexpr double kHalfLength = kLongBays * kBay / 2, kHalfWidth = kShortBays * kBay / 2;
constexpr double kAisle = 3.4;
constexpr double kLowerColumn = 3.1, kLowerTop = 5.0;   // where the arches spring, and where their wall ends
constexpr double kGallery = 5.4;                        // the upper storey's floor
constexpr double kUpperColumn = 2.3, kUpperTop = 3.55;  // above the gallery
constexpr double kRoof = kGallery + kUpperTop;
constexpr double kWallDepth = 0.5;

struct Materials {
  MaterialId blocks, trim, floor, plaster, red_cloth, green_cloth, blue_cloth, bronze, leaf, water, sun, sky;
};

Materials AddMaterials(SceneDescription& scene) {
  const TextureId blocks = scene.Add(StoneBlocks({0.80, 0.70, 0.56}));
  const TextureId slabs = scene.Add(StoneSlabs({0.82, 0.76, 0.66}, {0.62, 0.46, 0.36}));
  constexpr Vec3 kWhite = {1, 1, 1};
  const auto add = [&](Material material) { return scene.Add(std::move(material)); };
  const auto cloth = [&](const char* name, Vec3 color) { return add(DoubleSided(Matte(name, color))); };
  return {
      .blocks = add(Textured(Glossy("stone blocks", kWhite, 0.9, 0.5), blocks, {2.4, 2.4})),
      .trim = add(Glossy("dressed stone", {0.66, 0.57, 0.44}, 0.7, 0.6)),
      .floor = add(Textured(Glossy("stone slabs", kWhite, 0.38), slabs, {3, 3})),
      .plaster = add(Matte("plaster", {0.74, 0.68, 0.58})),
      .red_cloth = cloth("red cloth", {0.58, 0.06, 0.05}),
      .green_cloth = cloth("green cloth", {0.10, 0.30, 0.10}),
      .blue_cloth = cloth("blue cloth", {0.07, 0.14, 0.42}),
      .bronze = add(Metal("bronze", {0.45, 0.30, 0.16}, 0.35)),
      .leaf = add(DoubleSided(Glossy("leaf", {0.10, 0.26, 0.06}, 0.5))),
      .water = add(Glossy("water", {0.02, 0.05, 0.05}, 0.03)),
      .sun = add(Emitter("sun", {36000, 32000, 25500})),
      .sky = add(Emitter("sky", {0.65, 0.9, 1.3})),
  };
}

/// One side of the court, seen from its middle: x to the right along the arcade, +z into the court.
struct Side {
  Transform transform;
  int bays;
};

constexpr int kSides = 4;

std::array<Side, kSides> Sides() {
  return {{{{{0, 0, -kHalfLength}, Rotation::Yaw(0)}, kShortBays},
           {{{-kHalfWidth, 0, 0}, Rotation::Yaw(90)}, kLongBays},
           {{{0, 0, kHalfLength}, Rotation::Yaw(180)}, kShortBays},
           {{{kHalfWidth, 0, 0}, Rotation::Yaw(-90)}, kLongBays}}};
}

/// A round column with a plinth, a moulded base and a bell capital under a square slab.
Mesh ColumnMesh(double height, double radius) {
  Mesh mesh;
  const double r = radius, slab = 0.42 * r, wide = 3.0 * r;
  AddRoundedBox(mesh, {0, slab / 2, 0}, {wide, slab, wide}, 0.02);
  AddRoundedBox(mesh, {0, height - slab / 2, 0}, {wide, slab, wide}, 0.02);
  std::vector<Vec2> profile;
  const auto torus = [&](double center, double bulge, double out) {
    for (int i = 0; i <= 6; ++i) {
      const double angle = std::numbers::pi * (i / 6.0 - 0.5);
      profile.push_back({out + bulge * std::cos(angle), center + bulge * std::sin(angle)});
    }
  };
  torus(slab + 0.16 * r, 0.16 * r, 1.22 * r);
  torus(slab + 0.44 * r, 0.10 * r, 1.10 * r);
  const double foot = slab + 0.62 * r, neck = height - slab - 1.5 * r;
  for (int i = 0; i <= 8; ++i) {
    const double t = i / 8.0;
    profile.push_back({r * (1 - 0.16 * t * t), Mix(foot, neck, t)});
  }
  torus(neck + 0.1 * r, 0.08 * r, 0.86 * r);
  for (int i = 0; i <= 8; ++i) {
    const double t = i / 8.0;
    profile.push_back({r * (0.86 + 0.56 * t * t * t), Mix(neck + 0.2 * r, height - slab, t)});
  }
  AddLathe(mesh, {}, profile, 28);
  return mesh;
}

/// An arch's wall, its foot on the columns' tops, and the round mouldings that follow it on both faces.
struct ArchMeshes {
  Mesh wall, moulding;
};
ArchMeshes ArchOnColumns(double width, double height, double radius, double depth) {
  ArchMeshes arch;
  AddArchWall(arch.wall, {width, height, depth, radius, 0, 24});
  const double bead = 0.055 * radius;
  for (const double face : {depth / 2, -depth / 2}) {
    for (const double distance : {1.04, 1.17}) {
      std::vector<Vec3> path;
      for (int i = 0; i <= 24; ++i) {
        const double angle = std::numbers::pi * (1 - i / 24.0);
        path.push_back({distance * radius * std::cos(angle), distance * radius * std::sin(angle), face});
      }
      AddTube(arch.moulding, path, bead, 8);
    }
  }
  return arch;
}

/// A part that stands `count` times along a side, `pitch` apart and centred.
void PlaceAlong(SceneDescription& scene, const Side& side, const char* name, MeshId mesh, int count,
                double pitch, Vec3 first_offset) {
  for (int i = 0; i < count; ++i) {
    const double x = (i - (count - 1) / 2.0) * pitch;
    scene.Place(name, mesh, OnWall(side.transform, first_offset + Vec3{x, 0, 0}));
  }
}

void AddLowerArcade(SceneDescription& scene, const Materials& m) {
  const MeshId column = scene.Add("lower column", {{ColumnMesh(kLowerColumn, 0.25), m.trim}});
  const ArchMeshes arch = ArchOnColumns(kBay, kLowerTop - kLowerColumn, 1.2, kWallDepth);
  const MeshId arch_mesh = scene.Add("lower arch", {{arch.wall, m.blocks}, {arch.moulding, m.trim}});
  const ArchMeshes rib = ArchOnColumns(kAisle, kLowerTop - kLowerColumn, 1.4, 0.4);
  const MeshId rib_mesh = scene.Add("aisle arch", {{rib.wall, m.plaster}, {rib.moulding, m.trim}});
  Mesh pier;
  AddRoundedBox(pier, {0, kLowerColumn / 2, 0}, {0.5, kLowerColumn, 0.3}, 0.02);
  AddRoundedBox(pier, {0, kLowerColumn - 0.08, 0.03}, {0.64, 0.16, 0.42}, 0.03);
  const MeshId pier_mesh = scene.Add("wall pier", {{pier, m.trim}});
  for (const Side& side : Sides()) {
    PlaceAlong(scene, side, "lower arch", arch_mesh, side.bays, kBay, {0, kLowerColumn, 0});
    PlaceAlong(scene, side, "lower column", column, side.bays, kBay, {kBay / 2, 0, 0});
    // Across the aisle behind every column, turned a quarter against the arcade.
    for (int i = 0; i <= side.bays; ++i) {
      const double x = (i - side.bays / 2.0) * kBay;
      Transform at = OnWall(side.transform, {x, kLowerColumn, -kAisle / 2});
      at.rotation = at.rotation * Rotation::Yaw(90);
      scene.Place("aisle arch", rib_mesh, at);
      scene.Place("wall pier", pier_mesh, OnWall(side.transform, {x, 0, -kAisle + 0.1}));
    }
  }
}

void AddUpperArcade(SceneDescription& scene, const Materials& m) {
  constexpr double kHalfBay = kBay / 2;
  const MeshId column = scene.Add("upper column", {{ColumnMesh(kUpperColumn, 0.15), m.trim}});
  const ArchMeshes arch = ArchOnColumns(kHalfBay, kUpperTop - kUpperColumn, 0.6, 0.36);
  const MeshId arch_mesh = scene.Add("upper arch", {{arch.wall, m.blocks}, {arch.moulding, m.trim}});
  for (const Side& side : Sides()) {
    const int arches = 2 * side.bays;
    PlaceAlong(scene, side, "upper arch", arch_mesh, arches, kHalfBay, {0, kGallery + kUpperColumn, 0});
    PlaceAlong(scene, side, "upper column", column, arches, kHalfBay, {kHalfBay / 2, kGallery, 0});
  }
}

void AddBalustrade(SceneDescription& scene, const Materials& m) {
  constexpr double kHeight = 0.92;
  constexpr int kPerBay = 10;
  Mesh baluster, rail;
  const Vec2 profile[] = {{0.05, 0},    {0.05, 0.05}, {0.03, 0.08},  {0.05, 0.2},
                          {0.06, 0.28}, {0.045, 0.4}, {0.025, 0.55}, {0.025, 0.62},
                          {0.04, 0.66}, {0.04, 0.7},  {0.05, 0.74},  {0.05, 0.78}};
  AddLathe(baluster, {}, profile, 12);
  AddRoundedBox(rail, {0, kHeight - 0.07, 0}, {kBay, 0.12, 0.24}, 0.03);
  AddRoundedBox(rail, {0, 0.03, 0}, {kBay, 0.06, 0.2}, 0.01);
  const MeshId baluster_mesh = scene.Add("baluster", {{baluster, m.trim}});
  const MeshId rail_mesh = scene.Add("balustrade rail", {{rail, m.trim}});
  for (const Side& side : Sides()) {
    PlaceAlong(scene, side, "balustrade rail", rail_mesh, side.bays, kBay, {0, kGallery, 0});
    PlaceAlong(scene, side, "baluster", baluster_mesh, side.bays * kPerBay, kBay / kPerBay,
               {0, kGallery + 0.06, 0});
  }
}

/// The walls around the aisles, one panel a bay, and the slabs and cornices over both storeys.
void AddWallsAndSlabs(SceneDescription& scene, const Materials& m) {
  Mesh panel, cornice, eaves;
  AddQuad(panel, {-kBay / 2, 0, 0}, {kBay, 0, 0}, {0, kRoof, 0});
  AddRoundedBox(cornice, {0, 0, 0.04}, {kBay, 0.18, kWallDepth + 0.2}, 0.03);
  AddRoundedBox(cornice, {0, 0.2, 0.08}, {kBay, 0.24, kWallDepth + 0.36}, 0.05, 3);
  AddRoundedBox(eaves, {0, 0.08, 0.06}, {kBay, 0.16, kWallDepth + 0.2}, 0.03);
  AddRoundedBox(eaves, {0, 0.28, 0.16}, {kBay, 0.26, kWallDepth + 0.5}, 0.06, 3);
  AddBox(eaves, {0, 0.66, 0}, {kBay, 0.5, kWallDepth});
  AddRoundedBox(eaves, {0, 0.95, 0}, {kBay, 0.1, kWallDepth + 0.16}, 0.03);
  const MeshId panel_mesh = scene.Add("wall panel", {{panel, m.blocks}});
  const MeshId cornice_mesh = scene.Add("cornice", {{cornice, m.trim}});
  const MeshId eaves_mesh = scene.Add("eaves", {{eaves, m.trim}});
  for (const Side& side : Sides()) {
    PlaceAlong(scene, side, "wall panel", panel_mesh, side.bays + 4, kBay, {0, 0, -kAisle});
    PlaceAlong(scene, side, "cornice", cornice_mesh, side.bays, kBay, {0, kLowerTop + 0.08, 0});
    PlaceAlong(scene, side, "eaves", eaves_mesh, side.bays, kBay, {0, kRoof, 0});
  }
  Mesh slab;
  for (const double y : {kLowerTop + 0.2, kRoof + 0.15}) {
    const double outer_x = kHalfWidth + kAisle, outer_z = kHalfLength + kAisle;
    for (const double s : {-1.0, 1.0}) {
      AddBox(slab, {s * (kHalfWidth + kAisle / 2), y, 0}, {kAisle, 0.4, 2 * outer_z});
      AddBox(slab, {0, y, s * (kHalfLength + kAisle / 2)}, {2 * (outer_x - kAisle), 0.4, kAisle});
    }
  }
  scene.PlaceOnce("slabs", {{slab, m.plaster}});
  Mesh floor;
  const double x = kHalfWidth + kAisle, z = kHalfLength + kAisle;
  AddQuad(floor, {-x, 0, z}, {2 * x, 0, 0}, {0, 0, -2 * z});
  scene.PlaceOnce("floor", {{floor, m.floor}});
}

void AddCurtains(SceneDescription& scene, const Materials& m) {
  // One curtain drawn to one side of an arch, one that covers the whole arch.
  const Mesh drawn = Curtain({1.05, 3.25}, 7, 0.26, 41);
  const Mesh wide = Curtain({2.15, 3.0}, 9, 0.2, 57);
  const MaterialId cloths[] = {m.red_cloth, m.green_cloth, m.blue_cloth};
  std::array<MeshId, 3> drawn_meshes, wide_meshes;
  for (std::size_t i = 0; i < 3; ++i) {
    drawn_meshes[i] = scene.Add("drawn curtain", {{drawn, cloths[i]}});
    wide_meshes[i] = scene.Add("curtain", {{wide, cloths[i]}});
  }
  Mesh rod;
  const Vec3 ends[] = {{-kBay / 2, 0, 0}, {kBay / 2, 0, 0}};
  AddTube(rod, ends, 0.022, 10);
  const MeshId rod_mesh = scene.Add("curtain rod", {{rod, m.bronze}});
  const std::array<Side, kSides> sides = Sides();
  for (const int index : {1, 3}) {
    const Side& side = sides[index];
    PlaceAlong(scene, side, "curtain rod", rod_mesh, side.bays, kBay, {0, kLowerColumn + 0.02, 0});
    for (int bay = 0; bay < side.bays; ++bay) {
      const double x = (bay - (side.bays - 1) / 2.0) * kBay;
      const bool whole = (bay + index) % 3 == 0;
      const std::size_t color = static_cast<std::size_t>((bay + index / 2) % 3);
      const double shift = whole ? 0 : (bay % 2 == 0 ? -0.62 : 0.62);
      scene.Place("curtain", whole ? wide_meshes[color] : drawn_meshes[color],
                  OnWall(side.transform, {x + shift, kLowerColumn, 0}));
    }
  }
}

void AddFountain(SceneDescription& scene, const Materials& m) {
  Mesh stone, water;
  const Vec2 basin[] = {{1.25, 0},    {1.25, 0.12}, {1.25, 0.12}, {1.1, 0.16}, {1.08, 0.42}, {1.2, 0.5},
                        {1.22, 0.58}, {1.2, 0.6},   {1.2, 0.6},   {1.02, 0.6}, {1.02, 0.6},  {1.0, 0.2}};
  AddLathe(stone, {}, basin, 64);
  const Vec2 stem[] = {{0.22, 0.2},  {0.16, 0.4},  {0.11, 0.8},  {0.14, 1.0},  {0.12, 1.08}, {0.35, 1.2},
                       {0.52, 1.34}, {0.54, 1.38}, {0.54, 1.38}, {0.5, 1.38},  {0.5, 1.38},  {0.1, 1.28},
                       {0.1, 1.28},  {0.07, 1.5},  {0.1, 1.62},  {0.05, 1.74}, {0, 1.76}};
  AddLathe(stone, {}, stem, 48);
  const Vec2 lower_water[] = {{1.02, 0.5}, {0, 0.5}}, upper_water[] = {{0.51, 1.35}, {0.05, 1.35}};
  AddLathe(water, {}, lower_water, 48);
  AddLathe(water, {}, upper_water, 48);
  scene.PlaceOnce("fountain", {{stone, m.trim}, {water, m.water}}, {.translation = {0, 0, -1.5}});
}

void AddUrns(SceneDescription& scene, const Materials& m) {
  Mesh pedestal, urn, leaves;
  AddRoundedBox(pedestal, {0, 0.06, 0}, {0.62, 0.12, 0.62}, 0.02);
  AddRoundedBox(pedestal, {0, 0.36, 0}, {0.5, 0.5, 0.5}, 0.015);
  AddRoundedBox(pedestal, {0, 0.65, 0}, {0.6, 0.1, 0.6}, 0.03);
  const Vec2 profile[] = {{0.16, 0.7},  {0.15, 0.74}, {0.07, 0.8},  {0.08, 0.86}, {0.2, 0.96},
                          {0.27, 1.12}, {0.25, 1.26}, {0.22, 1.32}, {0.29, 1.38}, {0.29, 1.4},
                          {0.29, 1.4},  {0.25, 1.4},  {0.25, 1.4},  {0.2, 1.3},   {0, 1.3}};
  AddLathe(urn, {}, profile, 40);
  AddMoved(leaves, LeafTuft(28, 0.7, 12), {.translation = {0, 1.28, 0}});
  const MeshId mesh = scene.Add("urn", {{pedestal, m.trim}, {urn, m.bronze}, {leaves, m.leaf}});
  for (const double z : {-9.0, -4.5, 1.5, 6.0}) {
    for (const double x : {-3.1, 3.1}) scene.Place("urn", mesh, {{x, 0, z}, Rotation::Yaw(31 * z + 17 * x)});
  }
}

void AddSunAndSky(SceneDescription& scene, const Materials& m) {
  // Close enough that its power has the order of the sky's, small enough for sharp shadows: one degree wide.
  constexpr double kSunSize = 0.35, kSkyHeight = 20;
  constexpr Vec3 kSunPlace = {9.5, kSkyHeight - 0.3, -3.5}, kAim = {-2, 0, -1};
  Transform sun = Transform::LookingAt(kSunPlace, kAim);
  sun.rotation = sun.rotation * Rotation::Yaw(180);
  scene.PlaceOnce("sun", {{UprightRect({kSunSize, kSunSize}), m.sun}}, sun);
  Mesh sky;
  constexpr double kX = 16, kNear = 24, kFar = -22, kHorizon = 6;
  AddQuad(sky, {-kX, kSkyHeight, kFar}, {2 * kX, 0, 0}, {0, 0, kNear - kFar});
  AddQuad(sky, {-kX, kHorizon, kFar}, {2 * kX, 0, 0}, {0, kSkyHeight - kHorizon, 0});  // over the far roof
  scene.PlaceOnce("sky", {{sky, m.sky}});
}

}  // namespace

SceneDescription BuildAtrium() {
  SceneDescription scene{.name = "atrium"};
  const Materials materials = AddMaterials(scene);
  AddWallsAndSlabs(scene, materials);
  AddLowerArcade(scene, materials);
  AddUpperArcade(scene, materials);
  AddBalustrade(scene, materials);
  AddCurtains(scene, materials);
  AddFountain(scene, materials);
  AddUrns(scene, materials);
  AddSunAndSky(scene, materials);
  scene.camera = {Transform::LookingAt({1.4, 1.75, 11.2}, {-0.9, 3.5, -4}), 60};
  return scene;
}

}  // namespace lumifold::scenes
