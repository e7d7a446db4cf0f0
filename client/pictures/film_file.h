#pragma once

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/exr_film.h"
#include "filter/image/film_layout.h"

namespace lumifold::client {

/// Input files of a film.
struct FilmFileOptions {
  std::string picture;
  std::string half_b;           // a picture with the same number of other samples, or empty
  std::string layout = "auto";  // name or file of a layout; "auto": GuessFilmLayout
  std::string scratch_folder;   // folder of temporary files of pictures larger than memory
};

/// A film in one or two OpenEXR files of Lumifold or of another renderer. Read part by part.
class FilmFile final : public FilmSource {
 public:
  /// Reads no pixels.
  /// Errors: kNotFound for a missing file or layout; kInvalidArgument for an invalid layout; kDataLoss for a
  /// file that is not a picture or lacks layers that the layout requires.
  static absl::StatusOr<std::unique_ptr<FilmFile>> Open(const FilmFileOptions& options);

  /// Messages about the film for the user, one line each.
  const std::vector<std::string>& notes() const { return notes_; }

  /// The windows and attributes of the picture's file.
  std::shared_ptr<const ExrOrigin> origin() const { return picture_->origin(); }
  /// As IsTransparent says of the picture.
  bool is_transparent() const;
  /// Channels of another renderer's file besides the picture itself, which a filtered one should keep.
  std::vector<std::string> OtherChannels() const;

  int width() const override { return picture_->width(); }
  int height() const override { return picture_->height(); }
  /// Errors: kDataLoss for a damaged file.
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  explicit FilmFile(FilmFileOptions options) : options_(std::move(options)) {}
  absl::StatusOr<EdgedImage> ReadPart(const Rect& rect);
  absl::Status CheckLayers();
  /// Sets the layout for a picture with these channels, unless the user names one.
  absl::Status FindLayout(const LayeredImage& outline);

  FilmFileOptions options_;
  FilmLayout layout_;
  std::unique_ptr<ExrFilm> picture_;
  std::unique_ptr<ExrFilm> half_b_;  // null if there is none
  bool is_own_film_ = false;         // written with --save-film: has halves
  std::vector<std::string> notes_;
};

}  // namespace lumifold::client
