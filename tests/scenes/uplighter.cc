// A living room at night, lit by a floor lamp alone that shines up into a deep shade: all light comes off one
// spot on the ceiling, which the camera does not see. On the table a glass egg casts a caustic of that spot.
// A light sample reaches the lamp from nowhere but the spot, so nearly all light is indirect and found by
// chance. The room is 5 m wide (x), 5 m long (z) and 2.7 m high; the camera stands in its right rear corner.

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

constexpr Room kRoom = {.left = -2.5, .right = 2.5, .front = -2.5, .rear = 2.5, .height = 2.7};
constexpr Vec3 kLamp = {-1.55, 0, -1.45};
constexpr double kShadeBottom = 1.45;
constexpr Vec3 kTable = {0, 0, 0};
constexpr double kTableHeight = 0.46;
constexpr Vec3 kShelf = {1.3, 0, -2.5};  // the middle of its back's lower edge

struct Materials {
  MaterialId floor, wall, red_wall, ceiling, trim, walnut, rug, glass, steel, copper, black, lining, bulb,
      cushion, frame, print, leaf, pot, page, book_red, book_blue, book_ochre;
};

Materials AddMaterials(SceneDescription& scene) {
  const TextureId boards = scene.Add(WoodBoards({{0.72, 0.55, 0.37}, {0.45, 0.30, 0.19}}));
  const TextureId grain = scene.Add(WoodGrain({{0.60, 0.42, 0.28}, {0.36, 0.23, 0.14}}));
  const TextureId rug = scene.Add(Rug());
  const TextureId stripes = scene.Add(StripedCloth({0.30, 0.42, 0.52}, {0.78, 0.74, 0.62}));
  const TextureId print = scene.Add(BotanicalPrint());
  constexpr Vec3 kWhite = {1, 1, 1};
  const auto add = [&](Material material) { return scene.Add(std::move(material)); };
  return {
      .floor = add(Textured(Glossy("floor boards", kWhite, 0.35), boards, {2.4, 1.2})),
      .wall = add(Matte("wall", {0.72, 0.69, 0.62})),
      .red_wall = add(Matte("red wall", {0.55, 0.16, 0.10})),
      .ceiling = add(Matte("ceiling", {0.82, 0.81, 0.78})),
      .trim = add(Glossy("trim", {0.75, 0.74, 0.70}, 0.4)),
      .walnut = add(Textured(Glossy("walnut", kWhite, 0.3), grain, {1.6, 0.8})),
      .rug = add(Textured(Matte("rug", kWhite), rug, {2.2, 1.65})),
      .glass = add(SolidGlass("glass")),
      .steel = add(Metal("steel", {0.86, 0.86, 0.87}, 0)),
      .copper = add(Metal("copper", {0.93, 0.60, 0.45}, 0.15)),
      .black = add(Glossy("black lacquer", {0.03, 0.03, 0.03}, 0.3)),
      .lining = add(Matte("shade lining", {0.30, 0.28, 0.25})),
      .bulb = add(Emitter("bulb", {7500, 6000, 4200})),
      .cushion = add(Textured(Matte("striped cloth", kWhite), stripes, {0.4, 0.4})),
      .frame = add(Metal("chrome", {0.75, 0.75, 0.76}, 0.1)),
      .print = add(Textured(Glossy("print", kWhite, 0.5), print, {0.5, 0.75})),
      .leaf = add(DoubleSided(Glossy("leaf", {0.10, 0.26, 0.07}, 0.4))),
      .pot = add(Glossy("pot", {0.62, 0.35, 0.24}, 0.6)),
      .page = add(Matte("page", {0.80, 0.78, 0.70})),
      .book_red = add(Glossy("red cloth", {0.50, 0.10, 0.08}, 0.6)),
      .book_blue = add(Glossy("blue cloth", {0.09, 0.16, 0.38}, 0.6)),
      .book_ochre = add(Glossy("ochre cloth", {0.58, 0.40, 0.12}, 0.6)),
  };
}

void AddShell(SceneDescription& scene, const Materials& m) {
  Mesh floor, ceiling, wall, skirting;
  AddQuad(floor, {kRoom.left, 0, kRoom.rear}, {kRoom.width(), 0, 0}, {0, 0, -kRoom.length()});
  AddQuad(ceiling, {kRoom.left, kRoom.height, kRoom.front}, {kRoom.width(), 0, 0}, {0, 0, kRoom.length()});
  scene.PlaceOnce("floor", {{floor, m.floor}});
  scene.PlaceOnce("ceiling", {{ceiling, m.ceiling}});
  AddQuad(wall, {}, {kRoom.width(), 0, 0}, {0, kRoom.height, 0});  // the room is square
  AddBox(skirting, {kRoom.width() / 2, 0.06, 0.008}, {kRoom.width(), 0.12, 0.016});
  const MeshId white = scene.Add("wall", {{wall, m.wall}, {skirting, m.trim}});
  scene.Place("front wall", white, kRoom.FrontWall());
  scene.Place("right wall", white, kRoom.RightWall());
  scene.Place("rear wall", white, kRoom.RearWall());
  scene.PlaceOnce("left wall", {{wall, m.red_wall}, {skirting, m.trim}}, kRoom.LeftWall());
}

/// The bulb lies deep in an opaque shade: its light leaves within 36 degrees of the vertical.
void AddLamp(SceneDescription& scene, const Materials& m) {
  constexpr double kDeep = 0.28, kRim = 0.13;
  Mesh stand, shade, lining, bulb;
  const Vec2 foot[] = {{0, 0}, {0.15, 0}, {0.15, 0}, {0.15, 0.015}, {0.14, 0.025}, {0.02, 0.035}, {0, 0.035}};
  AddLathe(stand, {}, foot, 48);
  AddCylinder(stand, {0, 0.03, 0}, 0.011, 0.011, kShadeBottom - 0.03, 16);
  const Vec2 outside[] = {{0, 0},        {0.05, 0},     {0.075, 0.03},
                          {kRim, kDeep}, {kRim, kDeep}, {kRim - 0.006, kDeep}};
  const Vec2 inside[] = {{kRim - 0.006, kDeep}, {0.068, 0.034}, {0.068, 0.034}, {0, 0.034}};
  AddLathe(shade, {0, kShadeBottom, 0}, outside, 48);
  AddLathe(lining, {0, kShadeBottom, 0}, inside, 48);
  const Vec2 disc[] = {{0.04, 0.045}, {0, 0.045}};
  AddLathe(bulb, {0, kShadeBottom, 0}, disc, 16);
  scene.PlaceOnce("lamp", {{stand, m.black}, {shade, m.black}, {lining, m.lining}, {bulb, m.bulb}},
                  {.translation = kLamp});
  const Vec3 corners[] = {{0, 0.006, -0.1}, {0.1, 0.006, -0.5}, {-0.4, 0.006, -0.8}, {-0.9, 0.006, -1.0}};
  Mesh cord;
  AddTube(cord, RoundedPath(corners, 0.15), 0.005, 8);
  scene.PlaceOnce("cord", {{cord, m.black}}, {.translation = kLamp});
}

void AddTable(SceneDescription& scene, const Materials& m) {
  constexpr double kWidth = 1.25, kDepth = 0.75, kThick = 0.03;
  Mesh top, legs;
  AddRoundedBox(top, {0, kTableHeight - kThick / 2, 0}, {kWidth, kThick, kDepth}, 0.01);
  for (const double x : {-0.52, 0.52}) {
    for (const double z : {-0.28, 0.28})
      AddCylinder(legs, {x, 0, z}, 0.012, 0.018, kTableHeight - kThick, 16);
  }
  scene.PlaceOnce("table", {{top, m.walnut}, {legs, m.frame}}, {kTable, Rotation::Yaw(12)});
  Mesh rug, rim;
  AddQuad(rug, {-1.1, 0.012, 0.825}, {2.2, 0, 0}, {0, 0, -1.65});
  AddRoundedBox(rim, {0, 0.005, 0}, {2.21, 0.013, 1.66}, 0.005);
  scene.PlaceOnce("rug", {{rug, m.rug}, {rim, m.cushion}}, {kTable + Vec3{0.05, 0, 0.1}, Rotation::Yaw(8)});
}

/// An egg that stands on its blunt end.
Mesh Egg(double height, double radius) {
  constexpr int kRows = 32;
  std::vector<Vec2> profile;
  for (int i = 0; i <= kRows; ++i) {
    const double angle = std::numbers::pi * i / kRows;
    const double blunt = 1 + 0.18 * std::cos(angle);
    const bool is_pole = i == 0 || i == kRows;
    profile.push_back({is_pole ? 0 : radius * std::sin(angle) * blunt, height / 2 * (1 - std::cos(angle))});
  }
  Mesh mesh;
  AddLathe(mesh, {}, profile, 64);
  return mesh;
}

void AddThingsOnTable(SceneDescription& scene, const Materials& m) {
  const auto on_table = [](double x, double z, double yaw = 0) {
    return Transform{kTable + Vec3{x, kTableHeight + 0.0005, z}, Rotation::Yaw(yaw)};
  };
  scene.PlaceOnce("egg", {{Egg(0.25, 0.088), m.glass}}, on_table(0.12, 0.08));
  Mesh ball, cup, covers, pages;
  AddSphere(ball, {0, 0.08, 0}, 0.08, 64);
  scene.PlaceOnce("steel ball", {{ball, m.steel}}, on_table(-0.22, 0.14));
  const Vec2 profile[] = {{0, 0},         {0.05, 0},      {0.05, 0},     {0.062, 0.02}, {0.07, 0.13},
                          {0.068, 0.135}, {0.066, 0.128}, {0.058, 0.02}, {0, 0.012}};
  AddLathe(cup, {}, profile, 48);
  scene.PlaceOnce("copper cup", {{cup, m.copper}}, on_table(0.40, -0.12));
  AddBox(covers, {0, 0.018, 0}, {0.24, 0.036, 0.17});
  AddBox(pages, {0.004, 0.018, 0.003}, {0.236, 0.028, 0.168});
  scene.PlaceOnce("book", {{covers, m.book_blue}, {pages, m.page}}, on_table(-0.28, -0.16, 28));
}

/// A tube chair with a seat and a back of cloth.
void AddChair(SceneDescription& scene, const Materials& m) {
  Mesh frame, seat, back;
  for (const double x : {-0.28, 0.28}) {
    const Vec3 corners[] = {
        {x, 0.80, -0.34}, {x, 0.36, -0.24}, {x, 0.36, 0.28}, {x, 0.012, 0.30}, {x, 0.012, -0.30}};
    AddTube(frame, RoundedPath(corners, 0.07), 0.011, 12);
  }
  AddRoundedBox(seat, {0, 0.40, 0.02}, {0.56, 0.09, 0.52}, 0.04, 4);
  AddRoundedBox(back, {}, {0.55, 0.42, 0.08}, 0.035, 4);
  AddMoved(seat, back, {{0, 0.66, -0.27}, Rotation::AboutAxis({1, 0, 0}, -12)});
  scene.PlaceOnce("chair", {{frame, m.frame}, {seat, m.cushion}}, {{-1.2, 0, -0.35}, Rotation::Yaw(70)});
}

/// Open compartments, the darkest places of the room, with books in some.
void AddShelf(SceneDescription& scene, const Materials& m) {
  constexpr double kWidth = 1.5, kTall = 1.25, kDeep = 0.32, kBoard = 0.02;
  constexpr int kRows = 3;
  Mesh boards;
  for (const double side : {-1.0, 0.0, 1.0})
    AddBox(boards, {side * (kWidth - kBoard) / 2, kTall / 2, kDeep / 2}, {kBoard, kTall, kDeep});
  for (int row = 0; row <= kRows; ++row) {
    const double y = 0.06 + (kTall - 0.06 - kBoard / 2) * row / kRows;
    AddBox(boards, {0, y, kDeep / 2 - 0.001}, {kWidth - 0.002, kBoard, kDeep - 0.002});
  }
  AddBox(boards, {0, kTall / 2, 0.011}, {kWidth - 0.004, kTall - 0.004, 0.014});
  scene.PlaceOnce("shelf", {{boards, m.walnut}}, {.translation = kShelf});
  const MaterialId cloths[] = {m.book_red, m.book_blue, m.book_ochre};
  Mesh books[3];
  constexpr double kFirst[] = {-0.70, -0.62, 0.05, 0.20};  // the left ends of rows of books
  for (int shelf = 0; shelf < 4; ++shelf) {
    double x = kFirst[shelf];
    const double y = 0.07 + (kTall - 0.07) * (shelf % kRows) / kRows;
    for (int i = 0; i < 9; ++i) {
      const int kind = (5 * shelf + 7 * i) % 11;
      const double thick = 0.022 + 0.003 * (kind % 5), tall = 0.21 + 0.012 * kind;
      AddBox(books[kind % 3], {x + thick / 2, y + tall / 2, 0.16},
             {thick - 0.001, tall, 0.2 + 0.006 * (kind % 4)});
      x += thick;
    }
  }
  for (int i = 0; i < 3; ++i) scene.PlaceOnce("books", {{books[i], cloths[i]}}, {.translation = kShelf});
}

void AddDecoration(SceneDescription& scene, const Materials& m) {
  constexpr Vec2 kPrint = {0.5, 0.75};
  Mesh print;
  AddQuad(print, {-kPrint.x / 2, -kPrint.y / 2, 0.01}, {kPrint.x, 0, 0}, {0, kPrint.y, 0});
  scene.PlaceOnce("picture", {{print, m.print}, {RectangularFrame(kPrint, 0.03, 0.03), m.black}},
                  OnWall(kRoom.FrontWall(), {2.2, 1.5, 0}));
  Mesh pot;
  const Vec2 profile[] = {{0, 0},        {0.11, 0},     {0.11, 0},    {0.15, 0.28}, {0.15, 0.28},
                          {0.135, 0.28}, {0.135, 0.28}, {0.13, 0.24}, {0, 0.24}};
  AddLathe(pot, {}, profile, 40);
  Mesh leaves;
  AddMoved(leaves, LeafTuft(28, 0.75, 8), {.translation = {0, 0.24, 0}});
  scene.PlaceOnce("plant", {{pot, m.pot}, {leaves, m.leaf}}, {.translation = {0.15, 0, -2.05}});
}

}  // namespace

SceneDescription BuildUplighter() {
  SceneDescription scene{.name = "uplighter"};
  const Materials materials = AddMaterials(scene);
  AddShell(scene, materials);
  AddLamp(scene, materials);
  AddTable(scene, materials);
  AddThingsOnTable(scene, materials);
  AddChair(scene, materials);
  AddShelf(scene, materials);
  AddDecoration(scene, materials);
  scene.camera = {Transform::LookingAt({1.35, 1.4, 2.2}, {-0.15, 0.62, -0.5}), 47};
  return scene;
}

}  // namespace lumifold::scenes
