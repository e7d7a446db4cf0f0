#include "tests/scenes/textures.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "tests/scenes/noise.h"

namespace lumifold::scenes {
namespace {

/// Paints pixel centres; u grows to the right, v downwards, both in [0, 1).
Texture Paint(const char* name, int width, int height, const std::function<Vec3(double u, double v)>& color) {
  Texture texture{.name = name, .width = width, .height = height};
  texture.rgb.reserve(std::size_t{3} * width * height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Vec3 c = color((x + 0.5) / width, (y + 0.5) / height);
      for (const double value : {c.x, c.y, c.z}) {
        texture.rgb.push_back(static_cast<std::uint8_t>(std::floor(Clamp01(value) * 255 + 0.5)));
      }
    }
  }
  return texture;
}

double Fraction(double x) { return x - std::floor(x); }

/// 0 at whole numbers, 1 half-way between: a triangle wave.
double Zigzag(double x) { return 1 - std::fabs(2 * Fraction(x) - 1); }

/// 1 inside the middle of a cell, 0 on its rim; `rim` as a part of the cell.
double InsideCell(double fraction, double rim) {
  return SmoothStep(0, rim, fraction) * SmoothStep(0, rim, 1 - fraction);
}

/// Grain along u: stretched noise bent into rings. `period` is in noise cells.
Vec3 Grain(const WoodColors& colors, Vec2 p, Vec2 period, unsigned seed) {
  const double warp = Fbm(p, 3, seed, period);
  const double rings = Zigzag(warp * 5);
  const double fibre = Fbm({p.x * 2, p.y * 8}, 3, seed + 11, {period.x * 2, period.y * 8});
  return Mix(colors.light, colors.dark, Clamp01(0.55 * rings * rings + 0.55 * fibre - 0.1));
}

struct Cell {
  int row = 0;
  int column = 0;
  Vec2 inside;
};

/// Running bond: `columns` x `rows` pieces, every row shifted against the one before by `shift` of a piece.
Cell BondCell(double u, double v, int columns, int rows, double shift) {
  const double y = v * rows;
  const int row = static_cast<int>(y);
  const double x = u * columns + row * shift;
  const int column = static_cast<int>(std::floor(x)) % columns;
  return {row, column, {Fraction(x), Fraction(y)}};
}

/// An ornament made of leaf shapes about the middle of the unit cell: 1 on the leaves.
double LeafOrnament(Vec2 p) {
  const double x = std::fabs(p.x - 0.5) * 2;
  const double y = p.y * 2 - 1;
  double shape = 0;
  const auto leaf = [&](double cx, double cy, double half_width, double half_height, double lean) {
    const double dx = (x - cx - lean * (y - cy)) / half_width, dy = (y - cy) / half_height;
    shape = std::max(shape, SmoothStep(1.05, 0.9, dx * dx + std::fabs(dy)));
  };
  leaf(0, -0.25, 0.22, 0.6, 0);
  leaf(0.36, -0.02, 0.17, 0.45, -0.5);
  leaf(0.58, 0.3, 0.13, 0.32, -0.9);
  leaf(0.22, 0.52, 0.11, 0.3, 0.6);
  leaf(0, 0.75, 0.09, 0.22, 0);
  return shape;
}

}  // namespace

Texture WoodBoards(const WoodColors& colors) {
  return Paint("wood boards", 512, 512, [&](double u, double v) {
    const Cell board = BondCell(u, v, 2, 8, 0.37 * 2);
    const unsigned seed = static_cast<unsigned>(board.row * 7 + board.column * 131);
    const double tint = 0.82 + 0.34 * HashNoise(board.row, board.column, 5);
    const Vec3 wood = Grain(colors, {board.inside.x * 4, board.inside.y * 4}, {}, 40 + seed);
    const double gap = InsideCell(board.inside.y, 0.05) * InsideCell(board.inside.x, 0.006);
    return wood * tint * Mix(0.35, 1, gap);
  });
}

Texture WoodGrain(const WoodColors& colors) {
  return Paint("wood grain", 512, 256,
               [&](double u, double v) { return Grain(colors, {u * 3, v * 6}, {3, 6}, 77); });
}

Texture Wallpaper(Vec3 ground, Vec3 stripe, Vec3 ornament) {
  return Paint("wallpaper", 256, 256, [&](double u, double v) {
    const double paper = 0.97 + 0.06 * ValueNoise({u * 128, v * 128}, 3, {128, 128});
    const bool wide = u < 0.5;
    const double edge = InsideCell(Fraction(u * 2), 0.03);
    Vec3 color = Mix(ornament, wide ? ground : stripe, Mix(0.35, 1, edge));
    // Two ornaments a repeat, on the wide stripe.
    if (wide) color = Mix(color, ornament, 0.75 * LeafOrnament({u * 2, Fraction(v * 2)}));
    return color * paper;
  });
}

Texture Carpet(Vec3 color) {
  return Paint("carpet", 256, 256, [&](double u, double v) {
    const bool turned = (u < 0.5) != (v < 0.5);
    const Vec2 p = turned ? Vec2{v, u} : Vec2{u, v};
    const double pile = HashNoise(static_cast<int>(u * 256), static_cast<int>(v * 256), 9);
    const double rows = Zigzag(p.x * 32);
    const double wear = Fbm({u * 8, v * 8}, 3, 21, {8, 8});
    return color * (0.72 + 0.22 * pile + 0.16 * rows + 0.16 * wear) * (turned ? 0.93 : 1.0);
  });
}

Texture Rug() {
  constexpr Vec3 kRed = {0.50, 0.12, 0.11}, kNavy = {0.11, 0.15, 0.28}, kCream = {0.83, 0.74, 0.58};
  return Paint("rug", 512, 384, [&](double u, double v) {
    const double x = u * 4, y = v * 3;
    const double rim = std::min({x, 4 - x, y, 3 - y});
    const double pile = 0.86 + 0.28 * HashNoise(static_cast<int>(u * 512), static_cast<int>(v * 384), 4);
    Vec3 color = kRed;
    const auto diamond = [](double px, double py) { return std::fabs(px) + std::fabs(py); };
    if (rim < 0.08) {
      color = kCream;
    } else if (rim < 0.5) {
      color = diamond(Fraction(x * 4) - 0.5, Fraction(y * 4) - 0.5) < 0.3 ? kCream : kNavy;
    } else if (rim < 0.57) {
      color = kCream;
    } else {
      const double medallion = diamond((x - 2) / 1.25, (y - 1.5) / 0.85);
      const double small = diamond(Fraction(x * 2) - 0.5, Fraction(y * 2) - 0.5);
      if (medallion < 1) color = medallion > 0.93 ? kCream : medallion > 0.55 ? kNavy : kRed;
      if (medallion < 0.5) color = medallion > 0.42 ? kCream : kRed;
      if (medallion >= 1 && small < 0.2) color = small < 0.1 ? kCream : kNavy;
    }
    return color * pile;
  });
}

Texture StoneBlocks(Vec3 color) {
  return Paint("stone blocks", 512, 512, [&](double u, double v) {
    const Cell block = BondCell(u, v, 4, 8, 0.5);
    const double tint = 0.88 + 0.2 * HashNoise(block.column, block.row, 31);
    const double warmth = 0.04 * (HashNoise(block.column, block.row, 32) - 0.5);
    const double rough = Fbm({u * 16, v * 16}, 5, 33, {16, 16});
    const double joint = InsideCell(block.inside.x, 0.035) * InsideCell(block.inside.y, 0.07);
    const Vec3 stone = (color + Vec3{warmth, 0, -warmth}) * tint * (0.78 + 0.44 * rough);
    return Mix(color * 0.62, stone, joint);
  });
}

Texture StoneSlabs(Vec3 first, Vec3 second) {
  return Paint("stone slabs", 512, 512, [&](double u, double v) {
    const Cell slab = BondCell(u, v, 4, 4, 0);
    const Vec3 color = (slab.row + slab.column) % 2 == 0 ? first : second;
    const double tint = 0.9 + 0.2 * HashNoise(slab.column, slab.row, 51);
    const double cloud = Fbm({u * 8, v * 8}, 5, 52, {8, 8});
    const double vein = Zigzag(Fbm({u * 4 + slab.column, v * 4 + slab.row}, 4, 53) * 4);
    const double joint = InsideCell(slab.inside.x, 0.025) * InsideCell(slab.inside.y, 0.025);
    return color * tint * (0.8 + 0.3 * cloud + 0.1 * vein) * Mix(0.55, 1, joint);
  });
}

Texture Landscape() {
  return Paint("landscape", 512, 384, [](double u, double v) {
    const auto scenery = [](double x, double y) {
      Vec3 color = Mix(Vec3{0.36, 0.52, 0.78}, Vec3{1.0, 0.80, 0.50}, SmoothStep(0, 0.5, y));
      const double cloud = Fbm({x * 5, y * 16}, 5, 61);
      color = Mix(color, {0.98, 0.86, 0.74}, SmoothStep(0.5, 0.75, cloud) * 0.8);
      const double sun = Length(Vec2{(x - 0.68) * 1.33, y - 0.4});
      color =
          Mix(color, {1, 0.93, 0.7}, std::max(SmoothStep(0.06, 0.05, sun), 0.5 * SmoothStep(0.3, 0, sun)));
      for (int ridge = 0; ridge < 4; ++ridge) {
        const double crest = 0.42 + 0.06 * ridge - 0.16 * (Fbm({x * (3 + ridge), 0.5}, 5, 70 + ridge) - 0.35);
        const Vec3 haze = Mix(Vec3{0.62, 0.56, 0.66}, Vec3{0.16, 0.30, 0.20}, ridge / 3.0);
        color = Mix(color, haze, SmoothStep(crest, crest + 0.006, y));
      }
      return color;
    };
    constexpr double kShore = 0.66;
    if (v < kShore) return scenery(u, v);
    const double ripple = Fbm({u * 12, v * 80}, 3, 81) - 0.5;
    const Vec3 mirrored = scenery(u + 0.02 * ripple, kShore - (v - kShore) * 1.4 + 0.03 * ripple);
    return mirrored * 0.8 + Vec3{0.0, 0.02, 0.05};
  });
}

Texture BotanicalPrint() {
  return Paint("botanical print", 256, 384, [](double u, double v) {
    const Vec3 paper = Vec3{0.93, 0.90, 0.82} * (0.96 + 0.06 * Fbm({u * 20, v * 30}, 3, 85));
    const double mount = std::min({u, 1 - u, (v * 1.5), 1.5 - v * 1.5});
    if (mount < 0.12) return Vec3{0.96, 0.96, 0.95};
    const double stem =
        SmoothStep(0.008, 0.004, std::fabs(u - 0.5)) * SmoothStep(0.18, 0.2, v) * SmoothStep(0.86, 0.84, v);
    double plant = stem;
    for (int pair = 0; pair < 6; ++pair) {
      const double reach = 0.26 - 0.03 * pair, rise = 0.78 - 0.11 * pair;
      const double x = std::fabs(u - 0.5) / reach;
      const double bend = (v - rise + 0.14 * x) / (0.035 * (1.1 - x));
      if (x < 1) plant = std::max(plant, SmoothStep(1.05, 0.9, bend * bend + 0.3 * x));
    }
    const double shade = 0.7 + 0.5 * Fbm({u * 14, v * 40}, 3, 86);
    return Mix(paper, Vec3{0.22, 0.36, 0.18} * shade, plant);
  });
}

Texture StripedCloth(Vec3 ground, Vec3 stripe) {
  return Paint("striped cloth", 256, 256, [&](double u, double v) {
    const double weave = 0.93 + 0.1 * HashNoise(static_cast<int>(u * 256), static_cast<int>(v * 256), 91);
    const double wide = SmoothStep(0.30, 0.31, v) * SmoothStep(0.55, 0.54, v);
    const double thin = SmoothStep(0.60, 0.605, v) * SmoothStep(0.64, 0.635, v) +
                        SmoothStep(0.21, 0.215, v) * SmoothStep(0.25, 0.245, v);
    return Mix(ground, stripe, wide + thin) * weave;
  });
}

Texture PrintedPage() {
  return Paint("printed page", 256, 362, [](double u, double v) {
    constexpr Vec3 kPaper = {0.93, 0.93, 0.91}, kInk = {0.15, 0.15, 0.2};
    if (u < 0.1 || u > 0.9 || v < 0.06 || v > 0.92) return kPaper;
    const int line = static_cast<int>(v * 44);
    const double height = Fraction(v * 44);
    const double line_end = 0.6 + 0.3 * HashNoise(line, 0, 95);
    const bool paragraph_gap = line % 9 == 7;
    const bool letter = HashNoise(static_cast<int>(u * 90), line, 96) < 0.78;
    return !paragraph_gap && letter && height > 0.25 && height < 0.7 && u < line_end ? kInk : kPaper;
  });
}

}  // namespace lumifold::scenes
