#pragma once

#include "tests/scenes/mesh_builder.h"

namespace lumifold::scenes {

// Parts that the furnished rooms share. Parts on a wall use the wall's frame: x to the right and y up as seen
// from inside the room, z = 0 on the wall's face, +z into the room.

/// A rectangle on a wall, by its lower left corner.
struct WallRect {
  double x = 0, y = 0, width = 0, height = 0;
};

/// The world transform of a part on a wall.
inline Transform OnWall(const Transform& wall, Vec3 place) {
  return {wall.Point(place), wall.rotation, wall.scale};
}

/// The inside of an axis-parallel room with its floor at y = 0. The left wall has the window.
struct Room {
  double left, right, front, rear, height;

  double width() const { return right - left; }
  double length() const { return rear - front; }
  /// The frames of the walls: x = 0 is each wall's left end as seen from inside.
  Transform LeftWall() const { return {{left, 0, rear}, Rotation::Yaw(90)}; }
  Transform FrontWall() const { return {{left, 0, front}}; }
  Transform RightWall() const { return {{right, 0, front}, Rotation::Yaw(-90)}; }
  Transform RearWall() const { return {{right, 0, rear}, Rotation::Yaw(180)}; }
};

/// An opening in the left wall, in that wall's frame.
struct Window {
  WallRect opening;
  double wall_depth;
};

struct ShellMaterials {
  MaterialId floor, ceiling, wall, trim, window_frame;
};

/// Floor, ceiling, the four walls with skirting, and the window's frame and sill.
void PlaceShell(SceneDescription& scene, const Room& room, const Window& window,
                const ShellMaterials& materials);

/// Two vertical emitters outside the window that meet at the horizon. They are close to the window and hardly
/// larger than it, so that few light samples are occluded by the wall.
struct Daylight {
  double distance, margin, horizon;
  MaterialId sky, ground;
};
void PlaceDaylight(SceneDescription& scene, const Room& room, const Window& window, const Daylight& daylight);

/// A wall from x = 0 that is `thickness` deep, with a rectangular opening through it.
Mesh WallWithOpening(Vec2 size, double thickness, const WallRect& opening);

/// Four mitre-free bars around the rectangle of `inner` size centred on the origin, `bar` wide, z in [0,
/// depth].
Mesh RectangularFrame(Vec2 inner, double bar, double depth);

/// A vertical rectangle centred on the origin that faces +z.
Mesh UprightRect(Vec2 size);

/// A panelled door leaf, its frame and its handle, standing on y = 0 and centred on x = 0.
struct DoorMeshes {
  Mesh leaf, frame, handle;
};
DoorMeshes PanelledDoor(Vec2 size);

/// The curtain of a rail at y = 0: `width` wide along x, hanging down `height` in `folds` folds of `depth`.
/// A thin sheet: give it a double-sided material.
Mesh Curtain(Vec2 size, int folds, double depth, unsigned seed);

/// Thin arched leaves that rise from the origin to about `height`: give them a double-sided material.
Mesh LeafTuft(int leaves, double height, unsigned seed);

}  // namespace lumifold::scenes
