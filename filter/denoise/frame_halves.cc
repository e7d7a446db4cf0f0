#include "filter/denoise/frame_halves.h"

namespace lumifold::filter {
namespace {

/// Sum over the points of a pixel of weight * albedo * light; channel c.
float SumOver(const LayerFragments& fragments, const LayerFragments::Pixel& pixel,
              const std::vector<float>& weight, const std::vector<float>& light, size_t c) {
  float sum = 0;
  for (size_t i = pixel.first; i < pixel.last; ++i)
    sum += weight[i] * fragments.albedo[i][c] * light[3 * i + c];
  return sum;
}

void AddMixedPixels(const Rect& box, const FilteredLayer& layer, size_t h, size_t c, Planes* rest,
                    Planes* change) {
  const LayerFragments& fragments = layer.fragments;
  for (const LayerFragments::Pixel& p : fragments.pixels) {
    const float noisy = SumOver(fragments, p, fragments.share[h], fragments.noisy[h], c);
    const float filtered = SumOver(fragments, p, fragments.coverage[h], layer.light.points[h], c);
    if (rest != nullptr) (*rest)[c].At(box.x0 + p.x, box.y0 + p.y) -= UsableOr0(noisy);
    (*change)[c].At(box.x0 + p.x, box.y0 + p.y) += UsableOr0(filtered - noisy);
  }
}

/// to += t * (from - to), both halves.
void MoveTowards(const FrameChange& to, const Plane& share, TaskPool* pool, FrameChange* from) {
  for (size_t h = 0; h < 2; ++h) {
    for (size_t c = 0; c < 3; ++c) {
      ForEachPixel(pool, share.width(), share.height(), [&](int x, int y) {
        float& value = (*from)[h][c].At(x, y);
        value += share.At(x, y) * (to[h][c].At(x, y) - value);
      });
    }
  }
}

}  // namespace

FrameChange NoChange(const Frame& frame) {
  return {MakePlanes(3, frame.width, frame.height), MakePlanes(3, frame.width, frame.height)};
}

void AddEmissionChange(const FragmentSet& set, FrameChange* change) {
  for (const FragmentSet::Pixel& pixel : set.pixels) {
    for (Planes& planes : *change) {
      for (size_t c = 0; c < 3; ++c) planes[c].At(pixel.x, pixel.y) += UsableOr0(pixel.emission_change[c]);
    }
  }
}

void AddFiltered(const Product& product, const FilteredLayer& layer, size_t h, TaskPool* pool, Planes* rest,
                 Planes* change) {
  const Rect& box = product.box;
  const Planes& after = h == 0 ? layer.light.picture.a : layer.light.picture.b;
  const ConstColorView& half = h == 0 ? product.halves.a : product.halves.b;
  const ConstFloatView& count = h == 0 ? product.halves.samples_a : product.halves.samples_b;
  const int width = (*change)[0].width();
  const int height = (*change)[0].height();
  Plane is_mixed(width, height);
  for (const LayerFragments::Pixel& p : layer.fragments.pixels) is_mixed.At(box.x0 + p.x, box.y0 + p.y) = 1;
  const bool has_factor = !product.factor[0].IsEmpty();
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(pool, width, height, [&](int x, int y) {
      if (is_mixed.At(x, y) > 0) return;
      const float noisy = count.At(x, y) > 0 ? half[c].At(x, y) : product.mean[c].At(x, y);
      const float factor = has_factor ? product.factor[c].At(x, y) : 1.0f;
      if (rest != nullptr) (*rest)[c].At(x, y) -= UsableOr0(noisy * factor);
      if (!box.Contains(x, y) || !(product.validity.At(x - box.x0, y - box.y0) > 0)) return;
      (*change)[c].At(x, y) += UsableOr0((after[c].At(x - box.x0, y - box.y0) - noisy) * factor);
    });
    AddMixedPixels(box, layer, h, c, rest, change);
  }
}

Planes MeanOfHalves(const Frame& frame, const Planes& a, const Planes& b, TaskPool* pool) {
  Planes mean = MakeUninitializedPlanes(3, frame.width, frame.height);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
      const float share = frame.samples.ShareA(x, y);
      mean[c].At(x, y) = share * a[c].At(x, y) + (1.0f - share) * b[c].At(x, y);
    });
  }
  return mean;
}

Picture PictureOf(const Frame& frame, const FrameChange& change, TaskPool* pool) {
  const Planes mean = MeanOfHalves(frame, change[0], change[1], pool);
  Picture picture = ClonePicture(frame.combined.mean);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
      float& value = picture[c].At(x, y);
      value = UsableOr0(UsableOr0(value) + mean[c].At(x, y));
    });
  }
  return picture;
}

void ChooseChange(const Frame& frame, const Plane& mixed, const std::vector<FrameChange>& candidates,
                  const ChoiceParams& params, TaskPool* pool, FrameChange* change) {
  const Plane ones = MakePlane(frame.width, frame.height, 1.0f);
  Halves halves =
      MakeHalves({frame.combined.a, frame.combined.b, frame.samples.a, frame.samples.b}, ones.view(), pool);
  if (halves.level == 0) return;
  halves.is_mixed = mixed.Clone();
  // The picture of a change, in the halves' unit.
  const auto picture_of = [&](const FrameChange& of) {
    Candidate picture = {Clone(halves.a), Clone(halves.b)};
    for (size_t h = 0; h < 2; ++h) {
      Planes& planes = h == 0 ? picture.a : picture.b;
      for (size_t c = 0; c < 3; ++c) {
        ForEachPixel(pool, frame.width, frame.height,
                     [&](int x, int y) { planes[c].At(x, y) += of[h][c].At(x, y) / halves.scale; });
      }
    }
    return picture;
  };
  const Choice choice(halves, LightOf(halves, picture_of(*change), pool), params, pool);
  const auto compare = [&](const FrameChange& with) {
    MoveTowards(with, choice.ShareOf(picture_of(*change), picture_of(with), pool), pool, change);
  };
  for (const FrameChange& candidate : candidates) compare(candidate);
  compare(NoChange(frame));
}

}  // namespace lumifold::filter
