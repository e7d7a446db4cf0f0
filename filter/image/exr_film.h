#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "filter/image/film_source.h"

namespace lumifold {

/// An OpenEXR file as a film that is read part by part, with an edge set where it has one.
///
/// Tiles are read where they are wanted. Scan lines can only be decoded from side to side: each is decoded
/// once and kept in a scratch file until the parts that are read have moved below it, which takes 4 bytes a
/// pixel and channel of a part's rows. Whole rows and whole pictures need no scratch file.
class ExrFilm final : public FilmSource {
 public:
  /// `scratch_folder` is where a scratch file goes when one is needed.
  /// Errors: as ReadExr, as far as the headers tell.
  static absl::StatusOr<std::unique_ptr<ExrFilm>> Open(const std::string& path,
                                                       const std::string& scratch_folder);
  ~ExrFilm() override;

  int width() const override;
  int height() const override;
  /// A picture of no pixels with the file's channels and metadata.
  LayeredImage Outline() const;
  /// Errors: kInvalidArgument naming the file where it is damaged or its edge set is not in the order of
  /// rows; kUnavailable where the scratch file cannot be written.
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  class Part;
  struct File;
  explicit ExrFilm(std::unique_ptr<File> file);
  absl::StatusOr<int> FirstEdgeFrom(int y);
  absl::StatusOr<LayeredImage> ReadEdges(const Rect& rect);
  absl::StatusOr<LayeredImage> ReadEdgeRows(int first, int last, const Rect& rect);

  std::unique_ptr<File> file_;
};

}  // namespace lumifold
