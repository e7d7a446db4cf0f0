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
  packets_.push_back(rays);
}

void PathStream::Add(std::span<const Ray> rays, std::span<const Path> paths) {
  paths_.insert(paths_.end(), paths.begin(), paths.end());
  packets_.push_back(rays);
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
  for (const std::span<const Ray> rays : packets_) {
    std::array<Hit, PathTracer::kPacket> hits;
    tracer_->embree_->IntersectTogether(rays, hits);
    if (tracer_->CatchesShadows()) tracer_->backdrop_.catchers->Hide(rays, hits);
    lit_ = 0;
    for (size_t i = 0; i < rays.size(); ++i) Shade(first + i, hits[i]);
    FlushAll();
    if (lit_ > 0) {
      std::array<Ray, PathTracer::kPacket> shadow_rays;
      std::array<Vec3, PathTracer::kPacket> transmittances;
      for (size_t i = 0; i < lit_; ++i) shadow_rays[i] = shadows_[i].connection.ray;
      tracer_->visibility_.Transmittances({shadow_rays.data(), lit_}, transmittances);
      for (size_t i = 0; i < lit_; ++i) Arrive(i, transmittances[i]);
    }
    FinishEnded();
    first += rays.size();
  }
}

void PathStream::Advance() {
  arriving_.swap(live_);
  live_.clear();
  rays_.clear();
  for (const size_t path : arriving_) rays_.push_back(&paths_[path].ray);
  hits_.resize(rays_.size());
  tracer_->embree_->IntersectEach(rays_, hits_);
  lit_ = 0;
  for (size_t i = 0; i < arriving_.size(); ++i) Shade(arriving_[i], hits_[i]);
  FlushAll();
  for (size_t i = 0; i < lit_; ++i) Arrive(i, tracer_->visibility_.Transmittance(shadows_[i].connection.ray));
  FinishEnded();
}

void PathStream::Shade(size_t path, const Hit& hit) {
  size_t kind = hit.IsMiss() ? kRare : static_cast<size_t>(tracer_->surfaces_.KindOf(hit.instance));
  Vertex* vertex = &queues_[kind].vertices[queues_[kind].count];
  if (!tracer_->Reach(hit, &paths_[path], &vertex->surface)) {
    ended_.push_back(path);
    return;
  }
  vertex->path = path;
  vertex->hit = &hit;
  if (vertex->surface.values == nullptr) vertex->textured = tracer_->surfaces_.Shade(vertex->surface);
  BaseMaterial textured;
  const BaseMaterial* material =
      kind == kRare ? nullptr : tracer_->LaneMaterialOf(vertex->surface, vertex->material(), &textured);
  if (material != nullptr) {
    vertex->alpha = material->alpha;
    tracer_->SetLane(vertex->surface, *material, paths_[path], queues_[kind].count, &queues_[kind].lanes);
  } else if (kind != kRare) {
    kind = kRare;
    queues_[kRare].vertices[queues_[kRare].count] = *vertex;
  }
  Queue& queue = queues_[kind];
  paths_[path].random.SetLane(paths_[path].vertex, queue.count, &queue.lanes.random);
  if (++queue.count == kMaxLanes) Flush(kind);
}

void PathStream::Flush(size_t kind) {
  Queue& queue = queues_[kind];
  if (queue.count == 0) return;
  const RandomLanes& random = queue.lanes.random;
  DrawLanes(&queue.lanes.random, queue.count);
  if (kind != kRare) {
    for (size_t i = 0; i < queue.count; ++i)
      tracer_->SetLightLane(queue.vertices[i].surface, paths_[queue.vertices[i].path], i, &queue.lanes);
    ShadeLanes(queue.lanes, queue.count, tracer_->albedo_table_.Nodes(), &shaded_);
  }
  for (size_t i = 0; i < queue.count; ++i) {
    const Vertex& vertex = queue.vertices[i];
    Path* path = &paths_[vertex.path];
    Connection* connection = Open(vertex.path);
    const bool goes_on =
        kind == kRare
            ? tracer_->Scatter(
                  *vertex.hit, vertex.surface, vertex.material(),
                  {random.light_and_lobe.At(i), random.light_point.At(i), random.direction.At(i)}, path,
                  connection, &branches_)
            : tracer_->ScatterLane(*vertex.hit, vertex.surface, vertex.alpha, shaded_, i, path, connection);
    Close(vertex.path, goes_on);
  }
  queue.count = 0;
}

void PathStream::FlushAll() {
  for (size_t kind = 0; kind <= kRare; ++kind) Flush(kind);
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
