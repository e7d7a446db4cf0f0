#include "worker/render/sample_batch.h"

#include <algorithm>
#include <optional>

namespace lumifold::render {

/// Samples of one pixel that wait to be traced.
struct SampleBatch::Packet {
  std::optional<SamplerPacket> samplers;
  std::optional<CameraPacket> rays;
  int x = 0;
  int y = 0;
  bool is_last = false;  // of its pixel
};

SampleBatch::SampleBatch(const PathTracer& tracer, size_t packets, const Target& target)
    : tracer_(tracer),
      target_(target),
      capacity_(packets),
      stream_(tracer),
      samples_(packets * PathTracer::kPacket) {}

SampleBatch::~SampleBatch() = default;

void SampleBatch::Add(const PictureCamera& camera, uint64_t seed, int frame, int x, int y,
                      SampleRange range) {
  for (uint32_t first = range.first; first < range.last; first += PathTracer::kPacket) {
    if (target_.counts->IsStopped()) return;
    if (count_ == packets_.size()) packets_.push_back(std::make_unique<Packet>());
    Packet& packet = *packets_[count_];
    const uint32_t last = std::min<uint32_t>(range.last, first + PathTracer::kPacket);
    packet.samplers.emplace(seed, frame, camera.NumberOf(x, y), first);
    packet.rays.emplace(camera, x, y, *packet.samplers, SampleRange{first, last});
    packet.x = x;
    packet.y = y;
    packet.is_last = last == range.last;
    stream_.Add(packet.rays->rays(), packet.rays->samplers(), SamplesOf(count_));
    if (++count_ == capacity_) Trace();
  }
}

void SampleBatch::Trace() {
  stream_.Run();
  for (size_t i = 0; i < count_; ++i) {
    const CameraPacket& rays = *packets_[i]->rays;
    if (tracer_.CatchesShadows()) tracer_.CatchShadows(rays.rays(), rays.samplers(), SamplesOf(i));
    Sum(*packets_[i], SamplesOf(i));
  }
  count_ = 0;
  if (target_.counts->rows != nullptr) target_.counts->rows->fetch_add(rows_, std::memory_order_relaxed);
  rows_ = 0;
}

void SampleBatch::Sum(const Packet& packet, std::span<const LayerSample> samples) {
  const bool is_edge = target_.edges->Has(packet.x, packet.y);
  for (size_t i = 0; i < packet.rays->size(); ++i) {
    if (!target_.counts->Add(IsFinite(samples[i]))) continue;
    sums_.Add(samples[i], packet.rays->Index(i) & 1, target_.picture->HasLens());
    if (is_edge) by_surface_.Add(samples[i], packet.rays->Index(i) & 1);
  }
  if (!packet.is_last) return;
  target_.picture->Store(packet.x - target_.rect.x0, packet.y - target_.rect.y0, sums_);
  sums_ = {};
  if (!is_edge) return;
  target_.fragments->Add(packet.x, packet.y, by_surface_.Sorted());
  by_surface_ = {};
}

}  // namespace lumifold::render
