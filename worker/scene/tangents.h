#pragma once

#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Gives `mesh` the tangents its normal texture is to be read with, as MikkTSpace defines them (Mikkelsen,
/// "Simulation of Wrinkled Surfaces Revisited", 2008): corners that share position, normal and texture
/// coordinate and hang together by edges of one orientation get one tangent, the mean of their triangles'
/// weighted by the angle at the corner, at right angles to the normal. Handedness is glTF's: the bitangent
/// points up in the picture, where v falls. Vertices are split where tangents differ; a mesh without normals
/// gets three vertices a triangle, since each face has its own. Does nothing where the texture's UV set is
/// missing. `normal_texture` also gives the transform of its texture coordinates.
void GenerateTangents(const TextureRef& normal_texture, Mesh* mesh);

}  // namespace lumifold::scene
