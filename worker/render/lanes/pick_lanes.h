#pragma once

#include <cstddef>

#include "worker/render/lights/light_tree.h"

namespace lumifold::render {

struct VertexLanes;

/// Sets ChoiceLanes::slot and ChoiceLanes::probability of the first `count` paths to what LightTree::Pick()
/// returns for a tree of one leaf, an opaque surface and the vertex's first random number over `share`. Whole
/// vectors are read and written. The bits are those of Pick(), whatever the instruction set and the other
/// paths.
void PickLanes(const LightLeaf& leaf, float share, size_t count, VertexLanes* lanes);

}  // namespace lumifold::render
