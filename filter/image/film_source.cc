#include "filter/image/film_source.h"

namespace lumifold {

absl::StatusOr<EdgedImage> FilmInMemory::Read(const Rect& rect) {
  EdgedImage part{film_.Crop(rect), {}};
  if (edges_ != nullptr) part.edges = EdgesInside(*edges_, rect);
  return part;
}

}  // namespace lumifold
