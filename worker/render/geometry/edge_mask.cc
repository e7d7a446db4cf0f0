#include "worker/render/geometry/edge_mask.h"

#include <utility>

namespace lumifold::render {
namespace {

/// Of all masks together, one bit each: a frame of 4096x4096.
constexpr int64_t kMaxMaskPixels = int64_t{1} << 24;

int64_t PixelsOf(const EdgeMask& mask) { return int64_t{mask.rect().width()} * mask.rect().height(); }

}  // namespace

std::shared_ptr<const EdgeMask> EdgeMaskCache::Find(const Rect& rect) const {
  absl::MutexLock lock(&mutex_);
  const auto found = masks_.find(KeyOf(rect));
  return found == masks_.end() ? nullptr : found->second;
}

void EdgeMaskCache::Keep(std::shared_ptr<const EdgeMask> mask) {
  const Key key = KeyOf(mask->rect());
  const int64_t pixels = PixelsOf(*mask);
  absl::MutexLock lock(&mutex_);
  if (!masks_.emplace(key, std::move(mask)).second) return;
  order_.push_back(key);
  pixels_ += pixels;
  while (pixels_ > kMaxMaskPixels) {
    const auto oldest = masks_.find(order_.front());
    pixels_ -= PixelsOf(*oldest->second);
    masks_.erase(oldest);
    order_.pop_front();
  }
}

}  // namespace lumifold::render
