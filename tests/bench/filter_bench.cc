// Megapixels per second of the manifolds alone and of the whole default filter, on a synthetic film. Compare
// figures within one run: the machine may be shared.
#include <benchmark/benchmark.h>

#include <memory>
#include <random>

#include "filter/image/parallel.h"
#include "filter/manifold/manifold_filter.h"
#include "filter/methods.h"
#include "tests/unit/filter/synthetic_film.h"

namespace lumifold::filter {
namespace {

constexpr int kWidth = 1024;
constexpr int kHeight = 768;

void CountPixels(benchmark::State& state) {
  state.counters["pixels/s"] = benchmark::Counter(static_cast<double>(state.iterations()) * kWidth * kHeight,
                                                  benchmark::Counter::kIsRate);
}

/// Planes of steps of 64 pixels with noise on top, so that manifolds have something to split.
Planes NoisySteps(size_t count, uint32_t seed) {
  Planes planes = MakePlanes(count, kWidth, kHeight);
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> noise(0.0f, 1.0f);
  for (size_t k = 0; k < count; ++k) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const int step = (x / 64 * static_cast<int>(k + 3) + y / 64 * static_cast<int>(2 * k + 1)) % 5;
        planes[k].At(x, y) = static_cast<float>(step) + noise(random);
      }
    }
  }
  return planes;
}

/// C = 6 signals (D and I), d = 10 features, 15 manifolds; features ready.
void BM_Manifolds(benchmark::State& state) {
  const Planes signals = NoisySteps(6, 1);
  const Planes features = NoisySteps(10, 2);
  Plane mask(kWidth, kHeight);
  mask.Fill(1);
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(ManifoldFilter(signals, features, mask.view(), ManifoldParams{}, pool.get()));
  }
  CountPixels(state);
}

void BM_Film(benchmark::State& state, const char* method) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(kWidth, kHeight, 0.3f, 3);
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    const auto picture = FilterFilm(synthetic.film, method, pool.get());
    if (!picture.ok()) return state.SkipWithError(std::string(picture.status().message()).c_str());
    benchmark::DoNotOptimize(picture->data());
  }
  CountPixels(state);
}

BENCHMARK(BM_Manifolds)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Film, paper, "paper")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Film, default, "default")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace lumifold::filter

BENCHMARK_MAIN();
