#include "tests/scenes/interior_parts.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/scenes/noise.h"

namespace lumifold::scenes {
namespace {

/// A frame and its mullion, set back into the wall, and a sill in front.
Mesh WindowFrame(const Window& window) {
  const WallRect& opening = window.opening;
  constexpr double kBar = 0.06, kDepth = 0.07, kSillDepth = 0.16;
  const Vec3 middle = {opening.x + opening.width / 2, opening.y + opening.height / 2, -window.wall_depth};
  Mesh mesh;
  AddMoved(mesh, RectangularFrame({opening.width - 2 * kBar, opening.height - 2 * kBar}, kBar, kDepth),
           {.translation = middle});
  AddBox(mesh, middle + Vec3{0, 0, kDepth / 2}, {kBar, opening.height - 2 * kBar, kDepth});
  AddRoundedBox(mesh, {middle.x, opening.y - 0.02, kSillDepth / 2 - 0.04},
                {opening.width + 0.16, 0.04, kSillDepth + 0.08}, 0.01);
  return mesh;
}

}  // namespace

void PlaceShell(SceneDescription& scene, const Room& room, const Window& window,
                const ShellMaterials& materials) {
  constexpr double kSkirtingHeight = 0.1, kSkirtingDepth = 0.016;
  const Vec3 across = {room.width(), 0, 0}, up = {0, room.height, 0};
  Mesh floor, ceiling;
  AddQuad(floor, {room.left, 0, room.rear}, across, {0, 0, -room.length()});
  AddQuad(ceiling, {room.left, room.height, room.front}, across, {0, 0, room.length()});
  scene.PlaceOnce("floor", {{floor, materials.floor}});
  scene.PlaceOnce("ceiling", {{ceiling, materials.ceiling}});
  const auto skirting = [&](double width) {
    Mesh mesh;
    AddBox(mesh, {width / 2, kSkirtingHeight / 2, kSkirtingDepth / 2},
           {width, kSkirtingHeight, kSkirtingDepth});
    return mesh;
  };
  const Mesh window_wall = WallWithOpening({room.length(), room.height}, window.wall_depth, window.opening);
  scene.PlaceOnce("window wall",
                  {{window_wall, materials.wall},
                   {skirting(room.length()), materials.trim},
                   {WindowFrame(window), materials.window_frame}},
                  room.LeftWall());
  Mesh end, side;
  AddQuad(end, {}, across, up);
  AddQuad(side, {}, {room.length(), 0, 0}, up);
  const MeshId end_wall =
      scene.Add("end wall", {{end, materials.wall}, {skirting(room.width()), materials.trim}});
  scene.Place("front wall", end_wall, room.FrontWall());
  scene.Place("rear wall", end_wall, room.RearWall());
  scene.PlaceOnce("right wall", {{side, materials.wall}, {skirting(room.length()), materials.trim}},
                  room.RightWall());
}

void PlaceDaylight(SceneDescription& scene, const Room& room, const Window& window,
                   const Daylight& daylight) {
  const WallRect& opening = window.opening;
  const double left = opening.x - daylight.margin, bottom = opening.y - daylight.margin;
  const Vec3 across = {opening.width + 2 * daylight.margin, 0, 0};
  const double top = opening.y + opening.height + daylight.margin;
  Mesh sky, ground;
  AddQuad(sky, {left, daylight.horizon, -daylight.distance}, across, {0, top - daylight.horizon, 0});
  AddQuad(ground, {left, bottom, -daylight.distance}, across, {0, daylight.horizon - bottom, 0});
  scene.PlaceOnce("daylight", {{sky, daylight.sky}, {ground, daylight.ground}}, room.LeftWall());
}

Mesh WallWithOpening(Vec2 size, double thickness, const WallRect& opening) {
  Mesh mesh;
  const double right = opening.x + opening.width, top = opening.y + opening.height;
  const auto face = [&](double x0, double y0, double x1, double y1) {
    const std::size_t first = mesh.uvs.size();
    AddQuad(mesh, {x0, y0, 0}, {x1 - x0, 0, 0}, {0, y1 - y0, 0});
    for (std::size_t i = first; i < mesh.uvs.size(); ++i) mesh.uvs[i] = mesh.uvs[i] + Vec2{x0, y0};
  };
  face(0, 0, opening.x, size.y);
  face(right, 0, size.x, size.y);
  face(opening.x, 0, right, opening.y);
  face(opening.x, top, right, size.y);
  const Vec3 inwards = {0, 0, -thickness}, outwards = {0, 0, thickness};
  AddQuad(mesh, {opening.x, opening.y, 0}, {opening.width, 0, 0}, inwards);
  AddQuad(mesh, {opening.x, top, -thickness}, {opening.width, 0, 0}, outwards);
  AddQuad(mesh, {opening.x, opening.y, -thickness}, {0, opening.height, 0}, outwards);
  AddQuad(mesh, {right, opening.y, 0}, {0, opening.height, 0}, inwards);
  for (Vec3& normal : mesh.normals) normal = Normalized(normal);
  return mesh;
}

Mesh RectangularFrame(Vec2 inner, double bar, double depth) {
  Mesh mesh;
  const double edge = std::min(bar, depth) * 0.25;
  for (const double side : {-1.0, 1.0}) {
    AddRoundedBox(mesh, {0, side * (inner.y + bar) / 2, depth / 2}, {inner.x + 2 * bar, bar, depth}, edge);
    AddRoundedBox(mesh, {side * (inner.x + bar) / 2, 0, depth / 2}, {bar, inner.y, depth}, edge);
  }
  return mesh;
}

Mesh UprightRect(Vec2 size) {
  Mesh mesh;
  AddQuad(mesh, {-size.x / 2, -size.y / 2, 0}, {size.x, 0, 0}, {0, size.y, 0});
  return mesh;
}

DoorMeshes PanelledDoor(Vec2 size) {
  constexpr double kLeafDepth = 0.03, kPanelMargin = 0.13;
  DoorMeshes door;
  AddBox(door.leaf, {0, size.y / 2, 0}, {size.x, size.y, kLeafDepth});
  const double panel_width = size.x - 2 * kPanelMargin;
  const double panel_height = (size.y - 3 * kPanelMargin) / 2;
  for (const double bottom : {kPanelMargin, 2 * kPanelMargin + panel_height}) {
    AddMoved(door.leaf, RectangularFrame({panel_width - 0.06, panel_height - 0.06}, 0.03, 0.014),
             {.translation = {0, bottom + panel_height / 2, kLeafDepth / 2}});
  }
  constexpr double kBar = 0.09;
  for (const double side : {-1.0, 1.0}) {
    AddRoundedBox(door.frame, {side * (size.x + kBar) / 2, (size.y + kBar) / 2, 0.02},
                  {kBar, size.y + kBar, 0.08}, 0.01);
  }
  AddRoundedBox(door.frame, {0, size.y + kBar / 2, 0.02}, {size.x, kBar, 0.08}, 0.01);
  const double x = -size.x / 2 + 0.07;
  const Vec3 path[] = {{x, 1.02, 0.01}, {x, 1.02, 0.055}, {x + 0.015, 1.02, 0.07}, {x + 0.12, 1.02, 0.07}};
  AddTube(door.handle, path, 0.011, 12);
  AddSphere(door.handle, path[3], 0.011, 12);
  return door;
}

Mesh Curtain(Vec2 size, int folds, double depth, unsigned seed) {
  Mesh mesh;
  AddSurface(mesh, folds * 14, 24, size, [&](double u, double v) {
    const double drop = 1 - v;
    // Folds are regular at the rail and irregular further down.
    const double wander = 1.1 * (Fbm({u * 4, drop * 1.5}, 2, seed) - 0.5) * drop;
    const double phase = 2 * std::numbers::pi * (u * folds + wander);
    const double strength =
        depth / 2 * (0.45 + 0.55 * std::sqrt(drop)) * (0.7 + 0.6 * ValueNoise({u * folds, 0}, seed + 5));
    const double sway = 0.03 * size.x * (Fbm({u * 3, drop * 2}, 2, seed + 9) - 0.5) * drop;
    return Vec3{(u - 0.5) * size.x + sway + 0.12 * strength * std::sin(2 * phase), -drop * size.y,
                strength * std::sin(phase)};
  });
  return mesh;
}

Mesh LeafTuft(int leaves, double height, unsigned seed) {
  Mesh mesh;
  for (int i = 0; i < leaves; ++i) {
    const double turn = 137.508 * i + 20 * HashNoise(i, 1, seed);
    const double reach = height * Mix(0.25, 0.95, HashNoise(i, 2, seed));
    const double rise = height * Mix(0.65, 1.15, HashNoise(i, 3, seed));
    const double width = 0.11 * height * Mix(0.7, 1.2, HashNoise(i, 4, seed));
    Mesh leaf;
    AddSurface(leaf, 2, 10, {width, height}, [&](double u, double v) {
      const double half_width = width / 2 * 4 * v * (1 - v) * (1.25 - 0.5 * v) + 0.002;
      const double across = (2 * u - 1) * half_width;
      const double trough = 0.35 * std::fabs(across);
      return Vec3{across, rise * v * (1.55 - 0.75 * v) + trough, reach * v * v};
    });
    AddMoved(mesh, leaf, {.rotation = Rotation::Yaw(turn)});
  }
  return mesh;
}

}  // namespace lumifold::scenes
