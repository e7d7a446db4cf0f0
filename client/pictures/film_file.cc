#include "client/pictures/film_file.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "client/pictures/output_file.h"
#include "filter/image/file_io.h"
#include "filter/image/layers.h"

namespace lumifold::client {
namespace {

constexpr int64_t kMaxLayoutBytes = 64 * 1024;

/// The layout that is found by the layers of the picture.
constexpr char kFoundByItself[] = "auto";

absl::StatusOr<FilmLayout> LayoutOf(const std::string& name) {
  if (const FilmLayout* known = FindFilmLayout(name)) return *known;
  const absl::StatusOr<std::string> text = ReadFile(name, kMaxLayoutBytes);
  if (absl::IsNotFound(text.status())) {
    return absl::NotFoundError(
        absl::StrCat("--layout: no layout is named '", name, "', and there is no such file"));
  }
  if (!text.ok()) return text.status();
  return ParseFilmLayout(name, *text);
}

/// Errors of a picture are kDataLoss: kInvalidArgument is for errors of the command line.
absl::Status AsPictureError(const absl::Status& status) {
  return absl::IsInvalidArgument(status) ? absl::DataLossError(status.message()) : status;
}

/// Maps the layers of `picture` and, unless null, of `half_b` from another file to a part of a film.
absl::StatusOr<ForeignFilm> MapLayers(const FilmFileOptions& options, const FilmLayout& layout,
                                      const LayeredImage& picture, const LayeredImage* half_b) {
  absl::StatusOr<ForeignFilm> film = ReadForeignFilm(options.picture, picture, layout);
  if (!film.ok() || half_b == nullptr) return film;
  const absl::StatusOr<ForeignFilm> other = ReadForeignFilm(options.half_b, *half_b, layout);
  if (!other.ok()) return other.status();
  absl::StatusOr<LayeredImage> joined = JoinHalves(film->film, other->film);
  if (!joined.ok()) return joined.status();
  return ForeignFilm{*std::move(joined), std::move(film->notes)};
}

}  // namespace

absl::StatusOr<std::unique_ptr<FilmFile>> FilmFile::Open(const FilmFileOptions& options) {
  std::unique_ptr<FilmFile> film(new FilmFile(options));
  if (options.layout != kFoundByItself) {
    absl::StatusOr<FilmLayout> layout = LayoutOf(options.layout);
    if (!layout.ok()) return AsPictureError(layout.status());
    film->layout_ = *std::move(layout);
  }
  if (absl::Status status = film->CheckLayers(); !status.ok()) return AsPictureError(status);
  return film;
}

absl::Status FilmFile::FindLayout(const LayeredImage& outline) {
  if (options_.layout != kFoundByItself) return absl::OkStatus();
  const absl::StatusOr<std::string> guess = GuessFilmLayout(options_.picture, outline);
  if (!guess.ok()) return guess.status();
  options_.layout = *guess;
  layout_ = *FindFilmLayout(*guess);
  if (*guess != "lumifold") notes_.push_back(absl::StrCat("read with --layout ", *guess));
  return absl::OkStatus();
}

bool FilmFile::is_transparent() const { return IsTransparent(picture_->Outline()); }

std::vector<std::string> FilmFile::OtherChannels() const {
  std::vector<std::string> names;
  if (options_.layout == "lumifold") return names;
  const LayeredImage outline = picture_->Outline();
  for (const LayeredImage::Channel& channel : outline.channels()) names.push_back(channel.name);
  return names;
}

absl::Status FilmFile::CheckLayers() {
  absl::StatusOr<std::unique_ptr<ExrFilm>> picture = ExrFilm::Open(options_.picture, options_.scratch_folder);
  if (!picture.ok()) return picture.status();
  picture_ = *std::move(picture);
  const LayeredImage outline = picture_->Outline();
  if (absl::Status status = FindLayout(outline); !status.ok()) return status;
  is_own_film_ = options_.layout == "lumifold" && options_.half_b.empty() && outline.Has(layers::kSamplesA) &&
                 outline.HasColor(layers::HalfA(layers::kDirect));
  if (is_own_film_) return absl::OkStatus();
  LayeredImage other;
  if (!options_.half_b.empty()) {
    absl::StatusOr<std::unique_ptr<ExrFilm>> half = ExrFilm::Open(options_.half_b, options_.scratch_folder);
    if (!half.ok()) return half.status();
    half_b_ = *std::move(half);
    other = half_b_->Outline();
    if (half_b_->width() != width() || half_b_->height() != height()) {
      return absl::InvalidArgumentError(absl::StrCat("the halves differ in size: ", width(), "x", height(),
                                                     " and ", half_b_->width(), "x", half_b_->height()));
    }
  }
  absl::StatusOr<ForeignFilm> film =
      MapLayers(options_, layout_, outline, half_b_ != nullptr ? &other : nullptr);
  if (!film.ok()) return film.status();
  notes_.insert(notes_.end(), film->notes.begin(), film->notes.end());
  if (half_b_ == nullptr)
    notes_.emplace_back(
        "one picture: its noise is estimated from the picture itself, and fine detail may be taken for "
        "noise");
  return absl::OkStatus();
}

absl::StatusOr<EdgedImage> FilmFile::Read(const Rect& rect) {
  absl::StatusOr<EdgedImage> part = ReadPart(rect);
  if (!part.ok()) return AsPictureError(part.status());
  return part;
}

absl::StatusOr<EdgedImage> FilmFile::ReadPart(const Rect& rect) {
  absl::StatusOr<EdgedImage> picture = picture_->Read(rect);
  if (!picture.ok() || is_own_film_) return picture;
  absl::StatusOr<EdgedImage> half = EdgedImage();
  if (half_b_ != nullptr) half = half_b_->Read(rect);
  if (!half.ok()) return half.status();
  absl::StatusOr<ForeignFilm> film =
      MapLayers(options_, layout_, picture->pixels, half_b_ != nullptr ? &half->pixels : nullptr);
  if (!film.ok()) return film.status();
  return EdgedImage{std::move(film->film), {}};
}

}  // namespace lumifold::client
