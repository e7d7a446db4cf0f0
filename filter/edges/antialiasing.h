#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// Edge pixels whose light is the mean of (D + I) T + E over their sub-samples, and nothing else: all
/// sub-samples hit diffuse surfaces, emitters or the sky.
struct EdgePoints {
  SlicePoints points;        // where D and I are read from the manifolds; features of geometry
  std::vector<int> rows;     // of the edge set, for each pixel
  std::vector<char> is_lit;  // for each point: whether it has D and I, else E alone
};

/// Leaves out pixels with a mirror, glass or metal in a sub-sample, those where the albedo of the glossy
/// lobes is above `max_glossy_albedo`, and those of more than `max_samples` samples. `sigma_normal`: as in
/// the features of D and I.
EdgePoints EdgePointsOf(const Frame& frame, float max_glossy_albedo, float max_samples, float sigma_normal);

/// The points with pixel coordinates relative to the corner of `box`.
SlicePoints RelativeTo(const Rect& box, const SlicePoints& points);

/// A filtered layer at the points, and the share of the noisy layer that was chosen at their pixels.
struct FilteredPoints {
  std::vector<float> values;   // laid out as SlicedPoints::values
  std::vector<float> weights;  // 0: the point found nothing
  std::vector<float> raw;      // for each pixel
};

/// Values of a black layer at the points; `raw`: share of the noisy layer.
FilteredPoints BlackPoints(const SlicePoints& points, float raw);

/// Scales the points of each pixel, at most by 2, so that their mean is the pixel's value in `planes`: next
/// to an edge a manifold holds mixtures of both sides, so that its points are too similar and too dark.
void FitToPixels(const SlicePoints& points, const Planes& planes, FilteredPoints* at_points);

/// Draws the picture at the pixels towards the mean of (D + I) T + E over the sub-samples, as far as D and I
/// were filtered there and as far as TrustIn() follows it. A point that found nothing is left out of the
/// mean; pixels where half of the points found nothing stay.
/// Shapes:  glossy: light of the glossy lobes that is added to the mean, W x H, 3 planes.
/// Source:  Gruzdev et al. 2015, antialiasing, with albedo and emission inside the mean.
void AntialiasEdges(const Frame& frame, const EdgePoints& points, const FilteredPoints& direct,
                    const FilteredPoints& indirect, const Planes& glossy, TaskPool* pool, Picture* picture);

}  // namespace lumifold::filter
