#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/rect.h"
#include "filter/image/sample_range.h"
#include "lumifold/v1/worker.pb.h"

namespace lumifold::bench {

/// Units that are ready to be sent: their layout and values are valid for the lease that they answer, and they
/// cost next to nothing to send, so that the load falls on the coordinator.
/// Threads: safe.
class ReadyUnits {
 public:
  /// The messages that deliver the unit of a lease, in order. The pixels are shared by all units of the same
  /// size and number of samples, and must outlive the messages.
  std::vector<grpc::ByteBuffer> MessagesFor(const v1::Lease& lease);

 private:
  /// Serialised PixelChunks of a picture.
  using Chunks = std::vector<std::string>;
  /// Kind, width and height of a unit, and the samples of its halves.
  struct Shape {
    v1::UnitKind kind;
    int width;
    int height;
    uint32_t samples_a;
    uint32_t samples_b;
    friend auto operator<=>(const Shape&, const Shape&) = default;
  };

  const Chunks& PixelsOf(v1::UnitKind kind, const Rect& rect, SampleRange samples);

  absl::Mutex mutex_;
  std::map<Shape, Chunks> pixels_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::bench
