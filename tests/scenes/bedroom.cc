// A bedroom with a cloudy sky in the window and the bedside lamp lit. The bed stands against the front wall.
// The room is 5 m wide (x), 4.6 m long (z) and 2.6 m high; the camera stands in its right rear corner.

#include <cmath>
#include <numbers>
#include <utility>

#include "tests/scenes/interior_parts.h"
#include "tests/scenes/materials.h"
#include "tests/scenes/noise.h"
#include "tests/scenes/scenes.h"
#include "tests/scenes/textures.h"

namespace lumifold::scenes {
namespace {

constexpr Room kRoom = {.left = -2.6, .right = 2.4, .front = -2.2, .rear = 2.4, .height = 2.6};
constexpr Window kWindow = {.opening = {1.75, 0.62, 1.9, 1.7}, .wall_depth = 0.25};

constexpr Vec3 kBed = {-0.05, 0, -1.12};  // the bed's middle; its head is towards -z
constexpr double kHalfBed = 0.9, kBedLength = 2.04, kMattressTop = 0.54;

struct Materials {
  MaterialId wallpaper, ceiling, floor, trim, window_frame, wood, dark_wood, brass, ceramic, shade,
      shade_inside, diffuser, mattress, duvet, sheet, throw_cloth, headboard, pillow, accent_pillow, curtain,
      rug, print, leaf, pot, books, sky, garden, balcony_light;
};

Materials AddMaterials(SceneDescription& scene) {
  const TextureId wallpaper =
      scene.Add(Wallpaper({0.91, 0.89, 0.82}, {0.83, 0.84, 0.77}, {0.70, 0.75, 0.66}));
  const TextureId boards = scene.Add(WoodBoards({{0.80, 0.62, 0.42}, {0.56, 0.38, 0.24}}));
  const TextureId walnut = scene.Add(WoodGrain({{0.60, 0.42, 0.28}, {0.36, 0.23, 0.14}}));
  const TextureId rug = scene.Add(Rug());
  const TextureId stripes = scene.Add(StripedCloth({0.80, 0.74, 0.62}, {0.60, 0.25, 0.17}));
  const TextureId print = scene.Add(BotanicalPrint());
  constexpr Vec3 kWhite = {1, 1, 1};
  const auto add = [&](Material material) { return scene.Add(std::move(material)); };
  return {
      .wallpaper = add(Textured(Glossy("wallpaper", kWhite, 0.85, 0.4), wallpaper, {0.5, 0.5})),
      .ceiling = add(Matte("ceiling", {0.84, 0.83, 0.8})),
      .floor = add(Textured(Glossy("floor boards", kWhite, 0.32), boards, {2.4, 1.2})),
      .trim = add(Glossy("trim", {0.8, 0.79, 0.76}, 0.4)),
      .window_frame = add(Glossy("window frame", {0.82, 0.82, 0.8}, 0.35)),
      .wood = add(Textured(Glossy("walnut", kWhite, 0.38), walnut, {1.6, 0.8})),
      .dark_wood = add(Glossy("dark wood", {0.06, 0.04, 0.03}, 0.3)),
      .brass = add(Metal("brass", {0.86, 0.66, 0.36}, 0.22)),
      .ceramic = add(Glossy("teal ceramic", {0.05, 0.22, 0.24}, 0.1)),
      .shade = add(Emitter("lampshade", {2.6, 1.55, 0.75})),
      .shade_inside = add(Matte("lampshade lining", {0.85, 0.8, 0.7})),
      .diffuser = add(Emitter("lamp diffuser", {20, 13, 7})),
      .mattress = add(Matte("mattress", {0.78, 0.77, 0.74})),
      .duvet = add(Glossy("duvet", {0.40, 0.50, 0.60}, 0.9, 0.3)),
      .sheet = add(Matte("sheet", {0.83, 0.82, 0.79})),
      .throw_cloth = add(DoubleSided(Textured(Matte("striped throw", kWhite), stripes, {0.5, 0.5}))),
      .headboard = add(Glossy("headboard", {0.33, 0.30, 0.27}, 0.9, 0.3)),
      .pillow = add(Matte("pillow", {0.84, 0.83, 0.80})),
      .accent_pillow = add(Glossy("rust pillow", {0.50, 0.17, 0.09}, 0.85, 0.3)),
      .curtain = add(DoubleSided(Matte("curtain", {0.60, 0.40, 0.15}))),
      .rug = add(Textured(Matte("rug", kWhite), rug, {2.0, 1.5})),
      .print = add(Textured(Glossy("print", kWhite, 0.5), print, {0.4, 0.6})),
      .leaf = add(DoubleSided(Glossy("leaf", {0.08, 0.22, 0.06}, 0.4))),
      .pot = add(Glossy("pot", {0.72, 0.70, 0.66}, 0.5)),
      .books = add(Glossy("book cover", {0.35, 0.09, 0.08}, 0.5)),
      .sky = add(Emitter("sky", {2.9, 3.5, 4.3})),
      .garden = add(Emitter("garden", {0.34, 0.42, 0.27})),
      .balcony_light = add(Emitter("balcony daylight", {3.4, 3.8, 4.3})),
  };
}

void AddCornice(SceneDescription& scene, const Materials& m) {
  constexpr double kSize = 0.08;
  Mesh cornice;
  for (const double x : {kRoom.left, kRoom.right}) {
    AddRoundedBox(cornice, {x, kRoom.height - kSize / 2, (kRoom.front + kRoom.rear) / 2},
                  {kSize, kSize, kRoom.length()}, 0.03, 3);
  }
  for (const double z : {kRoom.front, kRoom.rear}) {
    AddRoundedBox(cornice, {(kRoom.left + kRoom.right) / 2, kRoom.height - kSize / 2, z},
                  {kRoom.width(), kSize, kSize}, 0.03, 3);
  }
  scene.PlaceOnce("cornice", {{cornice, m.trim}});
}

void AddWindow(SceneDescription& scene, const Materials& m) {
  PlaceDaylight(scene, kRoom, kWindow,
                {.distance = 0.8, .margin = 0.6, .horizon = 1.12, .sky = m.sky, .ground = m.garden});
  constexpr WallRect kOpening = kWindow.opening;
  constexpr double kRailHeight = 2.4, kFromWall = 0.12, kCurtainWidth = 0.5;
  Mesh rod;
  const Vec3 ends[] = {{kOpening.x - 0.45, kRailHeight, kFromWall},
                       {kOpening.x + kOpening.width + 0.45, kRailHeight, kFromWall}};
  AddTube(rod, ends, 0.014, 12);
  for (const Vec3& end : ends) AddSphere(rod, end, 0.03, 16);
  scene.PlaceOnce("curtain rod", {{rod, m.brass}}, kRoom.LeftWall());
  const Vec2 size = {kCurtainWidth, kRailHeight - 0.04};
  const double near_x = kOpening.x - 0.12, far_x = kOpening.x + kOpening.width + 0.12;
  scene.PlaceOnce("near curtain", {{Curtain(size, 6, 0.09, 11), m.curtain}},
                  OnWall(kRoom.LeftWall(), {near_x, kRailHeight - 0.015, kFromWall}));
  scene.PlaceOnce("far curtain", {{Curtain(size, 6, 0.09, 23), m.curtain}},
                  OnWall(kRoom.LeftWall(), {far_x, kRailHeight - 0.015, kFromWall}));
}

/// A glazed door behind the camera, which lights the shadows of the window.
void AddBalconyDoor(SceneDescription& scene, const Materials& m) {
  constexpr Vec2 kDoor = {1.6, 2.1};
  Mesh glow;
  AddQuad(glow, {-kDoor.x / 2, -kDoor.y / 2, 0.01}, {kDoor.x, 0, 0}, {0, kDoor.y, 0});
  scene.PlaceOnce("balcony door",
                  {{glow, m.balcony_light}, {RectangularFrame(kDoor, 0.08, 0.06), m.window_frame}},
                  OnWall(kRoom.RearWall(), {3.2, 0.1 + kDoor.y / 2, 0}));
}

/// The position of a cloth point at the distance `along` from the bed's middle; beyond the mattress's edge
/// the cloth bends down. x: sideways, y: distance below the top.
Vec2 Drape(double along, double half_width) {
  constexpr double kBend = 0.07;
  const double sign = along < 0 ? -1 : 1;
  const double beyond = std::fabs(along) - (half_width - kBend);
  if (beyond <= 0) return {along, 0};
  const double angle = beyond / kBend;
  if (angle < std::numbers::pi / 2) {
    return {sign * (half_width - kBend + kBend * std::sin(angle)), kBend * (1 - std::cos(angle))};
  }
  return {sign * half_width, kBend + beyond - kBend * std::numbers::pi / 2};
}

/// Height of the wrinkles on top of the bed: long soft ridges across each other, and a puff between them.
double Wrinkles(double x, double z, unsigned seed) {
  const auto ridge = [&](double px, double py, unsigned offset) {
    const double n = 1 - std::fabs(2 * Fbm({px, py}, 2, seed + offset) - 1);
    return n * n * n;
  };
  const double diagonal = ridge(1.6 * x + 1.1 * z, 4.2 * z - 3.0 * x, 0);
  const double counter = ridge(1.3 * x - 1.5 * z, 3.4 * z + 3.8 * x, 10);
  const double puff = Fbm({x * 2.2, z * 2.2}, 3, seed + 20);
  const double fine = Fbm({x * 9, z * 9}, 2, seed + 30);
  return 0.065 * diagonal + 0.048 * counter + 0.06 * puff + 0.006 * fine;
}

/// The cloth's position for `s` across the bed and `t` along it, both in metres from the mattress's middle.
Vec3 ClothPoint(double s, double t, double lift, unsigned seed) {
  const Vec2 across = Drape(s, kHalfBed + 0.02 + lift);
  const Vec2 along = t < 0 ? Vec2{t, 0} : Drape(t, kBedLength / 2 + 0.03 + lift);
  // At the corners both edges contribute, and the cloth hangs a little lower: the fourth-power mean of the
  // drops.
  const double across2 = across.y * across.y, along2 = along.y * along.y;
  const double drop = std::sqrt(std::sqrt(across2 * across2 + along2 * along2));
  const double hanging = SmoothStep(0.0, 0.2, drop);
  const double wrinkle = Wrinkles(s, t, seed);
  // Hanging cloth gathers in upright folds that deepen towards the hem.
  const double wave_side = std::sin(15 * t + 5 * Fbm({t * 2.5, s > 0 ? 3.0 : 9.0}, 2, seed + 40));
  const double wave_foot = std::sin(13 * s + 5 * Fbm({s * 2.5, 6}, 2, seed + 50));
  const double depth = 0.02 + 0.13 * drop;
  const double side = (across.y > 0 ? (s < 0 ? -1.0 : 1.0) : 0.0) * SmoothStep(0, 0.1, across.y);
  const double foot = SmoothStep(0, 0.1, along.y);
  const double out_x = side * (depth * (0.6 + 0.5 * wave_side) + 0.5 * wrinkle);
  const double out_z = foot * (depth * (0.6 + 0.5 * wave_foot) + 0.5 * wrinkle);
  return {across.x + out_x, kMattressTop + lift - drop + wrinkle * (1 - 0.8 * hanging), along.x + out_z};
}

struct ClothPatch {
  double half_width, from, to;  ///< across, and along the bed
  double lift;                  ///< above the mattress
  int columns, rows;
};

/// All patches share one seed, so that one laid on another follows its wrinkles.
Mesh ClothMesh(const ClothPatch& patch) {
  constexpr unsigned kSeed = 17;
  Mesh mesh;
  AddSurface(mesh, patch.columns, patch.rows, {2 * patch.half_width, patch.to - patch.from},
             [&](double u, double v) {
               const double s = (2 * u - 1) * patch.half_width;
               const double t = Mix(patch.to, patch.from, v);
               // The upper edge is turned under: it ends in a roll, not in a line.
               const double roll = SmoothStep(0.035, 0, t - patch.from);
               return ClothPoint(s, t, patch.lift - (patch.lift - 0.004) * roll * roll, kSeed);
             });
  return mesh;
}

void AddBedFrame(SceneDescription& scene, const Materials& m) {
  Mesh frame, mattress, headboard;
  AddRoundedBox(frame, {0, 0.24, 0.01}, {2 * kHalfBed + 0.06, 0.16, kBedLength + 0.06}, 0.015);
  for (const double x : {-0.8, 0.8}) {
    for (const double z : {-0.9, 0.9}) AddCylinder(frame, {x, 0, z}, 0.025, 0.035, 0.18, 16);
  }
  AddRoundedBox(mattress, {0, kMattressTop - 0.12, 0}, {2 * kHalfBed, 0.24, kBedLength}, 0.06, 4);
  constexpr int kPads = 7;
  constexpr double kPadWidth = (2 * kHalfBed + 0.1) / kPads;
  for (int i = 0; i < kPads; ++i) {
    const double x = (i - (kPads - 1) / 2.0) * kPadWidth;
    AddRoundedBox(headboard, {x, 0.68, -kBedLength / 2 - 0.03}, {kPadWidth, 0.95, 0.1}, 0.04, 4);
  }
  scene.PlaceOnce("bed", {{frame, m.wood}, {mattress, m.mattress}, {headboard, m.headboard}},
                  {.translation = kBed});
}

void AddBedclothes(SceneDescription& scene, const Materials& m) {
  const Mesh duvet = ClothMesh({kHalfBed + 0.40, -0.36, kBedLength / 2 + 0.38, 0.035, 150, 110});
  const Mesh sheet = ClothMesh({kHalfBed + 0.36, -0.52, -0.18, 0.055, 150, 26});
  const Mesh blanket = ClothMesh({kHalfBed + 0.42, 0.42, 0.86, 0.05, 150, 34});
  scene.PlaceOnce("bedclothes", {{duvet, m.duvet}, {sheet, m.sheet}, {blanket, m.throw_cloth}},
                  {.translation = kBed});

  Mesh pillow, cushion;
  AddCushion(pillow, {0.74, 0.2, 0.5}, 5);
  AddCushion(cushion, {0.46, 0.17, 0.46}, 29);
  const MeshId pillow_mesh = scene.Add("pillow", {{pillow, m.pillow}});
  const MeshId cushion_mesh = scene.Add("cushion", {{cushion, m.accent_pillow}});
  const auto leaning = [&](const char* name, MeshId mesh, Vec3 at, double lean, double yaw) {
    const Rotation turn = Rotation::Yaw(yaw) * Rotation::AboutAxis({1, 0, 0}, lean);
    scene.Place(name, mesh, {kBed + at, turn});
  };
  leaning("pillow", pillow_mesh, {-0.44, kMattressTop + 0.20, -0.94}, 58, 3);
  leaning("pillow", pillow_mesh, {0.43, kMattressTop + 0.20, -0.94}, 56, -4);
  leaning("pillow", pillow_mesh, {-0.42, kMattressTop + 0.14, -0.76}, 38, -5);
  leaning("pillow", pillow_mesh, {0.45, kMattressTop + 0.14, -0.76}, 36, 6);
  leaning("cushion", cushion_mesh, {0.05, kMattressTop + 0.18, -0.62}, 52, 12);
}

MeshId AddNightstandMesh(SceneDescription& scene, const Materials& m) {
  Mesh body, front, knobs;
  AddRoundedBox(body, {0, 0.34, 0}, {0.46, 0.36, 0.40}, 0.012);
  AddRoundedBox(body, {0, 0.525, 0.005}, {0.49, 0.025, 0.43}, 0.008);
  for (const double x : {-0.19, 0.19}) {
    for (const double z : {-0.16, 0.16}) AddCylinder(body, {x, 0, z}, 0.013, 0.02, 0.17, 12);
  }
  for (const double y : {0.25, 0.42}) {
    AddRoundedBox(front, {0, y, 0.204}, {0.42, 0.15, 0.02}, 0.006);
    AddSphere(knobs, {0, y, 0.232}, 0.014, 16);
  }
  return scene.Add("nightstand", {{body, m.wood}, {front, m.wood}, {knobs, m.brass}});
}

void AddLamp(SceneDescription& scene, const Materials& m, Vec3 at) {
  Mesh base, stem, shade, lining, diffuser;
  const Vec2 vase[] = {{0, 0},        {0.065, 0},   {0.065, 0},    {0.07, 0.012}, {0.06, 0.03}, {0.085, 0.09},
                       {0.092, 0.14}, {0.08, 0.19}, {0.045, 0.23}, {0.028, 0.25}, {0.03, 0.26}, {0, 0.26}};
  AddLathe(base, {}, vase, 40);
  AddCylinder(stem, {0, 0.26, 0}, 0.008, 0.008, 0.08, 12);
  const Vec2 outside[] = {{0.17, 0.30}, {0.12, 0.53}};
  const Vec2 inside[] = {{0.117, 0.53}, {0.167, 0.30}};
  AddLathe(shade, {}, outside, 24);
  AddLathe(lining, {}, inside, 24);
  // Instead of a bulb, two emissive discs inside the shade, one facing up and one down: the same cones of
  // light on wall and table, but from an area that light sampling handles well.
  const Vec2 upper[] = {{0.1, 0.47}, {0, 0.47}};
  const Vec2 lower[] = {{0, 0.37}, {0.13, 0.37}};
  AddLathe(diffuser, {}, upper, 12);
  AddLathe(diffuser, {}, lower, 12);
  scene.PlaceOnce("lamp",
                  {{base, m.ceramic},
                   {stem, m.brass},
                   {shade, m.shade},
                   {lining, m.shade_inside},
                   {diffuser, m.diffuser}},
                  {.translation = at});
}

void AddNightstands(SceneDescription& scene, const Materials& m) {
  const MeshId nightstand = AddNightstandMesh(scene, m);
  const double z = kRoom.front + 0.26, top = 0.5375;
  const Vec3 left = {kBed.x - 1.24, 0, z}, right = {kBed.x + 1.24, 0, z};
  scene.Place("nightstand", nightstand, {.translation = left});
  scene.Place("nightstand", nightstand, {.translation = right});
  AddLamp(scene, m, right + Vec3{0.02, top, -0.02});
  Mesh covers, pages;
  constexpr double kBooks[][3] = {{0.20, 0.03, 0}, {0.18, 0.024, 0.03}, {0.16, 0.035, 0.054}};
  for (const auto& [width, height, bottom] : kBooks) {
    AddBox(covers, {0, bottom + height / 2, 0}, {width, height, width * 0.72});
    AddBox(pages, {0.004, bottom + height / 2, 0.003}, {width - 0.004, height - 0.008, width * 0.72});
  }
  scene.PlaceOnce("books", {{covers, m.books}, {pages, m.sheet}},
                  {left + Vec3{0.02, top, 0.04}, Rotation::Yaw(24)});
}

void AddWardrobe(SceneDescription& scene, const Materials& m) {
  constexpr double kWidth = 1.04, kTall = 2.1, kDepth = 0.55;
  Mesh body, doors, handles;
  AddBox(body, {0, kTall / 2, 0}, {kWidth, kTall, kDepth});
  AddRoundedBox(body, {0, kTall + 0.02, 0.01}, {kWidth + 0.05, 0.05, kDepth + 0.05}, 0.015);
  for (const double side : {-1.0, 1.0}) {
    const double x = side * kWidth / 4;
    AddRoundedBox(doors, {x, kTall / 2 + 0.04, kDepth / 2 + 0.01}, {kWidth / 2 - 0.008, kTall - 0.12, 0.022},
                  0.006);
    AddMoved(doors, RectangularFrame({kWidth / 2 - 0.22, kTall - 0.42}, 0.025, 0.014),
             {.translation = {x, kTall / 2 + 0.04, kDepth / 2 + 0.02}});
    AddCylinder(handles, {side * 0.045, 1.0, kDepth / 2 + 0.045}, 0.008, 0.008, 0.16, 12);
  }
  // Vertical grain: the doors' texture coordinates are rotated by 90 degrees.
  for (Mesh* mesh : {&body, &doors}) {
    for (Vec2& uv : mesh->uvs) uv = {uv.y, uv.x};
  }
  scene.PlaceOnce("wardrobe", {{body, m.wood}, {doors, m.wood}, {handles, m.brass}},
                  {.translation = {kRoom.left + kWidth / 2 + 0.03, 0, kRoom.front + kDepth / 2 + 0.02}});
}

void AddDecoration(SceneDescription& scene, const Materials& m) {
  constexpr Vec2 kPrint = {0.4, 0.6};
  Mesh print;
  AddQuad(print, {-kPrint.x / 2, -kPrint.y / 2, 0.01}, {kPrint.x, 0, 0}, {0, kPrint.y, 0});
  const MeshId picture =
      scene.Add("picture", {{print, m.print}, {RectangularFrame(kPrint, 0.025, 0.03), m.dark_wood}});
  const double middle = kBed.x - kRoom.left;
  for (const double x : {-0.34, 0.34})
    scene.Place("picture", picture, OnWall(kRoom.FrontWall(), {middle + x, 1.72, 0}));

  Mesh rug;
  AddQuad(rug, {-1, 0.012, 0.75}, {2, 0, 0}, {0, 0, -1.5});
  Mesh rim;
  AddRoundedBox(rim, {0, 0.005, 0}, {2.01, 0.013, 1.51}, 0.005);
  scene.PlaceOnce("rug", {{rug, m.rug}, {rim, m.throw_cloth}}, {{-0.6, 0, 0.85}, Rotation::Yaw(-7)});

  Mesh pot, leaves;
  const Vec2 profile[] = {{0, 0},        {0.11, 0},     {0.11, 0},    {0.15, 0.28}, {0.15, 0.28},
                          {0.135, 0.28}, {0.135, 0.28}, {0.13, 0.24}, {0, 0.24}};
  AddLathe(pot, {}, profile, 40);
  AddMoved(leaves, LeafTuft(26, 0.75, 8), {.translation = {0, 0.24, 0}});
  scene.PlaceOnce("plant", {{pot, m.pot}, {leaves, m.leaf}}, {.translation = {-2.2, 0, 0.35}});
}

}  // namespace

SceneDescription BuildBedroom() {
  SceneDescription scene{.name = "bedroom"};
  const Materials materials = AddMaterials(scene);
  PlaceShell(scene, kRoom, kWindow,
             {.floor = materials.floor,
              .ceiling = materials.ceiling,
              .wall = materials.wallpaper,
              .trim = materials.trim,
              .window_frame = materials.window_frame});
  AddCornice(scene, materials);
  AddWindow(scene, materials);
  AddBalconyDoor(scene, materials);
  AddBedFrame(scene, materials);
  AddBedclothes(scene, materials);
  AddNightstands(scene, materials);
  AddWardrobe(scene, materials);
  AddDecoration(scene, materials);
  scene.camera = {Transform::LookingAt({2.1, 1.55, 2.2}, {-0.66, 0.74, -1.1}), 50};
  return scene;
}

}  // namespace lumifold::scenes
