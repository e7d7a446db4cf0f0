#pragma once

#include <span>
#include <string>
#include <vector>

#include "filter/image/edged_image.h"
#include "worker/render/embree_scene.h"
#include "worker/render/geometry_sample.h"

namespace lumifold::render {

/// What tells whether an edge runs through a pixel or between two: the means of a few of its sub-samples.
struct EdgeProbe {
  bool hit = false;
  bool valid = false;  // a surface with a diffuse lobe
  bool mixed = false;  // the sub-samples disagree among themselves
  int instance = scene::kNone;
  scene::Vec3 normal;
  scene::Vec3 geometric;
  scene::Vec3 position;
  float distance = 0;
  Ray centre;  // through the pixel's middle
};

/// `samples` are of one pixel; `centre` is the ray through its middle.
EdgeProbe ProbeOf(std::span<const GeometrySample> samples, const Ray& centre);

/// Whether normal, distance, object or validity jump from one pixel to the next. A distance jumps where it
/// changes by more than 5 % beyond what the plane of either surface explains. Symmetric.
bool IsEdgeBetween(const EdgeProbe& a, const EdgeProbe& b);

/// Collects the sub-samples of edge pixels.
class EdgeRows {
 public:
  EdgeRows();
  /// The next edge pixel, at (x, y) of the whole frame.
  void Add(int x, int y, std::span<const GeometrySample, kSubSamples> samples);
  /// EdgedImage::edges.
  LayeredImage Make() const;

 private:
  std::vector<std::string> names_;
  std::vector<std::vector<float>> values_;  // by channel
};

}  // namespace lumifold::render
