#include "worker/units/unit_messages.h"

#include <utility>

#include "proto/rpc/image_codec.h"

namespace lumifold::worker {
namespace {

v1::WorkerMessage MakeChunk(const v1::Lease& lease) {
  v1::WorkerMessage message;
  *message.mutable_chunk()->mutable_unit() = lease.unit();
  message.mutable_chunk()->set_attempt(lease.attempt());
  return message;
}

v1::WorkerMessage MakePlanMessage(const v1::Lease& lease, const v1::Plan& plan) {
  v1::WorkerMessage message;
  *message.mutable_plan()->mutable_unit() = lease.unit();
  message.mutable_plan()->set_attempt(lease.attempt());
  *message.mutable_plan()->mutable_plan() = plan;
  return message;
}

}  // namespace

void SendUnit(const v1::Lease& lease, const RenderedUnit& unit,
              absl::FunctionRef<void(v1::WorkerMessage)> send) {
  if (unit.plan.has_value()) return send(MakePlanMessage(lease, *unit.plan));
  v1::PixelChunk piece;
  const LayeredImage& list =
      lease.unit().kind() == v1::UNIT_KIND_PASS ? unit.image.fragments : unit.image.edges;
  if (list.height() > 0) {
    rpc::PixelChunker rows(list);
    while (rows.Next(&piece)) {
      v1::WorkerMessage message = MakeChunk(lease);
      message.mutable_chunk()->mutable_edges()->Swap(&piece);
      send(std::move(message));
    }
  }
  rpc::PixelChunker pixels(unit.image.pixels);
  while (pixels.Next(&piece)) {
    v1::WorkerMessage message = MakeChunk(lease);
    if (piece.last()) *message.mutable_chunk()->mutable_stats() = unit.stats;
    message.mutable_chunk()->mutable_pixels()->Swap(&piece);
    send(std::move(message));
  }
}

}  // namespace lumifold::worker
