// A meeting room by day: a long table under ceiling panels, blinds, a picture and a mirror on the far wall.
// The room is 6.4 m wide (x), 6.4 m long (z) and 2.8 m high; the camera stands near its rear wall.

#include <utility>

#include "tests/scenes/interior_parts.h"
#include "tests/scenes/materials.h"
#include "tests/scenes/scenes.h"
#include "tests/scenes/textures.h"

namespace lumifold::scenes {
namespace {

constexpr Room kRoom = {.left = -3.2, .right = 3.2, .front = -3.0, .rear = 3.4, .height = 2.8};
constexpr Window kWindow = {.opening = {2.0, 0.9, 3.6, 1.5}, .wall_depth = 0.22};
constexpr double kTableHeight = 0.74;
constexpr Vec3 kTableCenter = {-0.25, 0, -0.55};
constexpr double kTableWidth = 1.3, kTableLength = 3.4;

struct Materials {
  MaterialId wall, ceiling, carpet, trim, window_frame, slat, table, chrome, fabric, door, black, mirror,
      painting, porcelain, red_glaze, paper, leaf, terracotta, whiteboard, screen, panel_light, sky,
      ground_light;
};

Materials AddMaterials(SceneDescription& scene) {
  const TextureId carpet = scene.Add(Carpet({0.42, 0.45, 0.50}));
  const TextureId oak = scene.Add(WoodGrain({{0.72, 0.53, 0.35}, {0.47, 0.30, 0.17}}));
  const TextureId landscape = scene.Add(Landscape());
  const TextureId page = scene.Add(PrintedPage());
  constexpr Vec3 kWhite = {1, 1, 1};
  const auto add = [&](Material material) { return scene.Add(std::move(material)); };
  return {
      .wall = add(Glossy("wall", {0.74, 0.72, 0.66}, 0.9, 0.5)),
      .ceiling = add(Matte("ceiling", {0.82, 0.82, 0.8})),
      .carpet = add(Textured(Matte("carpet", kWhite), carpet, {1, 1})),
      .trim = add(Glossy("trim", {0.78, 0.77, 0.74}, 0.45)),
      .window_frame = add(Glossy("window frame", {0.8, 0.8, 0.8}, 0.35)),
      .slat = add(DoubleSided(Glossy("slat", {0.8, 0.8, 0.78}, 0.5))),
      .table = add(Textured(Glossy("oak", kWhite, 0.28), oak, {1.8, 0.9})),
      .chrome = add(Metal("chrome", {0.72, 0.73, 0.75}, 0.2)),
      .fabric = add(Glossy("blue fabric", {0.06, 0.11, 0.22}, 0.95, 0.3)),
      .door = add(Textured(Glossy("door", kWhite, 0.4), oak, {2.4, 1.2})),
      .black = add(Glossy("black lacquer", {0.03, 0.03, 0.035}, 0.25)),
      .mirror = add(Metal("mirror", {0.93, 0.94, 0.94}, 0)),
      .painting = add(Textured(Glossy("painting", kWhite, 0.6), landscape, {1.44, 1.08})),
      .porcelain = add(Glossy("porcelain", {0.82, 0.81, 0.78}, 0.12)),
      .red_glaze = add(Glossy("red glaze", {0.6, 0.05, 0.03}, 0.15)),
      .paper = add(Textured(Matte("paper", kWhite), page, {0.21, 0.297})),
      .leaf = add(DoubleSided(Glossy("leaf", {0.09, 0.24, 0.06}, 0.45))),
      .terracotta = add(Glossy("terracotta", {0.55, 0.24, 0.13}, 0.8)),
      .whiteboard = add(Glossy("whiteboard", {0.85, 0.86, 0.87}, 0.15)),
      .screen = add(Glossy("screen", {0.02, 0.02, 0.025}, 0.08)),
      .panel_light = add(Emitter("panel light", {7.0, 6.5, 5.8})),
      .sky = add(Emitter("sky", {2.8, 3.2, 3.8})),
      .ground_light = add(Emitter("lit ground", {1.0, 1.05, 0.85})),
  };
}

/// One slat of the blinds along x, slightly arched, rotated about its own axis.
Mesh SlatMesh(double length) {
  constexpr double kChord = 0.05, kArch = 0.006, kTilt = 42;
  Mesh mesh;
  AddSurface(mesh, 1, 6, {length, kChord}, [&](double u, double v) {
    const double across = v - 0.5;
    return Vec3{(u - 0.5) * length, kArch * (1 - 4 * across * across), -across * kChord};
  });
  Mesh tilted;
  AddMoved(tilted, mesh, {.rotation = Rotation::AboutAxis({1, 0, 0}, kTilt)});
  return tilted;
}

void AddBlinds(SceneDescription& scene, const Materials& m) {
  constexpr WallRect kOpening = kWindow.opening;
  constexpr double kPitch = 0.046, kInset = -0.06;
  const double middle = kOpening.x + kOpening.width / 2, top = kOpening.y + kOpening.height;
  Mesh rail, cords;
  AddRoundedBox(rail, {middle, top - 0.025, kInset}, {kOpening.width - 0.02, 0.05, 0.06}, 0.008);
  const MeshId slat = scene.Add("slat", {{SlatMesh(kOpening.width - 0.04), m.slat}});
  const int slats = static_cast<int>((kOpening.height - 0.12) / kPitch);
  for (int i = 0; i < slats; ++i) {
    scene.Place("slat", slat, OnWall(kRoom.LeftWall(), {middle, top - 0.08 - i * kPitch, kInset}));
  }
  const double bottom = top - 0.08 - slats * kPitch;
  AddRoundedBox(rail, {middle, bottom, kInset}, {kOpening.width - 0.04, 0.025, 0.05}, 0.008);
  for (const double part : {0.12, 0.5, 0.88}) {
    const Vec3 from = {kOpening.x + part * kOpening.width, bottom, kInset};
    AddCylinder(cords, from, 0.003, 0.003, top - bottom - 0.03, 6);
  }
  scene.PlaceOnce("blind rails", {{rail, m.window_frame}, {cords, m.trim}}, kRoom.LeftWall());
  PlaceDaylight(scene, kRoom, kWindow,
                {.distance = 0.9, .margin = 0.7, .horizon = 1.25, .sky = m.sky, .ground = m.ground_light});
}

void AddCeilingPanels(SceneDescription& scene, const Materials& m) {
  constexpr double kPanelWidth = 0.6, kPanelLength = 1.2;
  Mesh light, frame;
  AddQuad(light, {-kPanelWidth / 2, -0.012, -kPanelLength / 2}, {kPanelWidth, 0, 0}, {0, 0, kPanelLength});
  AddMoved(frame, RectangularFrame({kPanelWidth, kPanelLength}, 0.035, 0.025),
           {.rotation = Rotation::AboutAxis({1, 0, 0}, 90)});
  const MeshId panel = scene.Add("ceiling panel", {{light, m.panel_light}, {frame, m.trim}});
  for (const double z : {-1.7, 0.4, 2.5}) {
    for (const double x : {-1.5, 1.5})
      scene.Place("ceiling panel", panel, {.translation = {x, kRoom.height, z}});
  }
}

void AddTable(SceneDescription& scene, const Materials& m) {
  Mesh top, legs;
  AddRoundedBox(top, {0, kTableHeight - 0.02, 0}, {kTableLength, 0.04, kTableWidth}, 0.012);
  for (const double side : {-1.0, 1.0}) {
    const double x = side * (kTableLength / 2 - 0.45), z = kTableWidth / 2 - 0.18;
    const Vec3 corners[] = {
        {x, kTableHeight - 0.05, -z}, {x, 0.02, -z}, {x, 0.02, z}, {x, kTableHeight - 0.05, z}};
    AddTube(legs, RoundedPath(corners, 0.06), 0.025, 12);
  }
  AddBox(legs, {0, kTableHeight - 0.06, 0}, {kTableLength - 0.6, 0.04, 0.08});
  // The grain follows the table's length, which is x here and z in the room.
  scene.PlaceOnce("table", {{top, m.table}, {legs, m.chrome}}, {kTableCenter, Rotation::Yaw(90)});
}

/// A cantilever chair that faces +z.
MeshId AddChairMesh(SceneDescription& scene, const Materials& m) {
  Mesh frame, cushions;
  for (const double x : {-0.23, 0.23}) {
    const Vec3 corners[] = {
        {x, 0.88, -0.27}, {x, 0.45, -0.2}, {x, 0.44, 0.22}, {x, 0.015, 0.24}, {x, 0.015, -0.24}};
    AddTube(frame, RoundedPath(corners, 0.06), 0.013, 10);
  }
  const Vec3 back_bar[] = {{-0.23, 0.015, -0.24}, {0.23, 0.015, -0.24}};
  AddTube(frame, back_bar, 0.013, 10);
  AddRoundedBox(cushions, {0, 0.475, 0.02}, {0.47, 0.07, 0.45}, 0.03, 4);
  Mesh back;
  AddRoundedBox(back, {0, 0, 0}, {0.46, 0.40, 0.055}, 0.025, 4);
  AddMoved(cushions, back, {{0, 0.72, -0.232}, Rotation::AboutAxis({1, 0, 0}, -9)});
  return scene.Add("chair", {{frame, m.chrome}, {cushions, m.fabric}});
}

void AddChairs(SceneDescription& scene, const Materials& m) {
  const MeshId chair = AddChairMesh(scene, m);
  const auto place = [&](double x, double z, double yaw) {
    scene.Place("chair", chair, {kTableCenter + Vec3{x, 0, z}, Rotation::Yaw(yaw)});
  };
  constexpr double kBeside = kTableWidth / 2 + 0.16;
  place(-kBeside, -1.05, 92);
  place(-kBeside, 0.0, 87);
  place(-kBeside - 0.05, 1.05, 95);
  place(kBeside, -1.05, -91);
  place(kBeside + 0.02, 0.0, -86);
  place(kBeside + 0.34, 1.12, -116);  // pushed back
  place(0, -kTableLength / 2 - 0.16, 3);
}

void AddMug(Mesh& mug) {
  const Vec2 profile[] = {{0, 0},          {0.034, 0},      {0.034, 0},     {0.039, 0.006}, {0.040, 0.09},
                          {0.0385, 0.095}, {0.0365, 0.093}, {0.036, 0.012}, {0.036, 0.012}, {0, 0.012}};
  AddLathe(mug, {}, profile, 32);
  const Vec3 handle[] = {{0.038, 0.078, 0}, {0.068, 0.078, 0}, {0.068, 0.022, 0}, {0.038, 0.022, 0}};
  AddTube(mug, RoundedPath(handle, 0.022), 0.006, 8);
}

void AddLaptop(SceneDescription& scene, const Materials& m, const Transform& at) {
  Mesh body, keys, lid, screen;
  AddRoundedBox(body, {0, 0.008, 0}, {0.34, 0.016, 0.23}, 0.006);
  AddBox(keys, {0, 0.0165, -0.03}, {0.29, 0.001, 0.11});
  AddRoundedBox(lid, {0, 0.11, -0.004}, {0.34, 0.22, 0.008}, 0.003);
  AddQuad(screen, {-0.158, 0.015, 0.0005}, {0.316, 0, 0}, {0, 0.19, 0});
  const Transform opened = {{0, 0.014, -0.115}, Rotation::AboutAxis({1, 0, 0}, -18)};
  AddMoved(body, lid, opened);
  AddMoved(keys, screen, opened);
  scene.PlaceOnce("laptop", {{body, m.chrome}, {keys, m.screen}}, at);
}

void AddThingsOnTable(SceneDescription& scene, const Materials& m) {
  const auto on_table = [](double x, double z, double yaw) {
    return Transform{kTableCenter + Vec3{x, kTableHeight, z}, Rotation::Yaw(yaw)};
  };
  Mesh mug;
  AddMug(mug);
  const MeshId white_mug = scene.Add("white mug", {{mug, m.porcelain}});
  const MeshId red_mug = scene.Add("red mug", {{mug, m.red_glaze}});
  scene.Place("mug", white_mug, on_table(-0.42, 0.75, 200));
  scene.Place("mug", red_mug, on_table(0.36, 1.2, -30));
  scene.Place("mug", white_mug, on_table(0.40, -0.25, 40));
  Mesh sheet;
  AddQuad(sheet, {-0.105, 0.001, 0.1485}, {0.21, 0, 0}, {0, 0, -0.297});
  const MeshId paper = scene.Add("paper", {{sheet, m.paper}});
  // Each sheet lies a little higher than the one before: some of them overlap.
  constexpr double kSheets[][3] = {
      {-0.38, 1.15, -82}, {-0.33, 1.02, -101}, {0.36, 0.86, 84}, {-0.4, 0.05, -93}, {0.36, -1.0, 95}};
  double lift = 0;
  for (const auto& [x, z, yaw] : kSheets) {
    Transform at = on_table(x, z, yaw);
    at.translation.y += lift;
    lift += 0.0006;
    scene.Place("paper", paper, at);
  }
  AddLaptop(scene, m, on_table(0.30, 0.12, 82));
  Mesh bowl, fruit;
  const Vec2 profile[] = {{0, 0},        {0.06, 0},     {0.06, 0},      {0.07, 0.012},
                          {0.15, 0.075}, {0.147, 0.08}, {0.068, 0.022}, {0, 0.016}};
  AddLathe(bowl, {}, profile, 40);
  constexpr Vec3 kFruit[] = {
      {0.045, 0.055, 0.01}, {-0.035, 0.055, 0.04}, {-0.02, 0.055, -0.045}, {0, 0.10, 0.004}};
  for (const Vec3& at : kFruit) AddSphere(fruit, at, 0.037, 20);
  scene.PlaceOnce("bowl", {{bowl, m.black}, {fruit, m.red_glaze}}, on_table(-0.02, -0.5, 0));
}

/// The objects on the far wall, and its door.
void AddFrontWallThings(SceneDescription& scene, const Materials& m) {
  constexpr Vec2 kPicture = {1.44, 1.08}, kMirror = {0.95, 1.35};
  Mesh picture;
  AddQuad(picture, {-kPicture.x / 2, -kPicture.y / 2, 0.012}, {kPicture.x, 0, 0}, {0, kPicture.y, 0});
  scene.PlaceOnce("picture", {{picture, m.painting}, {RectangularFrame(kPicture, 0.05, 0.035), m.black}},
                  OnWall(kRoom.FrontWall(), {3.15, 1.62, 0}));
  Mesh mirror;
  AddQuad(mirror, {-kMirror.x / 2, -kMirror.y / 2, 0.02}, {kMirror.x, 0, 0}, {0, kMirror.y, 0});
  scene.PlaceOnce("mirror", {{mirror, m.mirror}, {RectangularFrame(kMirror, 0.045, 0.035), m.table}},
                  OnWall(kRoom.FrontWall(), {1.35, 1.5, 0}));
  const DoorMeshes door = PanelledDoor({0.92, 2.08});
  scene.PlaceOnce("door", {{door.leaf, m.door}, {door.frame, m.trim}, {door.handle, m.chrome}},
                  OnWall(kRoom.FrontWall(), {5.2, 0, 0.015}));
}

/// Visible in the mirror only.
void AddWhiteboard(SceneDescription& scene, const Materials& m) {
  constexpr Vec2 kBoard = {2.4, 1.2};
  Mesh board;
  AddQuad(board, {-kBoard.x / 2, -kBoard.y / 2, 0.01}, {kBoard.x, 0, 0}, {0, kBoard.y, 0});
  scene.PlaceOnce("whiteboard", {{board, m.whiteboard}, {RectangularFrame(kBoard, 0.03, 0.025), m.chrome}},
                  OnWall(kRoom.RearWall(), {4.2, 1.55, 0}));
}

void AddPlant(SceneDescription& scene, const Materials& m) {
  Mesh pot, soil;
  const Vec2 profile[] = {{0, 0},       {0.14, 0},    {0.14, 0},    {0.19, 0.36},
                          {0.19, 0.36}, {0.17, 0.36}, {0.17, 0.36}, {0.165, 0.31}};
  AddLathe(pot, {}, profile, 40);
  AddCylinder(soil, {0, 0.25, 0}, 0.165, 0.165, 0.06, 24);
  Mesh leaves;
  AddMoved(leaves, LeafTuft(34, 0.85, 3), {.translation = {0, 0.3, 0}});
  scene.PlaceOnce("plant", {{pot, m.terracotta}, {soil, m.black}, {leaves, m.leaf}},
                  {.translation = {-2.65, 0, -2.45}});
}

}  // namespace

SceneDescription BuildMeetingRoom() {
  SceneDescription scene{.name = "meeting-room"};
  const Materials materials = AddMaterials(scene);
  PlaceShell(scene, kRoom, kWindow,
             {.floor = materials.carpet,
              .ceiling = materials.ceiling,
              .wall = materials.wall,
              .trim = materials.trim,
              .window_frame = materials.window_frame});
  AddBlinds(scene, materials);
  AddCeilingPanels(scene, materials);
  AddTable(scene, materials);
  AddChairs(scene, materials);
  AddThingsOnTable(scene, materials);
  AddFrontWallThings(scene, materials);
  AddWhiteboard(scene, materials);
  AddPlant(scene, materials);
  scene.camera = {Transform::LookingAt({1.35, 1.65, 3.1}, {-0.3, 0.98, -1.2}), 52};
  return scene;
}

}  // namespace lumifold::scenes
