#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// "mdas": multidimensional adaptive sampling. Samples are points of the picture and, if the camera has one,
/// of the lens. The boxes whose samples differ most get more samples. The picture is the mean over pixel and
/// lens of the nearest sample, by a metric that is stretched along directions of little change. Light paths
/// beyond the lens are drawn as usual, and their noise cannot be told from detail: the method is best where
/// lens or edges cause most of the noise. Differences from the publication: many boxes get a sample at a
/// time, and the metric is constant in a box. Takes about 150 bytes per sample.
/// Source:  Hachisuka et al. 2008, "Multidimensional Adaptive Sampling and Reconstruction for Ray Tracing".
RenderMethod MultidimensionalSamplingMethod();

}  // namespace lumifold::charts
