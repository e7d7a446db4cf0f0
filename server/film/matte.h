#pragma once

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/film_source.h"
#include "filter/image/plane.h"

namespace lumifold::film {

/// A of a film with layers::kMatte and, where it catches shadows, layers::kShadow: the part of the pixel that
/// surfaces cover, and the shadow on the rest. `is_filtered`: in edge pixels the sub-samples count as they do
/// in the filtered picture, by the square of their number against that of a half's samples, so that colour
/// and A have the same coverage.
Plane AlphaOf(const EdgedImage& film, bool is_filtered);

/// The shadows on catchers as a film that filters read: D is the part of the light that does not arrive,
/// shadow over light, and T the part of the pixel that catchers cover.
LayeredImage ShadowFilmOf(const LayeredImage& film);

/// ShadowFilmOf of any part of a film, which must outlive it.
class ShadowFilm final : public FilmSource {
 public:
  explicit ShadowFilm(FilmSource* film) : film_(*film) {}
  int width() const override { return film_.width(); }
  int height() const override { return film_.height(); }
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  FilmSource& film_;
};

}  // namespace lumifold::film
