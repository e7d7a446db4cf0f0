#pragma once

#include <functional>
#include <span>
#include <vector>

#include "tests/scenes/scene_description.h"

namespace lumifold::scenes {

// Each function appends a shape to `mesh`. Lengths are metres; fronts face outwards.

/// The parallelogram corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v; its front looks
/// along edge_u x edge_v. Texture coordinates start at the corner.
void AddQuad(Mesh& mesh, Vec3 corner, Vec3 edge_u, Vec3 edge_v);

/// A flat four-sided polygon given counter-clockwise as seen from its front.
void AddFlatPolygon(Mesh& mesh, std::span<const Vec3> corners);

/// An axis-parallel box with hard edges.
void AddBox(Mesh& mesh, Vec3 center, Vec3 size);

/// A box whose edges are rounded with `radius` (at most half the smallest side), `steps` per eighth of a
/// turn.
void AddRoundedBox(Mesh& mesh, Vec3 center, Vec3 size, double radius, int steps = 2);

/// The image of the unit square under `point`, on a grid of columns x rows cells, with smooth normals that
/// look along d/du x d/dv. Places where the surface touches itself (a seam, a pole) share one normal.
/// `uv_size` is the extent of the texture coordinates in metres.
void AddSurface(Mesh& mesh, int columns, int rows, Vec2 uv_size,
                const std::function<Vec3(double u, double v)>& point);

/// Turns `profile`, pairs of (radius, height) from bottom to top on the outer side, about the vertical
/// through `base`. A point given twice makes a hard edge; otherwise normals are smooth.
void AddLathe(Mesh& mesh, Vec3 base, std::span<const Vec2> profile, int segments);

/// A closed upright cylinder, or cone if the radii differ, standing on `base`.
void AddCylinder(Mesh& mesh, Vec3 base, double bottom_radius, double top_radius, double height, int segments);

void AddSphere(Mesh& mesh, Vec3 center, double radius, int segments);

/// A round rod along `path`, open at its ends, bent smoothly at the inner points.
void AddTube(Mesh& mesh, std::span<const Vec3> path, double radius, int segments);

/// The path with its inner corners cut by arcs that start `radius` before each corner.
std::vector<Vec3> RoundedPath(std::span<const Vec3> corners, double radius);

/// A wall with a round-arched opening that reaches down to y = 0: from x = -width / 2 to width / 2, up to
/// `height`, centred on z = 0. The opening is 2 * radius wide and its arch starts at `spring_height`.
struct ArchShape {
  double width, height, thickness, radius, spring_height;
  int segments = 24;
};
void AddArchWall(Mesh& mesh, const ArchShape& arch);

/// A cushion lying on y = 0 around the origin: puffed in the middle, pinched towards the corners.
void AddCushion(Mesh& mesh, Vec3 size, unsigned seed);

/// Appends a moved copy of `part`.
void AddMoved(Mesh& mesh, const Mesh& part, const Transform& transform);

}  // namespace lumifold::scenes
