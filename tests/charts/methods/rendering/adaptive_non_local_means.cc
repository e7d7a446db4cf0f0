#include "tests/charts/methods/rendering/adaptive_non_local_means.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "filter/baselines/non_local_means.h"
#include "filter/image/planes.h"
#include "filter/kernels/box_mean.h"
#include "tests/charts/methods/rendering/gaussian.h"
#include "tests/charts/methods/rendering/sampled_frame.h"

namespace lumifold::charts {
namespace {

using render::RenderSettings;

constexpr int kRounds = 3;

/// The fraction of a round's samples that is distributed uniformly, and the most samples of a pixel, over the
/// mean.
constexpr float kEvenShare = 0.1f;
constexpr float kMostOverMean = 8;

/// Window radius in pixels for the ratio of the halves' difference to the sample variance: stratified samples
/// have less noise than their variance suggests.
constexpr int kStratificationRadius = 10;
constexpr float kMostRatio = 10;

/// Sigma in pixels of the blur of the error.
constexpr float kErrorSigma = 0.8f;

/// Added to the squared brightness in relative errors, so that dark pixels do not dominate.
constexpr float kDarkness = 1e-3f;

constexpr float kTiny = 1e-20f;

/// The two halves' means and their variances, scaled to a mean of about 1.
struct Buffers {
  std::array<Planes, 2> means;
  std::array<Planes, 2> variances;
  float scale = 1;  // factor of the means
};

/// The mean of all values, or 1 if it is about 0.
float LevelOf(const Planes& planes) {
  double sum = 0;
  for (const Plane& plane : planes)
    ForEachPixel(plane.width(), plane.height(),
                 [&](int x, int y) { sum += static_cast<double>(plane.At(x, y)); });
  const double mean = sum / (3.0 * planes[0].width() * planes[0].height());
  return mean > static_cast<double>(kTiny) ? static_cast<float>(mean) : 1.0f;
}

/// Scales the variances to match the halves' difference, averaged around each pixel. The average is over
/// ratios, so that few pixels of high variance do not dominate it.
void FitToDifference(const Planes& a, const Planes& b, TaskPool* pool, Planes* var_a, Planes* var_b) {
  const int width = a[0].width();
  const int height = a[0].height();
  Planes ratio = MakePlanes(1, width, height);
  Plane weight(width, height);
  ForEachPixel(weight.width(), weight.height(), [&](int x, int y) {
    float seen = 0;
    float expected = 0;
    for (size_t c = 0; c < 3; ++c) {
      const float difference = a[c].At(x, y) - b[c].At(x, y);
      seen += difference * difference;
      expected += (*var_a)[c].At(x, y) + (*var_b)[c].At(x, y);
    }
    if (expected <= kTiny) return;
    ratio[0].At(x, y) = std::min(kMostRatio, seen / expected);
    weight.At(x, y) = 1;
  });
  ratio = filter::BoxMeans(ratio, weight.view(), kStratificationRadius, pool);
  for (Planes* variances : {var_a, var_b}) {
    for (Plane& variance : *variances) {
      ForEachPixel(variance.width(), variance.height(),
                   [&](int x, int y) { variance.At(x, y) *= ratio[0].At(x, y); });
    }
  }
}

Buffers MakeBuffers(const SampledFrame& frame, TaskPool* pool) {
  Buffers out;
  out.scale = 1 / LevelOf(frame.Means());
  for (size_t half = 0; half < 2; ++half) {
    out.means[half] = frame.HalfMeans(half);
    out.variances[half] = frame.HalfVariances(half);
    for (size_t c = 0; c < 3; ++c) {
      ForEachPixel(out.means[half][c].width(), out.means[half][c].height(), [&](int x, int y) {
        out.means[half][c].At(x, y) *= out.scale;
        out.variances[half][c].At(x, y) *= out.scale * out.scale;
      });
    }
  }
  FitToDifference(out.means[0], out.means[1], pool, &out.variances[0], &out.variances[1]);
  return out;
}

/// Each half, filtered with the weights of the other.
std::array<Planes, 2> FilterHalves(const Buffers& buffers, const filter::NonLocalMeansParams& params,
                                   TaskPool* pool) {
  std::array<Planes, 2> out;
  for (size_t half = 0; half < 2; ++half)
    out[half] = filter::NonLocalMeans(buffers.means[half], buffers.means[1 - half],
                                      buffers.variances[1 - half], params, pool);
  return out;
}

/// The estimated error, relative to brightness and divided by the samples of the pixel.
Plane ErrorMap(const std::array<Planes, 2>& filtered, const Plane& counts, TaskPool* pool) {
  Plane error(counts.width(), counts.height());
  ForEachPixel(counts.width(), counts.height(), [&](int x, int y) {
    float squared = 0;
    float mean = 0;
    for (size_t c = 0; c < 3; ++c) {
      const float difference = filtered[0][c].At(x, y) - filtered[1][c].At(x, y);
      squared += 2 * difference * difference;
      mean += (filtered[0][c].At(x, y) + filtered[1][c].At(x, y)) / 6;
    }
    error.At(x, y) = squared / (kDarkness + mean * mean) / counts.At(x, y);
  });
  return Gaussian(kErrorSigma, counts.width(), counts.height()).Mean(error, pool);
}

/// Distributes `budget` samples in proportion to the error, at most `most` per pixel; the excess goes to the
/// other pixels. Some of the budget remains if all pixels have their maximum.
Plane Densities(const Plane& error, double budget, float most) {
  Plane density(error.width(), error.height());
  constexpr int kRedistributions = 8;
  for (int i = 0; i < kRedistributions; ++i) {
    double left = budget;
    double open = 0;
    ForEachPixel(error.width(), error.height(), [&](int x, int y) {
      if (density.At(x, y) >= most) {
        left -= static_cast<double>(most);
      } else {
        open += static_cast<double>(error.At(x, y));
      }
    });
    if (open <= 0) break;
    const auto factor = static_cast<float>(left / open);
    ForEachPixel(error.width(), error.height(), [&](int x, int y) {
      if (density.At(x, y) < most) density.At(x, y) = std::min(most, factor * error.At(x, y));
    });
  }
  return density;
}

/// Rounds the density plus `floor` to whole numbers by error diffusion, with a sum of at most `budget`.
std::vector<uint32_t> Diffused(const Plane& density, float floor, uint64_t budget) {
  std::vector<uint32_t> samples;
  double carried = 0;
  ForEachPixel(density.width(), density.height(), [&](int x, int y) {
    carried += static_cast<double>(density.At(x, y) + floor);
    const auto whole = std::min<uint64_t>(budget, static_cast<uint64_t>(std::max(0.0, carried)));
    samples.push_back(static_cast<uint32_t>(whole));
    carried -= static_cast<double>(whole);
    budget -= whole;
  });
  return samples;
}

void PlaceRound(uint64_t budget, const filter::NonLocalMeansParams& params, TaskPool* pool,
                SampledFrame* frame) {
  if (budget == 0) return;
  const Plane error = ErrorMap(FilterHalves(MakeBuffers(*frame, pool), params, pool), frame->Counts(), pool);
  const float mean = static_cast<float>(budget) / static_cast<float>(error.width() * error.height());
  const Plane density = Densities(error, static_cast<double>((1 - kEvenShare)) * static_cast<double>(budget),
                                  kMostOverMean * mean);
  frame->Take(Diffused(density, kEvenShare * mean, budget), pool);
}

/// The mean of the filtered halves, weighted by their sample counts.
Picture PictureOf(const SampledFrame& frame, const filter::NonLocalMeansParams& params, TaskPool* pool) {
  const Buffers buffers = MakeBuffers(frame, pool);
  const std::array<Planes, 2> filtered = FilterHalves(buffers, params, pool);
  const Plane share = frame.ShareOfHalfA();
  Picture picture = MakePicture(frame.width(), frame.height());
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(share.width(), share.height(), [&](int x, int y) {
      const float of_a = share.At(x, y);
      picture[c].At(x, y) =
          (of_a * filtered[0][c].At(x, y) + (1 - of_a) * filtered[1][c].At(x, y)) / buffers.scale;
    });
  }
  return picture;
}

absl::StatusOr<RenderedPicture> Render(std::shared_ptr<const scene::Scene> scene,
                                       const RenderSettings& settings, uint32_t samples_per_pixel,
                                       absl::Span<const float> values, TaskPool* pool) {
  const absl::StatusOr<CameraFrame> frame = CameraFrame::Create(std::move(scene), settings);
  if (!frame.ok()) return frame.status();
  const filter::NonLocalMeansParams params = {.search_radius = static_cast<int>(values[2]),
                                              .patch_radius = static_cast<int>(values[1]),
                                              .strength = values[0]};
  const uint64_t budget = static_cast<uint64_t>(frame->pixels()) * samples_per_pixel;
  SampledFrame sampled(*frame);
  sampled.TakeFirst(samples_per_pixel, pool);
  for (int round = 0; round < kRounds; ++round)
    PlaceRound((budget - sampled.taken()) / static_cast<uint64_t>(kRounds - round), params, pool, &sampled);
  RenderedPicture out;
  out.camera_paths = sampled.taken();
  out.picture = PictureOf(sampled, params, pool);
  return out;
}

}  // namespace

RenderMethod AdaptiveNonLocalMeansMethod() {
  return {.info = {.name = "adaptive-nlm",
                   .summary =
                       "adaptive samples where two filtered halves differ; non-local means for the picture",
                   .source = "Rousselle et al. 2012, without its second filter pass",
                   .parameters = {{"k",
                                   "strength: standard deviations that similar patches may differ by",
                                   0.45f,
                                   {0.25f, 0.45f, 0.9f},
                                   0.01f,
                                   100},
                                  {"patch", "radius of patches in pixels", 3, {3}, 0, 8},
                                  {"search", "radius of the search in pixels", 10, {10}, 0, 32}}},
          .render = Render};
}

}  // namespace lumifold::charts
