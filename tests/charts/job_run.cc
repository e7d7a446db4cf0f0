#include "tests/charts/job_run.h"

#include <filesystem>
#include <map>
#include <memory>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/methods.h"
#include "server/film/unit_assembler.h"
#include "server/film/unit_film.h"
#include "server/film/unit_log.h"
#include "server/film/unit_record.h"
#include "server/job/plan.h"
#include "server/job/tile_grid.h"
#include "tests/support/cpu_seconds.h"
#include "worker/units/decoded_cache.h"
#include "worker/units/job_plan.h"
#include "worker/units/unit_messages.h"

namespace lumifold::charts {
namespace {

using job::UnitKey;

constexpr int64_t kAttempt = 1;
constexpr char kJob[] = "j-0000000000000000";

int64_t FloatBytesOf(const LayeredImage& image) {
  return static_cast<int64_t>(image.channels().size() * sizeof(float)) * image.width() * image.height();
}

/// The units of a frame in their log.
class LoggedUnits final : public film::UnitSource {
 public:
  LoggedUnits(film::UnitLogReader reader, std::map<UnitKey, film::RecordPlace> places)
      : reader_(std::move(reader)), places_(std::move(places)) {}

  absl::StatusOr<film::UnitOutline> Outline(const UnitKey& key) const override {
    absl::StatusOr<film::UnitHeader> header = reader_.ReadHeader(places_.at(key));
    if (!header.ok()) return header.status();
    return std::move(header->outline);
  }
  absl::StatusOr<EdgedImage> Read(const UnitKey& key) const override {
    absl::StatusOr<film::StoredUnit> unit = reader_.Read(places_.at(key));
    if (!unit.ok()) return unit.status();
    return std::move(unit->image);
  }

 private:
  film::UnitLogReader reader_;
  std::map<UnitKey, film::RecordPlace> places_;
};

class JobRun {
 public:
  JobRun(v1::JobSpec spec, std::string log_path, TaskPool* pool)
      : log_path_(std::move(log_path)), pool_(pool), last_(CpuSeconds()) {
    result_.spec = std::move(spec);
  }
  ~JobRun() {
    std::error_code error;
    std::filesystem::remove(log_path_, error);
  }
  JobRun(const JobRun&) = delete;
  JobRun& operator=(const JobRun&) = delete;

  absl::StatusOr<JobResult> Run(const worker::JobScene& scene) {
    absl::Status status = Plan(scene);
    if (status.ok()) status = Render(scene);
    if (status.ok()) status = Transfer();
    if (status.ok()) status = Filter();
    if (!status.ok()) return status;
    return std::move(result_);
  }

 private:
  struct Unit {
    UnitKey key;
    worker::RenderedUnit rendered;
  };

  /// Adds the time since the last call, or since construction.
  void Charge(double* seconds) {
    const double now = CpuSeconds();
    *seconds += now - last_;
    last_ = now;
  }

  v1::Lease LeaseOf(const UnitKey& key) const {
    v1::Lease lease;
    *lease.mutable_unit() = job::ProtoFromUnit({job::JobId(kJob), key});
    lease.set_attempt(kAttempt);
    return lease;
  }

  absl::Status Plan(const worker::JobScene& scene) {
    if (!job::NeedsPlan(result_.spec)) return absl::OkStatus();
    const absl::StatusOr<v1::Plan> plan = worker::PlanJob(result_.spec, scene);
    if (!plan.ok()) return plan.status();
    absl::StatusOr<v1::JobSpec> planned = job::PlannedSpec(result_.spec, *plan);
    if (!planned.ok()) return planned.status();
    result_.spec = *std::move(planned);
    result_.costs.rays += plan->probe_rays();
    worker::RenderedUnit unit;
    unit.plan = *plan;
    worker::SendUnit(LeaseOf({.kind = v1::UNIT_KIND_PLAN}), unit, [this](const v1::WorkerMessage& message) {
      result_.costs.wire_bytes += static_cast<int64_t>(message.ByteSizeLong());
    });
    Charge(&result_.costs.plan_seconds);
    return absl::OkStatus();
  }

  absl::Status Render(const worker::JobScene& scene) {
    render::RenderSettings settings = scene.settings;
    worker::ApplyPlan(result_.spec, &settings);
    const absl::StatusOr<std::unique_ptr<render::Renderer>> renderer =
        render::Renderer::Create(scene.scene, settings);
    if (!renderer.ok()) return renderer.status();
    const job::FrameUnits frame(result_.spec);
    units_.resize(static_cast<size_t>(frame.count()));
    ParallelFor(pool_, frame.count(), [&](int64_t i) {
      Unit& unit = units_[static_cast<size_t>(i)];
      unit.key = frame.KeyOf(0, i);
      const Rect rect = frame.tiles().RectOf(unit.key.tile);
      if (unit.key.kind == v1::UNIT_KIND_GEOMETRY) {
        unit.rendered.image = (*renderer)->RenderGeometry(rect, 0);
        return;
      }
      render::RenderCounts counts;
      unit.rendered.image = (*renderer)->RenderPass(rect, 0, frame.SamplesOf(unit.key), &counts);
      unit.rendered.stats.set_samples(counts.samples);
      unit.rendered.stats.set_bad_samples(counts.bad_samples);
      unit.rendered.stats.set_rays(counts.rays);
    });
    for (const Unit& unit : units_) {
      result_.costs.rays += unit.rendered.stats.rays();
      const EdgedImage& image = unit.rendered.image;
      result_.costs.float_bytes +=
          FloatBytesOf(image.pixels) + FloatBytesOf(image.edges) + FloatBytesOf(image.fragments);
    }
    Charge(&result_.costs.render_seconds);
    return absl::OkStatus();
  }

  /// The unit as the coordinator gets it.
  absl::StatusOr<film::EncodedUnit> Deliver(const Unit& unit, const job::FrameUnits& frame) {
    film::UnitAssembler assembler(unit.key.kind, frame.tiles().RectOf(unit.key.tile),
                                  frame.SamplesOf(unit.key), film::ModelOf(result_.spec));
    absl::Status status;
    worker::SendUnit(LeaseOf(unit.key), unit.rendered, [&](v1::WorkerMessage message) {
      result_.costs.wire_bytes += static_cast<int64_t>(message.ByteSizeLong());
      if (status.ok()) status = assembler.Add(std::move(*message.mutable_chunk()));
    });
    if (!status.ok()) return status;
    return film::EncodeUnit({job::JobId(kJob), unit.key}, job::Attempt(kAttempt), unit.rendered.stats,
                            assembler.Take());
  }

  absl::Status Transfer() {
    absl::StatusOr<film::UnitLog> log = film::UnitLog::Open(log_path_, 0);
    if (!log.ok()) return log.status();
    const job::FrameUnits frame(result_.spec);
    std::map<UnitKey, film::RecordPlace> places;
    for (const Unit& unit : units_) {
      const absl::StatusOr<film::EncodedUnit> encoded = Deliver(unit, frame);
      if (!encoded.ok()) return encoded.status();
      const absl::StatusOr<film::RecordPlace> place = log->Append(*encoded);
      if (!place.ok()) return place.status();
      result_.costs.stored_bytes += static_cast<int64_t>(place->length);
      places[unit.key] = *place;
    }
    units_.clear();
    absl::StatusOr<film::UnitLogReader> reader = film::UnitLogReader::Open(log_path_);
    if (!reader.ok()) return reader.status();
    const LoggedUnits logged(*std::move(reader), std::move(places));
    absl::StatusOr<film::UnitFilm> film = film::UnitFilm::Open(result_.spec, 0, &logged, pool_);
    if (!film.ok()) return film.status();
    absl::StatusOr<EdgedImage> read = film->Read({0, 0, film->width(), film->height()});
    if (!read.ok()) return read.status();
    film_ = *std::move(read);
    Charge(&result_.costs.transfer_seconds);
    return absl::OkStatus();
  }

  absl::Status Filter() {
    absl::StatusOr<Picture> picture = filter::FilterFilm(film_.pixels, result_.spec.filter().method(), pool_,
                                                         &film_.edges, &film_.fragments);
    if (!picture.ok()) return picture.status();
    result_.picture = *std::move(picture);
    Charge(&result_.costs.filter_seconds);
    return absl::OkStatus();
  }

  const std::string log_path_;
  TaskPool* const pool_;
  double last_;
  JobResult result_;
  std::vector<Unit> units_;
  EdgedImage film_;
};

}  // namespace

absl::StatusOr<JobResult> RunJob(const worker::JobScene& scene, v1::JobSpec spec, const std::string& scratch,
                                 TaskPool* pool) {
  worker::DecodedCache decoded;  // mip levels are made once for plan and picture
  worker::JobScene cached = scene;
  cached.settings.mips = [&decoded](const scene::SharedImage& image, bool srgb) {
    return decoded.Mips(image, srgb);
  };
  return JobRun(std::move(spec), scratch + "/job.units", pool).Run(cached);
}

}  // namespace lumifold::charts
