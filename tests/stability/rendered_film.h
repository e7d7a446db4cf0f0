#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "tests/charts/films/film_source.h"
#include "tests/scenes/scene_description.h"

namespace lumifold::stability {

/// The input of a method: a film and, if it was rendered, its scene and settings.
struct Subject {
  const EdgedImage& film;
  const charts::FilmSource* source = nullptr;  // null: drawn
  charts::FilmSettings settings = {};
};

/// A rendered film with its scene and settings.
struct SceneFilm {
  EdgedImage film;
  std::shared_ptr<const charts::FilmSource> source;
  charts::FilmSettings settings;

  Subject subject() const { return {film, source.get(), settings}; }
};

/// A film, and a reference of the same scene with many samples and another seed.
struct JudgedFilm {
  SceneFilm rendered;
  EdgedImage reference;

  ConstColorView noisy() const { return rendered.film.pixels.GetColor(layers::kNoisy); }
  ConstColorView truth() const { return reference.pixels.GetColor(layers::kNoisy); }
  /// DisplayError against the truth, without the noise of the truth.
  double ErrorOf(const ConstColorView& picture) const;
};

/// Films of small scenes, cached in a folder.
class FilmStore {
 public:
  explicit FilmStore(std::string folder) : folder_(std::move(folder)) {}

  /// The film, from the cache or rendered. Errors: those of charts::FilmSource.
  absl::StatusOr<SceneFilm> Get(const scenes::SceneDescription& scene, const charts::FilmSettings& settings,
                                TaskPool* pool) const;

  /// The film of `settings`, and a reference of `reference_samples` per pixel.
  absl::StatusOr<JudgedFilm> GetJudged(const scenes::SceneDescription& scene,
                                       const charts::FilmSettings& settings, uint32_t reference_samples,
                                       TaskPool* pool) const;
  /// The same of a scene of charts::FilmSource::Create by name.
  absl::StatusOr<JudgedFilm> GetJudged(const std::string& scene_name, const charts::FilmSettings& settings,
                                       uint32_t reference_samples, TaskPool* pool) const;

  /// Renders the scene in tiles of the given size, without the cache. Errors: as Get.
  absl::StatusOr<EdgedImage> RenderInTiles(const scenes::SceneDescription& scene,
                                           const charts::FilmSettings& settings, charts::TileSize tile,
                                           TaskPool* pool) const;

 private:
  std::string folder_;
};

}  // namespace lumifold::stability
