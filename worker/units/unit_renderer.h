#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "worker/cache/asset_source.h"
#include "worker/render/renderer.h"
#include "worker/units/decoded_cache.h"
#include "worker/units/job_scene.h"

namespace lumifold::worker {

/// The pixels of a unit, its edge set or its fragments, and its statistics; or a plan.
struct RenderedUnit {
  EdgedImage image;
  v1::UnitStats stats;
  std::optional<v1::Plan> plan;  // of a plan unit, which has nothing else
};

/// What other threads see of a unit that is being rendered, and what they ask of it.
struct UnitControl {
  /// Grows by one for each row of pixels traced, for each file of a scene loaded and each step of a filter.
  std::atomic<int64_t> progress = 0;
  /// Of a frame or block that is finished: the share that is filtered.
  std::atomic<double> filtered = 0;
  /// The unit is no longer wanted.
  std::atomic<bool> stop = false;
};

/// Renders leased units. Loads the scene of a job for its first unit and keeps it for the next ones; an
/// animated scene is loaded for each frame, but its pictures are decoded once. The scene of a plan unit is
/// kept for the first unit after it.
/// Threads: safe concurrently; threads that need a scene that is being loaded wait for it.
class UnitRenderer {
 public:
  /// `assets` must outlive it. `threads` load a scene.
  explicit UnitRenderer(AssetSource* assets, int threads = 1)
      : assets_(assets), loaders_(MakeTaskPool(threads)) {}

  /// Errors: those of AssetSource, scene::LoadGltf and render::Renderer::Create, each naming the job's scene;
  /// kDataLoss where more than 1 % of the samples are not finite; kCancelled once control->stop is true (at
  /// the latest after a packet of rays, but a scene is loaded to the end, for the next units of the job).
  absl::StatusOr<RenderedUnit> Render(const v1::JobSpec& spec, const v1::Lease& lease, UnitControl* control);

  /// Ends scenes that are being loaded at their next file, with kCancelled; none is loaded any more.
  void StopLoading() { stopped_ = true; }

  /// Scenes loaded for rendering, and the time of the threads that loaded them, for plan units too.
  struct Loads {
    int64_t scenes = 0;
    absl::Duration time;
  };
  Loads loads() const {
    absl::MutexLock lock(&mutex_);
    return loads_;
  }

  /// Memory is short: unloads what no unit in progress uses.
  void DropIdle();
  /// Unloads the scene of a job; units in progress keep it until they are done.
  void ForgetJob(const std::string& job_id);

 private:
  /// The scene of a job's units.
  struct LoadedScene {
    std::shared_ptr<const render::Renderer> renderer;
    bool animated = false;  // valid for one frame only
    bool in_studio = false;
  };

  /// The scene of a job's frame, or the error of loading it. `ready` is set once, by the thread that created
  /// the entry.
  struct Entry {
    std::string job_id;
    int frame = 0;
    bool ready = false;
    absl::Status failure;
    LoadedScene loaded;
  };

  absl::StatusOr<LoadedScene> SceneOf(const v1::JobSpec& spec, const v1::UnitId& unit,
                                      std::atomic<int64_t>* progress);
  /// An entry whose scene fits the unit, or may fit once it is ready; null if a new one is needed.
  std::shared_ptr<Entry> FindEntry(const v1::UnitId& unit) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::shared_ptr<Entry> AddEntry(const v1::UnitId& unit) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<LoadedScene> Load(const v1::JobSpec& spec, const v1::UnitId& unit,
                                   std::atomic<int64_t>* progress);
  absl::StatusOr<LoadedScene> LoadUnguarded(const v1::JobSpec& spec, const v1::UnitId& unit,
                                            std::atomic<int64_t>* progress);
  /// Reads the scene of a unit: that of the last plan unit, or from its files.
  absl::StatusOr<JobScene> LoadScene(const v1::JobSpec& spec, const v1::UnitId& unit,
                                     std::atomic<int64_t>* progress);
  absl::StatusOr<RenderedUnit> Plan(const v1::JobSpec& spec, const v1::UnitId& unit, UnitControl* control);

  /// The scene that a plan unit has read.
  struct PlannedScene {
    std::string job_id;
    int frame = 0;
    JobScene scene;
  };

  AssetSource* assets_;
  std::unique_ptr<TaskPool> loaders_;
  DecodedCache decoded_;
  std::atomic<bool> stopped_ = false;
  mutable absl::Mutex mutex_;
  Loads loads_ ABSL_GUARDED_BY(mutex_);
  std::deque<std::shared_ptr<Entry>> entries_ ABSL_GUARDED_BY(mutex_);  // least recently used first
  std::optional<PlannedScene> planned_ ABSL_GUARDED_BY(mutex_);
};

/// Whether the cause of a failure is in the job, so that it would fail on every worker.
bool IsPermanent(const absl::Status& failure);

/// The file of the scene whose absence or damage on the coordinator's side is the cause of a failure of
/// UnitRenderer::Render; nullopt for other causes.
std::optional<v1::AssetRef> MissingAsset(const absl::Status& failure);

}  // namespace lumifold::worker
