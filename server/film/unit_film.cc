#include "server/film/unit_film.h"

#include <algorithm>
#include <atomic>
#include <map>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/layers.h"
#include "proto/rpc/image_codec.h"

namespace lumifold::film {
namespace {

using job::UnitKey;

/// Maximum memory of a band of rows; a row of tiles that needs more is read in several bands.
constexpr int64_t kMaxBandBytes = int64_t{512} << 20;

/// Runs `task` for each tile. Returns the error of the lowest tile, so that the error does not depend on the
/// order of the threads.
absl::Status ForEachTile(TaskPool* pool, const std::vector<int32_t>& tiles,
                         absl::FunctionRef<absl::Status(int32_t)> task) {
  absl::Mutex mutex;
  std::map<int32_t, absl::Status> errors;
  ParallelFor(pool, static_cast<int64_t>(tiles.size()), [&](int64_t i) {
    const int32_t tile = tiles[static_cast<size_t>(i)];
    absl::Status status = task(tile);
    if (status.ok()) return;
    absl::MutexLock lock(&mutex);
    errors.emplace(tile, std::move(status));
  });
  return errors.empty() ? absl::OkStatus() : errors.begin()->second;
}

absl::StatusOr<EdgedImage> ReadChecked(const UnitSource& units, const UnitKey& key, const Rect& rect,
                                       const UnitModel& model) {
  absl::StatusOr<EdgedImage> unit = units.Read(key);
  if (!unit.ok()) return unit.status();
  if (absl::Status status = CheckUnitLayout(key.kind, rect, rpc::LayoutOf(unit->pixels), model); !status.ok())
    return status;
  if (absl::Status status = CheckEdges(rect, unit->edges); !status.ok()) return status;
  if (absl::Status status = CheckFragments(rect, model, unit->fragments); !status.ok()) return status;
  return unit;
}

absl::Status AssembleTile(const UnitSource& units, const std::vector<UnitKey>& keys, const Rect& rect,
                          const UnitModel& model, FilmBuilder* film) {
  TileSums sums;
  for (const UnitKey& key : keys) {
    const absl::StatusOr<EdgedImage> unit = ReadChecked(units, key, rect, model);
    if (!unit.ok()) return unit.status();
    if (key.kind == v1::UNIT_KIND_PASS) {
      sums.Add(*unit);
    } else {
      film->SetGeometry(rect, unit->pixels);
      film->AddEdges(unit->edges);
    }
  }
  if (sums.Has(layers::kSamplesA)) film->SetMeans(rect, sums);
  return absl::OkStatus();
}

}  // namespace

UnitFilm::UnitFilm(const v1::JobSpec& spec, int32_t frame, const UnitSource* units, TaskPool* pool,
                   const FilmRounds& rounds)
    : width_(spec.width()),
      height_(spec.height()),
      tile_size_(spec.tile_size()),
      frame_(frame),
      tiles_(spec),
      units_(*units),
      pool_(pool),
      rounds_(rounds),
      model_(ModelOf(spec)) {}

/// The passes in order, then the geometry.
std::vector<UnitKey> UnitFilm::UnitsOf(int32_t tile) const {
  std::vector<UnitKey> keys;
  const int32_t passes = rounds_.rounds == nullptr ? tiles_.pass_count() : rounds_.count;
  keys.reserve(static_cast<size_t>(passes) + 1);
  for (int32_t pass = 0; pass < passes; ++pass) {
    const UnitKey key = {frame_, tile, pass, v1::UNIT_KIND_PASS};
    if (rounds_.rounds == nullptr || rounds_.rounds->Has(key)) keys.push_back(key);
  }
  keys.push_back({frame_, tile, 0, v1::UNIT_KIND_GEOMETRY});
  if (has_ != nullptr) std::erase_if(keys, [this](const UnitKey& key) { return !has_(key); });
  return keys;
}

absl::StatusOr<UnitFilm> UnitFilm::Open(const v1::JobSpec& spec, int32_t frame, const UnitSource* units,
                                        TaskPool* pool, const FilmRounds& rounds) {
  UnitFilm film(spec, frame, units, pool, rounds);
  if (absl::Status status = film.FindOutline(); !status.ok()) return status;
  return film;
}

absl::StatusOr<UnitFilm> UnitFilm::OpenUnfinished(const v1::JobSpec& spec, int32_t frame,
                                                  const UnitSource* units,
                                                  std::function<bool(const UnitKey&)> has, TaskPool* pool) {
  UnitFilm film(spec, frame, units, pool, {});
  film.has_ = std::move(has);
  if (absl::Status status = film.FindOutline(); !status.ok()) return status;
  return film;
}

UnitFilm UnitFilm::OpenPart(const v1::JobSpec& spec, int32_t frame, const UnitSource* units, TaskPool* pool,
                            const LevelSet& levels) {
  UnitFilm film(spec, frame, units, pool, {});
  film.levels_ = levels;
  return film;
}

absl::Status UnitFilm::FindOutline() {
  absl::Mutex mutex;
  const std::vector<int32_t> all = tiles_.tiles().TilesIn({0, 0, width_, height_});
  return ForEachTile(pool_, all, [&](int32_t tile) -> absl::Status {
    for (const UnitKey& key : UnitsOf(tile)) {
      const absl::StatusOr<UnitOutline> outline = units_.Outline(key);
      if (!outline.ok()) return outline.status();
      const LevelSet levels = LevelsOf(key.kind, outline->pixels);
      absl::MutexLock lock(&mutex);
      levels_ |= levels;
      (key.kind == v1::UNIT_KIND_PASS ? pass_rows_ : edge_rows_) += outline->list_rows;
    }
    return absl::OkStatus();
  });
}

absl::StatusOr<int64_t> UnitFilm::CountFragments() const {
  if (pass_rows_ == 0) return 0;
  std::atomic<int64_t> rows = 0;
  const std::vector<int32_t> all = tiles_.tiles().TilesIn({0, 0, width_, height_});
  const absl::Status status = ForEachTile(pool_, all, [&](int32_t tile) -> absl::Status {
    TileFragments fragments;
    for (const UnitKey& key : UnitsOf(tile)) {
      if (key.kind != v1::UNIT_KIND_PASS) continue;
      const absl::StatusOr<EdgedImage> unit = ReadChecked(units_, key, tiles_.tiles().RectOf(tile), model_);
      if (!unit.ok()) return unit.status();
      fragments.Add(unit->fragments);
    }
    rows += fragments.rows();
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return rows.load();
}

LayeredImage UnitFilm::Outline() const { return FilmBuilder(Rect{}, levels_, model_).Take().pixels; }

int UnitFilm::BandEnd(int y) const {
  const int64_t row_bytes =
      int64_t{width_} * static_cast<int64_t>(Outline().channels().size() * sizeof(float));
  const auto max_rows = static_cast<int>(std::clamp<int64_t>(kMaxBandBytes / row_bytes, 1, height_));
  return std::min({(y / tile_size_ + 1) * tile_size_, y + max_rows, height_});
}

absl::StatusOr<EdgedImage> UnitFilm::Read(const Rect& rect) {
  FilmBuilder film(rect, levels_, model_);
  const absl::Status status = ForEachTile(pool_, tiles_.tiles().TilesIn(rect), [&](int32_t tile) {
    return AssembleTile(units_, UnitsOf(tile), tiles_.tiles().RectOf(tile), model_, &film);
  });
  if (!status.ok()) return status;
  return film.Take();
}

}  // namespace lumifold::film
