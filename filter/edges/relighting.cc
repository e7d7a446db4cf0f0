#include "filter/edges/relighting.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/edges/band_pixels.h"
#include "filter/edges/edge_pixels.h"
#include "filter/edges/edge_views.h"
#include "filter/edges/trust.h"
#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

constexpr int kRadius = 2;  // 5x5 window
constexpr float kSigmaPixels = 1;
constexpr float kRidge =
    1e-2f;  // of the window's weight: draws surfaces that it says little of to the others
constexpr float kLeastRidge = 1e-20f;
constexpr size_t kMostSurfaces = 4;  // pixels that show more stay as they are
constexpr float kSameCosine = 0.9f;
constexpr float kSameDistance = 0.1f;  // relative
/// The picture is noisier than the fit by about this much of C's variance. A wide window: at few samples C
/// tells of a small one's bias little but its own noise.
constexpr TrustParams kTrust = {.radius = 8, .noise_left = 0.1f};
/// Slices that no sub-sample hits are not filtered before.
constexpr TrustParams kTrustInSlices = {.radius = 8, .noise_left = 1};

/// Something a pixel shows.
struct Surface {
  float id = 0;
  std::array<float, 3> normal = {0, 0, 0};
  float distance = 0;
  std::array<float, 3> albedo = {0, 0, 0};  // times its part of the pixel
};

bool AreAlike(const Surface& a, const Surface& b) {
  const float cosine = a.normal[0] * b.normal[0] + a.normal[1] * b.normal[1] + a.normal[2] * b.normal[2];
  return a.id == b.id && cosine >= kSameCosine &&
         std::abs(a.distance - b.distance) <= kSameDistance * std::max(a.distance, b.distance);
}

float SumOf(const std::array<float, 3>& color) { return color[0] + color[1] + color[2]; }

/// What a pixel shows: its picture is the sum of light times albedo over its surfaces, plus E.
struct Mixture {
  std::array<Surface, kMostSurfaces> surfaces;
  size_t count = 0;
  std::array<float, 3> emission = {0, 0, 0};
  bool is_known = true;   // it is, and they are no more than fit in here
  bool is_mixed = false;  // of several surfaces, or of one and what has no diffuse lobe
  bool is_slice = false;  // of one that no sub-sample hits

  void Add(const Surface& surface) {
    const auto end = surfaces.begin() + static_cast<std::ptrdiff_t>(count);
    const auto same =
        std::find_if(surfaces.begin(), end, [&](const Surface& s) { return AreAlike(s, surface); });
    if (same != end) {
      for (size_t c = 0; c < 3; ++c) same->albedo[c] += surface.albedo[c];
    } else if (count < kMostSurfaces) {
      surfaces[count++] = surface;
    } else {
      is_known = false;
    }
  }
};

/// Albedo of each surface of some pixel in another one.
using Parts = std::array<std::array<float, kMostSurfaces>, 3>;  // by channel

/// Whether `mixture` shows nothing but surfaces of `of`, and then what part of each.
bool FindParts(const Mixture& of, const Mixture& mixture, Parts* parts) {
  *parts = {};
  for (size_t k = 0; k < mixture.count; ++k) {
    size_t same = 0;
    while (same < of.count && !AreAlike(of.surfaces[same], mixture.surfaces[k])) ++same;
    if (same == of.count) return false;
    for (size_t c = 0; c < 3; ++c) (*parts)[c][same] += mixture.surfaces[k].albedo[c];
  }
  return true;
}

/// Reads mixtures out of a film and its edge set.
class Source {
 public:
  Source(const LayeredImage& film, const LayeredImage& edges, float max_glossy_albedo)
      : unknown_(film, max_glossy_albedo),
        edges_(edges),
        normal_{film.Get(layers::kNormalX), film.Get(layers::kNormalY), film.Get(layers::kNormalZ)},
        albedo_(film.GetColor(layers::kAlbedo)),
        emission_(film.GetColor(layers::kEmission)),
        distance_(film.Get(layers::kDistance)),
        id_(film.Get(layers::kObjectId)),
        mask_(film.Get(layers::kMask)),
        rows_(static_cast<size_t>(film.width()) * static_cast<size_t>(film.height()), -1) {
    ForEachEdgePixel(&edges, film.bounds(), [&](int row, int x, int y) { rows_[IndexOf(x, y)] = row; });
  }

  Mixture At(int x, int y) const {
    if (unknown_.Contain(x, y)) {
      Mixture mixture;
      mixture.is_known = false;
      return mixture;
    }
    Mixture mixture = SeenAt(x, y);
    if (mixture.count == 0) AddSlice(x, y, &mixture);
    return mixture;
  }

 private:
  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(id_.width()) + static_cast<size_t>(x);
  }

  /// What the sub-samples of an edge pixel show, or the pixel as a whole.
  Mixture SeenAt(int x, int y) const {
    const int row = rows_[IndexOf(x, y)];
    return row < 0 ? WholePixel(x, y) : EdgePixel(row);
  }

  /// Adds the slice of a surface that all sub-samples miss and own samples hit: its T is theirs, the surface
  /// the one that a pixel beside it shows most of.
  void AddSlice(int x, int y, Mixture* mixture) const {
    const std::array<float, 3> own = {albedo_[0].At(x, y), albedo_[1].At(x, y), albedo_[2].At(x, y)};
    if (!(SumOf(own) > 0)) return;
    const Rect window = Inflate({x, y, x + 1, y + 1}, 1, {0, 0, id_.width(), id_.height()});
    Surface slice;
    for (int j = window.y0; j < window.y1; ++j) {
      for (int i = window.x0; i < window.x1; ++i) {
        if (unknown_.Contain(i, j)) continue;
        const Mixture beside = SeenAt(i, j);
        for (size_t k = 0; beside.is_known && k < beside.count; ++k) {
          if (SumOf(beside.surfaces[k].albedo) > SumOf(slice.albedo)) slice = beside.surfaces[k];
        }
      }
    }
    if (!(SumOf(slice.albedo) > 0)) return;
    slice.albedo = own;
    mixture->Add(slice);
    mixture->is_slice = mixture->is_known;
  }

  Mixture WholePixel(int x, int y) const {
    Mixture mixture;
    for (size_t c = 0; c < 3; ++c) mixture.emission[c] = emission_[c].At(x, y);
    if (mask_.At(x, y) > 0 && distance_.At(x, y) > 0) {
      mixture.Add({id_.At(x, y),
                   {normal_[0].At(x, y), normal_[1].At(x, y), normal_[2].At(x, y)},
                   distance_.At(x, y),
                   {albedo_[0].At(x, y), albedo_[1].At(x, y), albedo_[2].At(x, y)}});
    }
    return mixture;
  }

  Mixture EdgePixel(int row) const {
    Mixture mixture;
    bool is_whole = true;
    constexpr float kPart = 1.0f / kSubSamples;
    for (int j = 0; j < kSubSamples; ++j) {
      for (size_t c = 0; c < 3; ++c) mixture.emission[c] += kPart * edges_.emission[c].At(j, row);
      if (!edges_.IsLit(j, row)) {
        is_whole = false;
        continue;
      }
      Surface surface = {edges_.id.At(j, row), {}, edges_.distance.At(j, row), {}};
      for (size_t c = 0; c < 3; ++c) {
        surface.normal[c] = edges_.normal[c].At(j, row);
        surface.albedo[c] = kPart * edges_.albedo[c].At(j, row);
      }
      mixture.Add(surface);
    }
    mixture.is_known = mixture.is_known && edges_.IsPlain(row);
    mixture.is_mixed = mixture.is_known && (mixture.count > 1 || (mixture.count == 1 && !is_whole));
    return mixture;
  }

  UnknownPixels unknown_;
  EdgeViews edges_;
  ConstColorView normal_, albedo_, emission_;
  ConstFloatView distance_, id_, mask_;
  std::vector<int> rows_;  // of the edge set, by pixel; -1 where there is none
};

/// The light of a pixel's surfaces in one channel, by weighted least squares.
class LightFit {
 public:
  explicit LightFit(size_t surfaces) : count_(surfaces) {}

  void Add(const std::array<float, kMostSurfaces>& parts, float picture, float weight) {
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

  /// What the fit says of a pixel with these parts. Consumes the sums.
  float PictureOf(const std::array<float, kMostSurfaces>& parts) {
    const float common = square_ > 0 ? product_ / square_ : 0.0f;  // were all surfaces lit alike
    const float ridge = kRidge * square_ + kLeastRidge;
    for (size_t a = 0; a < count_; ++a) {
      matrix_[a][a] += ridge;
      right_[a] += ridge * common;
    }
    // Without pivots: the ridge keeps the matrix positive definite.
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
  std::array<std::array<float, kMostSurfaces>, kMostSurfaces> matrix_ = {};
  std::array<float, kMostSurfaces> right_ = {};
  float square_ = 0;
  float product_ = 0;
};

/// The pixel's picture by the light of its surfaces about it.
std::array<float, 3> FitAt(const BandPixels<Mixture>& mixtures, int x, int y,
                           const std::array<Plane, 3>& picture) {
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

/// Draws the picture towards the values, as far as these are trusted.
void Follow(const Planes& values, const Plane& trust, TaskPool* pool, std::array<Plane, 3>* picture) {
  ForEachBand(pool, trust.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < trust.width(); ++x) {
        if (!(trust.At(x, y) > 0)) continue;
        for (size_t c = 0; c < 3; ++c) {
          float& out = (*picture)[c].At(x, y);
          if (std::isfinite(values[c].At(x, y))) out += trust.At(x, y) * (values[c].At(x, y) - out);
        }
      }
    }
  });
}

}  // namespace

void RelightEdges(const LayeredImage& film, const LayeredImage* edges, float max_glossy_albedo,
                  TaskPool* pool, std::array<Plane, 3>* picture) {
  if (edges == nullptr || edges->channels().empty() || !film.Has(layers::kObjectId)) return;
  const Source source(film, *edges, max_glossy_albedo);
  Planes values = MakePlanes(3, film.width(), film.height());
  Plane is_mixed(film.width(), film.height());
  Plane is_slice(film.width(), film.height());
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    const BandPixels<Mixture> mixtures(film.bounds(), y0, y1, kRadius,
                                       [&](int x, int y) { return source.At(x, y); });
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < film.width(); ++x) {
        const Mixture& shown = mixtures.At(x, y);
        if (!shown.is_mixed && !shown.is_slice) continue;
        (shown.is_slice ? is_slice : is_mixed).At(x, y) = 1;
        const std::array<float, 3> value = FitAt(mixtures, x, y, *picture);
        for (size_t c = 0; c < 3; ++c) values[c].At(x, y) = value[c];
      }
    }
  });
  Follow(values, TrustIn(values, is_mixed, film, kTrust, pool), pool, picture);
  Follow(values, TrustIn(values, is_slice, film, kTrustInSlices, pool), pool, picture);
}

}  // namespace lumifold::filter
