#pragma once

#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Generates the tangents of `mesh` for its normal texture, as MikkTSpace defines them (Mikkelsen,
/// "Simulation of Wrinkled Surfaces Revisited", 2008). Triangle corners that share position, normal and
/// texture coordinate and are connected by edges of one orientation get one tangent: the mean of their
/// triangles' tangents weighted by the angle at the corner, perpendicular to the normal. Handedness is
/// glTF's: the bitangent points up in the picture, towards smaller v. Vertices are split where tangents
/// differ; a mesh without normals gets three vertices for each triangle. Does nothing if the texture's UV set
/// is missing. `normal_texture` also gives the transform of its texture coordinates.
void GenerateTangents(const TextureRef& normal_texture, Mesh* mesh);

}  // namespace lumifold::scene
