// Camera samples per second with all layers, the cost of the geometry unit, and the cost of a frame with and
// without layers. Scenes: the generated ones and, if LUMIFOLD_SCENES_DIR is set, staircase.glb. Compare
// figures of one run only, because the machine may be shared.
#include <benchmark/benchmark.h>
#include <time.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/parallel.h"
#include "tests/charts/access/charts_access.h"
#include "tests/scenes/glb_writer.h"
#include "tests/scenes/scenes.h"
#include "worker/plan/plan.h"
#include "worker/render/renderer.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold {
namespace {

constexpr int kWidth = 512;
constexpr int kHeight = 384;
constexpr int kTile = 32;
constexpr uint32_t kSamples = 8;
constexpr int kThreads = 2;

absl::StatusOr<scene::Scene> LoadScene(const std::string& name) {
  if (name == "staircase") {
    const char* folder = std::getenv("LUMIFOLD_SCENES_DIR");
    if (folder == nullptr) return absl::NotFoundError("LUMIFOLD_SCENES_DIR is not set");
    return scene::LoadGltfFile(std::string(folder) + "/staircase.glb");
  }
  const auto glb = scenes::EncodeGlb(scenes::FindScene(name)->build());
  if (!glb.ok()) return glb.status();
  return scene::LoadGltf(*glb, name, nullptr);
}

/// The scene's renderer, created once for all benchmarks; null, with a message, if the scene does not exist.
const render::Renderer* RendererOf(const std::string& name, benchmark::State& state) {
  static std::map<std::string, std::unique_ptr<render::Renderer>> known;
  if (!known.contains(name)) {
    absl::StatusOr<scene::Scene> scene = LoadScene(name);
    if (!scene.ok()) {
      state.SkipWithError(std::string(scene.status().message()).c_str());
      return nullptr;
    }
    render::RenderSettings settings;
    settings.width = kWidth;
    settings.height = kHeight;
    known[name] = *render::Renderer::Create(std::make_shared<scene::Scene>(*std::move(scene)), settings);
  }
  return known[name].get();
}

void RunTiles(TaskPool& pool, absl::FunctionRef<void(const Rect&)> render) {
  constexpr int kColumns = kWidth / kTile;
  pool.Run(kColumns * (kHeight / kTile), [&](int64_t i) {
    const int x = static_cast<int>(i) % kColumns * kTile;
    const int y = static_cast<int>(i) / kColumns * kTile;
    render({x, y, x + kTile, y + kTile});
  });
}

void BM_Passes(benchmark::State& state, const std::string& name) {
  const render::Renderer* renderer = RendererOf(name, state);
  if (renderer == nullptr) return;
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(kThreads);
  for ([[maybe_unused]] auto _ : state) {
    RunTiles(*pool, [&](const Rect& tile) {
      render::RenderCounts counts;
      benchmark::DoNotOptimize(renderer->RenderPass(tile, 0, {0, kSamples}, &counts));
    });
  }
  state.counters["samples/s"] = benchmark::Counter(
      static_cast<double>(state.iterations()) * kWidth * kHeight * kSamples, benchmark::Counter::kIsRate);
}

void BM_Geometry(benchmark::State& state, const std::string& name) {
  const render::Renderer* renderer = RendererOf(name, state);
  if (renderer == nullptr) return;
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(kThreads);
  for ([[maybe_unused]] auto _ : state) {
    RunTiles(*pool, [&](const Rect& tile) { benchmark::DoNotOptimize(renderer->RenderGeometry(tile, 0)); });
  }
  state.counters["pixels/s"] = benchmark::Counter(static_cast<double>(state.iterations()) * kWidth * kHeight,
                                                  benchmark::Counter::kIsRate);
}

/// The cost of a frame with all layers and features, or of C alone, as processor time of all threads. For
/// their ratio use --benchmark_enable_random_interleaving=true --benchmark_repetitions=N and the minimum of
/// each.
void BM_Frame(benchmark::State& state, const std::string& name, bool radiance_only) {
  const render::Renderer* renderer = RendererOf(name, state);
  if (renderer == nullptr) return;
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(kThreads);
  constexpr uint32_t kFrameSamples = 64;
  for ([[maybe_unused]] auto _ : state) {
    RunTiles(*pool, [&](const Rect& tile) {
      render::RenderCounts counts;
      const SampleRange range = {0, kFrameSamples};
      if (radiance_only) {
        benchmark::DoNotOptimize(render::ChartsAccess(*renderer).RenderRadiance(tile, 0, range, &counts));
      } else {
        benchmark::DoNotOptimize(renderer->RenderPass(tile, 0, range, &counts));
        benchmark::DoNotOptimize(renderer->RenderGeometry(tile, 0));
      }
    });
  }
  state.counters["samples/s"] =
      benchmark::Counter(static_cast<double>(state.iterations()) * kWidth * kHeight * kFrameSamples,
                         benchmark::Counter::kIsRate);
}

double ThreadSeconds() {
  timespec now = {};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double SecondsOfPass(const render::Renderer& renderer, const Rect& rect, SampleRange samples = {0, 16}) {
  render::RenderCounts counts;
  const double start = ThreadSeconds();
  benchmark::DoNotOptimize(renderer.RenderPass(rect, 0, samples, &counts));
  return ThreadSeconds() - start;
}

/// The time of a planned pass over that of a full one: the median of pairs that are rendered in turn.
void BM_PlannedOverFull(benchmark::State& state, const std::string& name) {
  auto loaded = LoadScene(name);
  if (!loaded.ok()) return state.SkipWithError(std::string(loaded.status().message()).c_str());
  const auto scene = std::make_shared<const scene::Scene>(*std::move(loaded));
  const Rect frame = {0, 0, 160, 120};
  plan::PlanSettings settings;
  settings.render.width = frame.width();
  settings.render.height = frame.height();
  const plan::Plan plan =
      *plan::MakePlan(*scene, settings, *plan::RunProbe(*scene, settings.render, settings.samples));
  const auto full = *render::Renderer::Create(scene, settings.render);
  settings.render.plan = plan.tracing;
  settings.render.max_bounces = plan.max_bounces;
  const auto planned = *render::Renderer::Create(scene, settings.render);
  std::vector<double> ratios;
  for ([[maybe_unused]] auto _ : state) {
    const double seconds = SecondsOfPass(*planned, frame);
    ratios.push_back(seconds / SecondsOfPass(*full, frame));
  }
  std::sort(ratios.begin(), ratios.end());
  state.counters["median"] = ratios[ratios.size() / 2];
  state.counters["least"] = ratios.front();
  state.counters["most"] = ratios.back();
}

/// What fragments cost: the time of the first pass over a tile, which finds its edge pixels, and of a later
/// one, over that of a pass without D, I and G, which has no fragments but traces the same. Medians over
/// tiles that are rendered in turn.
void BM_Fragments(benchmark::State& state, const std::string& name, uint32_t samples) {
  auto loaded = LoadScene(name);
  if (!loaded.ok()) return state.SkipWithError(std::string(loaded.status().message()).c_str());
  const auto scene = std::make_shared<const scene::Scene>(*std::move(loaded));
  render::RenderSettings settings;
  settings.width = kWidth;
  settings.height = kHeight;
  const auto with = *render::Renderer::Create(scene, settings);
  settings.plan.layers.direct = settings.plan.layers.indirect = settings.plan.layers.glossy = false;
  const auto without = *render::Renderer::Create(scene, settings);
  std::vector<double> first;
  std::vector<double> later;
  int tile = 0;
  for ([[maybe_unused]] auto _ : state) {
    const int number = tile++ * 37 % (kWidth * kHeight / kTile / kTile);  // all over the picture
    const int x = number % (kWidth / kTile) * kTile;
    const int y = number / (kWidth / kTile) * kTile;
    const Rect rect = {x, y, x + kTile, y + kTile};
    const double seconds = SecondsOfPass(*without, rect, {0, samples});
    first.push_back(SecondsOfPass(*with, rect, {0, samples}) / seconds);
    later.push_back(SecondsOfPass(*with, rect, {0, samples}) / seconds);
  }
  for (std::vector<double>* ratios : {&first, &later}) std::sort(ratios->begin(), ratios->end());
  state.counters["first"] = first[first.size() / 2];
  state.counters["later"] = later[later.size() / 2];
}

BENCHMARK_CAPTURE(BM_Fragments, cornell_box_16, "cornell-box", 16)->Iterations(31);
BENCHMARK_CAPTURE(BM_Fragments, cornell_box_64, "cornell-box", 64)->Iterations(31);
BENCHMARK_CAPTURE(BM_Fragments, bedroom_16, "bedroom", 16)->Iterations(31);
BENCHMARK_CAPTURE(BM_Fragments, bedroom_64, "bedroom", 64)->Iterations(31);
BENCHMARK_CAPTURE(BM_Fragments, staircase_16, "staircase", 16)->Iterations(31);
BENCHMARK_CAPTURE(BM_PlannedOverFull, cornell_box, "cornell-box")->Iterations(31)->UseRealTime();
BENCHMARK_CAPTURE(BM_PlannedOverFull, bedroom, "bedroom")->Iterations(5)->UseRealTime();
BENCHMARK_CAPTURE(BM_Passes, cornell_box, "cornell-box")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Passes, meeting_room, "meeting-room")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Passes, bedroom, "bedroom")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Passes, atrium, "atrium")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Passes, staircase, "staircase")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Frame, cornell_box_radiance_only, "cornell-box", true)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->Iterations(1);
BENCHMARK_CAPTURE(BM_Frame, cornell_box_all_layers, "cornell-box", false)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->Iterations(1);
BENCHMARK_CAPTURE(BM_Geometry, cornell_box, "cornell-box")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Geometry, atrium, "atrium")->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace lumifold

BENCHMARK_MAIN();
