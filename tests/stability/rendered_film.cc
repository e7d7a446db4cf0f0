#include "tests/stability/rendered_film.h"

#include <memory>
#include <utility>

#include "tests/scenes/glb_writer.h"
#include "tests/stability/errors.h"
#include "worker/render/renderer.h"

namespace lumifold::stability {
namespace {

absl::StatusOr<SceneFilm> FilmOf(absl::StatusOr<charts::FilmSource> source,
                                 const charts::FilmSettings& settings, TaskPool* pool) {
  if (!source.ok()) return source.status();
  absl::StatusOr<charts::RenderedFilm> rendered = source->Get(settings, pool);
  if (!rendered.ok()) return rendered.status();
  return SceneFilm{std::move(rendered->film), std::make_shared<const charts::FilmSource>(*std::move(source)),
                   settings};
}

absl::StatusOr<JudgedFilm> JudgedFilmOf(const absl::StatusOr<charts::FilmSource>& source,
                                        const charts::FilmSettings& settings, uint32_t reference_samples,
                                        TaskPool* pool) {
  charts::FilmSettings by_many = settings;
  by_many.samples = reference_samples;
  by_many.seed = charts::kReferenceSeed;
  absl::StatusOr<SceneFilm> reference = FilmOf(source, by_many, pool);
  if (!reference.ok()) return reference.status();
  absl::StatusOr<SceneFilm> film = FilmOf(source, settings, pool);
  if (!film.ok()) return film.status();
  return JudgedFilm{*std::move(film), std::move(reference->film)};
}

}  // namespace

double JudgedFilm::ErrorOf(const ConstColorView& picture) const {
  const auto everywhere = [](int, int) { return true; };
  const LayeredImage& pixels = reference.pixels;
  const double own = DisplayError(pixels.GetColor(layers::HalfA(layers::kNoisy)),
                                  pixels.GetColor(layers::HalfB(layers::kNoisy)), everywhere) /
                     4;
  return DisplayError(picture, truth(), everywhere) - own;
}

absl::StatusOr<SceneFilm> FilmStore::Get(const scenes::SceneDescription& scene,
                                         const charts::FilmSettings& settings, TaskPool* pool) const {
  return FilmOf(charts::FilmSource::Create(scene, folder_), settings, pool);
}

absl::StatusOr<JudgedFilm> FilmStore::GetJudged(const scenes::SceneDescription& scene,
                                                const charts::FilmSettings& settings,
                                                uint32_t reference_samples, TaskPool* pool) const {
  return JudgedFilmOf(charts::FilmSource::Create(scene, folder_), settings, reference_samples, pool);
}

absl::StatusOr<JudgedFilm> FilmStore::GetJudged(const std::string& scene_name,
                                                const charts::FilmSettings& settings,
                                                uint32_t reference_samples, TaskPool* pool) const {
  return JudgedFilmOf(charts::FilmSource::Create(scene_name, folder_), settings, reference_samples, pool);
}

absl::StatusOr<EdgedImage> FilmStore::RenderInTiles(const scenes::SceneDescription& scene,
                                                    const charts::FilmSettings& settings,
                                                    charts::TileSize tile, TaskPool* pool) const {
  const absl::StatusOr<charts::FilmSource> source = charts::FilmSource::Create(scene, folder_);
  if (!source.ok()) return source.status();
  const absl::StatusOr<std::unique_ptr<render::Renderer>> renderer = source->MakeRenderer(settings);
  if (!renderer.ok()) return renderer.status();
  return charts::RenderFilm(**renderer, settings, tile, pool);
}

}  // namespace lumifold::stability
