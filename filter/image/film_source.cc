#include "filter/image/film_source.h"

namespace lumifold {

absl::StatusOr<EdgedImage> FilmInMemory::Read(const Rect& rect) {
  EdgedImage part{film_.Crop(rect)};
  if (edges_ != nullptr) part.edges = EdgesInside(*edges_, rect);
  if (fragments_ != nullptr) part.fragments = EdgesInside(*fragments_, rect);
  return part;
}

absl::StatusOr<EdgedImage> TimedFilm::Read(const Rect& rect) {
  if (absl::Status status = before_(); !status.ok()) return status;
  absl::StatusOr<EdgedImage> part = film_.Read(rect);
  after_();
  return part;
}

}  // namespace lumifold
