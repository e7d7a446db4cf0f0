#include "filter/edges/relighting.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/edges/band_pixels.h"
#include "filter/edges/non_diffuse_pixels.h"
#include "filter/edges/trust.h"
#include "filter/image/edged_image.h"
#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

constexpr int kRadius = 2;  // 5x5 window
constexpr float kSigmaPixels = 1;
/// Ridge over the window's weight: draws surfaces that the window says little of towards the others.
constexpr float kRidge = 1e-2f;
constexpr float kMinRidge = 1e-20f;
constexpr size_t kMaxSurfaces = 4;          // pixels that show more stay as they are
constexpr float kMinCosine = 0.9f;          // between normals of one surface
constexpr float kMaxDistanceChange = 0.1f;  // between distances of one surface, relative
/// The competing picture has about this much of C's variance. The window is wide: at few samples C's own
/// noise hides the bias of a small one.
constexpr TrustParams kTrust = {.radius = 8, .competing_variance = 0.1f};
/// Surfaces that all sub-samples miss have not been filtered: the competing picture has all of C's noise.
constexpr TrustParams kTrustOfMissed = {.radius = 8, .competing_variance = 1};

/// A surface in a pixel.
struct Surface {
  float id = 0;
  std::array<float, 3> normal = {0, 0, 0};
  float distance = 0;
  std::array<float, 3> albedo = {0, 0, 0};  // times the part of the pixel that it covers
};

bool IsSameSurface(const Surface& a, const Surface& b) {
  const float cosine = a.normal[0] * b.normal[0] + a.normal[1] * b.normal[1] + a.normal[2] * b.normal[2];
  return a.id == b.id && cosine >= kMinCosine &&
         std::abs(a.distance - b.distance) <= kMaxDistanceChange * std::max(a.distance, b.distance);
}

float SumOf(const std::array<float, 3>& color) { return color[0] + color[1] + color[2]; }

/// The surfaces in a pixel: its value is the sum of light * albedo over them, plus E.
struct Mixture {
  std::array<Surface, kMaxSurfaces> surfaces;
  size_t count = 0;
  std::array<float, 3> emission = {0, 0, 0};
  bool is_known = true;    // whether D, I, T and E hold all its light, and all surfaces fit in here
  bool is_mixed = false;   // shows several surfaces, or one and something without a diffuse lobe
  bool is_missed = false;  // shows one that no sub-sample hits

  void Add(const Surface& surface) {
    const auto end = surfaces.begin() + static_cast<std::ptrdiff_t>(count);
    const auto same =
        std::find_if(surfaces.begin(), end, [&](const Surface& s) { return IsSameSurface(s, surface); });
    if (same != end) {
      for (size_t c = 0; c < 3; ++c) same->albedo[c] += surface.albedo[c];
    } else if (count < kMaxSurfaces) {
      surfaces[count++] = surface;
    } else {
      is_known = false;
    }
  }
};

/// Albedo of each surface of one pixel as it occurs in another one.
using Parts = std::array<std::array<float, kMaxSurfaces>, 3>;  // by channel

/// Whether `mixture` shows only surfaces of `of`; then *parts is the part of each.
bool FindParts(const Mixture& of, const Mixture& mixture, Parts* parts) {
  *parts = {};
  for (size_t k = 0; k < mixture.count; ++k) {
    size_t same = 0;
    while (same < of.count && !IsSameSurface(of.surfaces[same], mixture.surfaces[k])) ++same;
    if (same == of.count) return false;
    for (size_t c = 0; c < 3; ++c) (*parts)[c][same] += mixture.surfaces[k].albedo[c];
  }
  return true;
}

/// Reads mixtures from a frame that has edges; keeps a reference to it.
class MixtureReader {
 public:
  MixtureReader(const Frame& frame, float max_glossy_albedo)
      : frame_(frame),
        non_diffuse_(frame, max_glossy_albedo),
        rows_(static_cast<size_t>(frame.width) * static_cast<size_t>(frame.height), -1) {
    frame.edges->ForEachPixel(frame.bounds(), [&](int row, int x, int y) { rows_[IndexOf(x, y)] = row; });
  }

  Mixture At(int x, int y) const {
    if (non_diffuse_.Contain(x, y)) {
      Mixture mixture;
      mixture.is_known = false;
      return mixture;
    }
    Mixture mixture = HitsAt(x, y);
    if (mixture.count == 0) AddMissedSurface(x, y, &mixture);
    return mixture;
  }

 private:
  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(frame_.width) + static_cast<size_t>(x);
  }

  /// The surfaces that the sub-samples of an edge pixel hit; off the edge set the pixel's one surface.
  Mixture HitsAt(int x, int y) const {
    const int row = rows_[IndexOf(x, y)];
    return row < 0 ? WholePixel(x, y) : EdgePixel(row);
  }

  /// Adds a surface that all sub-samples miss and own samples hit: with the pixel's own T, it is the surface
  /// of greatest albedo in the pixels beside it.
  void AddMissedSurface(int x, int y, Mixture* mixture) const {
    const ConstColorView& albedo = frame_.surface.albedo;
    const std::array<float, 3> own = {albedo[0].At(x, y), albedo[1].At(x, y), albedo[2].At(x, y)};
    if (!(SumOf(own) > 0)) return;
    const Rect window = Inflate({x, y, x + 1, y + 1}, 1, frame_.bounds());
    Surface missed;
    for (int j = window.y0; j < window.y1; ++j) {
      for (int i = window.x0; i < window.x1; ++i) {
        if (non_diffuse_.Contain(i, j)) continue;
        const Mixture beside = HitsAt(i, j);
        for (size_t k = 0; beside.is_known && k < beside.count; ++k) {
          if (SumOf(beside.surfaces[k].albedo) > SumOf(missed.albedo)) missed = beside.surfaces[k];
        }
      }
    }
    if (!(SumOf(missed.albedo) > 0)) return;
    missed.albedo = own;
    mixture->Add(missed);
    mixture->is_missed = mixture->is_known;
  }

  Mixture WholePixel(int x, int y) const {
    Mixture mixture;
    for (size_t c = 0; c < 3; ++c) mixture.emission[c] = frame_.emission[c].At(x, y);
    const SurfaceViews& s = frame_.surface;
    if (s.mask.At(x, y) > 0 && s.distance.At(x, y) > 0) {
      mixture.Add({frame_.object_id.At(x, y),
                   {s.normal[0].At(x, y), s.normal[1].At(x, y), s.normal[2].At(x, y)},
                   s.distance.At(x, y),
                   {s.albedo[0].At(x, y), s.albedo[1].At(x, y), s.albedo[2].At(x, y)}});
    }
    return mixture;
  }

  Mixture EdgePixel(int row) const {
    const EdgeViews& edges = *frame_.edges;
    Mixture mixture;
    bool is_whole = true;
    constexpr float kPart = 1.0f / kSubSamples;
    for (int j = 0; j < kSubSamples; ++j) {
      for (size_t c = 0; c < 3; ++c) mixture.emission[c] += kPart * edges.emission[c].At(j, row);
      if (!edges.IsLit(j, row)) {
        is_whole = false;
        continue;
      }
      Surface surface = {edges.id.At(j, row), {}, edges.distance.At(j, row), {}};
      for (size_t c = 0; c < 3; ++c) {
        surface.normal[c] = edges.normal[c].At(j, row);
        surface.albedo[c] = kPart * edges.albedo[c].At(j, row);
      }
      mixture.Add(surface);
    }
    mixture.is_known = mixture.is_known && edges.IsPlain(row);
    mixture.is_mixed = mixture.is_known && (mixture.count > 1 || (mixture.count == 1 && !is_whole));
    return mixture;
  }

  const Frame& frame_;
  NonDiffusePixels non_diffuse_;
  std::vector<int> rows_;  // row of the edge set for each pixel; -1 off it
};

/// Weighted least squares for the light of a pixel's surfaces in one channel.
class LightFit {
 public:
  explicit LightFit(size_t surfaces) : count_(surfaces) {}

  void Add(const std::array<float, kMaxSurfaces>& parts, float picture, float weight) {
    float whole = 0;
    for (size_t a = 0; a < count_; ++a) {
      const float by = weight * parts[a];
      for (size_t b = 0; b < count_; ++b) matrix_[a][b] += by * parts[b];
      right_[a] += by * picture;
      whole += parts[a];
    }
    square_ += weight * whole * whole;
    product_ += weight * whole * picture;
  }

  /// Value of the fit for a pixel with these parts. Consumes the sums.
  float PictureOf(const std::array<float, kMaxSurfaces>& parts) {
    const float common = square_ > 0 ? product_ / square_ : 0.0f;  // light if all surfaces had the same
    const float ridge = kRidge * square_ + kMinRidge;
    for (size_t a = 0; a < count_; ++a) {
      matrix_[a][a] += ridge;
      right_[a] += ridge * common;
    }
    // No pivoting: the ridge keeps the matrix positive definite.
    for (size_t a = 0; a < count_; ++a) {
      for (size_t b = a + 1; b < count_; ++b) {
        const float by = matrix_[b][a] / matrix_[a][a];
        for (size_t d = a; d < count_; ++d) matrix_[b][d] -= by * matrix_[a][d];
        right_[b] -= by * right_[a];
      }
    }
    float sum = 0;
    for (size_t a = count_; a-- > 0;) {
      for (size_t b = a + 1; b < count_; ++b) right_[a] -= matrix_[a][b] * right_[b];
      right_[a] /= matrix_[a][a];  // now the light of surface a
      sum += right_[a] * parts[a];
    }
    return sum;
  }

 private:
  size_t count_;
  std::array<std::array<float, kMaxSurfaces>, kMaxSurfaces> matrix_ = {};
  std::array<float, kMaxSurfaces> right_ = {};
  float square_ = 0;
  float product_ = 0;
};

/// Value of the pixel by the light of its surfaces, fitted in the window around it.
std::array<float, 3> FitAt(const BandPixels<Mixture>& mixtures, int x, int y, const Picture& picture) {
  constexpr float kNearness = 1.0f / (2 * kSigmaPixels * kSigmaPixels);
  const Mixture& centre = mixtures.At(x, y);
  std::array<LightFit, 3> fits = {LightFit(centre.count), LightFit(centre.count), LightFit(centre.count)};
  const Rect window = mixtures.WindowAt(x, y);
  Parts parts;
  for (int j = window.y0; j < window.y1; ++j) {
    for (int i = window.x0; i < window.x1; ++i) {
      const Mixture& other = mixtures.At(i, j);
      if (!other.is_known || other.count == 0 || !FindParts(centre, other, &parts)) continue;
      const float weight = Exp(-kNearness * static_cast<float>((i - x) * (i - x) + (j - y) * (j - y)));
      for (size_t c = 0; c < 3; ++c) fits[c].Add(parts[c], picture[c].At(i, j) - other.emission[c], weight);
    }
  }
  FindParts(centre, centre, &parts);
  std::array<float, 3> value;
  for (size_t c = 0; c < 3; ++c) value[c] = centre.emission[c] + fits[c].PictureOf(parts[c]);
  return value;
}

/// What RelightEdges() draws pixels towards.
struct RelitPixels {
  Planes values;    // 3
  Plane is_mixed;   // 1 or 0, as Mixture
  Plane is_missed;  // 1 or 0
};

RelitPixels Relight(const Frame& frame, const MixtureReader& reader, TaskPool* pool, const Picture& picture) {
  RelitPixels relit{MakePlanes(3, frame.width, frame.height), Plane(frame.width, frame.height),
                    Plane(frame.width, frame.height)};
  ForEachBand(pool, frame.height, [&](int, int y0, int y1) {
    const BandPixels<Mixture> mixtures(frame.bounds(), y0, y1, kRadius,
                                       [&](int x, int y) { return reader.At(x, y); });
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < frame.width; ++x) {
        const Mixture& shown = mixtures.At(x, y);
        if (!shown.is_mixed && !shown.is_missed) continue;
        (shown.is_missed ? relit.is_missed : relit.is_mixed).At(x, y) = 1;
        const std::array<float, 3> value = FitAt(mixtures, x, y, picture);
        for (size_t c = 0; c < 3; ++c) relit.values[c].At(x, y) = value[c];
      }
    }
  });
  return relit;
}

}  // namespace

int RelightingWindow() { return kRadius + kTrust.radius; }

void RelightEdges(const Frame& frame, float max_glossy_albedo, TaskPool* pool, Picture* picture) {
  if (!frame.edges.has_value() || frame.object_id.IsEmpty()) return;
  const MixtureReader reader(frame, max_glossy_albedo);
  const RelitPixels relit = Relight(frame, reader, pool, *picture);
  Follow(relit.values, TrustIn(relit.values, relit.is_mixed, frame, kTrust, pool), pool, picture);
  Follow(relit.values, TrustIn(relit.values, relit.is_missed, frame, kTrustOfMissed, pool), pool, picture);
}

}  // namespace lumifold::filter
