#include "server/film/plane_rows.h"

#include <algorithm>

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
      names_(picture.layout.channels().begin(), picture.layout.channels().end()) {}

std::optional<size_t> PlaneRows::Find(std::string_view name) const {
  const auto found = std::find(names_.begin(), names_.end(), name);
  if (found == names_.end()) return std::nullopt;
  return static_cast<size_t>(found - names_.begin());
}

std::string_view PlaneRows::Row(size_t plane, int y) {
  const size_t row_bytes = static_cast<size_t>(width_) * sizeof(float);
  if (image_ != nullptr)
    return {reinterpret_cast<const char*>(image_->channels()[plane].plane.Row(y)), row_bytes};
  const size_t offset = (plane * static_cast<size_t>(height_) + static_cast<size_t>(y)) * row_bytes;
  size_t piece = offset / rpc::kMaxChunkBytes;
  const std::string_view bytes = picture_->pieces[piece].bytes;
  const std::string_view row = bytes.substr(offset % rpc::kMaxChunkBytes, row_bytes);
  if (row.size() == row_bytes) return row;
  joined_ = row;
  while (joined_.size() < row_bytes)
    joined_ += std::string_view(picture_->pieces[++piece].bytes).substr(0, row_bytes - joined_.size());
  return joined_;
}

}  // namespace lumifold::film
