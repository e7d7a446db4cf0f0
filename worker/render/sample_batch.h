#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "filter/image/sample_range.h"
#include "worker/render/geometry/camera_packet.h"
#include "worker/render/geometry/edge_mask.h"
#include "worker/render/geometry/fragments.h"
#include "worker/render/renderer.h"
#include "worker/render/tracing/pass_sums.h"
#include "worker/render/tracing/path_stream.h"

namespace lumifold::render {

/// Traces the samples of a pass many packets at a time, which leaves no trace in them, and adds them to their
/// pixels in their order.
class SampleBatch {
 public:
  /// Where the sums of a tile go.
  struct Target {
    Rect rect;
    const EdgeMask* edges;  // pixels that have fragments
    PassPicture* picture;
    FragmentRows* fragments;
    RenderCounts* counts;
  };

  /// Traces `packets` at a time.
  SampleBatch(const PathTracer& tracer, size_t packets, const Target& target);
  ~SampleBatch();

  /// Adds the samples of `range` in pixel (x, y). Pixels come in the order of rows.
  void Add(const PictureCamera& camera, uint64_t seed, int frame, int x, int y, SampleRange range);
  /// Called when a row of pixels is complete.
  void EndRow() { ++rows_; }
  /// Traces what was added.
  void Trace();

 private:
  struct Packet;

  std::span<LayerSample> SamplesOf(size_t packet) {
    return std::span(samples_).subspan(packet * PathTracer::kPacket, PathTracer::kPacket);
  }
  void Sum(const Packet& packet, std::span<const LayerSample> samples);

  const PathTracer& tracer_;
  Target target_;
  size_t capacity_;  // packets
  PathStream stream_;
  std::vector<std::unique_ptr<Packet>> packets_;  // the first count_ of them are in use
  size_t count_ = 0;
  std::vector<LayerSample> samples_;  // PathTracer::kPacket for each packet
  int rows_ = 0;                      // that were added since samples were traced last
  PixelSums sums_;                    // of the pixel whose packets come
  PixelFragments by_surface_;
};

}  // namespace lumifold::render
