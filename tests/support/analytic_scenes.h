#pragma once

#include <array>

#include "worker/scene/scene.h"

/// Small scenes whose light is known in closed form or bounded.
namespace lumifold::testing {

/// A quad with corners origin, origin + a, origin + a + b, origin + b; its front is the side a x b points to.
scene::Mesh QuadMesh(scene::Vec3 origin, scene::Vec3 a, scene::Vec3 b, int material);

/// A sphere around the origin of 8 * n^2 triangles with smooth normals.
scene::Mesh SphereMesh(float radius, int n, int material);

/// Pure Lambert of the given albedo, without a dielectric layer.
scene::Material Lambert(scene::Vec3 albedo);

/// Emits `radiance` from its front and reflects nothing.
scene::Material Emitter(scene::Vec3 radiance);

/// Adds `mesh` to the scene with the identity transform.
void Place(scene::Scene* scene, scene::Mesh mesh);

/// Places the six inner faces of the box [-h, h]^3, fronts inward, with a material each: floor (-Y), ceiling,
/// back (-Z), front, left (-X), right.
void PlaceBoxInside(scene::Scene* scene, float h, const std::array<int, 6>& materials);

/// A camera at `from` that looks at `to`; up is +Y, or +Z if +Y is the line of sight.
scene::Camera LookAt(scene::Vec3 from, scene::Vec3 to, float yfov);

/// All positions and distances times `factor`.
scene::Scene Scaled(scene::Scene scene, float factor);

/// A white furnace: a sphere of `material` seen from outside, within a large box whose inner faces emit
/// radiance 1. A material that conserves energy is as bright as the background.
scene::Scene Furnace(const scene::Material& material);

/// A closed room with a quad light and diffuse, glossy and mirror objects; fast to render.
scene::Scene SmallRoom();

}  // namespace lumifold::testing
