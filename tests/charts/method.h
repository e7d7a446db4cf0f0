#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/baselines/baseline.h"
#include "filter/image/parallel.h"
#include "tests/charts/film_source.h"
#include "tests/charts/methods/samples/sample_method.h"

namespace lumifold::charts {

/// What methods make their picture of: a film, and where it came from. Not copied: samples point into it.
struct Subject {
  std::string scene;
  const FilmSource* source = nullptr;  // null for a film from a file
  FilmSettings settings;
  TimedFilm timed;
  std::optional<SampleSet> samples;  // traced for the first method that asks

  Subject() = default;
  Subject(const Subject&) = delete;
  Subject& operator=(const Subject&) = delete;
};

/// A picture and the processor seconds its method took beside rendering the film.
struct MadePicture {
  std::array<Plane, 3> picture;
  double seconds = 0;
};

/// A way to make a picture, whoever its author. What cannot run on a subject says so: kUnimplemented.
struct Method {
  std::string name;
  std::string summary;
  std::string source;
  std::vector<filter::BaselineParameter> parameters;
  bool renders = false;             // by itself: the film's own cost is no part of its
  bool grows_with_samples = false;  // its cost, not only the film's
  std::function<absl::StatusOr<MadePicture>(Subject* subject, absl::Span<const float> values, TaskPool* pool)>
      make;
};

/// Ours ("none", "default", "paper"), then the filters of filter/baselines, the methods that need samples one
/// by one, and those that render.
const std::vector<Method>& AllMethods();

/// Those of the given names; all for no name. Errors: kNotFound naming one that there is not.
absl::StatusOr<std::vector<const Method*>> FindMethods(const std::vector<std::string>& names);

/// A number that changes when what the method makes changes: a hash of its default pictures of small films
/// of few samples and, where its cost does not grow with them, of many.
/// Errors: the method's own.
absl::StatusOr<uint64_t> FingerprintOf(const Method& method, const std::string& cache_folder, TaskPool* pool);

}  // namespace lumifold::charts
