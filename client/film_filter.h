#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/film_source.h"

namespace lumifold::client {

/// Filters a film (channels of filter/image/layers.h) by the method of that name, on so many threads, and
/// gives R G B and the channels named in `passed_on` to `sink` in rows from the top down. A film without
/// halves is given some, made from its one picture. The program passes it in, so that the client library does
/// not link the filter. Errors: those of filter::FilterFilmInRows.
using FilmFilter =
    std::function<absl::Status(FilmSource* film, const std::string& method, int threads,
                               const std::vector<std::string>& passed_on, const RowSink& sink)>;

}  // namespace lumifold::client
