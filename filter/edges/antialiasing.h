#pragma once

#include <array>
#include <vector>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// The pixels of an edge set whose light is all diffuse or radiated, or comes from the sky, sub-sample by
/// sub-sample: their picture is the mean of (D + I) T + E over the sub-samples, and nothing else.
struct EdgePoints {
  SlicePoints points;        // where to read D and I; features of geometry
  std::vector<int> rows;     // of the edge set, a pixel
  std::vector<char> is_lit;  // of each point: whether it has D and I, else E alone
};

/// What is left out: pixels with a mirror, glass or metal in a sub-sample, and those where more than
/// `max_glossy_albedo` of the light is reflected by glossy lobes, and pixels of more than `most_samples`.
/// `film` has the channels mask.Y and, where it knows them, glossy_albedo.*; `sigma_normal` as the products'
/// features.
EdgePoints EdgePointsOf(const LayeredImage& film, const LayeredImage& edges, float max_glossy_albedo,
                        float most_samples, float sigma_normal);

/// A layer at the points, and the share of the untouched layer that was chosen at their pixels.
struct FilteredPoints {
  std::vector<float> values;   // as SlicedPoints
  std::vector<float> weights;  // 0: the point found nothing
  std::vector<float> raw;      // a pixel
};

/// Scales the points of each pixel, at most by 2, so that their mean is what `planes` say of the pixel: next
/// to an edge a manifold holds mixtures of both sides, and its points come out too alike and too dark.
void FitToPixels(const SlicePoints& points, const Planes& planes, FilteredPoints* at_points);

/// Draws what `picture` shows at the pixels towards the mean of (D + I) T + E over the sub-samples, as
/// far as D and I were filtered there. `rest`: what is added to it, W x H, 3 planes. A point that found
/// nothing is left out of the mean; pixels where half of the points did stay as they are. Source: Gruzdev et
/// al. 2015, antialiasing, with albedo and emission inside the mean.
void AntialiasEdges(const LayeredImage& film, const LayeredImage& edges, const EdgePoints& points,
                    const FilteredPoints& direct, const FilteredPoints& indirect, const Planes& rest,
                    TaskPool* pool, std::array<Plane, 3>* picture);

}  // namespace lumifold::filter
