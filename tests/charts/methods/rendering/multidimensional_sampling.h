#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// Multidimensional adaptive sampling: samples are points of the picture and, where the camera has one, of
/// the lens; boxes whose samples differ most get more. The picture is the mean, over each pixel and the lens,
/// of the sample that is nearest by a metric stretched along directions in which the light hardly changes.
/// Light paths beyond the lens are drawn as always: their noise is not told from detail, so that this is at
/// its best where lens or edges make most of the noise. Not as published: many boxes get a sample at a time,
/// and the metric is that of a box. Takes about 150 bytes a sample. Source: Hachisuka et al. 2008,
/// "Multidimensional Adaptive Sampling and Reconstruction for Ray Tracing".
RenderMethod MultidimensionalSamplingMethod();

}  // namespace lumifold::charts
