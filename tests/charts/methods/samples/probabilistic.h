#pragma once

#include "tests/charts/methods/samples/sample_method.h"

namespace lumifold::charts {

/// "probabilistic": light is split into clusters: direct, indirect, and light seen in mirrors and through
/// glass. In each cluster a pixel becomes the weighted mean of the pixels around it that have similar normals
/// and depths. The weight is the probability, by Poisson's distribution, of the neighbour's number of samples
/// that carry light, given this pixel's number, and the reverse. Albedo and emission are not filtered.
/// Source:  Doidge & Jones 2013. A reconstruction: the clusters are those that layers tell apart, and the
///          geometry's weights are those of our own features.
SampleMethod ProbabilisticMethod();

}  // namespace lumifold::charts
