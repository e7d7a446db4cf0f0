#include "server/job/tile_grid.h"

#include <algorithm>
#include <cstdlib>

#include "filter/image/check.h"
#include "server/job/plan.h"

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

int TileGrid::CountWithin(int radius) const {
  if (radius < 0) return 0;
  const int width = std::min(CentreX() + radius, columns_ - 1) - std::max(CentreX() - radius, 0) + 1;
  const int height = std::min(CentreY() + radius, rows_ - 1) - std::max(CentreY() - radius, 0) + 1;
  return width * height;
}

std::array<TileGrid::Side, 4> TileGrid::Ring(int radius) const {
  if (radius == 0) return {{{CentreX(), CentreY(), 1, 0, 1}, {}, {}, {}}};
  const int left = CentreX() - radius;
  const int right = CentreX() + radius;
  const int top = CentreY() - radius;
  const int bottom = CentreY() + radius;
  const int x0 = std::max(left, 0);
  const int x1 = std::min(right, columns_ - 1);
  const int y0 = std::max(top + 1, 0);  // between the corners, which belong to the rows
  const int y1 = std::min(bottom - 1, rows_ - 1);
  return {{{x0, top, 1, 0, top >= 0 ? x1 - x0 + 1 : 0},
           {right, y0, 0, 1, right < columns_ ? y1 - y0 + 1 : 0},
           {x1, bottom, -1, 0, bottom < rows_ ? x1 - x0 + 1 : 0},
           {left, y1, 0, -1, left >= 0 ? y1 - y0 + 1 : 0}}};
}

int TileGrid::RankOf(int tile) const {
  LUMIFOLD_CHECK(tile >= 0 && tile < count());
  const int x = tile % columns_;
  const int y = tile / columns_;
  const int radius = std::max(std::abs(x - CentreX()), std::abs(y - CentreY()));
  int rank = CountWithin(radius - 1);
  for (const Side& side : Ring(radius)) {
    const int step = (x - side.x) * side.dx + (y - side.y) * side.dy;
    const bool on_line = side.x + step * side.dx == x && side.y + step * side.dy == y;
    if (on_line && step >= 0 && step < side.length) return rank + step;
    rank += side.length;
  }
  LUMIFOLD_CHECK(false);
  return -1;
}

int TileGrid::TileOfRank(int rank) const {
  LUMIFOLD_CHECK(rank >= 0 && rank < count());
  int low = 0;
  int high = std::max(columns_, rows_);
  while (low < high) {  // the first radius within which there are more than `rank` tiles
    const int middle = (low + high) / 2;
    if (CountWithin(middle) > rank) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  int step = rank - CountWithin(low - 1);
  for (const Side& side : Ring(low)) {
    if (step < side.length) return (side.y + step * side.dy) * columns_ + side.x + step * side.dx;
    step -= side.length;
  }
  LUMIFOLD_CHECK(false);
  return -1;
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

namespace {

/// Of a pass before those of pass_samples; 0 where there is none.
int FirstPassSamplesOf(const v1::JobSpec& spec) {
  const int samples = spec.first_pass_samples();
  return samples < std::min(spec.pass_samples(), spec.samples_per_pixel()) ? samples : 0;
}

int PassCountOf(const v1::JobSpec& spec) {
  if (NeedsPlan(spec)) return 0;
  if (spec.has_adaptive()) return kMaxRounds;
  return CeilDivide(spec.samples_per_pixel(), spec.pass_samples()) + (FirstPassSamplesOf(spec) > 0 ? 1 : 0);
}

}  // namespace

FrameUnits::FrameUnits(const v1::JobSpec& spec)
    : first_kind_(NeedsPlan(spec) ? v1::UNIT_KIND_PLAN : v1::UNIT_KIND_GEOMETRY),
      tiles_(spec.width(), spec.height(),
             NeedsPlan(spec) ? std::max(spec.width(), spec.height()) : spec.tile_size()),
      tile_of_rank_(spec.plan().tile_order().begin(), spec.plan().tile_order().end()),
      rank_of_tile_(tile_of_rank_.size()),
      samples_per_pixel_(spec.samples_per_pixel()),
      pass_samples_(spec.pass_samples()),
      first_pass_samples_(FirstPassSamplesOf(spec)),
      pass_count_(PassCountOf(spec)),
      is_adaptive_(spec.has_adaptive()) {
  LUMIFOLD_CHECK(tile_of_rank_.empty() || tile_of_rank_.size() == static_cast<size_t>(tiles_.count()));
  for (size_t rank = 0; rank < tile_of_rank_.size(); ++rank) {
    const int32_t tile = tile_of_rank_[rank];
    LUMIFOLD_CHECK(tile >= 0 && tile < tiles_.count());
    rank_of_tile_[static_cast<size_t>(tile)] = static_cast<int32_t>(rank);
  }
}

int FrameUnits::RankOf(int tile) const {
  return rank_of_tile_.empty() ? tiles_.RankOf(tile) : rank_of_tile_[static_cast<size_t>(tile)];
}

int FrameUnits::TileOfRank(int rank) const {
  return tile_of_rank_.empty() ? tiles_.TileOfRank(rank) : tile_of_rank_[static_cast<size_t>(rank)];
}

std::optional<int64_t> FrameUnits::NumberOf(const UnitKey& key) const {
  if (key.tile < 0 || key.tile >= tiles_.count()) return std::nullopt;
  const bool is_first_kind = key.kind == first_kind_;
  if (is_first_kind && pass_count_ == 0) return key.pass == 0 ? std::optional<int64_t>(0) : std::nullopt;
  const int passes = is_first_kind ? 1 : pass_count_;
  if ((!is_first_kind && key.kind != v1::UNIT_KIND_PASS) || key.pass < 0 || key.pass >= passes)
    return std::nullopt;
  if (key.pass == 0) return 2 * int64_t{tiles_.RankOf(key.tile)} + (is_first_kind ? 0 : 1);
  return int64_t{tiles_.count()} * (1 + key.pass) + RankOf(key.tile);
}

UnitKey FrameUnits::KeyOf(int32_t frame, int64_t number) const {
  LUMIFOLD_CHECK(number >= 0 && number < count());
  if (pass_count_ == 0) return {frame, 0, 0, first_kind_};
  if (number < 2 * int64_t{tiles_.count()})
    return {frame, tiles_.TileOfRank(static_cast<int>(number / 2)), 0, KindOf(number)};
  const int32_t tile = TileOfRank(static_cast<int>(number % tiles_.count()));
  return {frame, tile, static_cast<int32_t>(number / tiles_.count()) - 1, v1::UNIT_KIND_PASS};
}

int FrameUnits::FirstSampleOf(int pass) const {
  if (first_pass_samples_ == 0) return std::min(pass * pass_samples_, samples_per_pixel_);
  return pass == 1 ? first_pass_samples_
                   : std::min(std::max(pass - 1, 0) * pass_samples_, samples_per_pixel_);
}

SampleRange FrameUnits::SamplesOf(const UnitKey& key) const {
  if (key.kind != v1::UNIT_KIND_PASS || is_adaptive_) return {};
  return {static_cast<uint32_t>(FirstSampleOf(key.pass)), static_cast<uint32_t>(FirstSampleOf(key.pass + 1))};
}

int64_t FrameUnits::CameraSamplesOf(const UnitKey& key) const {
  const Rect rect = tiles_.RectOf(key.tile);
  return int64_t{rect.width()} * rect.height() * SamplesOf(key).count();
}

}  // namespace lumifold::job
