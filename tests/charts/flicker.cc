#include "tests/charts/flicker.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/types/span.h"
#include "filter/denoise/denoise.h"
#include "filter/image/file_io.h"
#include "tests/charts/by_scene.h"
#include "tests/charts/films/adaptive_film.h"
#include "tests/charts/mean_ratio.h"
#include "tests/scenes/scenes.h"

namespace lumifold::charts {
namespace {

/// Not a whole number: edges move against the grid of pixels and of blocks.
constexpr double kPixelsPerFrame = 0.7;

struct Frame {
  Picture reference;
  Picture uniform;
  Picture adaptive;
};

/// The scene once the camera has turned for `frame` frames.
scenes::SceneDescription FrameOf(const scenes::SceneEntry& entry, const FlickerSettings& settings,
                                 int frame) {
  scenes::SceneDescription scene = entry.build();
  const double degrees = kPixelsPerFrame * scene.camera.vertical_fov_degrees / settings.height;
  scenes::Transform& camera = scene.camera.transform;
  camera.rotation = scenes::Rotation::Yaw(degrees * frame) * camera.rotation;
  return scene;
}

absl::StatusOr<Frame> RenderFrame(const scenes::SceneDescription& scene, const FlickerSettings& settings,
                                  uint64_t seed, const std::string& cache_folder, TaskPool* pool) {
  const absl::StatusOr<FilmSource> source = FilmSource::Create(scene, cache_folder);
  if (!source.ok()) return source.status();
  FilmSettings film = {settings.width, settings.height, static_cast<uint32_t>(settings.reference_samples),
                       kReferenceSeed};
  const absl::StatusOr<RenderedFilm> reference = source->Get(film, pool);
  if (!reference.ok()) return reference.status();
  film.seed = seed;
  const absl::StatusOr<std::unique_ptr<render::Renderer>> renderer = source->MakeRenderer(film);
  if (!renderer.ok()) return renderer.status();
  AdaptiveFilm adaptive = RenderAdaptively(
      **renderer,
      {.width = settings.width, .height = settings.height, .budget = static_cast<double>(settings.budget)},
      metrics::ErrorMetric::kMse255, pool);
  film.samples = static_cast<uint32_t>(std::lround(adaptive.mean_samples));
  const EdgedImage uniform = RenderFilm(**renderer, film, {}, pool);
  return Frame{filter::Denoise(filter::Frame(reference->film), pool),
               filter::Denoise(filter::Frame(uniform), pool), std::move(adaptive.picture)};
}

metrics::Flicker ChangeOf(const Picture& picture, const Picture& next) {
  return metrics::MeasureFlicker(ViewOf(picture), ViewOf(next));
}

absl::StatusOr<std::vector<FrameChange>> MeasureCamera(const scenes::SceneEntry& entry, bool turns,
                                                       const FlickerSettings& settings,
                                                       const std::string& cache_folder, TaskPool* pool) {
  std::vector<FrameChange> changes;
  std::optional<Frame> last;
  for (int number = 0; number < settings.frames; ++number) {
    absl::StatusOr<Frame> frame = RenderFrame(FrameOf(entry, settings, turns ? number : 0), settings,
                                              static_cast<uint64_t>(number) + 1, cache_folder, pool);
    if (!frame.ok()) return frame.status();
    if (last.has_value()) {
      changes.push_back({std::string(entry.name), turns, number - 1,
                         ChangeOf(last->reference, frame->reference), ChangeOf(last->uniform, frame->uniform),
                         ChangeOf(last->adaptive, frame->adaptive)});
    }
    last = *std::move(frame);
  }
  return changes;
}

std::string Csv(const std::vector<FrameChange>& changes) {
  std::string text =
      "scene,camera_turns,frame,reference_mean,reference_p99,uniform_mean,uniform_p99,adaptive_mean,adaptive_"
      "p99\n";
  for (const FrameChange& change : changes) {
    absl::StrAppendFormat(&text, "%s,%d,%d,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", change.scene,
                          change.camera_turns ? 1 : 0, change.frame, change.reference.mean,
                          change.reference.percentile99, change.uniform.mean, change.uniform.percentile99,
                          change.adaptive.mean, change.adaptive.percentile99);
  }
  return text;
}

using SceneChanges = absl::Span<const FrameChange>;
using Part = double metrics::Flicker::*;

double MeanOf(SceneChanges changes, metrics::Flicker FrameChange::* of, Part part) {
  double sum = 0;
  for (const FrameChange& change : changes) sum += change.*of.*part;
  return sum / static_cast<double>(changes.size());
}

/// Adaptive over uniform.
std::optional<MeanRatio> RatioOf(SceneChanges changes, Part part) {
  std::vector<std::pair<double, double>> pairs;
  pairs.reserve(changes.size());
  for (const FrameChange& change : changes) pairs.emplace_back(change.uniform.*part, change.adaptive.*part);
  return MeanRatioOf(pairs);
}

/// The rows of one scene and camera.
void AppendRows(SceneChanges changes, std::string* text) {
  if (changes.empty()) return;
  for (const auto& [name, part] :
       {std::pair{"mean", &metrics::Flicker::mean}, {"99th percentile", &metrics::Flicker::percentile99}}) {
    std::vector<std::string> cells = {changes[0].scene, changes[0].camera_turns ? "turns" : "stands still",
                                      name};
    for (const auto of : {&FrameChange::reference, &FrameChange::uniform, &FrameChange::adaptive})
      cells.push_back(absl::StrFormat("%.3f", MeanOf(changes, of, part)));
    cells.push_back(RatioCell(RatioOf(changes, part)));
    absl::StrAppend(text, TableLine(cells));
  }
}

std::string Table(const std::vector<FrameChange>& changes) {
  std::string text =
      TableHead({"scene", "camera", "change", "reference", "uniform", "adaptive", "adaptive over uniform"});
  for (const SceneChanges& scene : ByScene(changes)) {
    const auto turning =
        std::find_if(scene.begin(), scene.end(), [](const FrameChange& c) { return c.camera_turns; });
    const auto still = static_cast<size_t>(turning - scene.begin());
    AppendRows(scene.first(still), &text);
    AppendRows(scene.subspan(still), &text);
  }
  return text;
}

}  // namespace

absl::StatusOr<std::vector<FrameChange>> MeasureFrames(const std::string& scene,
                                                       const FlickerSettings& settings,
                                                       const std::string& cache_folder, TaskPool* pool) {
  const scenes::SceneEntry* entry = scenes::FindScene(scene);
  if (entry == nullptr) return absl::NotFoundError(absl::StrCat("no generated scene is named '", scene, "'"));
  std::vector<FrameChange> changes;
  for (const bool turns : {false, true}) {
    const absl::StatusOr<std::vector<FrameChange>> more =
        MeasureCamera(*entry, turns, settings, cache_folder, pool);
    if (!more.ok()) return more.status();
    changes.insert(changes.end(), more->begin(), more->end());
  }
  return changes;
}

absl::Status ChartFlicker(const std::string& folder, const std::vector<FrameChange>& changes,
                          const FlickerSettings& settings, const Provenance& provenance) {
  if (absl::Status status = WriteFileAtomically(folder + "/flicker.csv", Csv(changes)); !status.ok())
    return status;
  return WritePage(
      folder + "/flicker.md", "Flicker of adaptive sampling", provenance,
      absl::StrFormat("Change of the filtered picture from frame to frame, in 8-bit steps over pixels and "
                      "channels: mean of the "
                      "steps between %d frames of %dx%d pixels, and of their ratios, ± the standard error. "
                      "The camera stands "
                      "still, or it turns by %.1f pixels a frame; every frame has its own seed. Adaptive "
                      "frames have at most %d "
                      "samples per pixel in the mean, uniform ones as many as these, the reference %d.\n\n%s",
                      settings.frames, settings.width, settings.height, kPixelsPerFrame, settings.budget,
                      settings.reference_samples, Table(changes)));
}

}  // namespace lumifold::charts
