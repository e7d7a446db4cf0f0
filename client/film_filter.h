#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/film_source.h"

namespace lumifold::client {

/// Filters a film (channels of filter/image/layers.h) with `method` on `threads` threads. Passes R G B and
/// the channels named in `passed_on` to `sink`, in bands of rows from the top down. For a film without
/// halves, halves are made from its one picture. The program passes this function in, so that the client
/// library does not link the filter.
/// Errors: those of filter::FilterFilmInRows.
using FilmFilter =
    std::function<absl::Status(FilmSource* film, const std::string& method, int threads,
                               const std::vector<std::string>& passed_on, const RowSink& sink)>;

/// What the commands print about the filter's methods, made from filter::Methods().
struct MethodTexts {
  std::string names;  // "a, b and c"
  std::string table;  // summary, source and parameters of each, for people
  std::string json;   // the same, one JSON object a line
};

}  // namespace lumifold::client
