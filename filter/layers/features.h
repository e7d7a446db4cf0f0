#pragma once

#include <array>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// Geometry of the surface that a pixel shows.
struct GeometryViews {
  ConstColorView normal;
  ConstFloatView distance;  // along the whole path, through mirrors and glass
};

inline constexpr size_t kGeometryFeatures = 4;
inline constexpr float kSigmaNormal = 0.3f;  // chord between unit normals: 10 degrees are 0.58 sigma
inline constexpr float kSigmaLogDepth = 0.05f;

/// Ranges of the geometry features; an infinite one switches its feature off.
struct GeometryRanges {
  float normal = kSigmaNormal;
  float log_depth = kSigmaLogDepth;
  float roughness = 0.1f;  // in the lobes
};

/// One geometry feature of unit normal n and distance z: n[0..2] / ranges.normal, ln(z) / ranges.log_depth.
std::array<float, kGeometryFeatures> GeometryFeature(const std::array<float, 3>& normal, float distance,
                                                     const GeometryRanges& ranges);

/// The geometry features of all pixels: kGeometryFeatures planes; 0 where `validity` is 0.
/// Threads: identical for any pool.
Planes GeometryFeatures(const GeometryViews& geometry, ConstFloatView validity, const GeometryRanges& ranges,
                        TaskPool* pool);

/// Appends value / sigma, 0 where `validity` is 0, to the features.
void AppendFeature(ConstFloatView value, float sigma, ConstFloatView validity, Planes* features);

/// Variance stabilisation, plane by plane: asinh(x / knee) - asinh(origin / knee). It is linear where noise
/// is additive and logarithmic where noise is proportional to the signal, so that one range sigma suits dark
/// and bright. knee > 0; subtracting that of `origin`, a typical value, keeps numbers small, which round
/// less.
Planes Stabilise(const Planes& color, float knee, float origin, TaskPool* pool);

}  // namespace lumifold::filter
