#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/edged_image.h"
#include "filter/image/rect.h"
#include "filter/image/sample_range.h"
#include "lumifold/v1/worker.pb.h"
#include "worker/render/renderer.h"

namespace lumifold::bench {

/// The units of a job.
struct LoadOfAJob {
  int size = 0;  // width and height of a frame, in pixels
  int tile = 0;
  uint32_t pass_samples = 2;
  bool float32 = false;  // all planes as float32, whatever their values
};

/// Units that are ready to be sent: their layout and values are valid for the lease that they answer, and
/// they cost next to nothing to send, so that the load falls on the coordinator.
/// Threads: safe.
class ReadyUnits {
 public:
  /// Made-up values.
  explicit ReadyUnits(bool float32 = false) : float32_(float32) {}
  /// Units of a generated scene, rendered now: some tiles that are spread over a frame, each sent for many
  /// tiles.
  /// Errors: kNotFound naming a scene that does not exist; those of loading it.
  static absl::StatusOr<std::unique_ptr<ReadyUnits>> OfScene(const std::string& scene, const LoadOfAJob& job);

  /// The messages that deliver the unit of a lease, in order. The pixels are shared by all units of the same
  /// size and number of samples, and must outlive the messages.
  std::vector<grpc::ByteBuffer> MessagesFor(const v1::Lease& lease);

 private:
  /// Serialised PixelChunks of a picture.
  using Chunks = std::vector<std::string>;
  struct Unit {
    Chunks pixels;
    LayeredImage list;  // the edge set or the fragments, of the tile at (0, 0)
    int64_t bad_samples = 0;
  };
  /// What a unit depends on: kind, width and height, the samples of its halves, and which tile of a scene it
  /// is.
  struct Shape {
    v1::UnitKind kind;
    int width;
    int height;
    uint32_t samples_a;
    uint32_t samples_b;
    int32_t variant;
    // clang-tidy 14 takes the result's comparison with 0 for one of pointers.
    friend auto operator<=>(const Shape&, const Shape&) = default;  // NOLINT(modernize-use-nullptr)
  };

  const Unit& UnitOf(v1::UnitKind kind, int32_t variant, const Rect& rect, SampleRange samples);
  Chunks ChunksOf(const LayeredImage& picture) const;
  Unit Make(v1::UnitKind kind, int32_t variant, const Rect& rect, SampleRange samples) const;
  /// A tile of the size of `rect`.
  Rect TileOf(int32_t variant, const Rect& rect) const;

  const bool float32_;
  std::unique_ptr<render::Renderer> renderer_;  // null: made-up values
  int frame_size_ = 0;
  absl::Mutex mutex_;
  std::map<Shape, Unit> units_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::bench
