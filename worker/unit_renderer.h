#pragma once

#include <deque>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/edged_image.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "worker/asset_source.h"
#include "worker/render/renderer.h"

namespace lumifold::worker {

/// A unit's pixels, its edge set where it is a geometry unit, and what its rendering counted.
struct RenderedUnit {
  EdgedImage image;
  v1::UnitStats stats;
};

/// Renders leased units: gets a job's scene the first time one of its units comes up, and keeps it for the
/// next ones; one that moves is got again for each frame, as it stands then. Threads: safe concurrently;
/// threads that need a scene somebody is loading wait for it.
class UnitRenderer {
 public:
  /// `assets` must outlive it.
  explicit UnitRenderer(AssetSource* assets) : assets_(assets) {}

  /// Errors: those of AssetSource, scene::LoadGltf and render::Renderer::Create, each naming the job's scene;
  /// kDataLoss where more than 1 % of the samples are not finite.
  absl::StatusOr<RenderedUnit> Render(const v1::JobSpec& spec, const v1::Lease& lease);

  /// Forgets a job's scene, unless others use it.
  void ForgetJob(const std::string& job_id);

 private:
  /// What units of a job are rendered with.
  struct LoadedScene {
    std::shared_ptr<const render::Renderer> renderer;
    bool animated = false;  // good for one frame alone
  };

  /// The scene of a job's frame, or why there is none. `ready` is set once, by the thread that made the
  /// entry.
  struct Entry {
    std::string job_id;
    int frame = 0;
    bool ready = false;
    absl::Status failure;
    LoadedScene loaded;
  };

  absl::StatusOr<std::shared_ptr<const render::Renderer>> RendererOf(const v1::JobSpec& spec,
                                                                     const v1::UnitId& unit);
  /// The entry that serves the unit, or may turn out to once it is ready; null where a new one is needed.
  std::shared_ptr<Entry> FindEntry(const v1::UnitId& unit) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::shared_ptr<Entry> AddEntry(const v1::UnitId& unit) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<LoadedScene> Load(const v1::JobSpec& spec, int frame) const;

  AssetSource* assets_;
  absl::Mutex mutex_;
  std::deque<std::shared_ptr<Entry>> entries_ ABSL_GUARDED_BY(mutex_);  // longest unused first
};

/// Whether a failure lies in the job itself, so that every worker would meet it.
bool IsPermanent(const absl::Status& failure);

}  // namespace lumifold::worker
