#include "client/local/film_filter.h"

#include <memory>

#include "filter/image/layers.h"
#include "filter/manifold/single_picture.h"
#include "filter/methods.h"

namespace lumifold::local {

absl::StatusOr<std::array<Plane, 3>> FilterFilm(EdgedImage* film, const std::string& method, int threads) {
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(threads);
  if (!film->pixels.Has(layers::kSamplesA)) filter::SplitIntoHalves(&film->pixels, pool.get());
  return filter::FilterFilm(film->pixels, method, pool.get(), &film->edges);
}

}  // namespace lumifold::local
