#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "worker/render/tracing/path.h"
#include "worker/render/tracing/path_tracer.h"

namespace lumifold::render {

/// Traces the paths of many samples side by side, one vertex of all of them after the other. What a sample
/// becomes does not depend on the others, but for those of its packet: see EmbreeScene::IntersectTogether.
/// Threads: one.
class PathStream {
 public:
  /// Keeps a reference to the tracer, which must outlive it.
  explicit PathStream(const PathTracer& tracer) : tracer_(&tracer) {}
  PathStream(const PathStream&) = delete;
  PathStream& operator=(const PathStream&) = delete;

  /// Adds samples of one packet, at most PathTracer::kPacket; `out` receives them. The rays' random keys are
  /// set. What the spans refer to is in use until the end of Run().
  void Add(std::span<const Ray> rays, std::span<const Sampler> samplers, std::span<LayerSample> out);
  /// Adds a packet of paths, which have not begun, and their rays.
  void Add(std::span<const Ray> rays, std::span<const Path> paths);
  /// Traces what was added, and forgets it.
  void Run();

 private:
  /// One vertex of all live paths: from their rays to the light that arrives there.
  void Advance();
  /// The same for the first vertex, whose rays are traced by packets.
  void AdvancePackets();
  void ConnectPackets();
  /// A vertex that waits until others are shaded with it.
  struct Vertex {
    size_t path;
    const Hit* hit;
    Surface surface;
    SurfaceMaterial textured;  // the material, if it is not the same everywhere
    BaseMaterial textured_base;

    const SurfaceMaterial& material() const { return surface.values != nullptr ? *surface.values : textured; }
  };
  /// Vertices of one kind.
  struct Queue {
    size_t count = 0;
    std::array<Vertex, kMaxLanes> vertices;
    VertexLanes lanes;
  };
  /// What lanes without a path read and write.
  struct Nobody {
    SurfaceRecord surface;
    BaseMaterial material;
    LightTriangle triangle;
    RayRecord ray;
    PathRecord path;
    ConnectionRecord connection;
    LaneVertex vertex = {&surface, &material, &triangle, &ray, &path, &connection, &ray};
  };
  static constexpr size_t kRare = static_cast<size_t>(SurfaceReader::Kind::kRare);

  /// Shades the end of a live path's ray, or puts it in a queue.
  void Shade(size_t path, const Hit& hit);
  /// Shades the vertices of a queue.
  void Flush(size_t kind);
  void FlushLanes(Queue* queue);
  void FlushRare(Queue* queue);
  void FlushAll();
  /// A path whose vertex is shaded goes on or not.
  void Close(size_t path, bool goes_on) { (goes_on ? live_ : ended_).push_back(path); }
  /// Ends the paths that did not go on.
  void FinishEnded();

  /// A light sample and the number of its path.
  struct Shadow {
    Connection connection;
    size_t path;
  };
  /// Adds its light, of which this part arrives.
  void Arrive(Shadow* shadow, Vec3 transmittance);

  const PathTracer* tracer_;
  std::vector<Path> paths_;
  std::vector<std::span<const Ray>> packets_;  // rays of the packets' paths
  std::vector<Path> branches_;                 // begin when the other paths have ended
  std::vector<size_t> live_;                   // numbers of the paths that go on, in order
  std::vector<size_t> ended_;                  // those that have ended and wait for their last light
  std::vector<const Ray*> rays_;
  std::vector<Hit> hits_;
  std::array<Queue, kRare + 1>
      queues_;  // by SurfaceReader::Kind; rare ones have lanes for random numbers only
  Nobody nobody_;
  ShadedLanes shaded_;
  std::vector<size_t> arriving_;  // the live paths before
  std::vector<Shadow> shadows_;   // the first lit_ of them are in use; some are black
  size_t lit_ = 0;
};

}  // namespace lumifold::render
