// Megapixels per second of the manifolds alone and of the whole default filter, on a synthetic film. Compare
// figures within one run: the machine may be shared.
#include <benchmark/benchmark.h>

#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "filter/image/memory.h"
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
  while (state.KeepRunning()) {
    benchmark::DoNotOptimize(ManifoldFilter(signals, features, mask.view(), ManifoldParams{}, pool.get()));
  }
  CountPixels(state);
}

/// As much work as opencv_ratio.py gives to OpenCV: 3 signals, 9 features, 7 manifolds.
void BM_SevenManifolds(benchmark::State& state) {
  const Planes signals = NoisySteps(3, 1);
  const Planes features = NoisySteps(9, 2);
  Plane mask(kWidth, kHeight);
  mask.Fill(1);
  ManifoldParams params;
  params.height = 3;
  while (state.KeepRunning())
    benchmark::DoNotOptimize(ManifoldFilter(signals, features, mask.view(), params, nullptr));
  CountPixels(state);
}

/// BM_Manifolds with 16 points in a twentieth of the pixels, as on edges: what their slices cost.
void BM_ManifoldsAndPoints(benchmark::State& state) {
  const Planes signals = NoisySteps(6, 1);
  const Planes features = NoisySteps(10, 2);
  Plane mask(kWidth, kHeight);
  mask.Fill(1);
  SlicePoints points;
  points.own_features = 4;
  for (int i = 0; i < kWidth * kHeight; i += 20) {
    for (int j = 0; j < 16; ++j) {
      points.pixels.push_back({i % kWidth, i / kWidth});
      for (size_t k = 6; k < 10; ++k) points.features.push_back(features[k].At(i % kWidth, i / kWidth));
    }
  }
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(static_cast<int>(state.range(0)));
  const ManifoldParams params;
  while (state.KeepRunning()) {
    benchmark::DoNotOptimize(
        ManifoldFilterAtPoints(signals, features, mask.view(), params, params.sigma_s, &points, pool.get()));
  }
  CountPixels(state);
}

void BM_Film(benchmark::State& state, const char* method) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(kWidth, kHeight, 0.3f, 3);
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(static_cast<int>(state.range(0)));
  while (state.KeepRunning()) {
    const auto picture = FilterFilm(synthetic.film, method, pool.get());
    if (!picture.ok()) return state.SkipWithError(std::string(picture.status().message()).c_str());
    benchmark::DoNotOptimize(picture->data());
  }
  CountPixels(state);
}

/// A film of any size: a small one, repeated.
class RepeatedFilm final : public FilmSource {
 public:
  RepeatedFilm(const LayeredImage& film, int width, int height)
      : film_(film), width_(width), height_(height) {}

  int width() const override { return width_; }
  int height() const override { return height_; }
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override {
    LayeredImage part(rect.width(), rect.height());
    for (const LayeredImage::Channel& channel : film_.channels()) {
      const FloatView out = part.Add(channel.name);
      for (int y = 0; y < rect.height(); ++y) {
        const float* row = channel.plane.Row((rect.y0 + y) % film_.height());
        for (int x = 0; x < rect.width(); ++x) out.At(x, y) = row[(rect.x0 + x) % film_.width()];
      }
    }
    return EdgedImage{std::move(part), {}};
  }

 private:
  const LayeredImage& film_;
  int width_;
  int height_;
};

/// The default method at any size, larger ones in blocks: the time of a pixel should not depend on it.
void BM_Size(benchmark::State& state) {
  const SyntheticFilm synthetic = MakeSyntheticFilm(kWidth, kHeight, 0.3f, 3);
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(2);
  RepeatedFilm film(synthetic.film, static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  while (state.KeepRunning()) {
    const absl::Status status = FilterFilmInRows(&film, "default", {}, pool.get(),
                                                 [](const LayeredImage&) { return absl::OkStatus(); });
    if (!status.ok()) return state.SkipWithError(std::string(status.message()).c_str());
  }
  state.counters["pixels/s"] = benchmark::Counter(
      static_cast<double>(state.iterations()) * static_cast<double>(state.range(0) * state.range(1)),
      benchmark::Counter::kIsRate);
}

/// out = a + 3 b over arrays larger than every cache: what the machine's memory gives, to compare traffic
/// with.
void BM_Triad(benchmark::State& state) {
  constexpr size_t kFloats = size_t{64} << 20;
  const std::vector<float> a(kFloats, 1.0f);
  const std::vector<float> b(kFloats, 2.0f);
  std::vector<float> out(kFloats);
  constexpr int64_t kParts = 256;
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(static_cast<int>(state.range(0)));
  while (state.KeepRunning()) {
    ParallelFor(pool.get(), kParts, [&](int64_t part) {
      const size_t first = static_cast<size_t>(part) * (kFloats / kParts);
      for (size_t i = first; i < first + kFloats / kParts; ++i) out[i] = a[i] + 3.0f * b[i];
    });
    benchmark::DoNotOptimize(out.data());
  }
  state.SetBytesProcessed(state.iterations() * static_cast<int64_t>(3 * kFloats * sizeof(float)));
}

BENCHMARK(BM_Manifolds)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(BM_SevenManifolds)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_ManifoldsAndPoints)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Film, paper, "paper")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Film, default, "default")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(BM_Size)
    ->Args({384, 256})
    ->Args({1024, 768})
    ->Args({2048, 1536})
    ->Args({4096, 3072})
    ->Args({8192, 6144})
    ->Args({16384, 8192})
    ->Unit(benchmark::kSecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK(BM_Triad)->Arg(1)->Arg(2)->UseRealTime();

}  // namespace
}  // namespace lumifold::filter

int main(int argc, char** argv) {
  lumifold::KeepFreedMemory();  // as the programs that filter do
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
}
