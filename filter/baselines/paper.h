#pragma once

#include "filter/baselines/baseline.h"

namespace lumifold::filter {

/// "paper": the method that ours extends, as published. The picture is F = (D + I) T + R.
///
/// * D and I of the first hit are each filtered once by adaptive manifolds. The space of the filter has the
///   NLM coordinates of the same layer, the normal and the logarithm of the distance.
/// * R of a mirror or of glass is F of the surface seen in it: D and I of each level are filtered in the same
///   way, with that level's normals and distances, and T of a level has the throughput of the chain.
/// * An edge pixel takes the mean of D and of I over its sub-samples. Each is read from the manifolds at its
///   own normal and distance, with the pixel's NLM coordinates; it is 0 at a sub-sample that hits no diffuse
///   surface. Sub-samples far from all manifolds are left out; where all are, the pixel stays as filtered.
/// * T is not filtered. What is no D or I of a surface (emission, glossy light, what the means of products
///   differ by from the products of means) is R, and stays as it is in C.
///
/// The publication gives no ranges. Those of normals and distances are ours (features.h). That of patches is
/// a multiple of the layer's noise, or the fixed 0.35 of the programs of Gastal & Oliveira, with the layer's
/// mean in place of the white of their pictures. The fixed one suits one number of samples only.
/// Source:  Gruzdev, Frolov & Ignatenko 2015; Gastal & Oliveira 2012.
Baseline PaperBaseline();

}  // namespace lumifold::filter
