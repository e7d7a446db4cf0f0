#pragma once

#include "tests/scenes/scene_description.h"

namespace lumifold::scenes {

/// Encoded colours: sRGB values in [0, 1], as stored in a texture.
struct WoodColors {
  Vec3 light, dark;
};

// All textures tile without a seam unless noted. Each has a fixed size in pixels.

/// A floor of staggered boards along u: 8 boards high, each with a tint and a grain of its own.
Texture WoodBoards(const WoodColors& colors);
/// One broad piece of wood with its grain along u.
Texture WoodGrain(const WoodColors& colors);
/// Vertical stripes with a leaf ornament on every other one.
Texture Wallpaper(Vec3 ground, Vec3 stripe, Vec3 ornament);
/// Carpet tiles with a speckled pile, turned by a quarter from one to the next.
Texture Carpet(Vec3 color);
/// A woven rug with a border and medallions: one picture, not repeating.
Texture Rug();
/// Courses of dressed stone with mortar between them, 8 courses high.
Texture StoneBlocks(Vec3 color);
/// Square slabs, 4 x 4, of two stones in a chequer.
Texture StoneSlabs(Vec3 first, Vec3 second);
/// A landscape of hills by a lake at sunset: one picture, not repeating.
Texture Landscape();
/// A pressed plant on cream paper: one picture, not repeating.
Texture BotanicalPrint();
/// Cloth with woven stripes across v.
Texture StripedCloth(Vec3 ground, Vec3 stripe);
/// Lines of text on paper: one picture, not repeating.
Texture PrintedPage();

}  // namespace lumifold::scenes
