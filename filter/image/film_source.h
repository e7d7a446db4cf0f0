#pragma once

#include <functional>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/rect.h"

namespace lumifold {

/// A film that need not be in memory as a whole: any part of it can be read.
/// Threads: one at a time.
class FilmSource {
 public:
  virtual ~FilmSource() = default;

  virtual int width() const = 0;
  virtual int height() const = 0;

  /// The part of the film inside `rect`, which lies within it: all channels, and the edge set and the
  /// fragments of its pixels, whose pixel coordinates start at the corner of `rect`. Cheapest if `rect` moves
  /// from left to right and then downwards.
  virtual absl::StatusOr<EdgedImage> Read(const Rect& rect) = 0;
};

/// Receives the rows of a picture in order from the top, some at a time: `rows` has the picture's width.
using RowSink = std::function<absl::Status(const LayeredImage& rows)>;

/// A film in memory, which the caller owns. `edges` and `fragments` may be null.
class FilmInMemory final : public FilmSource {
 public:
  explicit FilmInMemory(const LayeredImage& film, const LayeredImage* edges = nullptr,
                        const LayeredImage* fragments = nullptr)
      : film_(film), edges_(edges), fragments_(fragments) {}

  int width() const override { return film_.width(); }
  int height() const override { return film_.height(); }
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  const LayeredImage& film_;
  const LayeredImage* edges_;
  const LayeredImage* fragments_;
};

/// A film whose reads are observed, to measure the time between them or to stop early.
class TimedFilm final : public FilmSource {
 public:
  /// `before` is called ahead of each read; its error is the read's. `after` is called when the read is over.
  TimedFilm(FilmSource* film, std::function<absl::Status()> before, std::function<void()> after)
      : film_(*film), before_(std::move(before)), after_(std::move(after)) {}

  int width() const override { return film_.width(); }
  int height() const override { return film_.height(); }
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  FilmSource& film_;
  std::function<absl::Status()> before_;
  std::function<void()> after_;
};

}  // namespace lumifold
