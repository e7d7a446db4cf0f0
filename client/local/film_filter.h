#pragma once

#include <array>
#include <string>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"

namespace lumifold::local {

/// The client::FilmFilter of the `lumifold` program.
absl::StatusOr<std::array<Plane, 3>> FilterFilm(EdgedImage* film, const std::string& method, int threads);

}  // namespace lumifold::local
