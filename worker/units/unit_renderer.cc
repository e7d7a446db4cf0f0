#include "worker/units/unit_renderer.h"

#include <algorithm>
#include <array>
#include <new>
#include <optional>
#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include "filter/image/studio.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/rect_codec.h"
#include "worker/scene/out_of_memory.h"
#include "worker/units/job_plan.h"

namespace lumifold::worker {
namespace {

/// Scenes are large: one is in use, one is being loaded for the next job or frame.
constexpr size_t kMaxScenes = 2;

/// Key of the payload of a status: the serialised AssetRef that MissingAsset returns.
constexpr char kMissingAssetPayload[] = "lumifold/missing_asset";

/// A unit with a larger share of NaN or infinite samples fails: the scene is invalid.
constexpr double kMaxBadShare = 0.01;

bool HasSamples(const v1::Lease& lease, const Rect& rect) {
  if (lease.unit().kind() != v1::UNIT_KIND_PASS) return true;
  if (lease.block_samples().empty())
    return lease.first_sample() >= 0 && lease.first_sample() < lease.last_sample();
  const int64_t blocks = int64_t{BlocksIn(rect.width())} * BlocksIn(rect.height());
  if (lease.block_samples_size() != 2 * blocks) return false;
  for (int i = 0; i < lease.block_samples_size(); i += 2) {
    if (lease.block_samples(i) > lease.block_samples(i + 1)) return false;
  }
  return true;
}

/// Of a lease that HasSamples.
TileSamples SamplesOf(const v1::Lease& lease, const Rect& rect) {
  if (lease.block_samples().empty()) {
    return SampleRange{static_cast<uint32_t>(lease.first_sample()),
                       static_cast<uint32_t>(lease.last_sample())};
  }
  std::vector<SampleRange> blocks;
  for (int i = 0; i < lease.block_samples_size(); i += 2)
    blocks.push_back({lease.block_samples(i), lease.block_samples(i + 1)});
  return {rect.width(), rect.height(), std::move(blocks)};
}

/// The renderer relies on it: a rectangle within the picture, and samples.
absl::Status CheckLease(const v1::JobSpec& spec, const v1::Lease& lease) {
  const Rect rect = rpc::RectOf(lease.rect());
  const bool is_inside = rect.x0 >= 0 && rect.x0 < rect.x1 && rect.x1 <= spec.width() && rect.y0 >= 0 &&
                         rect.y0 < rect.y1 && rect.y1 <= spec.height();
  if (is_inside && HasSamples(lease, rect)) return absl::OkStatus();
  return absl::InvalidArgumentError("the lease is not for a part of the job's picture");
}

/// `matrix`, which row vectors of points are multiplied by, of points in the file's coordinates.
render::PictureCamera::Matrix FromFile(render::PictureCamera::Matrix matrix,
                                       const std::array<double, 3>& origin) {
  for (size_t column = 0; column < 4; ++column) {
    double shift = 0;
    for (size_t row = 0; row < 3; ++row) shift += origin[row] * static_cast<double>(matrix[4 * row + column]);
    matrix[12 + column] = static_cast<float>(static_cast<double>(matrix[12 + column]) - shift);
  }
  return matrix;
}

v1::CameraMatrices MatricesOf(const render::PictureCamera& camera, const scene::Scene& scene) {
  v1::CameraMatrices matrices;
  const auto to_camera = FromFile(camera.WorldToCamera(), scene.origin);
  const auto to_ndc = FromFile(camera.WorldToNdc(), scene.origin);
  matrices.mutable_world_to_camera()->Add(to_camera.begin(), to_camera.end());
  matrices.mutable_world_to_ndc()->Add(to_ndc.begin(), to_ndc.end());
  return matrices;
}

void DescribeStudio(v1::UnitStats* stats) {
  stats->set_environment(kStudioUri);
  stats->add_warnings("the scene has no light: a neutral studio lights it (--env none: it stays black)");
}

/// What the object numbers of the geometry unit stand for; or a warning.
void AddObjects(const scene::Scene& scene, v1::UnitStats* stats) {
  size_t bytes = 0;
  const auto name_of = [&bytes](const std::string& text, const char* kind, int number) {
    std::string line =
        rpc::BoundedLine(text.empty() ? absl::StrCat(kind, " ", number) : text, rpc::kMaxObjectNameBytes);
    bytes += line.size();
    return line;
  };
  for (size_t i = 0; i < scene.instances.size() && i < rpc::kMaxObjects; ++i) {
    const scene::Instance& instance = scene.instances[i];
    const int material = scene.meshes[static_cast<size_t>(instance.mesh)].material;
    v1::SceneObject* const object = stats->add_objects();
    object->set_name(name_of(instance.name, "object", static_cast<int>(i) + 1));
    const std::string unnamed;
    const std::string& of_material =
        material == scene::kNone ? unnamed : scene.materials[static_cast<size_t>(material)].name;
    object->set_material(name_of(of_material, "material", material + 1));
  }
  if (scene.instances.size() <= rpc::kMaxObjects && bytes <= rpc::kMaxObjectBytes) return;
  stats->clear_objects();
  stats->add_warnings("too many objects for Cryptomatte, or too long names: the picture has none");
}

}  // namespace

bool IsPermanent(const absl::Status& failure) {
  if (MissingAsset(failure).has_value()) return false;
  switch (failure.code()) {
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kDeadlineExceeded:
    case absl::StatusCode::kCancelled:
    case absl::StatusCode::kAborted:
    case absl::StatusCode::kInternal:
    case absl::StatusCode::kResourceExhausted:  // another machine may have the memory
      return false;
    default:
      return true;
  }
}

std::optional<v1::AssetRef> MissingAsset(const absl::Status& failure) {
  const auto payload = failure.GetPayload(kMissingAssetPayload);
  v1::AssetRef asset;
  if (!payload.has_value() || !asset.ParseFromString(std::string(*payload))) return std::nullopt;
  return asset;
}

absl::StatusOr<JobScene> UnitRenderer::LoadScene(const v1::JobSpec& spec, const v1::UnitId& unit,
                                                 std::atomic<int64_t>* progress) {
  {
    absl::MutexLock lock(&mutex_);
    if (planned_.has_value() && planned_->job_id == unit.job_id() && planned_->frame == unit.frame())
      return std::move(std::exchange(planned_, std::nullopt)->scene);
  }
  // A file that cannot be fetched fails the load, whatever the loader makes of its absence.
  absl::Status failure;
  const auto fetch = [&](const v1::AssetRef& asset) -> absl::StatusOr<AssetContent> {
    if (stopped_) failure = absl::CancelledError("the worker stops");
    if (!failure.ok()) return failure;
    absl::StatusOr<AssetContent> bytes = assets_->Fetch(unit.job_id(), asset);
    if (!bytes.ok()) failure = NamingScene(bytes.status(), spec);
    if (absl::IsNotFound(failure) || absl::IsDataLoss(failure))
      failure.SetPayload(kMissingAssetPayload, absl::Cord(asset.SerializeAsString()));
    return bytes;
  };
  absl::StatusOr<JobScene> scene =
      LoadJobScene(spec, unit.frame(), fetch, &decoded_, loaders_.get(), progress);
  if (!failure.ok()) return failure;
  return scene;
}

absl::StatusOr<UnitRenderer::LoadedScene> UnitRenderer::Load(const v1::JobSpec& spec, const v1::UnitId& unit,
                                                             std::atomic<int64_t>* progress) {
  try {
    return LoadUnguarded(spec, unit, progress);
  } catch (const std::bad_alloc&) {  // others wait for this scene: they must learn it
    return NamingScene(scene::OutOfMemory("the scene"), spec);
  }
}

absl::StatusOr<UnitRenderer::LoadedScene> UnitRenderer::LoadUnguarded(const v1::JobSpec& spec,
                                                                      const v1::UnitId& unit,
                                                                      std::atomic<int64_t>* progress) {
  absl::StatusOr<JobScene> job = LoadScene(spec, unit, progress);
  if (!job.ok()) return job.status();
  const bool animated = job->scene->animated;
  const bool in_studio = job->in_studio;
  ApplyPlan(spec, &job->settings);
  absl::StatusOr<std::unique_ptr<render::Renderer>> renderer =
      render::Renderer::Create(std::move(job->scene), job->settings);
  if (!renderer.ok()) return NamingScene(renderer.status(), spec);
  return LoadedScene{*std::move(renderer), animated, in_studio};
}

absl::StatusOr<RenderedUnit> UnitRenderer::Plan(const v1::JobSpec& spec, const v1::UnitId& unit,
                                                UnitControl* control) {
  const absl::Time start = rpc::MonotonicNow();
  absl::StatusOr<JobScene> scene = LoadScene(spec, unit, &control->progress);
  const absl::Duration load_time = rpc::MonotonicNow() - start;
  if (!scene.ok()) return scene.status();
  absl::StatusOr<v1::Plan> plan = PlanJob(spec, *scene);
  if (!plan.ok()) return plan.status();
  if (control->stop) return absl::CancelledError("the unit is no longer wanted");
  RenderedUnit planned;
  planned.plan = *std::move(plan);
  absl::MutexLock lock(&mutex_);
  loads_.time += load_time;
  planned_ = PlannedScene{unit.job_id(), unit.frame(), *std::move(scene)};
  return planned;
}

std::shared_ptr<UnitRenderer::Entry> UnitRenderer::FindEntry(const v1::UnitId& unit) {
  std::shared_ptr<Entry> loading;
  bool is_animated = false;
  for (const std::shared_ptr<Entry>& entry : entries_) {
    if (entry->job_id != unit.job_id()) continue;
    if (entry->frame == unit.frame() || (entry->ready && !entry->loaded.animated)) return entry;
    if (entry->ready) is_animated = true;
    if (!entry->ready) loading = entry;
  }
  return is_animated ? nullptr : loading;  // the scene being loaded may be static and fit every frame
}

std::shared_ptr<UnitRenderer::Entry> UnitRenderer::AddEntry(const v1::UnitId& unit) {
  auto entry = std::make_shared<Entry>();
  entry->job_id = unit.job_id();
  entry->frame = unit.frame();
  entries_.push_back(entry);
  if (entries_.size() > kMaxScenes) entries_.pop_front();  // threads that still use it hold a reference
  return entry;
}

absl::StatusOr<UnitRenderer::LoadedScene> UnitRenderer::SceneOf(const v1::JobSpec& spec,
                                                                const v1::UnitId& unit,
                                                                std::atomic<int64_t>* progress) {
  std::shared_ptr<Entry> entry;
  {
    absl::MutexLock lock(&mutex_);
    while ((entry = FindEntry(unit)) != nullptr) {
      mutex_.Await(absl::Condition(&entry->ready));
      // Loaded for a lease that is void; this unit has one of its own.
      if (absl::IsPermissionDenied(entry->failure)) continue;
      if (!entry->failure.ok()) return entry->failure;
      if (entry->frame != unit.frame() && entry->loaded.animated) continue;
      if (std::erase(entries_, entry) > 0) entries_.push_back(entry);  // now the most recently used
      return entry->loaded;
    }
    entry = AddEntry(unit);
  }
  const absl::Time start = rpc::MonotonicNow();
  absl::StatusOr<LoadedScene> loaded = Load(spec, unit, progress);
  absl::MutexLock lock(&mutex_);
  loads_.time += rpc::MonotonicNow() - start;
  if (loaded.ok()) {
    ++loads_.scenes;
    entry->loaded = *loaded;
  } else {
    entry->failure = loaded.status();
    std::erase(entries_, entry);  // the next unit tries again: the error may be transient
  }
  entry->ready = true;
  return loaded;
}

absl::StatusOr<RenderedUnit> UnitRenderer::Render(const v1::JobSpec& spec, const v1::Lease& lease,
                                                  UnitControl* control) {
  if (absl::Status status = CheckLease(spec, lease); !status.ok()) return status;
  if (lease.unit().kind() == v1::UNIT_KIND_PLAN) return Plan(spec, lease.unit(), control);
  const absl::StatusOr<LoadedScene> loaded = SceneOf(spec, lease.unit(), &control->progress);
  if (!loaded.ok()) return loaded.status();
  const render::Renderer& renderer = *loaded->renderer;
  const absl::Time start = rpc::MonotonicNow();
  RenderedUnit unit;
  render::RenderCounts counts;
  counts.rows = &control->progress;
  counts.stop = &control->stop;
  const Rect rect = rpc::RectOf(lease.rect());
  if (lease.unit().kind() == v1::UNIT_KIND_GEOMETRY) {
    unit.image = renderer.RenderGeometry(rect, lease.unit().frame(), &control->stop);
    for (std::string& warning :
         rpc::BoundedLines(renderer.warnings(), rpc::kMaxUnitWarnings, rpc::kMaxWarningBytes))
      unit.stats.add_warnings(std::move(warning));
    *unit.stats.mutable_camera() = MatricesOf(renderer.camera(), renderer.scene());
    if (loaded->in_studio) DescribeStudio(&unit.stats);
    unit.stats.set_catches_shadows(renderer.CatchesShadows());
    if (spec.cryptomatte() && lease.unit().tile() == 0) AddObjects(renderer.scene(), &unit.stats);
  } else {
    unit.image = renderer.RenderPass(rect, lease.unit().frame(), SamplesOf(lease, rect), &counts);
  }
  if (control->stop) return absl::CancelledError("the unit is no longer wanted");
  if (static_cast<double>(counts.bad_samples) > kMaxBadShare * static_cast<double>(counts.samples)) {
    return absl::DataLossError(absl::StrFormat("%s: %d of %d samples are not finite in the tile at %d,%d",
                                               spec.scene().display_name(), counts.bad_samples,
                                               counts.samples, rect.x0, rect.y0));
  }
  unit.stats.set_samples(counts.samples);
  unit.stats.set_bad_samples(counts.bad_samples);
  unit.stats.set_rays(counts.rays);
  unit.stats.set_seconds(absl::ToDoubleSeconds(rpc::MonotonicNow() - start));
  return unit;
}

void UnitRenderer::DropIdle() {
  absl::MutexLock lock(&mutex_);
  planned_.reset();
  std::erase_if(entries_, [](const std::shared_ptr<Entry>& entry) {
    return entry->ready && entry->loaded.renderer.use_count() == 1;
  });
  decoded_.Drop();
}

void UnitRenderer::ForgetJob(const std::string& job_id) {
  absl::MutexLock lock(&mutex_);
  if (planned_.has_value() && planned_->job_id == job_id) planned_.reset();
  std::erase_if(entries_,
                [&](const std::shared_ptr<Entry>& entry) { return entry->ready && entry->job_id == job_id; });
}

}  // namespace lumifold::worker
