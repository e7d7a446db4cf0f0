#include "tests/stability/test_scenes.h"

#include <string>
#include <utility>

#include "filter/image/planes.h"
#include "tests/scenes/materials.h"
#include "tests/scenes/mesh_builder.h"
#include "tests/scenes/textures.h"

namespace lumifold::stability {
namespace {

using scenes::MaterialId;
using scenes::Mesh;
using scenes::SceneDescription;
using scenes::Vec3;

constexpr double kRear = -2;
constexpr double kFront = 4;
constexpr double kSide = 2;
constexpr double kHeight = 3;

Mesh Quad(Vec3 corner, Vec3 u, Vec3 v) {
  Mesh mesh;
  scenes::AddQuad(mesh, corner, u, v);
  return mesh;
}

/// Squares of two shades, 2 x 2 of them.
scenes::Texture Chequer() {
  scenes::Texture texture{.name = "chequer", .width = 64, .height = 64};
  ForEachPixel(64, 64, [&](int x, int y) {
    const std::uint8_t shade = (x / 32 + y / 32) % 2 == 0 ? 230 : 90;
    texture.rgb.insert(texture.rgb.end(), {shade, shade, static_cast<std::uint8_t>(shade / 2 + 60)});
  });
  return texture;
}

struct Walls {
  MaterialId floor, ceiling, left, right, rear, front;
};

/// A room under construction.
class RoomBuilder {
 public:
  explicit RoomBuilder(std::string name) {
    scene_.name = std::move(name);
    scene_.camera = {scenes::Transform::LookingAt({0, 1.5, 3.6}, {0, 1.3, kRear}), 50};
  }

  MaterialId Add(scenes::Material material) { return scene_.Add(std::move(material)); }
  MaterialId White() { return Add(scenes::Matte("white", {0.75, 0.75, 0.75})); }
  MaterialId Textured(scenes::Texture texture, double size_m) {
    const std::string name = texture.name;
    return Add(
        scenes::Textured(scenes::Matte(name, {1, 1, 1}), scene_.Add(std::move(texture)), {size_m, size_m}));
  }
  void Place(const std::string& name, Mesh mesh, MaterialId material) {
    scene_.PlaceOnce(name, {{std::move(mesh), material}});
  }

  void PlaceWalls(const Walls& walls, double rear = kRear) {
    const double depth = kFront - rear;
    Place("floor", Quad({-kSide, 0, kFront}, {2 * kSide, 0, 0}, {0, 0, -depth}), walls.floor);
    Place("ceiling", Quad({-kSide, kHeight, rear}, {2 * kSide, 0, 0}, {0, 0, depth}), walls.ceiling);
    Place("left wall", Quad({-kSide, 0, kFront}, {0, 0, -depth}, {0, kHeight, 0}), walls.left);
    Place("right wall", Quad({kSide, 0, rear}, {0, 0, depth}, {0, kHeight, 0}), walls.right);
    Place("rear wall", Quad({-kSide, 0, rear}, {2 * kSide, 0, 0}, {0, kHeight, 0}), walls.rear);
    Place("front wall", Quad({kSide, 0, kFront}, {-2 * kSide, 0, 0}, {0, kHeight, 0}), walls.front);
  }
  void PlaceWhiteWalls() {
    const MaterialId white = White();
    PlaceWalls({white, white, white, white, white, white});
  }

  /// On the ceiling, facing down.
  void PlaceLamp(double radiance, double size = 1) {
    const MaterialId lamp = Add(scenes::Emitter("lamp", {radiance, 0.9 * radiance, 0.8 * radiance}));
    Place("lamp", Quad({-size / 2, kHeight - 0.01, 1 - size / 2}, {size, 0, 0}, {0, 0, size}), lamp);
  }
  void PlaceBall(Vec3 center, double radius, MaterialId material) {
    Mesh ball;
    scenes::AddSphere(ball, center, radius, 48);
    Place("ball", std::move(ball), material);
  }
  void PlaceBox(Vec3 center, Vec3 size, MaterialId material) {
    Mesh box;
    scenes::AddBox(box, center, size);
    Place("box", std::move(box), material);
  }

  SceneDescription Take() { return std::move(scene_); }

 private:
  SceneDescription scene_;
};

/// Walls of different materials, to be seen in a mirror.
Walls FurnishedWalls(RoomBuilder* room) {
  const MaterialId white = room->White();
  return {room->Textured(Chequer(), 0.8),
          white,
          room->Add(scenes::Matte("red", {0.6, 0.15, 0.1})),
          room->Textured(scenes::BotanicalPrint(), 1.5),
          white,
          room->Textured(scenes::Landscape(), 3)};
}

MaterialId AddMirror(RoomBuilder* room) { return room->Add(scenes::Metal("mirror", {0.9, 0.9, 0.9}, 0)); }

/// On the rear wall.
void PlaceFlatMirror(RoomBuilder* room) {
  room->Place("mirror", Quad({-1.2, 0.6, kRear + 0.02}, {2.4, 0, 0}, {0, 1.7, 0}), AddMirror(room));
}

}  // namespace

SceneDescription MirrorRoom() {
  RoomBuilder room("mirror-room");
  room.PlaceWalls(FurnishedWalls(&room));
  room.PlaceLamp(9);
  PlaceFlatMirror(&room);
  room.PlaceBox({0.9, 0.3, 0.2}, {0.6, 0.6, 0.6}, room.Add(scenes::Matte("blue", {0.2, 0.3, 0.7})));
  return room.Take();
}

SceneDescription MirrorSphereRoom() {
  RoomBuilder room("mirror-sphere-room");
  room.PlaceWalls(FurnishedWalls(&room));
  room.PlaceLamp(9);
  PlaceFlatMirror(&room);
  room.PlaceBall({-0.2, 0.7, 0.3}, 0.7, AddMirror(&room));
  return room.Take();
}

SceneDescription FacingMirrorsRoom() {
  RoomBuilder room("facing-mirrors-room");
  Walls walls = FurnishedWalls(&room);
  walls.rear = walls.front = AddMirror(&room);
  room.PlaceWalls(walls);
  room.PlaceLamp(7);
  room.PlaceBox({0.3, 0.4, -0.5}, {0.5, 0.8, 0.5}, room.Add(scenes::Matte("green", {0.2, 0.6, 0.3})));
  return room.Take();
}

SceneDescription GlassRoom() {
  RoomBuilder room("glass-room");
  const MaterialId white = room.White();
  room.PlaceWalls({white, white, white, white, room.Textured(Chequer(), 0.5), white});
  room.PlaceLamp(9);
  scenes::Material glass = scenes::Glass("pane");
  glass.double_sided = true;
  room.Place("pane", Quad({0, 0.2, 0.5}, {1.5, 0, 0.3}, {0, 2.2, 0}), room.Add(std::move(glass)));
  return room.Take();
}

SceneDescription RoughnessRoom() {
  RoomBuilder room("roughness-room");
  room.PlaceWalls(FurnishedWalls(&room));
  room.PlaceLamp(9);
  constexpr double kRoughness[kRoughnessPanels] = {0, 0.1, 0.2, 0.35, 0.5, 0.7, 1};
  for (int i = 0; i < kRoughnessPanels; ++i) {
    const MaterialId metal =
        room.Add(scenes::Metal("metal " + std::to_string(i), {0.9, 0.8, 0.6}, kRoughness[i]));
    room.Place("panel " + std::to_string(i),
               Quad({-1.75 + 0.5 * i, 0.5, kRear + 0.02}, {0.5, 0, 0}, {0, 2, 0}), metal);
  }
  return room.Take();
}

SceneDescription HalfMetalRoom() {
  RoomBuilder room("half-metal-room");
  room.PlaceWhiteWalls();
  room.PlaceLamp(9);
  scenes::Material mixed = scenes::Metal("half metal", {0.8, 0.5, 0.3}, 0.5);
  mixed.metallic = 0.5;
  room.PlaceBall({0, 1.2, 0}, 1, room.Add(std::move(mixed)));
  return room.Take();
}

SceneDescription CornerRoom() {
  RoomBuilder room("corner-room");
  room.PlaceWhiteWalls();
  room.PlaceLamp(9);
  const MaterialId white = room.Add(scenes::Matte("shade", {0.75, 0.75, 0.75}));
  room.PlaceBox({0, kHeight - 0.3, 1}, {1.6, 0.04, 1.6},
                white);  // blocks the direct light of the lamp on the floor
  return room.Take();
}

SceneDescription SlitRoom() {
  RoomBuilder room("slit-room");
  const MaterialId white = room.White();
  const Walls walls = {white, white, white, white, white, white};
  room.PlaceWalls(walls);
  const MaterialId sky = room.Add(scenes::Emitter("slit", {150, 150, 170}));
  room.Place("slit", Quad({kSide - 0.01, 0.8, -1}, {0, 0, 0.04}, {0, 1.6, 0}), sky);
  room.PlaceBox({0.8, 0.5, -0.6}, {0.5, 1, 0.5}, room.Add(scenes::Matte("ochre", {0.7, 0.5, 0.2})));
  return room.Take();
}

SceneDescription ChequeredHall() {
  RoomBuilder room("chequered-hall");
  const MaterialId white = room.White();
  room.PlaceWalls({room.Textured(Chequer(), 0.25), white, white, white, white, white}, -60);
  for (int i = 0; i < 4; ++i) {
    const double z = -2.0 - 14 * i;
    const MaterialId lamp = room.Add(scenes::Emitter("lamp " + std::to_string(i), {5, 5, 5}));
    room.Place("lamp " + std::to_string(i), Quad({-1, kHeight - 0.01, z}, {2, 0, 0}, {0, 0, 4}), lamp);
  }
  return room.Take();
}

SceneDescription CausticRoom() {
  RoomBuilder room("caustic-room");
  room.PlaceWhiteWalls();
  room.PlaceLamp(220, 0.2);
  room.PlaceBall({0, 0.7, 0}, 0.7, room.Add(scenes::Metal("brushed", {0.9, 0.9, 0.9}, 0.2)));
  return room.Take();
}

}  // namespace lumifold::stability
