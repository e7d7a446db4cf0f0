#pragma once

#include <string>
#include <vector>

#include "tests/support/gltf_fixture.h"

namespace lumifold::scene {

/// A document with images, texture transforms, quantised normals, instancing and a camera.
GltfFixture FurnishedDocument();

/// A bar of two joints, each a node. Its bind pose is along +Y; its upper half rotates by 90 degrees about +Z
/// between 0 and 1 second. Vertices 0 and 1 belong to the lower joint, 2 and 3 to the upper one.
GltfFixture SkinnedDocument();

/// A triangle with two morph targets that move vertex 1 along +X and vertex 2 along +Y by 1, weights (0, 0)
/// at 0 s and (1, 0.5) at 2 s.
GltfFixture MorphedDocument();

/// A square compressed with Draco; `edgebreaker`: with that method, else sequentially.
GltfFixture DracoDocument(bool edgebreaker);

/// One light of each kind, a material with a clear coat and one with sheen.
GltfFixture LitDocument();

struct NamedDocument {
  std::string name;
  GltfFixture fixture;
};

/// All of the above: the input of the damage tests and the seeds of the fuzz target.
std::vector<NamedDocument> SampleDocuments();

}  // namespace lumifold::scene
