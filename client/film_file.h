#pragma once

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/exr_film.h"
#include "filter/image/film_layout.h"

namespace lumifold::client {

/// Where a film to be filtered comes from.
struct FilmFileOptions {
  std::string picture;
  std::string half_b;               // a picture of as many other samples, or empty
  std::string layout = "lumifold";  // a layout's name or file
  std::string scratch_folder;       // for what does not fit into memory
};

/// The film in one OpenEXR file or two, ours or another renderer's, read part by part.
class FilmFile final : public FilmSource {
 public:
  /// Reads no pixels. Errors: kNotFound for a file or layout that is not there; kInvalidArgument for a layout
  /// that is none; kDataLoss for a picture that is none or lacks what the layout asks for.
  static absl::StatusOr<std::unique_ptr<FilmFile>> Open(const FilmFileOptions& options);

  /// What the user should know of the film, a line each.
  const std::vector<std::string>& notes() const { return notes_; }

  int width() const override { return picture_->width(); }
  int height() const override { return picture_->height(); }
  /// Errors: kDataLoss for a damaged file.
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  FilmFile(FilmFileOptions options, FilmLayout layout)
      : options_(std::move(options)), layout_(std::move(layout)) {}
  absl::StatusOr<EdgedImage> ReadPart(const Rect& rect);
  absl::Status Examine();

  FilmFileOptions options_;
  FilmLayout layout_;
  std::unique_ptr<ExrFilm> picture_;
  std::unique_ptr<ExrFilm> half_b_;  // null where there is none
  bool is_whole_film_ = false;       // it holds its own halves: what --save-film writes
  std::vector<std::string> notes_;
};

}  // namespace lumifold::client
