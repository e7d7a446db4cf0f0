#pragma once

#include "tests/charts/methods/samples/sample_method.h"

namespace lumifold::charts {

/// "guided-rays": the guided filter of filter/baselines on each layer of light. The guide is normals, depth
/// and the light of one path through each pixel's centre; all these paths use the same random numbers. Levels
/// whose box is smaller than the frame are filtered without that light.
/// Source:  He, Sun & Tang 2010; Bauszat, Eisemann & Magnor 2011.
SampleMethod GuidedRaysMethod();

}  // namespace lumifold::charts
