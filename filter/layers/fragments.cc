#include "filter/layers/fragments.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "filter/image/edged_image.h"
#include "filter/image/surface_key.h"

namespace lumifold::filter {
namespace {

/// E of a sub-sample is a mean over 16 rays beside bright lamps, and matters nowhere else
/// (RenderGeometryUnit()).
constexpr float kRaysOfEmission = 16 * kSubSamples;

/// Weight of the mean over n own samples beside that over the sub-samples' rays: both are stratified, so that
/// their errors fall nearly as 1/n.
float OwnWeight(float n, float rays) { return n * n / (n * n + rays * rays); }

/// The half that takes a sub-sample where the halves share none: each has two of every row and every column
/// of the pixel's grid and of the lens's, by the third orthogonal square (RenderGeometryUnit()).
size_t HalfOfSubSample(int j) {
  constexpr std::array<int, 4> kThrice = {0, 3, 1, 2};
  return static_cast<size_t>((j % 4) ^ kThrice[static_cast<size_t>(j / 4)]) / 2;
}

/// A fragment while its samples are counted.
struct Counted {
  Fragment fragment;
  float key = 0;
  float samples = 0;  // own
  float sub_samples = 0;
  std::array<float, 2> sub_samples_of_half = {};
  std::array<float, 3> albedo = {}, normal = {};  // sums over both
  float distance = 0;
  std::array<float, 2> place = {};  // sum over the sub-samples, from the pixel's corner

  void Add(float count, const std::array<float, 3>& t, const std::array<float, 3>& n, float d) {
    for (size_t c = 0; c < 3; ++c) {
      albedo[c] += count * t[c];
      normal[c] += count * n[c];
    }
    distance += count * d;
  }
};

/// 0 where the film lacks the layer.
std::array<float, 3> ColorAt(const ConstColorView& view, int x, int y) {
  if (view[0].IsEmpty()) return {};
  return {UsableOr0(view[0].At(x, y)), UsableOr0(view[1].At(x, y)), UsableOr0(view[2].At(x, y))};
}

Counted& FindOrAdd(float key, std::vector<Counted>* all) {
  const auto found = std::find_if(all->begin(), all->end(), [&](const Counted& c) { return c.key == key; });
  if (found != all->end()) return *found;
  all->emplace_back().key = key;
  return all->back();
}

void AddSubSamples(const EdgeViews& edges, int row, std::vector<Counted>* all) {
  for (int j = 0; j < kSubSamples; ++j) {
    const std::array<float, 3> normal = ColorAt(edges.normal, j, row);
    const float key = SurfaceKey(edges.id.At(j, row), normal, edges.distance.At(j, row));
    if (key == 0) continue;
    Counted& counted = FindOrAdd(key, all);
    counted.sub_samples += 1;
    for (size_t i = 0; i < 2; ++i) counted.place[i] += PlaceOfSubSample(j)[i];
    counted.sub_samples_of_half[HalfOfSubSample(j)] += 1;
    counted.Add(1, ColorAt(edges.albedo, j, row), normal, edges.distance.At(j, row));
  }
}

Counted FromFilm(const FragmentViews& views, int row, const std::array<float, 2>& in_pixel) {
  Counted counted;
  counted.fragment.row = row;
  if (!views.roughness.IsEmpty()) counted.fragment.roughness = UsableOr0(views.roughness.At(0, row));
  counted.fragment.glossy_albedo = ColorAt(views.glossy_albedo, 0, row);
  counted.key = views.key.At(0, row);
  const std::array<float, 2> n = {views.samples.a.At(0, row), views.samples.b.At(0, row)};
  for (size_t h = 0; h < 2; ++h) {
    if (!(n[h] > 0 && n[h] <= in_pixel[h])) continue;
    counted.fragment.share[h] = n[h] / in_pixel[h];
    counted.samples += n[h];
  }
  counted.Add(counted.samples, ColorAt(views.albedo, 0, row), ColorAt(views.normal, 0, row),
              UsableOr0(views.distance.At(0, row)));
  return counted;
}

/// `is_blurred`: the halves share no sub-samples, so that they show how noisy the coverage is.
Fragment Finish(const Counted& counted, const std::array<float, 2>& in_pixel, bool is_blurred) {
  Fragment fragment = counted.fragment;
  const float rays = is_blurred ? kSubSamples / 2.0f : kSubSamples;
  for (size_t h = 0; h < 2; ++h) {
    const float own = OwnWeight(in_pixel[h], rays);
    const float sub_samples = is_blurred ? counted.sub_samples_of_half[h] : counted.sub_samples;
    fragment.coverage[h] = own * fragment.share[h] + (1.0f - own) * sub_samples / rays;
  }
  const float count = counted.samples + counted.sub_samples;
  float length = 0;
  for (const float n : counted.normal) length += n * n;
  length = std::sqrt(length);
  for (size_t c = 0; c < 3; ++c) {
    fragment.albedo[c] = counted.albedo[c] / count;
    fragment.normal[c] = length > 0 ? counted.normal[c] / length : 0.0f;
  }
  fragment.distance = counted.distance / count;
  if (counted.sub_samples > 0) {
    for (size_t i = 0; i < 2; ++i) fragment.place[i] = counted.place[i] / counted.sub_samples - 0.5f;
  }
  return fragment;
}

using HalfColors = std::array<std::array<float, 3>, 2>;

/// FragmentSet::Pixel::emission_of_half by the means of the surfaces that the samples hit (`rows` of the
/// film's fragments). Samples that hit none see the environment, which has what is left of E. 0 where the
/// fragments have no E.
HalfColors EmissionOfHalves(const Frame& frame, const FragmentViews& fragments, const std::vector<int>& rows,
                            const std::array<float, 2>& in_pixel, int x, int y) {
  HalfColors of_half = {};
  if (fragments.emission[0].IsEmpty() || !(in_pixel[0] > 0 && in_pixel[1] > 0)) return of_half;
  std::array<float, 2> missed = in_pixel;
  for (const int row : rows) {
    const std::array<float, 3> emission = ColorAt(fragments.emission, 0, row);
    const std::array<float, 2> n = {fragments.samples.a.At(0, row), fragments.samples.b.At(0, row)};
    for (size_t h = 0; h < 2; ++h) {
      if (!(n[h] > 0 && n[h] <= missed[h])) continue;
      missed[h] -= n[h];
      for (size_t c = 0; c < 3; ++c) of_half[h][c] += n[h] / in_pixel[h] * emission[c];
    }
  }
  const float share_a = in_pixel[0] / (in_pixel[0] + in_pixel[1]);
  const std::array<float, 3> film = ColorAt(frame.emission, x, y);
  for (size_t c = 0; c < 3; ++c) {
    const float of_surfaces = share_a * of_half[0][c] + (1.0f - share_a) * of_half[1][c];
    const float all_missed = missed[0] + missed[1];
    const float of_missed = all_missed > 0 ? (film[c] - of_surfaces) / all_missed : 0.0f;
    const float mean = all_missed > 0 ? film[c] : of_surfaces;
    for (size_t h = 0; h < 2; ++h) {
      const float of_samples = of_missed * (in_pixel[0] + in_pixel[1]) * missed[h] / in_pixel[h];
      of_half[h][c] = UsableOr0(of_half[h][c] + of_samples - mean);
    }
  }
  return of_half;
}

/// FragmentSet::Pixel::emission_change.
HalfColors EmissionChange(const Frame& frame, const EdgeViews& edges, const HalfColors& of_half, int row,
                          int x, int y) {
  const bool is_blurred = IsBlurred(frame, x, y);
  const float rays = is_blurred ? kRaysOfEmission / 2.0f : kRaysOfEmission;
  const std::array<float, 2> own = {OwnWeight(frame.samples.a.At(x, y), rays),
                                    OwnWeight(frame.samples.b.At(x, y), rays)};
  HalfColors change = {};
  for (size_t c = 0; c < 3; ++c) {
    float sum = 0;
    std::array<float, 2> of_half_alone = {};
    for (int j = 0; j < kSubSamples; ++j) {
      const float emission = edges.emission[c].At(j, row);
      sum += emission;
      of_half_alone[HalfOfSubSample(j)] += emission;
    }
    for (size_t h = 0; h < 2; ++h) {
      const float mean = is_blurred ? 2 * of_half_alone[h] / kSubSamples : sum / kSubSamples;
      change[h][c] = (1.0f - own[h]) * (mean - frame.emission[c].At(x, y) - of_half[h][c]);
    }
  }
  return change;
}

/// The film's fragments in the order of its rows.
class FragmentList {
 public:
  explicit FragmentList(const FragmentViews& views) : views_(views) {}

  /// The rows of the pixel, which come in the order of the frame's rows; rows of other pixels are passed
  /// over.
  std::vector<int> RowsOf(int x, int y) {
    while (next_ < views_.rows() && PlaceOf(next_) < std::array<int, 2>{y, x}) ++next_;
    std::vector<int> rows;
    while (next_ < views_.rows() && PlaceOf(next_) == std::array<int, 2>{y, x}) rows.push_back(next_++);
    return rows;
  }

 private:
  std::array<int, 2> PlaceOf(int row) const {
    return {static_cast<int>(views_.y.At(0, row)), static_cast<int>(views_.x.At(0, row))};
  }

  const FragmentViews& views_;
  int next_ = 0;
};

/// Whether all samples and sub-samples of a pixel hit one surface: its means tell all that there is.
bool IsOneSurface(const std::vector<Counted>& all, const std::array<float, 2>& in_pixel) {
  return all.size() == 1 && all[0].samples + all[0].sub_samples == in_pixel[0] + in_pixel[1] + kSubSamples;
}

/// A pixel whose samples tell nothing but E of its surfaces.
FragmentSet::Pixel PixelOfEmission(const Frame& frame, const EdgeViews& edges, const HalfColors& of_half,
                                   int row, int x, int y, size_t fragments) {
  if (frame.surface.blur.IsEmpty())
    return {x, y, fragments, fragments, of_half, EmissionChange(frame, edges, of_half, row, x, y)};
  HalfColors known = {};  // the film has E of each half
  for (size_t h = 0; h < 2; ++h) {
    for (size_t c = 0; c < 3; ++c)
      known[h][c] = UsableOr0(frame.surface.emission_of[h][c].At(x, y) - frame.emission[c].At(x, y));
  }
  return {x, y, fragments, fragments, {}, EmissionChange(frame, edges, known, row, x, y)};
}

/// The pixels of films without fragments, whose surfaces reflect no light of their own.
FragmentSet EmissionOf(const Frame& frame, const EdgeViews& edges) {
  FragmentSet set;
  edges.ForEachPixel(frame.bounds(), [&](int row, int x, int y) {
    if (frame.samples.At(x, y) > 0) set.pixels.push_back(PixelOfEmission(frame, edges, {}, row, x, y, 0));
  });
  return set;
}

/// What sub-samples do not tell of a surface: S and roughness, summed over all samples of the frame that hit
/// it.
struct Gloss {
  std::array<float, 3> albedo = {};
  float roughness = 0;
  float samples = 0;
};

/// The gloss of each surface of the film's fragments, by its name.
std::map<float, Gloss> GlossOfSurfaces(const FragmentViews& views) {
  std::map<float, Gloss> surfaces;
  for (int row = 0; row < views.rows(); ++row) {
    const float key = views.key.At(0, row);
    if (!(key > 0)) continue;  // no name: a film may hold anything
    const float samples = UsableOr0(views.samples.At(0, row));
    Gloss& gloss = surfaces[key];
    const std::array<float, 3> albedo = ColorAt(views.glossy_albedo, 0, row);
    for (size_t c = 0; c < 3; ++c) gloss.albedo[c] += samples * albedo[c];
    gloss.roughness += samples * UsableOr0(views.roughness.At(0, row));
    gloss.samples += samples;
  }
  return surfaces;
}

/// Gives a fragment that sub-samples alone hit the gloss of its surface.
void AddGloss(const std::map<float, Gloss>& surfaces, float key, Fragment* fragment) {
  const auto found = fragment->row < 0 ? surfaces.find(key) : surfaces.end();
  if (found == surfaces.end() || !(found->second.samples > 0)) return;
  for (size_t c = 0; c < 3; ++c) fragment->glossy_albedo[c] = found->second.albedo[c] / found->second.samples;
  fragment->roughness = found->second.roughness / found->second.samples;
}

}  // namespace

FragmentSet FragmentsOf(const Frame& frame) {
  if (!frame.edges.has_value()) return {};
  const EdgeViews& edges = *frame.edges;
  if (!frame.fragments.has_value()) return EmissionOf(frame, edges);
  const FragmentViews& fragments = *frame.fragments;
  FragmentSet set;
  FragmentList list(fragments);
  const std::map<float, Gloss> gloss =
      fragments.roughness.IsEmpty() ? std::map<float, Gloss>{} : GlossOfSurfaces(fragments);
  edges.ForEachPixel(frame.bounds(), [&](int row, int x, int y) {
    const std::vector<int> rows = list.RowsOf(x, y);
    if (!(frame.samples.At(x, y) > 0)) return;
    const std::array<float, 2> in_pixel = {frame.samples.a.At(x, y), frame.samples.b.At(x, y)};
    std::vector<Counted> all;
    all.reserve(rows.size());
    for (const int of_pixel : rows) all.push_back(FromFilm(fragments, of_pixel, in_pixel));
    AddSubSamples(edges, row, &all);
    FragmentSet::Pixel pixel =
        PixelOfEmission(frame, edges, EmissionOfHalves(frame, fragments, rows, in_pixel, x, y), row, x, y,
                        set.fragments.size());
    if (IsOneSurface(all, in_pixel)) {
      // A slice of a lamp that all samples miss shows in E alone.
      if (pixel.emission_change != HalfColors{}) set.pixels.push_back(pixel);
      return;
    }
    for (const Counted& counted : all) {
      if (!(counted.samples + counted.sub_samples > 0)) continue;
      set.fragments.push_back(Finish(counted, in_pixel, IsBlurred(frame, x, y)));
      AddGloss(gloss, counted.key, &set.fragments.back());
    }
    pixel.last = set.fragments.size();
    set.pixels.push_back(pixel);
  });
  return set;
}

}  // namespace lumifold::filter
