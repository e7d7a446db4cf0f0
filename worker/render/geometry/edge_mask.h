#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <tuple>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/rect.h"

namespace lumifold::render {

/// Which pixels of a rectangle are edge pixels.
class EdgeMask {
 public:
  explicit EdgeMask(const Rect& rect)
      : rect_(rect), bits_(static_cast<size_t>(rect.width()) * static_cast<size_t>(rect.height())) {}

  const Rect& rect() const { return rect_; }
  /// (x, y) is a pixel of the frame inside the rectangle.
  bool Has(int x, int y) const { return bits_[NumberOf(x, y)]; }
  void Set(int x, int y, bool is_edge) { bits_[NumberOf(x, y)] = is_edge; }

 private:
  size_t NumberOf(int x, int y) const {
    return static_cast<size_t>(y - rect_.y0) * static_cast<size_t>(rect_.width()) +
           static_cast<size_t>(x - rect_.x0);
  }

  Rect rect_;
  std::vector<bool> bits_;
};

/// The masks of tiles that were rendered last, for the next passes over them. At most 2 MiB.
/// Threads: safe.
class EdgeMaskCache {
 public:
  /// The mask of a tile; null where it is not kept.
  std::shared_ptr<const EdgeMask> Find(const Rect& rect) const;
  void Keep(std::shared_ptr<const EdgeMask> mask);

 private:
  using Key = std::tuple<int, int, int, int>;
  static Key KeyOf(const Rect& rect) { return {rect.x0, rect.y0, rect.x1, rect.y1}; }

  mutable absl::Mutex mutex_;
  std::map<Key, std::shared_ptr<const EdgeMask>> masks_ ABSL_GUARDED_BY(mutex_);
  std::deque<Key> order_ ABSL_GUARDED_BY(mutex_);  // the oldest first
  int64_t pixels_ ABSL_GUARDED_BY(mutex_) = 0;     // of all masks
};

}  // namespace lumifold::render
