#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "tests/scenes/scene_description.h"
#include "worker/render/renderer.h"
#include "worker/scene/scene.h"

namespace lumifold::charts {

/// A film and the wall-clock seconds of its rendering; 0 if they are not known.
struct RenderedFilm {
  EdgedImage film;
  double render_seconds = 0;
};

/// The seed of references. It is no film's: noise in common would hide errors.
inline constexpr uint64_t kReferenceSeed = 777;

/// What is rendered of a scene.
struct FilmSettings {
  int width = 0;
  int height = 0;
  uint32_t samples = 0;
  uint64_t seed = 0;
};

/// What rendering costs: processor seconds, all threads together.
struct RenderRates {
  double radiance = 0;  // a sample of every pixel, C alone
  double layered = 0;   // a sample of every pixel, all layers in halves
  double geometry = 0;  // the geometry units of a frame
};

/// Renders films of one scene, as a farm would, and keeps them as files, by a hash of the scene's bytes, the
/// settings and the numeric class: a second run finds them, and the time the first took.
class FilmSource {
 public:
  /// `scene_name`: one that scenes::FindScene knows, or else a file LUMIFOLD_SCENES_DIR/NAME.glb, lit by
  /// NAME-sky.exr where that is there too.
  /// Errors: kNotFound for a name that is neither; kUnavailable without a cache folder; those of the files.
  static absl::StatusOr<FilmSource> Create(const std::string& scene_name, const std::string& cache_folder);

  /// Of a scene that has no place among those with a name.
  static absl::StatusOr<FilmSource> Create(const scenes::SceneDescription& scene,
                                           const std::string& cache_folder);

  /// Errors: those of loading and rendering the scene and of the cache's files.
  absl::StatusOr<RenderedFilm> Get(const FilmSettings& settings, TaskPool* pool) const;

  /// Where the film is kept, whether it is there or not.
  std::string PathOf(const FilmSettings& settings) const;

  /// The scene, and how it is rendered. Errors: those of loading it.
  absl::StatusOr<std::shared_ptr<const scene::Scene>> LoadScene() const;
  render::RenderSettings SettingsFor(const FilmSettings& settings) const;

  /// Renders a few samples with and without layers, in turns, and takes the least time of each; keeps the
  /// result as Get() keeps films. Errors: as Get().
  absl::StatusOr<RenderRates> Rates(int width, int height, TaskPool* pool) const;

  /// What renders the scene. Errors: those of loading it and of render::Renderer::Create.
  absl::StatusOr<std::unique_ptr<render::Renderer>> MakeRenderer(const FilmSettings& settings) const;

 private:
  FilmSource(std::string name, std::string bytes, std::string cache_folder);
  static absl::StatusOr<FilmSource> CreateFromFile(const std::string& name, const std::string& cache_folder);
  absl::StatusOr<RenderedFilm> Render(const FilmSettings& settings, TaskPool* pool) const;
  absl::StatusOr<RenderRates> MeasureRates(int width, int height, TaskPool* pool) const;
  std::string HashOf(uint64_t seed) const;

  std::string name_;
  std::string bytes_;
  std::string sky_bytes_;
  std::shared_ptr<const render::Environment> sky_;  // null: black
  std::string cache_folder_;
};

struct TileSize {
  int width = 32;
  int height = 32;
};

/// Renders a film in passes and tiles, as a farm would. `renderer` is of the settings' size and seed.
EdgedImage RenderFilm(const render::Renderer& renderer, const FilmSettings& settings, TileSize tile,
                      TaskPool* pool);

}  // namespace lumifold::charts
