#pragma once

#include <string>
#include <vector>

#include "tests/support/gltf_fixture.h"

namespace lumifold::scene {

/// A document with images, texture transforms, quantised normals, instancing and a camera.
GltfFixture FurnishedDocument();

/// A bar of two joints, each a node: bound at rest along +Y, its upper half turned a quarter about +Z between
/// 0 and 1 second. Vertices 0, 1 belong to the lower joint, 2, 3 to the upper one.
GltfFixture SkinnedDocument();

/// A triangle with two morph targets that move vertex 1 along +X and vertex 2 along +Y by 1, weights (0, 0)
/// at 0 s and (1, 0.5) at 2 s.
GltfFixture MorphedDocument();

/// A square compressed with Draco; `edgebreaker`: by that method, else sequentially.
GltfFixture DracoDocument(bool edgebreaker);

/// One light of each kind, a coated and a sheeny material.
GltfFixture LitDocument();

struct NamedDocument {
  std::string name;
  GltfFixture fixture;
};

/// All of the above: what the damage tests and the fuzz target start from.
std::vector<NamedDocument> SampleDocuments();

}  // namespace lumifold::scene
