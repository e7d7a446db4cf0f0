#include "filter/edges/regression.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "filter/edges/model_grid.h"
#include "filter/image/portable_math.h"
#include "filter/layers/magnitude.h"
#include "filter/layers/seen_surface.h"

namespace lumifold::filter {
namespace {

constexpr size_t kTerms = 11;    // 1, T (3), normal (3), covered part, S, log distance, roughness
constexpr size_t kSignals = 12;  // C of half A (3), of half B (3); C - F of half A (3), of half B (3)
constexpr size_t kTraits = 3;    // asinh(F / knee) / sigma_light
using Grid = ModelGrid<kTerms, kSignals, kTraits>;

constexpr float kMaxFeature = 10;
constexpr float kMaxSignal = 1e12f;  // C over its mean: fourth powers must stay finite

float Bounded(float x) { return std::isfinite(x) ? std::clamp(x, -kMaxFeature, kMaxFeature) : 0.0f; }

/// Reads samples of a frame and its filtered picture, all of which outlive it; light in units of `unit`.
class SampleReader {
 public:
  SampleReader(const Frame& frame, const SeenSurface& seen, const FrameChange& change, float sigma_light,
               float knee, const GeometryRanges& ranges, float unit)
      : frame_(frame),
        seen_(seen),
        change_{ViewOf(change[0]), ViewOf(change[1])},
        inverse_sigma_(1.0f / sigma_light),
        inverse_knee_(1.0f / knee),
        ranges_(ranges),
        unit_(unit) {}

  static size_t Count(int, int) { return 1; }

  void Read(int x, int y, Grid::Sample* to) const {
    Grid::Sample& sample = *to;
    SetTerms(x, y, sample.fit.row.data() + kSignals);
    bool is_usable = frame_.samples.HasBoth(x, y);
    for (size_t c = 0; c < 3; ++c) {
      const float a = frame_.combined.a[c].At(x, y) / unit_;
      const float b = frame_.combined.b[c].At(x, y) / unit_;
      const float change_a = change_[0][c].At(x, y) / unit_;
      const float change_b = change_[1][c].At(x, y) / unit_;
      const float share = frame_.samples.ShareA(x, y);
      const float f = share * (a + change_a) + (1.0f - share) * (b + change_b);
      for (const float signal : {a, b, f}) is_usable = is_usable && std::abs(signal) < kMaxSignal;
      sample.fit.row[c] = a;
      sample.fit.row[3 + c] = b;
      sample.fit.row[6 + c] = -change_a;
      sample.fit.row[9 + c] = -change_b;
      sample.fit.variance += (a - b) * (a - b) / 12;
      sample.fit.power += f * f / 3;
      sample.traits[c] = Asinh(f * inverse_knee_) * inverse_sigma_;
    }
    sample.weight = is_usable ? 1.0f : 0.0f;
  }

 private:
  void SetTerms(int x, int y, float* terms) const {
    terms[0] = 1;
    for (size_t c = 0; c < 3; ++c) {
      terms[1 + c] = Bounded(seen_.albedo[c].At(x, y));
      terms[4 + c] = Bounded(seen_.normal[c].At(x, y));
    }
    terms[7] = Bounded(seen_.mask.At(x, y));
    const ConstColorView& glossy = frame_.gloss.albedo;
    if (!glossy[0].IsEmpty()) terms[8] = Bounded(LuminanceAt(glossy, x, y));
    const float distance = seen_.distance.At(x, y);
    if (distance > 0 && std::isfinite(distance)) terms[9] = Log(distance) / ranges_.log_depth;
    if (!frame_.gloss.roughness.IsEmpty()) terms[10] = Bounded(frame_.gloss.roughness.At(x, y));
  }

  const Frame& frame_;
  const SeenSurface& seen_;
  std::array<ConstColorView, 2> change_;
  float inverse_sigma_;
  float inverse_knee_;
  const GeometryRanges& ranges_;
  float unit_;
};

}  // namespace

std::vector<FrameChange> FitMixedPixels(const Frame& frame, const Plane& mixed, const FrameChange& change,
                                        const RegressionParams& params, float knee,
                                        const GeometryRanges& ranges, TaskPool* pool) {
  const float unit = MeanMagnitude(frame.combined.mean, pool);
  if (!(unit > 0)) return {};
  const SeenSurface seen = SeenSurfaceOf(frame, pool);
  const SampleReader reader(frame, seen, change, params.sigma_light, knee, ranges, unit);
  const Grid grid(reader, mixed, params, pool);
  // Off the fitted pixels both are the picture itself.
  FrameChange corrected = {Clone(change[0]), Clone(change[1])};
  FrameChange refit = {Clone(change[0]), Clone(change[1])};
  ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
    if (!(mixed.At(x, y) > 0) || !(grid.At(grid.FirstOf(x, y)).weight > 0)) return;
    const auto fit = grid.ValueAt(grid.FirstOf(x, y));
    if (!fit.has_value()) return;
    const auto& row = grid.At(grid.FirstOf(x, y)).fit.row;
    for (size_t h = 0; h < 2; ++h) {
      for (size_t c = 0; c < 3; ++c) {
        corrected[h][c].At(x, y) += unit * (*fit)[6 + 3 * h + c];
        refit[h][c].At(x, y) = unit * ((*fit)[3 * h + c] - row[3 * h + c]);
      }
    }
  });
  std::vector<FrameChange> candidates;
  candidates.push_back(std::move(corrected));
  candidates.push_back(std::move(refit));
  return candidates;
}

}  // namespace lumifold::filter
