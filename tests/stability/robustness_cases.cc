// Properties of any film: more samples reduce the error, seeds and frames agree, odd input gives finite
// output.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <numeric>
#include <string_view>
#include <utility>

#include "filter/image/layers.h"
#include "filter/metrics/metrics.h"
#include "tests/charts/metrics/blotch.h"
#include "tests/charts/metrics/flicker.h"
#include "tests/charts/metrics/seeds.h"
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
    worst = std::max(worst, judged->ErrorOf(ViewOf(*filtered)) / judged->ErrorOf(judged->noisy()));
    if (samples == 16)
      finding.exhibit = {ClonePicture(judged->noisy()), *std::move(filtered), ClonePicture(judged->truth())};
  }
  finding.figures = {worst};
  return finding;
}

absl::StatusOr<Finding> Lens(const Trial& trial) {
  constexpr uint64_t kSeeds = 8;  // one film has a lone pixel by chance
  Finding finding;
  for (const char* scene : {"chess-board-lens", "foliage-lens"}) {
    double filtered_error = 0, noisy_error = 0, lone = 0;
    for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
      const absl::StatusOr<JudgedFilm> judged = trial.films.GetJudged(
          scene, {.width = kWidth, .height = kHeight, .samples = 16, .seed = seed}, 512, trial.pool);
      if (!judged.ok()) return judged.status();
      absl::StatusOr<Picture> filtered = trial.Filter(judged->rendered.subject());
      if (!filtered.ok()) return filtered.status();
      filtered_error += judged->ErrorOf(ViewOf(*filtered));
      noisy_error += judged->ErrorOf(judged->noisy());
      lone += LonePixels(ViewOf(*filtered), judged->truth()) / kSeeds;
      if (seed == 1) {
        finding.exhibit = {ClonePicture(judged->noisy()), *std::move(filtered),
                           ClonePicture(judged->truth())};
      }
    }
    finding.figures.insert(finding.figures.end(), {filtered_error / noisy_error, lone});
  }
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

/// Changes from frame to frame that the truth does not have, of the filtered and the noisy pixels of a
/// region, as means over channels in 8-bit steps.
struct ExcessChanges {
  std::vector<double> filtered, noisy;

  /// The mean and the 99th percentile, filtered over noisy.
  double Mean() const { return Sum(filtered) / Sum(noisy); }
  double Percentile99() { return Rank99(&filtered) / Rank99(&noisy); }

 private:
  static double Sum(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0);
  }
  static double Rank99(std::vector<double>* values) {
    const auto at = values->begin() + static_cast<std::ptrdiff_t>(values->size() * 99 / 100);
    std::nth_element(values->begin(), at, values->end());
    return *at;
  }
};

/// Adds the pixels whose truth hardly changes from one frame to the next to `still`, the others to `moving`.
void AddChanges(const Run& before, const Run& after, ExcessChanges* still, ExcessChanges* moving) {
  constexpr double kVisible = 1;
  const auto change = [](const Picture& a, const Picture& b, size_t c, int x, int y) {
    return 255 * static_cast<double>(SrgbFromLinear(b[c].At(x, y)) - SrgbFromLinear(a[c].At(x, y)));
  };
  ForEachPixel(kWidth, kHeight, [&](int x, int y) {
    double expected = 0, filtered = 0, noisy = 0;
    for (size_t c = 0; c < 3; ++c) {
      const double truth = change(before.truth, after.truth, c, x, y);
      expected += std::abs(truth) / 3;
      filtered += std::abs(change(before.filtered, after.filtered, c, x, y) - truth) / 3;
      noisy += std::abs(change(before.noisy, after.noisy, c, x, y) - truth) / 3;
    }
    ExcessChanges& region = expected < kVisible ? *still : *moving;
    region.filtered.push_back(filtered);
    region.noisy.push_back(noisy);
  });
}

absl::StatusOr<Finding> Pan(const Trial& trial) {
  constexpr int kFrames = 16;
  ExcessChanges still, moving;
  Run before;
  for (int frame = 0; frame < kFrames; ++frame) {
    absl::StatusOr<Run> run = Filter(
        trial, DrawFilm(kWidth, kHeight, RoomDrawing(kWidth, kHeight, 0.7f * static_cast<float>(frame)),
                        {.samples = 64, .seed = static_cast<uint32_t>(frame + 1)}));
    if (!run.ok()) return run.status();
    if (frame > 0) AddChanges(before, *run, &still, &moving);
    before = *std::move(run);
  }
  return Finding{{still.Mean(), moving.Mean(), moving.Percentile99()}, Show(std::move(before))};
}

/// The channels that a lens blurs.
constexpr std::string_view kFeatures[] = {layers::kNormalX, layers::kNormalY, layers::kNormalZ,
                                          layers::kDistance};

/// Mean squared difference of the 3x3 pixels around two pixels. The border is repeated.
double PatchDifference(const ConstFloatView& plane, int x, int y, int i, int j) {
  const auto at = [&](int column, int row) {
    return plane.At(std::clamp(column, 0, plane.width() - 1), std::clamp(row, 0, plane.height() - 1));
  };
  double sum = 0;
  for (int v = -1; v <= 1; ++v) {
    for (int u = -1; u <= 1; ++u) {
      const double difference = static_cast<double>(at(x + u, y + v) - at(i + u, j + v));
      sum += difference * difference / 9;
    }
  }
  return sum;
}

/// The mean of the pixels within 5 of (x, y), weighted by how alike their patches are beyond the noise.
float NonLocalMean(const ConstFloatView& plane, int x, int y, double variance) {
  constexpr int kReach = 5;
  constexpr double kStrength = 0.5;
  double sum = 0, weights = 0;
  for (int j = std::max(y - kReach, 0); j <= std::min(y + kReach, plane.height() - 1); ++j) {
    for (int i = std::max(x - kReach, 0); i <= std::min(x + kReach, plane.width() - 1); ++i) {
      const double excess = PatchDifference(plane, x, y, i, j) - 2 * variance;
      const double weight = std::exp(-std::max(0.0, excess) / (2 * kStrength * kStrength * variance));
      sum += weight * static_cast<double>(plane.At(i, j));
      weights += weight;
    }
  }
  return static_cast<float>(sum / weights);
}

/// Filters the normals and the distance of a film by non-local means (Rousselle et al. 2013). `noise`:
/// standard deviation of a normal, and relative of a distance.
void FilterFeatures(float noise, LayeredImage* film) {
  for (const std::string_view name : kFeatures) {
    const FloatView feature = film->Get(name);
    Plane filtered(film->width(), film->height());
    ForEachPixel(film->width(), film->height(), [&](int x, int y) {
      const float deviation = noise * (name == layers::kDistance ? std::max(feature.At(x, y), 1e-3f) : 1);
      filtered.At(x, y) =
          NonLocalMean(feature, x, y, static_cast<double>(deviation) * static_cast<double>(deviation));
    });
    CopyPlane(filtered.view(), feature);
  }
}

absl::StatusOr<Finding> NoisyFeatures(const Trial& trial) {
  const Sampling sampling = {.feature_noise = 0.2f};
  const auto draw = [&] { return DrawFilm(kWidth, kHeight, RoomDrawing(kWidth, kHeight), sampling); };
  DrawnFilm drawn = draw();
  FilterFeatures(sampling.feature_noise, &drawn.film.pixels);
  absl::StatusOr<Run> by_filtered = Filter(trial, std::move(drawn));
  if (!by_filtered.ok()) return by_filtered.status();
  absl::StatusOr<Run> blurred = Filter(trial, draw());
  if (!blurred.ok()) return blurred.status();
  const double error = Error(blurred->filtered, blurred->truth);
  const double left = error / Error(blurred->noisy, blurred->truth);
  return Finding{{left, error / Error(by_filtered->filtered, by_filtered->truth)}, Show(*std::move(blurred))};
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
       "normals and distances noisy as by defocus (0.2): error; error over that where non-local means filter "
       "the features first",
       "96x72, 16 spp",
       "",
       {{"error", 0.5}, {"over filtered", 1}},
       NoisyFeatures,
       KnownFailure{
           {0.25, 1.75},
           "no stage filters features; if non-local means filtered them first, 0.6 of the error would "
           "be left"}},
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
       "16 frames, the camera moves by 0.7 px per frame: change beyond that of the truth over the noisy "
       "picture's, mean of pixels whose truth changes by less than 1 of 255 steps, mean of the others and "
       "their 99th percentile",
       "96x72, 64 spp",
       "was: change at most twice that of the truth, which the truth's own change at edges hid; 0.2 is the "
       "flicker of seeds, 0.55 the root of 0.3 for shadow edges, 1 the noisy picture itself",
       {{"still", 0.2}, {"moving", 0.55}, {"moving 99 %", 1}},
       Pan},
      {48,
       "lens",
       "a chess board and foliage through a wide lens, 8 seeds: for each, error, and lone bright or dark "
       "pixels in 10,000",
       "96x72, 16 spp",
       "was: one film, and no lone pixel in it, which was chance: the default method left 1.4, most of them "
       "black, where a highlight's outlier was taken out of edges; 0.5 are left, highlights that the truth "
       "has darker by a few steps",
       {{"board", 0.3}, {"board lone", 1}, {"leaves", 0.3}, {"leaves lone", 1}},
       Lens},
  };
}

}  // namespace lumifold::stability
