#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "filter/image/film_source.h"

namespace lumifold {

struct ExrOrigin;

/// An OpenEXR file as a film that is read part by part, with its edge set and fragments if it has any. The
/// picture may be in several parts of the file, as other programs write them (ExrChannelName).
///
/// Tiles are read directly. Scan lines can only be decoded in full width: each is decoded once and kept in a
/// scratch file until the parts that are read lie below it. The scratch file takes 4 bytes per pixel and
/// channel of a part's rows. Reading whole rows or whole pictures needs no scratch file.
class ExrFilm final : public FilmSource {
 public:
  /// `scratch_folder`: the folder of the scratch file, if one is needed.
  /// Errors: those of ReadExr that the headers show.
  static absl::StatusOr<std::unique_ptr<ExrFilm>> Open(const std::string& path,
                                                       const std::string& scratch_folder);
  ~ExrFilm() override;

  int width() const override;
  int height() const override;
  /// An image without pixels, with the file's channels and metadata.
  LayeredImage Outline() const;
  /// Its windows and attributes.
  std::shared_ptr<const ExrOrigin> origin() const;
  /// Errors: kInvalidArgument naming the file if it is damaged or a list is not in the order of rows;
  /// kUnavailable if the scratch file cannot be written.
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  class Part;
  struct File;
  explicit ExrFilm(std::unique_ptr<File> file);
  static absl::StatusOr<int> FirstRowFrom(Part& list, int y);
  absl::StatusOr<LayeredImage> ReadList(Part& list, const Rect& rect) const;
  absl::StatusOr<LayeredImage> ReadRows(Part& list, int first, int last, const Rect& rect) const;

  std::unique_ptr<File> file_;
};

}  // namespace lumifold
