#include "tests/stability/columns.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "filter/image/film_source.h"
#include "filter/methods.h"
#include "tests/charts/methods/rendering/render_method.h"
#include "tests/charts/methods/samples/sample_method.h"

namespace lumifold::stability {
namespace {

Column FilterColumn(const filter::MethodInfo& method) {
  return {method.name, "",
          [name = method.name](const Subject& subject, TaskPool* pool) {
            return filter::FilterFilm(subject.film.pixels, name, pool, &subject.film.edges,
                                      &subject.film.fragments);
          },
          [name = method.name](const EdgedImage& film, const filter::BlockParams& blocks, TaskPool* pool) {
            FilmInMemory source(film.pixels, &film.edges, &film.fragments);
            return filter::FilterFilmByRows(&source, name, pool, blocks);
          }};
}

/// Largest samples per pixel for a method that reads single samples.
constexpr uint32_t kMostSamples = 16;
/// Largest samples per pixel for a method that renders the scene itself.
constexpr uint32_t kMostOwnSamples = 64;

absl::StatusOr<Picture> RunSampleMethod(const charts::SampleMethod& method, const Subject& subject,
                                        TaskPool* pool) {
  if (method.uses_samples && subject.settings.samples > kMostSamples)
    return absl::UnimplementedError("not run, cost: it reads single samples");
  const auto renderer = subject.source->MakeRenderer(subject.settings);
  if (!renderer.ok()) return renderer.status();
  charts::FilmSettings settings = subject.settings;
  if (!method.uses_samples) settings.samples = 0;
  const auto samples = charts::TraceSampleSet(**renderer, settings, subject.film.pixels, pool);
  if (!samples.ok()) return samples.status();
  return method.filter(*samples, filter::DefaultsOf(method.info), pool);
}

Column SampleColumn(const charts::SampleMethod& method) {
  return {
      method.info.name, "it needs what a film does not hold, and a drawn film has no scene to trace it in",
      [&method](const Subject& subject, TaskPool* pool) { return RunSampleMethod(method, subject, pool); }};
}

absl::StatusOr<Picture> RunRenderMethod(const charts::RenderMethod& method, const Subject& subject,
                                        TaskPool* pool) {
  if (subject.settings.samples > kMostOwnSamples)
    return absl::UnimplementedError("not run, cost: it renders the scene itself");
  const auto scene = subject.source->LoadScene();
  if (!scene.ok()) return scene.status();
  absl::StatusOr<charts::RenderedPicture> rendered =
      method.render(*scene, subject.source->SettingsFor(subject.settings), subject.settings.samples,
                    filter::DefaultsOf(method.info), pool);
  if (!rendered.ok()) return rendered.status();
  return std::move(rendered->picture);
}

Column RenderColumn(const charts::RenderMethod& method) {
  return {
      method.info.name, "it renders the scene itself, and a drawn film has no scene",
      [&method](const Subject& subject, TaskPool* pool) { return RunRenderMethod(method, subject, pool); }};
}

std::vector<Column> ListColumns() {
  std::vector<Column> columns;
  for (const filter::MethodInfo& method : filter::Methods()) columns.push_back(FilterColumn(method));
  for (const charts::SampleMethod& method : charts::SampleMethods()) columns.push_back(SampleColumn(method));
  for (const charts::RenderMethod& method : charts::RenderMethods()) columns.push_back(RenderColumn(method));
  return columns;
}

}  // namespace

const std::vector<Column>& AllColumns() {
  static const std::vector<Column> columns = ListColumns();
  return columns;
}

const Column* FindColumn(const std::string& name) {
  const std::vector<Column>& all = AllColumns();
  const auto found = std::find_if(all.begin(), all.end(), [&](const Column& c) { return c.name == name; });
  return found == all.end() ? nullptr : &*found;
}

}  // namespace lumifold::stability
