#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "filter/image/rect.h"
#include "tests/stability/drawn_film.h"
#include "tests/stability/errors.h"
#include "tests/stability/rendered_film.h"

namespace lumifold::stability {

/// A method under test: what makes a picture of a film, or of the scene the film was rendered of.
struct Column {
  std::string name;
  /// Empty where the method takes any film; otherwise what a drawn film, which has no scene, lacks for it.
  std::string needs_scene;
  std::function<absl::StatusOr<Picture>(const Subject& subject, TaskPool* pool)> filter;
};

/// What a case is given to work with.
struct Trial {
  const Column& column;
  const FilmStore& films;
  TaskPool* pool;

  /// The column's picture of a film. Errors: kUnimplemented with the reason where the method cannot be run on
  /// it; those of the method.
  absl::StatusOr<Picture> Filter(const Subject& subject) const { return FilterOn(pool, subject); }
  absl::StatusOr<Picture> FilterOn(TaskPool* other_pool, const Subject& subject) const;
};

/// What to look at when a cell surprises.
struct Exhibit {
  Picture noisy, filtered, truth;
  Rect crop = {};  // empty: all of it
};

/// What a case found out about a method.
struct Finding {
  std::vector<double> figures;  // one for each of the case's measures
  Exhibit exhibit;
};

/// The three pictures a figure is made of.
struct Views {
  ConstColorView filtered, noisy, truth;
};

/// Filters the film and takes the figures of what comes out.
absl::StatusOr<Finding> Judge(const Trial& trial, const DrawnFilm& drawn,
                              absl::FunctionRef<std::vector<double>(const Views&)> figures);

/// Error left, as a part of the noisy picture's, as displayed.
double ErrorLeft(const Views& views, Where where);
double ErrorLeft(const Views& views);

/// One figure of a case, and how large or small it has to be.
struct Measure {
  std::string name;
  double threshold = 0;
  bool at_least = false;  // or at most

  bool Passes(double figure) const { return at_least ? figure >= threshold : figure <= threshold; }
};

/// A failure of the default method that is known: its figures must not get worse than these.
struct KnownFailure {
  std::vector<double> figures;
  std::string reason;
};

/// One way in which a filter can fail.
struct Case {
  int number = 0;
  std::string name;
  std::string what;   // the scene, and what is asked of it
  std::string size;   // of the pictures, and samples
  std::string moved;  // why a threshold is not the first one set; empty where it is
  std::vector<Measure> measures;
  std::function<absl::StatusOr<Finding>(const Trial&)> run;
  std::optional<KnownFailure> known = std::nullopt;
};

// The families, each in a file of its own.
std::vector<Case> LightCases();
std::vector<Case> GeometryCases();
std::vector<Case> MaterialCases();
std::vector<Case> RobustnessCases();
std::vector<Case> InvarianceCases();

/// All cases, by number.
const std::vector<Case>& AllCases();

}  // namespace lumifold::stability
