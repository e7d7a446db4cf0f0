#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "tests/charts/film_source.h"
#include "tests/scenes/scene_description.h"

namespace lumifold::stability {

/// A film that is put before a method and, where it was rendered and not drawn, of what.
struct Subject {
  const EdgedImage& film;
  const charts::FilmSource* source = nullptr;  // null: drawn
  charts::FilmSettings settings = {};
};

/// A film that was rendered, and of what.
struct SceneFilm {
  EdgedImage film;
  std::shared_ptr<const charts::FilmSource> source;
  charts::FilmSettings settings;

  Subject subject() const { return {film, source.get(), settings}; }
};

/// A film and the same by many samples of other seeds.
struct JudgedFilm {
  SceneFilm rendered;
  EdgedImage reference;
};

/// Films of small scenes, kept in a folder.
class FilmStore {
 public:
  explicit FilmStore(std::string folder) : folder_(std::move(folder)) {}

  /// Renders the scene, or finds it. Errors: those of charts::FilmSource.
  absl::StatusOr<SceneFilm> Get(const scenes::SceneDescription& scene, const charts::FilmSettings& settings,
                                TaskPool* pool) const;

  /// The film of `settings` with one of `reference_samples`.
  absl::StatusOr<JudgedFilm> GetJudged(const scenes::SceneDescription& scene,
                                       const charts::FilmSettings& settings, uint32_t reference_samples,
                                       TaskPool* pool) const;

  /// Renders the scene anew in tiles of a size of one's own. Errors: as Get.
  absl::StatusOr<EdgedImage> RenderInTiles(const scenes::SceneDescription& scene,
                                           const charts::FilmSettings& settings, charts::TileSize tile,
                                           TaskPool* pool) const;

 private:
  std::string folder_;
};

}  // namespace lumifold::stability
