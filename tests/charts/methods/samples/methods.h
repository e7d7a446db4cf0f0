#pragma once

#include "tests/charts/methods/samples/sample_method.h"

namespace lumifold::charts {

/// "epanechnikov": every sample is spread over the pixels around its own by a kernel 1 - t^2 whose radius is
/// scale sqrt(Y / (n f)), Y its luminance, n the samples a pixel and f the picture's luminance there: spikes
/// go far, all draws together as samples grow. No energy is lost; what would fall off the picture is mirrored
/// back.
/// Source:  Suykens & Willems 2000. A reconstruction: radii and the picture's estimate (means over windows)
///          are ours.
SampleMethod EpanechnikovMethod();

/// "guided-rays": the guided filter of filter/baselines on each layer of light, its guide normals, depth and
/// the light found by one path through each pixel's centre that draws the same numbers everywhere. What is
/// seen in mirrors that fill less than the frame does without that light.
/// Source:  He, Sun & Tang 2010; Bauszat, Eisemann & Magnor 2011.
SampleMethod GuidedRaysMethod();

/// "probabilistic": in each cluster of light - by one step, by more, by mirrors and glass - a pixel becomes
/// the mean of those around it with like normals and depths, weighed by how likely the number of their
/// samples that brought light is, were this pixel's number the rule, and the reverse, by Poisson's
/// distribution. Albedo stays out of it; what surfaces radiate is kept.
/// Source:  Doidge & Jones 2013. A reconstruction: the clusters are those that layers tell apart, and the
///          geometry's weights are those of our own features.
SampleMethod ProbabilisticMethod();

/// "random-parameters": random parameter filtering. In four passes, boxes of 55, 35, 17 and 7 pixels, each
/// sample becomes the mean of others drawn from around its pixel, weighed by their colours and features; how
/// much each of those counts follows from the mutual information it has with place and with the random
/// numbers of the sample: light and lobe choice, point on the light, direction, lens. Features are position,
/// normal and albedo of the first surface; those of the second are not recorded. What passes lose or gain by
/// taming spikes is given back. Mutual information is freed of the bias that few samples give it, which as
/// published makes everything seem to depend on chance.
/// Source:  Sen & Darabi 2012.
SampleMethod RandomParametersMethod();

}  // namespace lumifold::charts
