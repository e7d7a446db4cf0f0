// Properties of any film: more samples reduce the error, seeds and frames agree, odd input gives finite
// output.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "filter/image/layers.h"
#include "filter/metrics/blotch.h"
#include "filter/metrics/flicker.h"
#include "filter/metrics/metrics.h"
#include "filter/metrics/seeds.h"
#include "tests/stability/case.h"
#include "tests/stability/drawings.h"
#include "tests/stability/test_scenes.h"

namespace lumifold::stability {
namespace {

using Figures = std::vector<double>;

constexpr int kWidth = 96;
constexpr int kHeight = 72;

bool Everywhere(int, int) { return true; }

/// One of several runs with other sample counts, seeds, or camera positions.
struct Run {
  Picture noisy, filtered, truth;
};

absl::StatusOr<Run> Filter(const Trial& trial, DrawnFilm drawn) {
  absl::StatusOr<Picture> filtered = trial.Filter({drawn.film});
  if (!filtered.ok()) return filtered.status();
  const ConstColorView noisy = std::as_const(drawn.film.pixels).GetColor(layers::kNoisy);
  return Run{ClonePicture(noisy), *std::move(filtered), std::move(drawn.truth)};
}

Exhibit Show(Run run) { return {std::move(run.noisy), std::move(run.filtered), std::move(run.truth)}; }

double Error(const Picture& picture, const Picture& truth) {
  return DisplayError(ViewOf(picture), ViewOf(truth), Everywhere);
}

absl::StatusOr<Finding> MoreSamples(const Trial& trial) {
  Finding finding;
  double worst_left = 0;
  double flattest = -10;
  double before = 0;
  double first = 0;
  for (uint32_t samples = 1; samples <= 4096; samples *= 4) {
    absl::StatusOr<Run> run =
        Filter(trial, DrawFilm(kWidth, kHeight, RoomDrawing(kWidth, kHeight), {.samples = samples}));
    if (!run.ok()) return run.status();
    const double error = Error(run->filtered, run->truth);
    worst_left = std::max(worst_left, error / Error(run->noisy, run->truth));
    if (samples == 1) first = error;
    if (samples > 1) flattest = std::max(flattest, std::log(error / before) / std::log(4.0));
    before = error;
    if (samples == 16) finding.exhibit = Show(*std::move(run));
  }
  finding.figures = {std::log(before / first) / std::log(4096.0), flattest, worst_left};
  return finding;
}

absl::StatusOr<Finding> RealSamples(const Trial& trial) {
  const scenes::SceneDescription scene = MirrorRoom();
  Finding finding;
  double worst = 0;
  for (uint32_t samples = 1; samples <= 1024; samples *= 4) {
    const absl::StatusOr<JudgedFilm> judged = trial.films.GetJudged(
        scene, {.width = 48, .height = 36, .samples = samples, .seed = 1}, 4096, trial.pool);
    if (!judged.ok()) return judged.status();
    absl::StatusOr<Picture> filtered = trial.Filter(judged->rendered.subject());
    if (!filtered.ok()) return filtered.status();
    const LayeredImage& reference = judged->reference.pixels;
    const ConstColorView truth = reference.GetColor(layers::kNoisy);
    const ConstColorView noisy = judged->rendered.film.pixels.GetColor(layers::kNoisy);
    const double own = DisplayError(reference.GetColor(layers::HalfA(layers::kNoisy)),
                                    reference.GetColor(layers::HalfB(layers::kNoisy)), Everywhere) /
                       4;
    worst = std::max(worst, (DisplayError(ViewOf(*filtered), truth, Everywhere) - own) /
                                (DisplayError(noisy, truth, Everywhere) - own));
    if (samples == 16) finding.exhibit = {ClonePicture(noisy), *std::move(filtered), ClonePicture(truth)};
  }
  finding.figures = {worst};
  return finding;
}

absl::StatusOr<Finding> Seeds(const Trial& trial) {
  double noisy_flicker = 0, flicker = 0, luminance = 0, chroma = 0;
  constexpr int kSeeds = 8;
  std::vector<Run> runs;
  for (uint32_t seed = 1; seed <= kSeeds; ++seed) {
    absl::StatusOr<Run> run =
        Filter(trial, DrawFilm(kWidth, kHeight, FlatRoomDrawing(kWidth, kHeight), {.seed = seed}));
    if (!run.ok()) return run.status();
    const auto blotch = metrics::MeasureBlotch(ViewOf(run->filtered), ViewOf(run->noisy), ViewOf(run->truth));
    if (!blotch.ok()) return blotch.status();
    luminance += blotch->luminance / kSeeds;
    chroma += blotch->chroma / kSeeds;
    if (!runs.empty()) {
      flicker += metrics::MeasureFlicker(ViewOf(runs.back().filtered), ViewOf(run->filtered)).mean;
      noisy_flicker += metrics::MeasureFlicker(ViewOf(runs.back().noisy), ViewOf(run->noisy)).mean;
    }
    runs.push_back(*std::move(run));
  }
  return Finding{{flicker / noisy_flicker, luminance, chroma}, Show(std::move(runs.back()))};
}

absl::StatusOr<Finding> RealSeeds(const Trial& trial) {
  const scenes::SceneDescription scene = MirrorRoom();
  constexpr uint64_t kSeeds = 8;
  std::vector<Picture> filtered;
  std::vector<Picture> noisy;
  Picture truth;
  for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const absl::StatusOr<JudgedFilm> judged = trial.films.GetJudged(
        scene, {.width = kWidth, .height = kHeight, .samples = 16, .seed = seed}, 512, trial.pool);
    if (!judged.ok()) return judged.status();
    absl::StatusOr<Picture> picture = trial.Filter(judged->rendered.subject());
    if (!picture.ok()) return picture.status();
    filtered.push_back(*std::move(picture));
    noisy.push_back(ClonePicture(judged->rendered.film.pixels.GetColor(layers::kNoisy)));
    if (seed == 1) truth = ClonePicture(judged->reference.pixels.GetColor(layers::kNoisy));
  }
  const auto measure = [&](const std::vector<Picture>& pictures) {
    std::vector<ConstColorView> views;
    for (const Picture& picture : pictures) views.push_back(ViewOf(picture));
    return metrics::MeasureSeeds(views, ViewOf(truth));
  };
  const auto ours = measure(filtered);
  if (!ours.ok()) return ours.status();
  const auto input = measure(noisy);
  if (!input.ok()) return input.status();
  // With a reference of 32 times the samples, a 32nd of the noise counts as bias.
  const double own = input->variance / 32;
  return Finding{{ours->variance / input->variance, (ours->bias_squared - own) / input->variance},
                 {std::move(noisy[0]), std::move(filtered[0]), std::move(truth)}};
}

absl::StatusOr<Finding> Pan(const Trial& trial) {
  constexpr int kFrames = 16;
  metrics::Flicker filtered, truth;
  Run before;
  for (int frame = 0; frame < kFrames; ++frame) {
    absl::StatusOr<Run> run = Filter(
        trial, DrawFilm(kWidth, kHeight, RoomDrawing(kWidth, kHeight, 0.7f * static_cast<float>(frame)),
                        {.samples = 64, .seed = static_cast<uint32_t>(frame + 1)}));
    if (!run.ok()) return run.status();
    if (frame > 0) {
      const metrics::Flicker change = metrics::MeasureFlicker(ViewOf(before.filtered), ViewOf(run->filtered));
      const metrics::Flicker expected = metrics::MeasureFlicker(ViewOf(before.truth), ViewOf(run->truth));
      filtered.mean += change.mean, filtered.percentile99 += change.percentile99;
      truth.mean += expected.mean, truth.percentile99 += expected.percentile99;
    }
    before = *std::move(run);
  }
  return Finding{{filtered.mean / truth.mean, filtered.percentile99 / truth.percentile99},
                 Show(std::move(before))};
}

absl::StatusOr<Finding> NoisyFeatures(const Trial& trial) {
  const Drawing drawing = RoomDrawing(kWidth, kHeight);
  Sampling sampling;
  absl::StatusOr<Run> sharp = Filter(trial, DrawFilm(kWidth, kHeight, drawing, sampling));
  if (!sharp.ok()) return sharp.status();
  sampling.feature_noise = 0.2f;
  absl::StatusOr<Run> blurred = Filter(trial, DrawFilm(kWidth, kHeight, drawing, sampling));
  if (!blurred.ok()) return blurred.status();
  const double left = Error(blurred->filtered, blurred->truth) / Error(blurred->noisy, blurred->truth);
  const double clean = Error(sharp->filtered, sharp->truth) / Error(sharp->noisy, sharp->truth);
  return Finding{{left, left / clean}, Show(*std::move(blurred))};
}

/// Writes bad numbers into some pixels of a layer and its halves.
void Poison(std::string_view layer, LayeredImage* film) {
  const float bad[] = {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                       -std::numeric_limits<float>::infinity(), -1e30f, 1e38f};
  size_t next = 0;
  for (const std::string& name : {std::string(layer), layers::HalfA(layer), layers::HalfB(layer)}) {
    const ColorView color = film->GetColor(name);
    for (int y = 3; y < film->height(); y += 11) {
      for (int x = 5; x < film->width(); x += 13, ++next) color[next % 3].At(x, y) = bad[next % 5];
    }
  }
}

absl::StatusOr<Finding> OddInput(const Trial& trial) {
  constexpr int kSize = 48;
  const auto two_values = [](float x, float) {
    Surface s;
    s.direct = Gray(x < kSize / 2 ? 0.2f : 0.7f);
    s.normal = x < kSize / 2 ? Triple{1, 0, 0} : Triple{0, 1, 0};
    return s;
  };
  const auto one_value = [](float, float) {
    Surface s;
    s.direct = Gray(0.5f);
    return s;
  };
  const auto nearly_all_sky = [](float x, float y) {
    Surface s;
    s.object = x < 1 && y < 1 ? 1 : 0;
    s.direct = Gray(0.5f);
    return s;
  };
  Finding finding;
  int bad = 0;
  for (const Drawing& drawing :
       {Drawing(two_values), Drawing(one_value), Drawing(nearly_all_sky), RoomDrawing(kSize, kSize)}) {
    for (const float noise : {0.0f, 1.0f}) {
      for (const bool is_poisoned : {false, true}) {
        DrawnFilm drawn = DrawFilm(kSize, kSize, drawing, {.samples = 4, .noise = noise});
        if (is_poisoned) {
          for (const std::string_view layer : {layers::kNoisy, layers::kDirect, layers::kIndirect})
            Poison(layer, &drawn.film.pixels);
        }
        absl::StatusOr<Run> run = Filter(trial, std::move(drawn));
        if (!run.ok()) return run.status();
        bad += CountNotFinite(ViewOf(run->filtered));
        finding.exhibit = Show(*std::move(run));
      }
    }
  }
  finding.figures = {static_cast<double>(bad)};
  return finding;
}

absl::StatusOr<Finding> PerfectInput(const Trial& trial) {
  // With 32 samples each half has all 16 points of a pixel, so even coverage has no noise.
  const DrawnFilm drawn = DrawFilm(128, 96, RoomDrawing(128, 96), {.samples = 32, .noise = 0});
  return Judge(trial, drawn,
               [](const Views& v) { return Figures{std::min(200.0, metrics::Psnr(v.filtered, v.noisy))}; });
}

}  // namespace

std::vector<Case> RobustnessCases() {
  return {
      {24,
       "more samples",
       "a room with 1, 4, ... 4096 samples: log-log slope of the error; the flattest between two; the "
       "largest "
       "error",
       "96x72, 1 to 4096 spp",
       "added: no slope above -0.1, and never worse than the input",
       {{"slope", -0.5}, {"flattest", -0.1}, {"error", 1}},
       MoreSamples},
      {27,
       "seeds",
       "a flat room with 8 seeds: mean change between seeds over the noisy one; blotch index of "
       "luminance and of chroma",
       "96x72, 16 spp",
       "",
       {{"flicker", 0.2}, {"blotch", 1.05}, {"chroma", 1.05}},
       Seeds},
      {32,
       "blurred features",
       "normals and distances noisy as by defocus (0.2): error; error over that with clean features",
       "96x72, 16 spp",
       "was: better with filtered features than without; the method does not filter features, so the cost of "
       "their noise is limited instead",
       {{"error", 0.5}, {"over clean", 4}},
       NoisyFeatures},
      {33,
       "odd input",
       "films of two values, of one, of one pixel; without noise; with NaN, infinities, 1e38: pixels not "
       "finite",
       "16 films, 48x48",
       "",
       {{"bad", 0}},
       OddInput},
      {34,
       "perfect input",
       "light without noise: PSNR of the result against the input in dB",
       "128x96, 32 spp",
       "",
       {{"PSNR", 60, true}},
       PerfectInput},
      {42,
       "real samples",
       "a room with mirrors with 1, 4, ... 1024 samples: the largest error",
       "48x36, 1 to 1024 spp",
       "",
       {{"error", 1}},
       RealSamples},
      {43,
       "real seeds",
       "a room with mirrors with 8 seeds: variance and bias^2 over the noisy variance",
       "96x72, 16 spp",
       "",
       {{"variance", 0.2}, {"bias^2", 0.2}},
       RealSeeds},
      {44,
       "slow pan",
       "16 frames, the camera moves by 0.7 px per frame: mean change and 99th percentile over those of the "
       "truth",
       "96x72, 64 spp",
       "",
       {{"mean", 2}, {"99 %", 1.25}},
       Pan},
  };
}

}  // namespace lumifold::stability
