#include "filter/edges/light_regression.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "filter/edges/model_grid.h"
#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

constexpr size_t kMostTerms = kMostLightTerms;
constexpr size_t kMostFeatures = kMostLightFeatures;
constexpr size_t kSignals = kLightShape.signals;
using Grid = ModelGrid<kLightShape.terms, kSignals, 3 + kMostFeatures>;

/// Reads samples of a layer: the fragments of pixels that have some, and the other pixels. All arguments
/// outlive it.
class LightReader {
 public:
  LightReader(const Halves& halves, const LayerFragments& fragments, const Planes& geometry,
              const Candidate& filtered, const RegressionParams& params, float knee)
      : halves_(halves),
        fragments_(fragments),
        geometry_(geometry),
        filtered_(filtered),
        inverse_reach_(1.0f / params.sigma_px),
        inverse_light_(1.0f / params.sigma_light),
        inverse_knee_(1.0f / knee),
        inverse_unit_(1.0f / halves.level),
        entry_of_(static_cast<size_t>(halves.width()) * static_cast<size_t>(halves.height()), 0) {
    for (size_t i = 0; i < fragments.pixels.size(); ++i)
      entry_of_[IndexOf(fragments.pixels[i].x, fragments.pixels[i].y)] = static_cast<uint32_t>(i + 1);
  }

  /// The fragments of a pixel; null if it has none.
  const LayerFragments::Pixel* FragmentsAt(int x, int y) const {
    const uint32_t entry = entry_of_[IndexOf(x, y)];
    return entry > 0 ? &fragments_.pixels[entry - 1] : nullptr;
  }

  size_t Count(int x, int y) const {
    const LayerFragments::Pixel* pixel = FragmentsAt(x, y);
    return pixel != nullptr ? pixel->last - pixel->first : 1;
  }

  void Read(int x, int y, Grid::Sample* samples) const {
    const LayerFragments::Pixel* pixel = FragmentsAt(x, y);
    if (pixel == nullptr) {
      ReadPixel(x, y, samples);
    } else {
      for (size_t i = pixel->first; i < pixel->last; ++i) ReadFragment(x, y, i, &samples[i - pixel->first]);
    }
  }

 private:
  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(halves_.width()) + static_cast<size_t>(x);
  }

  void ReadPixel(int x, int y, Grid::Sample* sample) const {
    sample->weight = std::min(halves_.weight_a.At(x, y), halves_.weight_b.At(x, y));
    SetPosition(static_cast<float>(x), static_cast<float>(y), sample);
    for (size_t k = 0; k < std::min(geometry_.size(), kMostFeatures); ++k) SetFeature(x, y, k, sample);
    for (size_t c = 0; c < 3; ++c) {
      SetLight(c, halves_.a[c].At(x, y), halves_.b[c].At(x, y), filtered_.a[c].At(x, y),
               filtered_.b[c].At(x, y), sample);
    }
  }

  void ReadFragment(int x, int y, size_t point, Grid::Sample* sample) const {
    const auto& share = fragments_.share;
    const bool has_both = share[0][point] > 0 && share[1][point] > 0;
    sample->weight = has_both ? 0.5f * (share[0][point] + share[1][point]) : 0.0f;
    const float* offset = &fragments_.offsets[2 * point];
    SetPosition(static_cast<float>(x) + offset[0], static_cast<float>(y) + offset[1], sample);
    const size_t own = fragments_.own_features;
    for (size_t k = 0; k < std::min(geometry_.size(), kMostFeatures); ++k) {
      if (k < own) {
        SetFeature(k, fragments_.features[(point + 1) * own - 1 - k], sample);
      } else {
        SetFeature(x, y, k, sample);
      }
    }
    for (size_t c = 0; c < 3; ++c) {
      const size_t at = 3 * point + c;
      SetLight(c, fragments_.light[0][at], fragments_.light[1][at], filtered_.points[0][at],
               filtered_.points[1][at], sample);
    }
  }

  void SetPosition(float x, float y, Grid::Sample* sample) const {
    float* terms = sample->fit.row.data() + kSignals;
    terms[0] = 1;
    terms[1] = x * inverse_reach_;
    terms[2] = y * inverse_reach_;
  }

  /// Feature k from the last; of the pixel.
  void SetFeature(int x, int y, size_t k, Grid::Sample* sample) const {
    SetFeature(k, geometry_[geometry_.size() - 1 - k].At(x, y), sample);
  }

  static void SetFeature(size_t k, float value, Grid::Sample* sample) {
    sample->traits[3 + k] = value;
    if (k < kMostTerms) sample->fit.row[kSignals + 3 + k] = value;
  }

  /// Light in units of the layer's mean.
  void SetLight(size_t c, float light_a, float light_b, float filtered_a, float filtered_b,
                Grid::Sample* sample) const {
    const float a = light_a * inverse_unit_;
    const float b = light_b * inverse_unit_;
    const float f = 0.5f * (filtered_a + filtered_b) * inverse_unit_;
    sample->fit.row[c] = a;
    sample->fit.row[3 + c] = b;
    sample->fit.variance += sample->weight * (a - b) * (a - b) / 12;
    sample->fit.power += f * f / 3;
    sample->traits[c] = Asinh(f * inverse_knee_) * inverse_light_;
    for (const float signal : {a, b, f}) {
      if (!(std::abs(signal) < kMaxLightSignal)) sample->weight = 0;
    }
  }

  const Halves& halves_;
  const LayerFragments& fragments_;
  const Planes& geometry_;
  const Candidate& filtered_;
  const float inverse_reach_;
  const float inverse_light_;
  const float inverse_knee_;
  const float inverse_unit_;
  std::vector<uint32_t> entry_of_;  // of each pixel: index in LayerFragments::pixels, plus 1; 0: none
};

}  // namespace

Candidate FitLight(const Halves& halves, const LayerFragments& fragments, const Planes& geometry,
                   const Candidate& filtered, const RegressionParams& params, float knee, TaskPool* pool) {
  const LightReader reader(halves, fragments, geometry, filtered, params, knee);
  const Grid grid(reader, halves.is_mixed, params, pool);
  Candidate fitted = {Clone(filtered.a), Clone(filtered.b), filtered.points};
  ForEachPixel(pool, halves.width(), halves.height(), [&](int x, int y) {
    if (!(halves.is_mixed.At(x, y) > 0)) return;
    const LayerFragments::Pixel* pixel = reader.FragmentsAt(x, y);
    if (pixel == nullptr && !(grid.At(grid.FirstOf(x, y)).weight > 0)) return;
    for (size_t i = grid.FirstOf(x, y); i < grid.EndOf(x, y); ++i) {
      const auto value = grid.ValueAt(i);
      if (!value.has_value()) continue;
      for (size_t c = 0; c < 3; ++c) {
        if (pixel == nullptr) {
          fitted.a[c].At(x, y) = halves.level * (*value)[c];
          fitted.b[c].At(x, y) = halves.level * (*value)[3 + c];
        } else {
          const size_t at = 3 * (pixel->first + i - grid.FirstOf(x, y)) + c;
          fitted.points[0][at] = halves.level * (*value)[c];
          fitted.points[1][at] = halves.level * (*value)[3 + c];
        }
      }
    }
  });
  return fitted;
}

}  // namespace lumifold::filter
