#pragma once

#include <functional>
#include <utility>

#include "proto/rpc/image_codec.h"
#include "server/film/unit_film.h"
#include "tests/support/random_unit.h"

namespace lumifold {

/// Units that a function makes.
class UnitsOfFunction final : public film::UnitSource {
 public:
  using Function = std::function<absl::StatusOr<EdgedImage>(const job::UnitKey&)>;
  explicit UnitsOfFunction(Function read) : read_(std::move(read)) {}

  absl::StatusOr<film::UnitOutline> Outline(const job::UnitKey& key) const override {
    const absl::StatusOr<EdgedImage> unit = read_(key);
    if (!unit.ok()) return unit.status();
    return film::UnitOutline{rpc::LayoutOf(unit->pixels), key.kind == v1::UNIT_KIND_PASS
                                                              ? unit->fragments.height()
                                                              : unit->edges.height()};
  }
  absl::StatusOr<EdgedImage> Read(const job::UnitKey& key) const override { return read_(key); }

 private:
  Function read_;
};

/// The whole film of a frame.
inline absl::StatusOr<EdgedImage> WholeFilm(const v1::JobSpec& spec, int32_t frame,
                                            const film::UnitSource& units, TaskPool* pool = nullptr) {
  absl::StatusOr<film::UnitFilm> film = film::UnitFilm::Open(spec, frame, &units, pool);
  if (!film.ok()) return film.status();
  return film->Read({0, 0, film->width(), film->height()});
}

/// RandomUnits of a job.
inline UnitsOfFunction RandomUnitsOf(const v1::JobSpec& spec, uint32_t seed) {
  return UnitsOfFunction(
      [units = job::FrameUnits(spec), model = FullModelOf(spec), seed](const job::UnitKey& key) {
        return absl::StatusOr<EdgedImage>(
            RandomUnit(key, units.tiles().RectOf(key.tile), units.SamplesOf(key), seed, model));
      });
}

}  // namespace lumifold
