#include "filter/layers/remainder.h"

#include <cmath>
#include <optional>

#include "filter/layers/features.h"
#include "filter/layers/magnitude.h"
#include "filter/layers/seen_surface.h"

namespace lumifold::filter {
namespace {

constexpr float kRounding = 1e-5f;  // of C: what sums of some thousand floats lose, and no eye sees

/// out += sign * x, plane by plane; unusable values count as 0.
void AddTo(const ConstColorView& x, float sign, TaskPool* pool, Planes* out) {
  ForEachBand(pool, x[0].height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        const float* __restrict in = x[c].Row(y);
        float* __restrict sum = (*out)[c].Row(y);
        for (int i = 0; i < x[c].width(); ++i) sum[i] += sign * UsableOr0(in[i]);
      }
    }
  });
}

/// Whether all light of a pixel is emitted by the surface it shows.
bool OnlyEmits(const Frame& frame, int x, int y) {
  bool emits = false;
  for (size_t c = 0; c < 3; ++c) {
    if (frame.surface.albedo[c].At(x, y) != 0) return false;
    emits |= frame.emission[c].At(x, y) > 0;
  }
  return emits;
}

/// 1 at all hits in the box that do more than emit, else 0.
Plane ReflectingMask(const Frame& frame, const Rect& box) {
  Plane mask(box.width(), box.height());
  ForEachPixel(mask.width(), mask.height(), [&](int x, int y) {
    const bool reflects =
        frame.surface.distance.At(box.x0 + x, box.y0 + y) > 0 && !OnlyEmits(frame, box.x0 + x, box.y0 + y);
    mask.At(x, y) = reflects ? 1.0f : 0.0f;
  });
  return mask;
}

/// Magnitude of the picture in the box over `mean`, averaged over the channels.
Plane LightOf(const Picture& picture, const Rect& box, float mean, TaskPool* pool) {
  const float share = mean > 0 ? 1.0f / (3.0f * mean) : 0.0f;
  Plane light(box.width(), box.height());
  for (const Plane& channel : picture) {
    ForEachPixel(pool, light.width(), light.height(), [&](int x, int y) {
      light.At(x, y) += share * std::abs(channel.At(box.x0 + x, box.y0 + y));
    });
  }
  return light;
}

Planes RemainderGeometry(const Frame& frame, const Rect& box, ConstFloatView validity,
                         const ProductParams& params, TaskPool* pool) {
  GeometryViews views = {frame.surface.normal, frame.surface.distance};
  SeenSurface seen;
  if (params.remainder_sees_levels) {
    seen = SeenSurfaceOf(frame, pool);
    views = seen.geometry();
  }
  return GeometryFeatures({Crop(views.normal, box), views.distance.Crop(box)}, validity, params.ranges, pool);
}

/// Adds factor * (E + E of all levels), of a half or, without one, of the mean.
void AddEmission(const Frame& frame, std::optional<size_t> half, float factor, TaskPool* pool, Planes* sum) {
  AddTo(half.has_value() ? frame.surface.emission_of[*half] : frame.emission, factor, pool, sum);
  for (const LevelViews& level : frame.levels) {
    if (level.emission[0].IsEmpty()) continue;
    AddTo(half.has_value() ? level.surface.emission_of[*half] : level.emission, factor, pool, sum);
  }
}

Planes WithoutEmissionOf(const Frame& frame, std::optional<size_t> half, const ConstColorView& combined,
                         TaskPool* pool) {
  Planes rest = MakePlanes(3, frame.width, frame.height);
  AddTo(combined, 1, pool, &rest);
  AddEmission(frame, half, -1, pool, &rest);
  return rest;
}

}  // namespace

Planes EmissionOf(const Frame& frame, TaskPool* pool) {
  Planes emission = MakePlanes(3, frame.width, frame.height);
  AddEmission(frame, std::nullopt, 1, pool, &emission);
  return emission;
}

Planes WithoutEmission(const Frame& frame, const ConstColorView& combined, TaskPool* pool) {
  return WithoutEmissionOf(frame, std::nullopt, combined, pool);
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

Remainder WithoutEmission(const Frame& frame, TaskPool* pool) {
  return {WithoutEmissionOf(frame, 0, frame.combined.a, pool),
          WithoutEmissionOf(frame, 1, frame.combined.b, pool),
          {}};
}

bool IsRounding(const Remainder& remainder, const Frame& frame, TaskPool* pool) {
  const float most = kRounding * MeanMagnitude(frame.combined.mean, pool);
  return MeanMagnitude(ViewOf(remainder.a), pool) <= most && MeanMagnitude(ViewOf(remainder.b), pool) <= most;
}

Product RemainderProduct(const Frame& frame, const Rect& box, const Picture& picture,
                         const ProductParams& params, TaskPool* pool, Remainder* remainder) {
  remainder->mean = MeanOfHalves(frame, remainder->a, remainder->b, pool);
  Product rest;
  rest.kind = Product::Kind::kRemainder;
  rest.picture_light = LightOf(picture, box, MeanMagnitude(frame.combined.mean, pool), pool);
  rest.mean = ViewOf(remainder->mean);
  rest.halves = {ViewOf(remainder->a), ViewOf(remainder->b), frame.samples.a, frame.samples.b};
  rest.box = box;
  rest.validity = ReflectingMask(frame, box);
  rest.geometry = RemainderGeometry(frame, box, rest.validity.view(), params, pool);
  return rest;
}

}  // namespace lumifold::filter
