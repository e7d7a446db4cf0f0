#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/baselines/method_info.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "tests/charts/films/film_source.h"
#include "tests/charts/methods/samples/sample_method.h"

namespace lumifold::charts {

/// The input of the methods: a film, and where it came from. Not copied, because `samples` points into it.
struct Subject {
  std::string scene;
  const FilmSource* source = nullptr;  // null for a film from a file
  FilmSettings settings;
  RenderedFilm rendered;
  std::optional<SampleSet> samples;  // traced for the first method that needs them

  Subject() = default;
  Subject(const Subject&) = delete;
  Subject& operator=(const Subject&) = delete;
};

/// A picture and the processor seconds of its method, without those of rendering the film.
struct MadePicture {
  Picture picture;
  double seconds = 0;
};

/// The pictures by whose bits a method's change is detected.
enum class Probe {
  kFilm,       // that of the film itself
  kCrop,       // that of the film's middle: for a filter that takes long and whose parameters ignore the size
  kSmallFilms  // those of small films of one scene: for methods that need single samples, or render
};

/// Any method that the charts compare, behind one interface.
struct Method {
  filter::MethodInfo info;
  bool renders = false;             // renders the scene itself: the cost of the film is not part of its cost
  bool grows_with_samples = false;  // its own cost is proportional to the samples per pixel
  Probe probe = Probe::kSmallFilms;
  /// Errors: kUnimplemented with the reason if the method cannot run on the subject; those of the method.
  std::function<absl::StatusOr<MadePicture>(Subject* subject, absl::Span<const float> values, TaskPool* pool)>
      make;
};

/// The methods of filter::Methods(), then those that need single samples, then those that render.
const std::vector<Method>& AllMethods();

/// The records of AllMethods(), for lists.
std::vector<filter::MethodInfo> AllMethodInfos();

/// The methods of the given names; all for no name. Errors: kNotFound naming a method that does not exist.
absl::StatusOr<std::vector<const Method*>> FindMethods(const std::vector<std::string>& names);

/// A number that changes when the method's result on a film changes.
struct Fingerprint {
  uint64_t hash = 0;
  std::optional<MadePicture> made;  // the picture of the film itself, if it was the probe
};

/// A hash of the default picture of the method's probe. kSmallFilms has few samples a pixel and, unless the
/// method's cost grows with them, many; its result is the same for every subject.
/// Errors: those of the method, kUnimplemented included.
absl::StatusOr<Fingerprint> FingerprintOf(const Method& method, Subject* subject,
                                          const std::string& cache_folder, TaskPool* pool);

}  // namespace lumifold::charts
