#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "filter/blocks.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "filter/image/rect.h"
#include "tests/stability/drawn_film.h"
#include "tests/stability/errors.h"
#include "tests/stability/rendered_film.h"

namespace lumifold::stability {

/// A method under test: it makes a picture from a film, or from the scene of the film.
struct Column {
  std::string name;
  /// Empty if the method accepts any film; else the reason why it needs a scene, which a drawn film lacks.
  std::string needs_scene;
  std::function<absl::StatusOr<Picture>(const Subject& subject, TaskPool* pool)> filter;
  /// The picture of a film that is filtered block by block; null for a method that does not filter films.
  std::function<absl::StatusOr<Picture>(const EdgedImage& film, const filter::BlockParams& blocks,
                                        TaskPool* pool)>
      filter_in_blocks = nullptr;
};

/// The inputs of a case.
struct Trial {
  const Column& column;
  const FilmStore& films;
  TaskPool* pool;

  /// The column's picture of a film. Errors: kUnimplemented with the reason if the method cannot run on it;
  /// those of the method.
  absl::StatusOr<Picture> Filter(const Subject& subject) const { return FilterOn(pool, subject); }
  absl::StatusOr<Picture> FilterOn(TaskPool* other_pool, const Subject& subject) const;
  absl::StatusOr<Picture> FilterInBlocks(const EdgedImage& film, const filter::BlockParams& blocks) const;
};

/// The pictures of a cell, for --crop.
struct Exhibit {
  Picture noisy, filtered, truth;
  Rect crop = {};  // empty: the whole picture
};

/// The result of a case for one method.
struct Finding {
  std::vector<double> figures;  // one for each of the case's measures
  Exhibit exhibit;
};

/// The three pictures that figures are computed from.
struct Views {
  ConstColorView filtered, noisy, truth;
};

/// Filters the film and computes the figures of the result.
absl::StatusOr<Finding> Judge(const Trial& trial, const DrawnFilm& drawn,
                              absl::FunctionRef<std::vector<double>(const Views&)> figures);

/// Squared error of the result over that of the noisy picture, in displayed values.
double ErrorLeft(const Views& views, Where where);
double ErrorLeft(const Views& views);

/// One figure of a case, with its threshold.
struct Measure {
  std::string name;
  double threshold = 0;
  bool at_least = false;  // else the figure may be at most the threshold

  bool Passes(double figure) const { return at_least ? figure >= threshold : figure <= threshold; }
};

/// A known failure of the default method: its figures must not become worse than these.
struct KnownFailure {
  std::vector<double> figures;
  std::string reason;
};

/// One way in which a filter can fail.
struct Case {
  int number = 0;
  std::string name;
  std::string what;            // the scene and its measures
  std::string size;            // of the pictures, and samples
  std::string threshold_note;  // why a threshold differs from the one set first; empty if none does
  std::vector<Measure> measures;
  std::function<absl::StatusOr<Finding>(const Trial&)> run;
  std::optional<KnownFailure> known = std::nullopt;
};

// The groups of cases, each in a file of its own.
std::vector<Case> LightCases();
std::vector<Case> RareLightCases();
std::vector<Case> GeometryCases();
std::vector<Case> MaterialCases();
std::vector<Case> RobustnessCases();
std::vector<Case> InvarianceCases();

/// All cases, by number.
const std::vector<Case>& AllCases();

}  // namespace lumifold::stability
