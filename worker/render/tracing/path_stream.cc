#include "worker/render/tracing/path_stream.h"

#include <array>
#include <numeric>

namespace lumifold::render {

void PathStream::Add(std::span<const Ray> rays, std::span<const Sampler> samplers,
                     std::span<LayerSample> out) {
  for (size_t i = 0; i < rays.size(); ++i) {
    out[i].Clear();
    paths_.emplace_back(rays[i], samplers[i], tracer_->plan_.levels, &out[i]);
  }
  packets_.push_back(rays.size());
}

void PathStream::Add(std::span<const Path> packet) {
  paths_.insert(paths_.end(), packet.begin(), packet.end());
  packets_.push_back(packet.size());
}

void PathStream::Run() {
  AdvancePackets();
  while (!live_.empty()) Advance();
  paths_.swap(branches_);
  live_.resize(paths_.size());
  std::iota(live_.begin(), live_.end(), size_t{0});
  while (!live_.empty()) Advance();
  paths_.clear();
  branches_.clear();
  packets_.clear();
}

void PathStream::AdvancePackets() {
  size_t first = 0;
  for (const size_t count : packets_) {
    std::array<Ray, PathTracer::kPacket> rays;
    std::array<Hit, PathTracer::kPacket> hits;
    for (size_t i = 0; i < count; ++i) rays[i] = paths_[first + i].ray;
    tracer_->embree_->IntersectTogether({rays.data(), count}, hits);
    lit_ = 0;
    for (size_t i = 0; i < count; ++i) Shade(first + i, hits[i]);
    FlushAll();
    if (lit_ > 0) {
      std::array<Vec3, PathTracer::kPacket> transmittances;
      for (size_t i = 0; i < lit_; ++i) rays[i] = shadows_[i].connection.ray;
      tracer_->visibility_.Transmittances({rays.data(), lit_}, transmittances);
      for (size_t i = 0; i < lit_; ++i) Arrive(i, transmittances[i]);
    }
    FinishEnded();
    first += count;
  }
}

void PathStream::Advance() {
  hits_.resize(live_.size());
  for (size_t i = 0; i < live_.size(); ++i) hits_[i] = tracer_->embree_->Intersect(paths_[live_[i]].ray);
  arriving_.swap(live_);
  live_.clear();
  lit_ = 0;
  for (size_t i = 0; i < arriving_.size(); ++i) Shade(arriving_[i], hits_[i]);
  FlushAll();
  for (size_t i = 0; i < lit_; ++i) Arrive(i, tracer_->visibility_.Transmittance(shadows_[i].connection.ray));
  FinishEnded();
}

void PathStream::Shade(size_t path, const Hit& hit) {
  Queue& queue = queues_[!hit.IsMiss() && tracer_->surfaces_.IsDiffuseOnly(hit.instance) ? 0 : 1];
  Vertex& vertex = queue.vertices[queue.count];
  if (!tracer_->Reach(hit, &paths_[path], &vertex.surface)) {
    ended_.push_back(path);
    return;
  }
  BaseMaterial textured;
  const BaseMaterial* material = tracer_->LaneMaterialOf(vertex.surface, &textured);
  if (material == nullptr) {
    Connection* connection = Open(path);
    Close(path, tracer_->Scatter(hit, vertex.surface, &paths_[path], connection, &branches_));
    return;
  }
  tracer_->SetLane(vertex.surface, *material, paths_[path], queue.count, &queue.lanes);
  vertex.path = path;
  vertex.hit = &hit;
  vertex.alpha = material->alpha;
  if (++queue.count == kMaxLanes) Flush(&queue);
}

void PathStream::Flush(Queue* queue) {
  if (queue->count == 0) return;
  ShadeLanes(queue->lanes, queue->count, tracer_->albedo_table_.Nodes(), &shaded_);
  for (size_t i = 0; i < queue->count; ++i) {
    const Vertex& vertex = queue->vertices[i];
    Connection* connection = Open(vertex.path);
    Close(vertex.path, tracer_->ScatterLane(*vertex.hit, vertex.surface, vertex.alpha, shaded_, i,
                                            &paths_[vertex.path], connection));
  }
  queue->count = 0;
}

void PathStream::FlushAll() {
  for (Queue& queue : queues_) Flush(&queue);
}

Connection* PathStream::Open(size_t path) {
  if (lit_ == shadows_.size()) shadows_.emplace_back();
  shadows_[lit_].path = path;
  shadows_[lit_].connection.light = {};
  return &shadows_[lit_].connection;
}

void PathStream::Close(size_t path, bool goes_on) {
  if (!shadows_[lit_].connection.IsBlack()) ++lit_;
  (goes_on ? live_ : ended_).push_back(path);
}

void PathStream::Arrive(size_t connection, Vec3 transmittance) {
  Connection& lit = shadows_[connection].connection;
  lit.light *= transmittance;
  paths_[shadows_[connection].path].Add(lit);
}

void PathStream::FinishEnded() {
  for (const size_t path : ended_) paths_[path].Finish();
  ended_.clear();
}

}  // namespace lumifold::render
