#include "filter/denoise/frame_halves.h"

#include <algorithm>
#include <utility>

#include "filter/layers/mixed_pixels.h"

namespace lumifold::filter {
namespace {

/// What takes the fireflies out of C. `halves`: of C; as they were afterwards.
FrameChange WithoutFireflies(const LayerSettings& settings, TaskPool* pool, Halves* halves) {
  FrameChange change = {Clone(halves->a), Clone(halves->b)};
  SuppressFireflies(settings.fireflies, settings.choice.wide_radius, halves, pool);
  std::swap(change[0], halves->a);
  std::swap(change[1], halves->b);
  for (size_t h = 0; h < 2; ++h) {
    for (size_t c = 0; c < 3; ++c) {
      const Plane& noisy = HalfOf(*halves, h)[c];
      Plane& plane = change[h][c];
      ForEachPixel(pool, plane.width(), plane.height(),
                   [&](int x, int y) { plane.At(x, y) = (plane.At(x, y) - noisy.At(x, y)) * halves->scale; });
    }
  }
  return change;
}

/// The squared difference of halves whose samples of emission are either 0 or what the brightest pixel around
/// shows: a lamp's rim covers a part of a pixel. n samples of a part p have variance p (1 - p) / n; two
/// halves of n / 2 differ by 4 times as much.
Plane EmissionDifference(const Frame& frame, float scale, TaskPool* pool) {
  const Planes emission = EmissionOf(frame, pool);
  Plane difference(frame.width, frame.height);
  ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
    const float samples = frame.samples.At(x, y);
    if (!(samples > 0)) return;
    for (const Plane& plane : emission) {
      float brightest = 0;
      for (int j = std::max(y - 1, 0); j <= std::min(y + 1, frame.height - 1); ++j) {
        for (int i = std::max(x - 1, 0); i <= std::min(x + 1, frame.width - 1); ++i)
          brightest = std::max(brightest, UsableOr0(plane.At(i, j)));
      }
      const float value = UsableOr0(plane.At(x, y));
      difference.At(x, y) += 4 * value * (brightest - value) / (samples * scale * scale);
    }
  });
  return difference;
}

}  // namespace

void AddEmissionChange(const FragmentSet& set, FrameChange* change) {
  for (const FragmentSet::Pixel& pixel : set.pixels) {
    for (size_t h = 0; h < 2; ++h) {
      for (size_t c = 0; c < 3; ++c)
        (*change)[h][c].At(pixel.x, pixel.y) += UsableOr0(pixel.emission_change[h][c]);
    }
  }
}

void SubtractEmissionOfHalves(const FragmentSet& set, Remainder* rest) {
  for (const FragmentSet::Pixel& pixel : set.pixels) {
    for (size_t c = 0; c < 3; ++c) {
      rest->a[c].At(pixel.x, pixel.y) -= pixel.emission_of_half[0][c];
      rest->b[c].At(pixel.x, pixel.y) -= pixel.emission_of_half[1][c];
    }
  }
}

Plane ChooseChange(const Frame& frame, const Plane& mixed, const std::vector<FrameChange>& candidates,
                   const LayerSettings& settings, TaskPool* pool, FrameChange* change) {
  const Plane ones = MakePlane(frame.width, frame.height, 1.0f);
  Halves halves =
      MakeHalves({frame.combined.a, frame.combined.b, frame.samples.a, frame.samples.b}, ones.view(), pool);
  if (halves.level == 0) return {frame.width, frame.height};
  halves.is_mixed = MixedPart(mixed, frame.bounds());
  halves.expected_difference = EmissionDifference(frame, halves.scale, pool);
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
  const Choice choice(halves, LightOf(halves, picture_of(*change), pool), settings.choice, nullptr, pool);
  const auto move = [&](const FrameChange& to, const Candidate& compared) {
    Plane share = choice.ShareOf(picture_of(*change), compared, pool);
    for (size_t h = 0; h < 2; ++h) MoveTowards(to[h], share, pool, &(*change)[h]);
    return share;
  };
  for (const FrameChange& candidate : candidates) move(candidate, picture_of(candidate));
  // By how much is said by C with its fireflies, as in the choices of the noisy layers.
  const Candidate noisy = {Clone(halves.a), Clone(halves.b)};
  return move(WithoutFireflies(settings, pool, &halves), noisy);
}

}  // namespace lumifold::filter
