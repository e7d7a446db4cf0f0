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
  hits_.resize(paths_.size());
  size_t first = 0;
  for (const std::span<const Ray> rays : packets_) {
    const std::span<Hit> hits = std::span(hits_).subspan(first, rays.size());
    tracer_->embree_->IntersectTogether(rays, hits);
    if (tracer_->CatchesShadows()) tracer_->backdrop_.catchers->Hide(rays, hits);
    first += rays.size();
  }
  lit_ = 0;
  for (size_t path = 0; path < paths_.size(); ++path) Shade(path, hits_[path]);
  FlushAll();
  ConnectPackets();
  FinishEnded();
}

void PathStream::ConnectPackets() {
  std::vector<Shadow*> of_path(paths_.size(), nullptr);
  for (Shadow& shadow : std::span(shadows_).first(lit_)) {
    if (!shadow.connection.IsBlack()) of_path[shadow.path] = &shadow;
  }
  size_t first = 0;
  for (const std::span<const Ray> packet : packets_) {
    std::array<Ray, PathTracer::kPacket> rays;
    std::array<Shadow*, PathTracer::kPacket> shadows;
    size_t count = 0;
    for (Shadow* shadow : std::span(of_path).subspan(first, packet.size())) {
      if (shadow == nullptr) continue;
      rays[count] = shadow->connection.shadow_ray;
      shadows[count++] = shadow;
    }
    first += packet.size();
    if (count == 0) continue;
    std::array<Vec3, PathTracer::kPacket> transmittances;
    tracer_->visibility_.Transmittances({rays.data(), count}, transmittances);
    for (size_t i = 0; i < count; ++i) Arrive(shadows[i], transmittances[i]);
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
  for (Shadow& shadow : std::span(shadows_).first(lit_)) {
    const Connection& connection = shadow.connection;
    if (!connection.IsBlack()) Arrive(&shadow, tracer_->visibility_.Transmittance(connection.shadow_ray));
  }
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
  const BaseMaterial* material =
      kind == kRare ? nullptr
                    : tracer_->LaneMaterialOf(vertex->surface, vertex->material(), &vertex->textured_base);
  if (material == nullptr && kind != kRare) {
    kind = kRare;
    queues_[kRare].vertices[queues_[kRare].count] = *vertex;
  }
  Queue& queue = queues_[kind];
  VertexLanes& lanes = queue.lanes;
  paths_[path].random.SetLane(paths_[path].vertex, queue.count, &lanes.random);
  if (material != nullptr) {
    lanes.vertices[queue.count] = {
        .surface = &vertex->surface, .material = material, .ray = &paths_[path].ray, .path = &paths_[path]};
    tracer_->SetChoiceLane(paths_[path], queue.count, &lanes.choice);
  }
  if (++queue.count == kMaxLanes) Flush(kind);
}

void PathStream::Flush(size_t kind) {
  Queue& queue = queues_[kind];
  if (queue.count == 0) return;
  if (shadows_.size() < lit_ + kMaxLanes) shadows_.resize(lit_ + kMaxLanes);
  queue.lanes.random.Draw(queue.count);
  kind == kRare ? FlushRare(&queue) : FlushLanes(&queue);
  queue.count = 0;
}

void PathStream::FlushRare(Queue* queue) {
  const RandomLanes& random = queue->lanes.random;
  for (size_t i = 0; i < queue->count; ++i) {
    const Vertex& vertex = queue->vertices[i];
    Shadow& shadow = shadows_[lit_];
    shadow.path = vertex.path;
    shadow.connection.light = {};
    Close(vertex.path,
          tracer_->Scatter(*vertex.hit, vertex.surface, vertex.material(),
                           {random.light_and_lobe.At(i), random.light_point.At(i), random.direction.At(i)},
                           &paths_[vertex.path], &shadow.connection, &branches_));
    if (!shadow.connection.IsBlack()) ++lit_;
  }
}

void PathStream::FlushLanes(Queue* queue) {
  VertexLanes& lanes = queue->lanes;
  for (size_t i = queue->count; i < kMaxLanes; ++i) lanes.vertices[i] = nobody_.vertex;
  tracer_->PickLights(queue->count, &lanes);
  for (size_t i = 0; i < queue->count; ++i) {
    const Vertex& vertex = queue->vertices[i];
    Shadow& shadow = shadows_[lit_ + i];
    shadow.path = vertex.path;
    lanes.vertices[i].connection = &shadow.connection;
    lanes.vertices[i].shadow_ray = &shadow.connection.shadow_ray;
    tracer_->SetLightLane(vertex.surface, paths_[vertex.path], i, &lanes);
  }
  ShadeLanes(lanes, queue->count, tracer_->albedo_table_.Nodes(), &shaded_);
  for (size_t i = 0; i < queue->count; ++i) {
    const Vertex& vertex = queue->vertices[i];
    Close(vertex.path, tracer_->LeaveLane(*vertex.hit, vertex.surface, lanes.vertices[i].material->alpha,
                                          shaded_, i, &paths_[vertex.path]));
  }
  lit_ += queue->count;
}

void PathStream::FlushAll() {
  for (size_t kind = 0; kind <= kRare; ++kind) Flush(kind);
}

void PathStream::Arrive(Shadow* shadow, Vec3 transmittance) {
  shadow->connection.light *= transmittance;
  paths_[shadow->path].Add(shadow->connection);
}

void PathStream::FinishEnded() {
  for (const size_t path : ended_) paths_[path].Finish();
  ended_.clear();
}

}  // namespace lumifold::render
