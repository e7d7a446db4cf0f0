#include "tests/charts/plan.h"

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "filter/image/decisions.h"
#include "filter/image/file_io.h"
#include "server/job/job_spec.h"
#include "server/job/plan.h"
#include "tests/charts/by_scene.h"
#include "worker/plan/probe.h"

namespace lumifold::charts {
namespace {

/// What a plan may cost and has to save.
constexpr double kMostErrorRatio = 1.01;
constexpr double kMostDiffuseBytes = 0.75;
constexpr double kMostDiffuseTime = 0.85;

struct Quantity {
  const char* name;
  double (*of)(const PlannedJob& job);
};

/// In millions.
double Mega(int64_t bytes) { return 1e-6 * static_cast<double>(bytes); }

constexpr std::array<Quantity, 9> kQuantities = {{
    {"camera paths", [](const PlannedJob& job) { return static_cast<double>(job.camera_paths); }},
    {"rays", [](const PlannedJob& job) { return static_cast<double>(job.costs.rays); }},
    {"bytes as float32", [](const PlannedJob& job) { return static_cast<double>(job.costs.float_bytes); }},
    {"bytes on the wire", [](const PlannedJob& job) { return static_cast<double>(job.costs.wire_bytes); }},
    {"bytes stored", [](const PlannedJob& job) { return static_cast<double>(job.costs.stored_bytes); }},
    {"rendering time", [](const PlannedJob& job) { return job.costs.render_seconds; }},
    {"filter time", [](const PlannedJob& job) { return job.costs.filter_seconds; }},
    {"total time", [](const PlannedJob& job) { return job.costs.TotalSeconds(); }},
    {"MSE255", [](const PlannedJob& job) { return job.mse255; }},
}};
constexpr size_t kWireBytes = 3;
constexpr size_t kTotalTime = 7;
constexpr size_t kError = 8;

absl::StatusOr<v1::JobSpec> SpecOf(const FilmSettings& settings, const render::RenderSettings& render,
                                   v1::PlanMode mode) {
  v1::JobSpec spec;
  spec.set_width(settings.width);
  spec.set_height(settings.height);
  spec.set_frame_count(1);
  spec.set_samples_per_pixel(static_cast<int32_t>(settings.samples));
  spec.set_seed(render.seed);
  spec.set_max_bounces(render.max_bounces);
  spec.mutable_planning()->set_mode(mode);
  return job::NormaliseJobSpec(std::move(spec));
}

bool IsDiffuse(const v1::JobSpec& planned) {
  return job::ValueOf(planned, decisions::kDirect) == 1 && job::ValueOf(planned, decisions::kGlossy) == 0 &&
         job::ValueOf(planned, decisions::kLevels) == 0;
}

/// The pairs of one scene.
class PairRun {
 public:
  PairRun(const FilmSource& source, std::shared_ptr<const scene::Scene> scene, FilmSettings settings,
          const Reference& reference, const std::string& scratch, TaskPool* pool)
      : source_(source),
        scene_(std::move(scene)),
        settings_(settings),
        reference_(reference),
        scratch_(scratch),
        pool_(pool) {}

  /// The first job of a process takes longer: it gets memory that later ones reuse.
  absl::Status WarmUp() {
    const uint32_t samples = std::exchange(settings_.samples, 1);
    PlannedJob job;
    const absl::StatusOr<v1::JobSpec> done = Run(0, v1::PLAN_MODE_FULL, &job);
    settings_.samples = samples;
    return done.status();
  }

  absl::Status Measure(uint64_t seed, PlanPair* pair) {
    pair->seed = seed;
    absl::StatusOr<v1::JobSpec> full, planned;
    const bool full_first = seed % 2 == 1;
    if (full_first) full = Run(seed, v1::PLAN_MODE_FULL, &pair->full);
    planned = Run(seed, v1::PLAN_MODE_AUTO, &pair->planned);
    if (!full_first) full = Run(seed, v1::PLAN_MODE_FULL, &pair->full);
    if (!full.ok()) return full.status();
    if (!planned.ok()) return planned.status();
    pair->is_diffuse = IsDiffuse(*planned);
    for (int i = 0; i < planned->plan().decisions_size(); ++i) {
      const v1::PlanDecision& decision = planned->plan().decisions(i);
      if (decision.value() != full->plan().decisions(i).value())
        pair->differences[decision.name()] = decision.value();
    }
    const absl::StatusOr<plan::Probe> probe =
        plan::RunProbe(*scene_, SceneFor(seed).settings, static_cast<int32_t>(settings_.samples));
    if (!probe.ok()) return probe.status();
    pair->planned.camera_paths += probe->samples;
    return absl::OkStatus();
  }

 private:
  worker::JobScene SceneFor(uint64_t seed) const {
    FilmSettings settings = settings_;
    settings.seed = seed;
    return {scene_, source_.SettingsFor(settings)};
  }

  absl::StatusOr<v1::JobSpec> Run(uint64_t seed, v1::PlanMode mode, PlannedJob* job) {
    const worker::JobScene scene = SceneFor(seed);
    absl::StatusOr<v1::JobSpec> spec = SpecOf(settings_, scene.settings, mode);
    if (!spec.ok()) return spec;
    absl::StatusOr<JobResult> result = RunJob(scene, *std::move(spec), scratch_, pool_);
    if (!result.ok()) return result.status();
    job->camera_paths = int64_t{settings_.width} * settings_.height * settings_.samples;
    job->costs = result->costs;
    job->mse255 = Judge(ViewOf(result->picture), reference_, false).mse255.whole;
    return std::move(result->spec);
  }

  const FilmSource& source_;
  std::shared_ptr<const scene::Scene> scene_;
  FilmSettings settings_;
  const Reference& reference_;
  const std::string scratch_;
  TaskPool* const pool_;
};

/// The pairs of one scene.
using ScenePairs = absl::Span<const PlanPair>;

std::optional<MeanRatio> RatioOf(ScenePairs pairs, const Quantity& quantity) {
  std::vector<std::pair<double, double>> values;
  values.reserve(pairs.size());
  for (const PlanPair& pair : pairs) values.emplace_back(quantity.of(pair.full), quantity.of(pair.planned));
  return MeanRatioOf(values);
}

std::string VerdictCell(bool is_reached) { return is_reached ? "yes" : "no"; }

std::string RatioTable(const std::vector<ScenePairs>& scenes) {
  std::vector<std::string> names = {"scene"};
  for (const Quantity& quantity : kQuantities) names.emplace_back(quantity.name);
  names.insert(names.end(), {"keeps accuracy", "diffuse: bytes -25 %", "diffuse: time -15 %"});
  std::string text = TableHead(names);
  for (const ScenePairs& pairs : scenes) {
    std::vector<std::string> cells = {pairs[0].scene};
    for (const Quantity& quantity : kQuantities) cells.push_back(RatioCell(RatioOf(pairs, quantity)));
    const std::optional<MeanRatio> error = RatioOf(pairs, kQuantities[kError]);
    cells.push_back(error.has_value() ? VerdictCell(KeepsAccuracy(*error)) : "");
    const auto saves = [&](size_t quantity, double most) {
      return pairs[0].is_diffuse ? VerdictCell(RatioOf(pairs, kQuantities[quantity])->mean <= most) : "";
    };
    cells.push_back(saves(kWireBytes, kMostDiffuseBytes));
    cells.push_back(saves(kTotalTime, kMostDiffuseTime));
    absl::StrAppend(&text, TableLine(cells));
  }
  return text;
}

/// "1.23, 0.98": the mean of the full jobs, then of the planned ones.
std::string MeansCell(ScenePairs pairs, int digits, double (*value)(const PlannedJob& job)) {
  double full = 0;
  double planned = 0;
  for (const PlanPair& pair : pairs) {
    full += value(pair.full);
    planned += value(pair.planned);
  }
  const auto count = static_cast<double>(pairs.size());
  return absl::StrFormat("%.*f, %.*f", digits, full / count, digits, planned / count);
}

std::string MeansTable(const std::vector<ScenePairs>& scenes) {
  std::string text =
      TableHead({"scene", "what the plan decides otherwise", "planning, s", "rendering, s", "transfer, s",
                 "filter, s", "float32, MB", "wire, MB", "stored, MB", "MSE255"});
  for (const ScenePairs& pairs : scenes) {
    absl::StrAppend(
        &text,
        TableLine({pairs[0].scene, DifferencesOf(pairs),
                   MeansCell(pairs, 3, [](const PlannedJob& job) { return job.costs.plan_seconds; }),
                   MeansCell(pairs, 2, [](const PlannedJob& job) { return job.costs.render_seconds; }),
                   MeansCell(pairs, 2, [](const PlannedJob& job) { return job.costs.transfer_seconds; }),
                   MeansCell(pairs, 2, [](const PlannedJob& job) { return job.costs.filter_seconds; }),
                   MeansCell(pairs, 2, [](const PlannedJob& job) { return Mega(job.costs.float_bytes); }),
                   MeansCell(pairs, 2, [](const PlannedJob& job) { return Mega(job.costs.wire_bytes); }),
                   MeansCell(pairs, 2, [](const PlannedJob& job) { return Mega(job.costs.stored_bytes); }),
                   MeansCell(pairs, 3, [](const PlannedJob& job) { return job.mse255; })}));
  }
  return text;
}

std::string Csv(const std::vector<PlanPair>& pairs) {
  std::string text =
      "scene,seed,plan,camera_paths,rays,float_bytes,wire_bytes,stored_bytes,plan_seconds,render_seconds,"
      "transfer_seconds,filter_seconds,mse255\n";
  for (const PlanPair& pair : pairs) {
    for (const auto& [name, job] : {std::pair("full", &pair.full), std::pair("auto", &pair.planned)}) {
      const JobCosts& costs = job->costs;
      absl::StrAppendFormat(&text, "%s,%d,%s,%d,%d,%d,%d,%d,%.4f,%.4f,%.4f,%.4f,%.6g\n", pair.scene,
                            pair.seed, name, job->camera_paths, costs.rays, costs.float_bytes,
                            costs.wire_bytes, costs.stored_bytes, costs.plan_seconds, costs.render_seconds,
                            costs.transfer_seconds, costs.filter_seconds, job->mse255);
    }
  }
  return text;
}

Figure RatioFigure(const std::vector<ScenePairs>& scenes) {
  Figure figure{"What a plan saves", "planned over full, mean of the pairs", "", {}, {}};
  for (const ScenePairs& pairs : scenes) figure.rows.push_back(pairs[0].scene);
  for (const size_t quantity : {kWireBytes, kTotalTime, kError}) {
    Curve curve{kQuantities[quantity].name, Curve::Style::kDots, false, {}};
    for (size_t row = 0; row < scenes.size(); ++row) {
      const std::optional<MeanRatio> ratio = RatioOf(scenes[row], kQuantities[quantity]);
      if (ratio.has_value() && ratio->mean > 0)
        curve.points.emplace_back(ratio->mean, static_cast<double>(row));
    }
    figure.curves.push_back(std::move(curve));
  }
  const auto last_row = static_cast<double>(scenes.size());
  figure.curves.push_back({"the full plan", Curve::Style::kGuide, false, {{1, -0.8}, {1, last_row}}});
  return figure;
}

}  // namespace

bool KeepsAccuracy(const MeanRatio& error) {
  return error.mean <= kMostErrorRatio + 2 * error.standard_error;
}

std::string DifferencesOf(absl::Span<const PlanPair> pairs) {
  std::vector<std::string> texts;
  for (const decisions::Decision& decision : decisions::kAll) {
    std::set<int> values;
    for (const PlanPair& pair : pairs) {
      const auto found = pair.differences.find(std::string(decision.name));
      if (found != pair.differences.end()) values.insert(found->second);
    }
    if (values.empty()) continue;
    texts.push_back(
        absl::StrCat(std::string(decision.name), " ", decisions::ValueText(decision, *values.begin())));
    if (values.size() > 1)
      absl::StrAppend(&texts.back(), " to ", decisions::ValueText(decision, *values.rbegin()));
    const auto differs = [&](const PlanPair& pair) {
      return pair.differences.contains(std::string(decision.name));
    };
    if (!std::all_of(pairs.begin(), pairs.end(), differs)) absl::StrAppend(&texts.back(), " with some seeds");
  }
  return absl::StrJoin(texts, ", ");
}

absl::StatusOr<std::vector<PlanPair>> MeasurePlan(const std::string& scene, const FilmSource& source,
                                                  const FilmSettings& settings, int seeds,
                                                  const Reference& reference, const std::string& scratch,
                                                  TaskPool* pool) {
  absl::StatusOr<std::shared_ptr<const scene::Scene>> loaded = source.LoadScene();
  if (!loaded.ok()) return loaded.status();
  PairRun run(source, *std::move(loaded), settings, reference, scratch, pool);
  if (absl::Status status = run.WarmUp(); !status.ok()) return status;
  std::vector<PlanPair> pairs(static_cast<size_t>(seeds));
  for (size_t i = 0; i < pairs.size(); ++i) {
    pairs[i].scene = scene;
    if (absl::Status status = run.Measure(i + 1, &pairs[i]); !status.ok()) return status;
  }
  return pairs;
}

absl::StatusOr<bool> ChartPlan(const std::string& folder, const std::vector<PlanPair>& pairs,
                               const FilmSettings& settings, const Provenance& provenance,
                               DrawFormat format) {
  const std::vector<ScenePairs> scenes = ByScene(pairs);
  absl::StatusOr<bool> drawn = Draw(folder + "/plan-ratios", RatioFigure(scenes), format);
  if (!drawn.ok()) return drawn;
  if (absl::Status status = WriteFileAtomically(folder + "/plan.csv", Csv(pairs)); !status.ok())
    return status;
  const absl::Status status = WritePage(
      folder + "/plan.md", "What plans save", provenance,
      absl::StrFormat("Pairs of jobs with the same seed, at %dx%d with %d samples per pixel: "
                      "everything modelled, and what the "
                      "[plan](../plan.md) leaves of it. Both go through the code of worker and "
                      "coordinator, in one process and "
                      "without a network. The planned job pays for its probe, of a %dth of its samples.\n\n"
                      "## Planned over full\n\n"
                      "Mean of the ratios of %d pairs, ± its standard error where they differ. "
                      "Times are processor seconds. A "
                      "plan keeps accuracy if MSE255 rises by at most 1 %%, as far as two standard "
                      "errors can tell. Bytes on the "
                      "wire are those of the workers' messages: a plane whose values are all equal "
                      "takes four bytes there, "
                      "with any plan; the bytes as float32 tell what plans leave out.\n\n"
                      "![ratios](plan-ratios.svg)\n\n%s\n## Means, full and planned\n\n%s",
                      settings.width, settings.height, settings.samples, plan::kSamplesPerProbeSample,
                      static_cast<int>(scenes[0].size()), RatioTable(scenes), MeansTable(scenes)));
  if (!status.ok()) return status;
  return drawn;
}

}  // namespace lumifold::charts
