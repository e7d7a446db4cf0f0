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
/// next ones. Threads: safe concurrently; threads that need a scene somebody is loading wait for it.
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
  /// A job's renderer, or why there is none. `ready` is set once, by the thread that made the entry.
  struct Entry {
    std::string job_id;
    bool ready = false;
    absl::Status failure;
    std::shared_ptr<const render::Renderer> renderer;
  };

  absl::StatusOr<std::shared_ptr<const render::Renderer>> RendererOf(const v1::JobSpec& spec,
                                                                     const std::string& job_id);
  absl::StatusOr<std::shared_ptr<const render::Renderer>> Load(const v1::JobSpec& spec) const;

  AssetSource* assets_;
  absl::Mutex mutex_;
  std::deque<std::shared_ptr<Entry>> entries_ ABSL_GUARDED_BY(mutex_);  // oldest first
};

/// Whether a failure lies in the job itself, so that every worker would meet it.
bool IsPermanent(const absl::Status& failure);

}  // namespace lumifold::worker
