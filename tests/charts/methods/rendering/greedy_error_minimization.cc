#include "tests/charts/methods/rendering/greedy_error_minimization.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "filter/image/mix_bits.h"
#include "filter/image/planes.h"
#include "filter/image/portable_math.h"
#include "tests/charts/methods/rendering/gaussian.h"
#include "tests/charts/methods/rendering/sampled_frame.h"

namespace lumifold::charts {
namespace {

using render::RenderSettings;

/// Sigmas in pixels, the identity first: during sampling, and for the picture.
constexpr float kSamplingBank[] = {0, 1, 2, 4, 8};
constexpr float kPictureBank[] = {0, 0.70710678f, 1, 1.41421356f, 2, 2.82842712f, 4, 5.65685425f, 8};

/// Fraction of pixels that get adaptive samples in a round, and fraction of samples distributed uniformly:
/// otherwise a pixel whose samples happen to be equal would never get another.
constexpr double kChosenShare = 0.25;
constexpr double kEvenShare = 0.1;

/// The sample variance of a pixel is shrunk towards a local mean (sigma in pixels) that counts as
/// kPriorSamples samples, because a few samples may miss rare light altogether.
constexpr float kVarianceSigma = 1;
constexpr float kPriorSamples = 8;

/// Added to the squared brightness in relative errors, so that dark pixels do not dominate.
constexpr float kDarkness = 1e-3f;

/// The frame, blurred by one Gaussian.
struct Level {
  float sigma = 0;
  Planes means;
  Planes variances;
  Plane samples;  // effective number of samples of its mean
};

float Sum(const Planes& planes, int x, int y) {
  return planes[0].At(x, y) + planes[1].At(x, y) + planes[2].At(x, y);
}

Level MakeLevel(const Planes& means, const Planes& variances, const Plane& counts, float sigma,
                TaskPool* pool) {
  const int width = counts.width();
  const int height = counts.height();
  const Gaussian gaussian(sigma, width, height);
  Level level;
  level.sigma = sigma;
  for (size_t c = 0; c < 3; ++c) {
    level.means.push_back(gaussian.Mean(means[c], pool));
    level.variances.push_back(gaussian.VarianceOfMean(variances[c], pool));
  }
  Plane inverse(width, height);
  ForEachPixel(width, height, [&](int x, int y) { inverse.At(x, y) = 1 / counts.At(x, y); });
  level.samples = gaussian.VarianceOfMean(inverse, pool);
  ForEachPixel(width, height, [&](int x, int y) { level.samples.At(x, y) = 1 / level.samples.At(x, y); });
  return level;
}

/// Variances of the pixels' means, shrunk towards their neighbours' for few samples.
Planes SteadyVariances(Planes variances, const Plane& counts, TaskPool* pool) {
  const Gaussian gaussian(kVarianceSigma, counts.width(), counts.height());
  for (Plane& variance : variances) {
    ForEachPixel(counts.width(), counts.height(),
                 [&](int x, int y) { variance.At(x, y) *= counts.At(x, y); });
    const Plane around = gaussian.Mean(variance, pool);
    ForEachPixel(counts.width(), counts.height(), [&](int x, int y) {
      const float count = counts.At(x, y);
      const float of_sample =
          (count * variance.At(x, y) + kPriorSamples * around.At(x, y)) / (count + kPriorSamples);
      variance.At(x, y) = of_sample / count;
    });
  }
  return variances;
}

std::vector<Level> MakeBank(const SampledFrame& frame, absl::Span<const float> sigmas, TaskPool* pool) {
  const Planes means = frame.Means();
  const Plane counts = frame.Counts();
  const Planes variances = SteadyVariances(frame.Variances(), counts, pool);
  std::vector<Level> bank;
  bank.reserve(sigmas.size());
  for (const float sigma : sigmas) bank.push_back(MakeLevel(means, variances, counts, sigma, pool));
  return bank;
}

/// The difference of squared biases of a coarser and a finer Gaussian, over the squared difference of their
/// means, if biases grow with the square of sigma.
float BiasFactor(const Level& fine, const Level& coarse) {
  const float f = fine.sigma * fine.sigma;
  const float c = coarse.sigma * coarse.sigma;
  return (c + f) / (c - f);
}

float SquaredDifference(const Level& fine, const Level& coarse, int x, int y) {
  float sum = 0;
  for (size_t c = 0; c < 3; ++c) {
    const float difference = fine.means[c].At(x, y) - coarse.means[c].At(x, y);
    sum += difference * difference;
  }
  return sum;
}

/// The factor on a noisy estimate of the bias that makes it exceed the true bias with the probability set by
/// `gamma`.
float BiasCaution(float gamma) { return -Log(1 - Pow(1.9f * gamma, 0.70710678f)); }

/// 1 where a pixel stays at `fine` rather than going on to `coarse`.
Plane Stops(const Level& fine, const Level& coarse, float caution) {
  const int width = fine.samples.width();
  const int height = fine.samples.height();
  const float factor = caution * BiasFactor(fine, coarse);
  Plane stops(width, height);
  ForEachPixel(width, height, [&](int x, int y) {
    const float gain = Sum(fine.variances, x, y) - Sum(coarse.variances, x, y);
    const float trust = 1 - 1 / std::max(1.0f, fine.samples.At(x, y));
    if (factor * trust * SquaredDifference(fine, coarse, x, y) >= gain) stops.At(x, y) = 1;
  });
  return stops;
}

/// The weighted majority of a pixel's neighbours, without the pixel itself.
Plane Majority(const Plane& stops, float sigma, TaskPool* pool) {
  const Gaussian gaussian(sigma, stops.width(), stops.height());
  Plane majority = gaussian.Mean(stops, pool);
  ForEachPixel(stops.width(), stops.height(), [&](int x, int y) {
    const float own = gaussian.CentreWeight(x, y);
    float& value = majority.At(x, y);
    value = value - own * stops.At(x, y) > 0.5f * (1 - own) ? 1.0f : 0.0f;
  });
  return majority;
}

/// The level of each pixel.
std::vector<uint8_t> ChooseLevels(const std::vector<Level>& bank, float gamma, bool for_picture,
                                  TaskPool* pool) {
  const float caution = BiasCaution(gamma);
  const int width = bank[0].samples.width();
  const int height = bank[0].samples.height();
  std::vector<uint8_t> chosen(static_cast<size_t>(width) * static_cast<size_t>(height), 0);
  for (size_t level = 0; level + 1 < bank.size(); ++level) {
    const Plane stops = Stops(bank[level], bank[level + 1], caution);
    const Plane smooth = Majority(stops, bank[level + 1].sigma, pool);
    const Plane smoother = for_picture ? Majority(smooth, 2 * bank[level + 1].sigma, pool) : Plane();
    ForEachPixel(width, height, [&](int x, int y) {
      const bool stop = smooth.At(x, y) > 0 && (!for_picture || smoother.At(x, y) > 0);
      uint8_t& at = chosen[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)];
      if (!stop && at == level) at = static_cast<uint8_t>(level + 1);
    });
  }
  return chosen;
}

/// The expected reduction of relative error by `more` samples in each pixel.
Plane WorthOfSampling(const std::vector<Level>& bank, const std::vector<uint8_t>& chosen, float more) {
  const int width = bank[0].samples.width();
  const int height = bank[0].samples.height();
  Plane worth(width, height);
  ForEachPixel(width, height, [&](int x, int y) {
    const size_t at = chosen[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)];
    const Level& level = bank[at];
    float error = Sum(level.variances, x, y);
    if (at > 0) {
      const float coarse = level.sigma * level.sigma;
      const float share = coarse / (coarse - bank[at - 1].sigma * bank[at - 1].sigma);
      error += share * share * SquaredDifference(bank[at - 1], level, x, y);
    }
    const float mean = Sum(level.means, x, y) / 3;
    worth.At(x, y) = error / (mean * mean + kDarkness) * more / (more + level.samples.At(x, y));
  });
  return worth;
}

/// Distributes a fraction of `budget` samples over all pixels at random; counts differ by at most one.
std::vector<uint32_t> SpreadEvenly(uint64_t budget, int round, size_t pixels) {
  const double each = kEvenShare * static_cast<double>(budget) / static_cast<double>(pixels);
  std::vector<uint32_t> samples(pixels);
  for (size_t i = 0; i < pixels; ++i) {
    const uint64_t bits = MixBits(MixBits(static_cast<uint64_t>(round)) + i);
    const auto drawn = static_cast<uint64_t>(each + static_cast<double>(bits >> 11) * 0x1p-53);
    samples[i] = static_cast<uint32_t>(std::min(budget, drawn));
    budget -= samples[i];
  }
  return samples;
}

void PlaceRound(uint64_t budget, int round, float gamma, TaskPool* pool, SampledFrame* frame) {
  if (budget == 0) return;
  const auto pixels = static_cast<size_t>(frame->width()) * static_cast<size_t>(frame->height());
  std::vector<uint32_t> more = SpreadEvenly(budget, round, pixels);
  budget -= std::accumulate(more.begin(), more.end(), uint64_t{0});
  const auto chosen =
      std::max<uint64_t>(1, static_cast<uint64_t>(kChosenShare * static_cast<double>(pixels)));
  const uint64_t each = std::max<uint64_t>(1, (budget + chosen - 1) / chosen);
  const std::vector<Level> bank = MakeBank(*frame, kSamplingBank, pool);
  const Plane worth = WorthOfSampling(bank, ChooseLevels(bank, gamma, false, pool), static_cast<float>(each));
  for (const size_t pixel : WorthiestPixels(worth, budget / each)) more[pixel] += static_cast<uint32_t>(each);
  frame->Take(more, pool);
}

/// Takes samples until the frame has about `budget`, including those it has already.
void PlaceSamples(uint64_t budget, int rounds, float gamma, TaskPool* pool, SampledFrame* frame) {
  for (int round = 0; round < rounds; ++round)
    PlaceRound((budget - frame->taken()) / static_cast<uint64_t>(rounds - round), round, gamma, pool, frame);
}

absl::StatusOr<RenderedPicture> Render(std::shared_ptr<const scene::Scene> scene,
                                       const RenderSettings& settings, uint32_t samples_per_pixel,
                                       absl::Span<const float> values, TaskPool* pool) {
  const absl::StatusOr<CameraFrame> frame = CameraFrame::Create(std::move(scene), settings);
  if (!frame.ok()) return frame.status();
  const float gamma = values[0];
  SampledFrame sampled(*frame);
  sampled.TakeFirst(samples_per_pixel, pool);
  PlaceSamples(static_cast<uint64_t>(frame->pixels()) * samples_per_pixel, static_cast<int>(values[1]), gamma,
               pool, &sampled);
  const std::vector<Level> bank = MakeBank(sampled, kPictureBank, pool);
  const std::vector<uint8_t> chosen = ChooseLevels(bank, gamma, true, pool);
  RenderedPicture out;
  out.camera_paths = sampled.taken();
  out.picture = MakePicture(frame->width(), frame->height());
  ForEachPixel(frame->width(), frame->height(), [&](int x, int y) {
    const Level& level =
        bank[chosen[static_cast<size_t>(y) * static_cast<size_t>(frame->width()) + static_cast<size_t>(x)]];
    for (size_t c = 0; c < 3; ++c) out.picture[c].At(x, y) = level.means[c].At(x, y);
  });
  return out;
}

}  // namespace

RenderMethod GreedyErrorMinimizationMethod() {
  return {.info = {.name = "adaptive-gem",
                   .summary = "adaptive samples and Gaussians chosen to minimise the estimated error",
                   .source = "Rousselle et al. 2011, with the pixel itself as the finest filter",
                   .parameters = {{"gamma",
                                   "caution: with a larger value an observed bias stops the blur earlier",
                                   0.4f,
                                   {0.2f, 0.4f, 0.5f},
                                   0.01f,
                                   0.5f},
                                  {"rounds", "rounds of adaptive sampling", 8, {8}, 1, 64}}},
          .render = Render};
}

}  // namespace lumifold::charts
