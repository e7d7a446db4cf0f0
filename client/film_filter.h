#pragma once

#include <array>
#include <functional>
#include <string>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"

namespace lumifold::client {

/// Filters a film and its edges (channels of filter/image/layers.h) by the method of that name, on so many
/// threads. A film without halves is given some, made from its one picture. The program passes it in, so that
/// the client library does not link the filter. Errors: those of filter::FilterFilm.
using FilmFilter = std::function<absl::StatusOr<std::array<Plane, 3>>(
    EdgedImage* film, const std::string& method, int threads)>;

}  // namespace lumifold::client
