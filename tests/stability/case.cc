#include "tests/stability/case.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/status/status.h"
#include "filter/image/layers.h"

namespace lumifold::stability {

absl::StatusOr<Picture> Trial::FilterOn(TaskPool* other_pool, const Subject& subject) const {
  if (subject.source == nullptr && !column.needs_scene.empty())
    return absl::UnimplementedError(column.needs_scene);
  return column.filter(subject, other_pool);
}

absl::StatusOr<Picture> Trial::FilterInBlocks(const EdgedImage& film,
                                              const filter::BlockParams& blocks) const {
  if (!column.filter_in_blocks) return absl::UnimplementedError(column.needs_scene);
  return column.filter_in_blocks(film, blocks, pool);
}

absl::StatusOr<Finding> Judge(const Trial& trial, const DrawnFilm& drawn,
                              absl::FunctionRef<std::vector<double>(const Views&)> figures) {
  absl::StatusOr<Picture> filtered = trial.Filter({drawn.film});
  if (!filtered.ok()) return filtered.status();
  const Views views = {ViewOf(*filtered), drawn.film.pixels.GetColor(layers::kNoisy), ViewOf(drawn.truth)};
  Finding finding;
  finding.figures = figures(views);
  finding.exhibit = {ClonePicture(views.noisy), *std::move(filtered), ClonePicture(views.truth)};
  return finding;
}

double ErrorLeft(const Views& views, Where where) {
  return DisplayError(views.filtered, views.truth, where) / DisplayError(views.noisy, views.truth, where);
}

double ErrorLeft(const Views& views) {
  return ErrorLeft(views, [](int, int) { return true; });
}

const std::vector<Case>& AllCases() {
  static const std::vector<Case> cases = [] {
    std::vector<Case> all;
    for (std::vector<Case> family : {LightCases(), RareLightCases(), GeometryCases(), MaterialCases(),
                                     RobustnessCases(), InvarianceCases()}) {
      std::move(family.begin(), family.end(), std::back_inserter(all));
    }
    std::sort(all.begin(), all.end(), [](const Case& a, const Case& b) { return a.number < b.number; });
    return all;
  }();
  return cases;
}

}  // namespace lumifold::stability
