#include "server/job/tile_grid.h"

#include <algorithm>

#include "filter/image/check.h"

namespace lumifold::job {
namespace {

int CeilDivide(int a, int b) { return (a + b - 1) / b; }

}  // namespace

TileGrid::TileGrid(int width, int height, int tile_size)
    : width_(width),
      height_(height),
      tile_size_(tile_size),
      columns_(CeilDivide(width, tile_size)),
      rows_(CeilDivide(height, tile_size)) {
  LUMIFOLD_CHECK(width >= 1 && height >= 1 && tile_size >= 1);
}

Rect TileGrid::RectOf(int tile) const {
  LUMIFOLD_CHECK(tile >= 0 && tile < count());
  const int x0 = tile % columns_ * tile_size_;
  const int y0 = tile / columns_ * tile_size_;
  return {x0, y0, std::min(x0 + tile_size_, width_), std::min(y0 + tile_size_, height_)};
}

std::vector<int32_t> TileGrid::TilesIn(const Rect& rect) const {
  LUMIFOLD_CHECK(!rect.IsEmpty() && Intersect(rect, {0, 0, width_, height_}) == rect);
  std::vector<int32_t> tiles;
  for (int row = rect.y0 / tile_size_; row * tile_size_ < rect.y1; ++row) {
    for (int column = rect.x0 / tile_size_; column * tile_size_ < rect.x1; ++column)
      tiles.push_back(row * columns_ + column);
  }
  return tiles;
}

FrameUnits::FrameUnits(const v1::JobSpec& spec)
    : tiles_(spec.width(), spec.height(), spec.tile_size()),
      samples_per_pixel_(spec.samples_per_pixel()),
      pass_samples_(spec.pass_samples()),
      pass_count_(CeilDivide(spec.samples_per_pixel(), spec.pass_samples())) {}

std::optional<int64_t> FrameUnits::NumberOf(const UnitKey& key) const {
  if (key.tile < 0 || key.tile >= tiles_.count()) return std::nullopt;
  if (key.kind == v1::UNIT_KIND_GEOMETRY) {
    return key.pass == 0 ? std::optional<int64_t>(key.tile) : std::nullopt;
  }
  if (key.kind != v1::UNIT_KIND_PASS || key.pass < 0 || key.pass >= pass_count_) return std::nullopt;
  return int64_t{tiles_.count()} * (1 + key.pass) + key.tile;
}

UnitKey FrameUnits::KeyOf(int32_t frame, int64_t number) const {
  LUMIFOLD_CHECK(number >= 0 && number < count());
  const auto tile = static_cast<int32_t>(number % tiles_.count());
  const auto layer = static_cast<int32_t>(number / tiles_.count());
  if (layer == 0) return {frame, tile, 0, v1::UNIT_KIND_GEOMETRY};
  return {frame, tile, layer - 1, v1::UNIT_KIND_PASS};
}

SampleRange FrameUnits::SamplesOf(const UnitKey& key) const {
  if (key.kind == v1::UNIT_KIND_GEOMETRY) return {};
  const int first = key.pass * pass_samples_;
  return {static_cast<uint32_t>(first),
          static_cast<uint32_t>(std::min(first + pass_samples_, samples_per_pixel_))};
}

int64_t FrameUnits::CameraSamplesOf(const UnitKey& key) const {
  const Rect rect = tiles_.RectOf(key.tile);
  return int64_t{rect.width()} * rect.height() * SamplesOf(key).count();
}

}  // namespace lumifold::job
