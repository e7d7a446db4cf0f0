#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "filter/metrics/regions.h"
#include "tests/charts/film_source.h"

namespace lumifold::charts {

/// What a picture is judged against.
struct Reference {
  EdgedImage film;
  std::vector<Region> regions;
  RegionMeans noise;  // MSE255 of the reference itself, from its halves; 0 where it has none
  bool has_halves = false;
};

/// Errors: kNotFound where the film has no noisy layer.
absl::StatusOr<Reference> MakeReference(EdgedImage film);

/// A film that is filtered by every method.
struct Subject {
  std::string scene;
  int samples = 0;
  TimedFilm timed;
};

/// One way to filter one film.
struct Row {
  std::string scene;
  int samples = 0;
  std::string method;
  std::string parameters;
  bool is_default = false;  // of the method's own settings
  bool is_best = false;     // of the method's grid on this film
  RegionMeans mse255;       // the reference's noise taken off
  double render_seconds = 0;
  double filter_seconds = 0;
};

/// Filters the film by our methods and by each baseline, with its default and every point of its grid.
/// Errors: those of filter::FilterFilm; kInvalidArgument for a reference of another size.
absl::StatusOr<std::vector<Row>> Measure(const Subject& subject, const Reference& reference, TaskPool* pool);

}  // namespace lumifold::charts
