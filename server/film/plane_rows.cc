#include "server/film/plane_rows.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "proto/rpc/limits.h"

namespace lumifold::film {

PlaneRows::PlaneRows(const LayeredImage& image)
    : image_(&image), width_(image.width()), height_(image.height()) {
  names_.reserve(image.channels().size());
  for (const LayeredImage::Channel& channel : image.channels()) names_.push_back(channel.name);
}

PlaneRows::PlaneRows(const rpc::ReceivedPicture& picture)
    : picture_(&picture),
      width_(picture.layout.width()),
      height_(picture.layout.height()),
      names_(picture.layout.channels().begin(), picture.layout.channels().end()),
      planes_(rpc::PlanesOf(picture.layout)) {}

std::optional<size_t> PlaneRows::Find(std::string_view name) const {
  const auto found = std::find(names_.begin(), names_.end(), name);
  if (found == names_.end()) return std::nullopt;
  return static_cast<size_t>(found - names_.begin());
}

int PlaneRows::DistinctRows(size_t plane) const {
  return image_ == nullptr && planes_[plane].encoding == v1::PLANE_ENCODING_CONSTANT ? 1 : height_;
}

std::string_view PlaneRows::Rows(size_t plane, int y, int count) {
  const size_t values = static_cast<size_t>(width_) * static_cast<size_t>(count);
  if (image_ != nullptr) return RowsInMemory(image_->channels()[plane].plane, y, count);
  const rpc::EncodedPlane& encoded = planes_[plane];
  if (encoded.encoding == v1::PLANE_ENCODING_ZSTD) return RowsInMemory(Decompressed(plane), y, count);
  const std::string_view bytes =
      BytesAt(encoded.RowByte(y, width_), rpc::EncodedBytes(encoded.encoding, values));
  if (encoded.encoding == v1::PLANE_ENCODING_FLOAT) return bytes;
  decoded_.resize(std::max(decoded_.size(), values));
  rpc::DecodeValues(encoded.encoding, bytes, decoded_.data(), values);
  return {reinterpret_cast<const char*>(decoded_.data()), values * sizeof(float)};
}

std::string_view PlaneRows::RowsInMemory(const Plane& plane, int y, int count) {
  const size_t row_bytes = static_cast<size_t>(width_) * sizeof(float);
  const auto bytes_of = [&](int i) { return reinterpret_cast<const char*>(plane.Row(y + i)); };
  const bool is_packed = plane.view().stride() == width_;
  if (count == 1 || is_packed) return {bytes_of(0), row_bytes * static_cast<size_t>(count)};
  joined_.clear();
  for (int i = 0; i < count; ++i) joined_.append(bytes_of(i), row_bytes);
  return joined_;
}

const Plane& PlaneRows::Decompressed(size_t plane) {
  if (decompressed_ != plane) {
    decompressed_ = plane;
    if (decompressed_plane_.height() == 0) decompressed_plane_ = Plane::Packed(width_, height_);
    const rpc::EncodedPlane& encoded = planes_[plane];
    const absl::Status decoded =
        rpc::DecompressPlane(BytesAt(encoded.first_byte, encoded.size_bytes), decompressed_plane_.view());
    if (!decoded.ok()) {
      decompressed_plane_.Fill(0);
      status_.Update(absl::InvalidArgumentError(absl::StrCat(
          std::string(names_[plane]), " cannot be decompressed: ", std::string(decoded.message()))));
    }
  }
  return decompressed_plane_;
}

std::string_view PlaneRows::BytesAt(uint64_t first, size_t size) {
  size_t piece = first / rpc::kMaxChunkBytes;
  const std::string_view bytes = picture_->pieces[piece].bytes;
  const std::string_view row = bytes.substr(first % rpc::kMaxChunkBytes, size);
  if (row.size() == size) return row;
  joined_ = row;
  while (joined_.size() < size)
    joined_ += std::string_view(picture_->pieces[++piece].bytes).substr(0, size - joined_.size());
  return joined_;
}

}  // namespace lumifold::film
