#pragma once

#include <functional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/rect.h"

namespace lumifold {

/// A film that need not be in memory whole: it gives any part of itself. Threads: one at a time.
class FilmSource {
 public:
  virtual ~FilmSource() = default;

  virtual int width() const = 0;
  virtual int height() const = 0;

  /// The part of the film inside `rect`, which lies within it: all its channels there, and the edge set of
  /// the pixels there, which counts its places from the corner of `rect`. Cheapest where `rect` moves from
  /// left to right and then downwards.
  virtual absl::StatusOr<EdgedImage> Read(const Rect& rect) = 0;
};

/// Takes the rows of a picture in order from the top, some at a time: `rows` has the picture's width.
using RowSink = std::function<absl::Status(const LayeredImage& rows)>;

/// A film in memory, which somebody else keeps. `edges` may be null.
class FilmInMemory final : public FilmSource {
 public:
  explicit FilmInMemory(const LayeredImage& film, const LayeredImage* edges = nullptr)
      : film_(film), edges_(edges) {}

  int width() const override { return film_.width(); }
  int height() const override { return film_.height(); }
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  const LayeredImage& film_;
  const LayeredImage* edges_;
};

}  // namespace lumifold
