#include "server/film/assemble.h"

#include <map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "proto/rpc/image_codec.h"
#include "server/film/film_builder.h"
#include "server/film/unit_layout.h"
#include "server/scheduler/tile_grid.h"

namespace lumifold::film {
namespace {

using scheduler::FrameUnits;
using scheduler::UnitKey;

absl::StatusOr<EdgedImage> ReadChecked(const UnitKey& key, const Rect& rect, UnitSource read) {
  absl::StatusOr<EdgedImage> unit = read(key);
  if (!unit.ok()) return unit.status();
  if (absl::Status status = CheckUnitLayout(key.kind, rect, rpc::LayoutOf(unit->pixels)); !status.ok())
    return status;
  if (absl::Status status = CheckEdges(rect, unit->edges); !status.ok()) return status;
  return unit;
}

absl::Status AssembleTile(const FrameUnits& units, int32_t frame, int32_t tile, UnitSource read,
                          FilmBuilder* film) {
  const Rect rect = units.tiles().RectOf(tile);
  TileSums sums;
  for (int32_t pass = 0; pass < units.pass_count(); ++pass) {
    const absl::StatusOr<EdgedImage> unit = ReadChecked({frame, tile, pass, v1::UNIT_KIND_PASS}, rect, read);
    if (!unit.ok()) return unit.status();
    sums.Add(unit->pixels);
  }
  film->SetMeans(rect, sums);
  absl::StatusOr<EdgedImage> geometry = ReadChecked({frame, tile, 0, v1::UNIT_KIND_GEOMETRY}, rect, read);
  if (!geometry.ok()) return geometry.status();
  film->SetGeometry(rect, geometry->pixels);
  film->AddEdges(std::move(geometry->edges));
  return absl::OkStatus();
}

// The error of the lowest tile, so that which one is told does not depend on the race between threads.
class FirstError {
 public:
  void Offer(int64_t tile, absl::Status status) {
    absl::MutexLock lock(&mutex_);
    if (!status.ok()) errors_.emplace(tile, std::move(status));
  }
  absl::Status Get() {
    absl::MutexLock lock(&mutex_);
    return errors_.empty() ? absl::OkStatus() : errors_.begin()->second;
  }

 private:
  absl::Mutex mutex_;
  std::map<int64_t, absl::Status> errors_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

absl::StatusOr<EdgedImage> AssembleFilm(const v1::JobSpec& spec, int32_t frame, UnitSource read,
                                        TaskPool* pool) {
  const FrameUnits units(spec);
  FilmBuilder film(spec.width(), spec.height());
  FirstError error;
  ParallelFor(pool, units.tiles().count(), [&](int64_t tile) {
    error.Offer(tile, AssembleTile(units, frame, static_cast<int32_t>(tile), read, &film));
  });
  if (absl::Status status = error.Get(); !status.ok()) return status;
  return film.Take();
}

}  // namespace lumifold::film
