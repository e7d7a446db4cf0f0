#include "server/page/preview_bytes.h"

#include <zlib.h>

#include <bit>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <vector>

#include "filter/image/layered_image.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/plane_codec.h"

namespace lumifold::page {
namespace {

static_assert(std::endian::native == std::endian::little, "planes are sent as they are in memory");

constexpr rpc::PixelLimits kLimits = {.max_width = 4096, .max_height = 4096, .max_channels = 16};
/// Fast: the picture is newer soon.
constexpr int kCompression = 1;
/// Of zlib's window bits: with the header of gzip.
constexpr int kGzip = 16;

/// Of those that a browser knows. Constant planes vanish by compression.
v1::PlaneEncoding EncodingOf(const LayeredImage::Channel& channel) {
  const bool is_half = rpc::EncodingOf(channel.plane.view()) == v1::PLANE_ENCODING_HALF;
  return is_half ? v1::PLANE_ENCODING_HALF : v1::PLANE_ENCODING_FLOAT;
}

std::string HeaderOf(const v1::Preview& preview, const LayeredImage& picture) {
  std::vector<std::string> channels;
  std::vector<std::string> types;
  for (const LayeredImage::Channel& channel : picture.channels()) {
    channels.push_back(channel.name);
    types.emplace_back(EncodingOf(channel) == v1::PLANE_ENCODING_HALF ? "half" : "float");
  }
  const nlohmann::ordered_json header = {
      {"units", preview.units()},
      {"width", preview.width()},
      {"height", preview.height()},
      {"reduction", preview.reduction()},
      {"x0", preview.region().x0()},
      {"y0", preview.region().y0()},
      {"preview_width", picture.width()},
      {"preview_height", picture.height()},
      {"samples_per_pixel", preview.samples_per_pixel()},
      {"finished", preview.finished()},
      {"layers", std::vector<std::string>(preview.layers().begin(), preview.layers().end())},
      {"channels", channels},
      {"types", types},
  };
  return header.dump();
}

absl::StatusOr<std::string> Compress(const std::string& bytes) {
  z_stream stream = {};
  if (deflateInit2(&stream, kCompression, Z_DEFLATED, MAX_WBITS + kGzip, MAX_MEM_LEVEL, Z_DEFAULT_STRATEGY) !=
      Z_OK)
    return absl::ResourceExhaustedError("no memory to compress a preview");
  std::string compressed(deflateBound(&stream, bytes.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(compressed.data());
  stream.avail_out = static_cast<uInt>(compressed.size());
  const int end = deflate(&stream, Z_FINISH);
  compressed.resize(stream.total_out);
  deflateEnd(&stream);
  if (end != Z_STREAM_END) return absl::InternalError("a preview could not be compressed");
  return compressed;
}

}  // namespace

absl::StatusOr<std::string> BytesOfPreview(const v1::Preview& preview) {
  const absl::StatusOr<LayeredImage> picture =
      rpc::ImageFromBytes(preview.layout(), preview.planes(), kLimits);
  if (!picture.ok()) return absl::InternalError(picture.status().message());
  const std::string header = HeaderOf(preview, *picture);
  const auto size = static_cast<uint32_t>(header.size());
  std::string bytes(sizeof(size), '\0');
  std::memcpy(bytes.data(), &size, sizeof(size));
  bytes += header;
  for (const LayeredImage::Channel& channel : picture->channels()) {
    rpc::AppendPlane(channel.plane.view(), EncodingOf(channel), &bytes);
  }
  return Compress(bytes);
}

}  // namespace lumifold::page
