#pragma once

#include <span>

#include "filter/image/edged_image.h"
#include "worker/render/geometry/pixel_rows.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/render/tracing/geometry_sample.h"

namespace lumifold::render {

/// Means of a few sub-samples of one pixel, from which edges within and between pixels are detected.
struct EdgeProbe {
  bool hit = false;
  bool valid = false;  // a surface with a diffuse lobe
  bool mixed = false;  // the sub-samples disagree among themselves
  int instance = scene::kNone;
  scene::Vec3 normal;
  scene::Vec3 geometric;
  scene::Vec3 position;
  float distance = 0;
  Ray centre;  // through the pixel's centre
};

/// `samples` belong to one pixel; `centre` is the ray through its centre.
EdgeProbe ProbeOf(std::span<const GeometrySample> samples, const Ray& centre);

/// Whether normal, distance, object or validity are discontinuous between two pixels. The distance is if it
/// changes by more than 5 % beyond the change along the plane of either surface. Symmetric in a and b.
bool IsEdgeBetween(const EdgeProbe& a, const EdgeProbe& b);

/// Collects the sub-samples of edge pixels.
class EdgeRows {
 public:
  EdgeRows();
  /// Adds the edge pixel at (x, y) of the whole frame.
  void Add(int x, int y, std::span<const GeometrySample, kSubSamples> samples);
  /// The rows as EdgedImage::edges.
  LayeredImage Make() const { return rows_.Make(); }

 private:
  PixelRows rows_;
};

}  // namespace lumifold::render
