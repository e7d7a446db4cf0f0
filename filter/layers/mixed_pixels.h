#pragma once

#include "filter/image/plane.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

/// 1 where what a pixel shows differs from its neighbourhood: pixels of the edge set, or, in another
/// renderer's film, pixels whose normal or distance differs from a neighbour's; diffuse pixels next to them;
/// metals, with a glossy albedo above `mixed_albedo`; and pixels that show a level. 0 elsewhere. W x H.
Plane MixedPixelsOf(const Frame& frame, float mixed_albedo);

/// The part of `mixed` in a box; an empty plane if no pixel of it is mixed.
Plane MixedPart(const Plane& mixed, const Rect& box);

}  // namespace lumifold::filter
