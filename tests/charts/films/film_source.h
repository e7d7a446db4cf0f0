#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "tests/scenes/scene_description.h"
#include "worker/render/geometry/camera.h"
#include "worker/render/renderer.h"
#include "worker/scene/scene.h"

namespace lumifold::charts {

/// A film and the wall-clock seconds of its rendering; 0 if they are not known.
struct RenderedFilm {
  EdgedImage film;
  double render_seconds = 0;
};

/// A scene seen through a lens. Apertures are wide, so that small pictures are as blurred as large ones.
struct LensScene {
  std::string_view name;
  std::string_view scene;  // of scenes::FindScene
  render::Lens lens;
};
inline constexpr std::array<LensScene, 6> kLensScenes = {
    {{"chess-board-lens", "chess-board", {0.9f, 0.42f}},
     {"meeting-room-lens", "meeting-room", {0.25f, 2.6f}},
     {"bedroom-lens", "bedroom", {0.25f, 2.2f}},
     {"foliage-lens", "foliage", {0.3f, 1.9f}},
     {"atrium-lens", "atrium", {0.08f, 6}},
     {"uplighter-lens", "uplighter", {0.25f, 2}}}};

/// The seed of references. No film has it: common noise would hide errors.
inline constexpr uint64_t kReferenceSeed = 777;

/// Size, samples per pixel and seed of a film.
struct FilmSettings {
  int width = 0;
  int height = 0;
  uint32_t samples = 0;
  uint64_t seed = 0;
};

/// Cost of rendering, in processor seconds summed over all threads.
struct RenderRates {
  double radiance = 0;  // one sample per pixel, C only
  double layered = 0;   // one sample per pixel, all layers in halves
  double geometry = 0;  // the geometry units of a frame
};

/// Renders films of one scene, as a farm would, and caches them as files, by a hash of the scene's bytes, the
/// settings and the numeric class. A second run reads the film and the time of its rendering from the cache.
class FilmSource {
 public:
  /// `scene_name`: a scene of scenes::FindScene; one of kLensScenes; or a file LUMIFOLD_SCENES_DIR/NAME.glb,
  /// with NAME-sky.exr as its environment light if that file exists. Errors: kNotFound for any other name;
  /// kUnavailable if the cache folder cannot be made; those of the files.
  static absl::StatusOr<FilmSource> Create(const std::string& scene_name, const std::string& cache_folder);

  /// For a scene that is not in the list of named scenes.
  static absl::StatusOr<FilmSource> Create(const scenes::SceneDescription& scene,
                                           const std::string& cache_folder);

  /// The film, from the cache or rendered. Errors: those of loading and rendering the scene and of the cache.
  absl::StatusOr<RenderedFilm> Get(const FilmSettings& settings, TaskPool* pool) const;

  /// The path of the film in the cache, whether the file exists or not.
  std::string PathOf(const FilmSettings& settings) const;

  /// The scene, and the settings it is rendered with. Errors: those of loading it.
  absl::StatusOr<std::shared_ptr<const scene::Scene>> LoadScene() const;
  render::RenderSettings SettingsFor(const FilmSettings& settings) const;

  /// Renders a few samples with and without layers, alternately, and takes the minimum time of each. The
  /// result is cached like films. Errors: as Get().
  absl::StatusOr<RenderRates> Rates(int width, int height, TaskPool* pool) const;

  /// A renderer of the scene. Errors: those of loading it and of render::Renderer::Create.
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
  render::Lens lens_;
};

struct TileSize {
  int width = 32;
  int height = 32;
};

/// Renders a film in passes and tiles, as a farm would. `renderer` has the size and seed of the settings.
EdgedImage RenderFilm(const render::Renderer& renderer, const FilmSettings& settings, TileSize tile,
                      TaskPool* pool);

}  // namespace lumifold::charts
