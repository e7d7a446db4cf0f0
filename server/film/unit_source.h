#pragma once

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "lumifold/v1/image.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "server/job/unit.h"

namespace lumifold::film {

/// Layout of a unit, without its pixels.
struct UnitOutline {
  v1::PixelLayout pixels;
  int list_rows = 0;  // of the edge set of a geometry unit, of the fragments of a pass
  v1::UnitStats stats = {};
};

/// The committed units of a frame.
/// Threads: safe.
class UnitSource {
 public:
  virtual ~UnitSource() = default;

  /// Errors of both: kDataLoss for a unit that is missing or damaged.
  virtual absl::StatusOr<UnitOutline> Outline(const job::UnitKey& key) const = 0;
  virtual absl::StatusOr<EdgedImage> Read(const job::UnitKey& key) const = 0;
};

}  // namespace lumifold::film
