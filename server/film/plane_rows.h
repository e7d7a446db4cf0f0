#pragma once

#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/layered_image.h"
#include "filter/image/plane.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/plane_codec.h"
#include "proto/rpc/plane_compression.h"

namespace lumifold::film {

/// The rows of a picture's planes, as bytes of float32: of a picture in memory, or of one in the pieces in
/// which it arrived. Copies no pixels, except rows that are not float32 or cut by the end of a piece, several
/// rows at once of a plane in memory, and a plane that is compressed: the last such plane is kept decoded, so
/// rows of one plane are read one after another. The picture must outlive it.
/// Threads: one at a time.
class PlaneRows {
 public:
  PlaneRows(const LayeredImage& image);            // NOLINT(google-explicit-constructor): a view
  PlaneRows(const rpc::ReceivedPicture& picture);  // NOLINT(google-explicit-constructor): a view

  int width() const { return width_; }
  int height() const { return height_; }
  /// Channel names in the order of the planes.
  const std::vector<std::string_view>& names() const { return names_; }
  /// Number of the plane with this name.
  std::optional<size_t> Find(std::string_view name) const;

  /// Number of rows from the top after which all rows of the plane are equal to the first: 1 of a plane that
  /// is encoded as constant, so that its cost does not grow with its size.
  int DistinctRows(size_t plane) const;

  /// The values of a row; valid until the next call. 0 in a plane that cannot be decompressed, see status().
  std::string_view Row(size_t plane, int y) { return Rows(plane, y, 1); }
  /// The same of `count` rows one after another, all of them among the distinct ones: a call for each row of
  /// a list, which may have one value, takes more time than what is done with it.
  std::string_view Rows(size_t plane, int y, int count);

  /// kInvalidArgument naming the first plane that Row found not to be decompressible.
  const absl::Status& status() const { return status_; }

 private:
  std::string_view RowsInMemory(const Plane& plane, int y, int count);
  const Plane& Decompressed(size_t plane);
  /// Bytes [first, first + size) of the picture's pieces; valid until the next call.
  std::string_view BytesAt(uint64_t first, size_t size);

  const LayeredImage* image_ = nullptr;
  const rpc::ReceivedPicture* picture_ = nullptr;
  int width_;
  int height_;
  std::vector<std::string_view> names_;
  std::vector<rpc::EncodedPlane> planes_;  // of a picture that arrived
  std::string joined_;                     // rows that are cut or apart
  std::vector<float> decoded_;             // rows that are not float32
  std::optional<size_t> decompressed_;     // the plane in decompressed_plane_
  Plane decompressed_plane_;
  absl::Status status_;
};

/// Value number `x` of a row. The bytes of a picture that arrived are no float objects, so they are copied.
inline float ValueAt(std::string_view row, int x) {
  float value;
  std::memcpy(&value, row.data() + static_cast<size_t>(x) * sizeof(value), sizeof(value));
  return value;
}

}  // namespace lumifold::film
