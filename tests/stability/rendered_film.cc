#include "tests/stability/rendered_film.h"

#include <memory>
#include <utility>

#include "tests/scenes/glb_writer.h"
#include "worker/render/renderer.h"

namespace lumifold::stability {
namespace {

constexpr uint64_t kReferenceSeed = 777;  // another one: noise in common would hide errors

}  // namespace

absl::StatusOr<RenderedFilm> FilmStore::Get(std::shared_ptr<const scenes::SceneDescription> scene,
                                            const charts::FilmSettings& settings, TaskPool* pool) const {
  const absl::StatusOr<charts::FilmSource> source = charts::FilmSource::Create(*scene, folder_);
  if (!source.ok()) return source.status();
  absl::StatusOr<charts::TimedFilm> timed = source->Get(settings, pool);
  if (!timed.ok()) return timed.status();
  return RenderedFilm{std::move(timed->film), std::move(scene), settings};
}

absl::StatusOr<JudgedFilm> FilmStore::GetJudged(std::shared_ptr<const scenes::SceneDescription> scene,
                                                const charts::FilmSettings& settings,
                                                uint32_t reference_samples, TaskPool* pool) const {
  charts::FilmSettings by_many = settings;
  by_many.samples = reference_samples;
  by_many.seed = kReferenceSeed;
  absl::StatusOr<RenderedFilm> reference = Get(scene, by_many, pool);
  if (!reference.ok()) return reference.status();
  absl::StatusOr<RenderedFilm> film = Get(std::move(scene), settings, pool);
  if (!film.ok()) return film.status();
  return JudgedFilm{*std::move(film), std::move(reference->film)};
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
