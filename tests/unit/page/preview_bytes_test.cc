#include "server/page/preview_bytes.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cstring>

#include "filter/image/layered_image.h"
#include "proto/rpc/image_codec.h"

namespace lumifold::page {
namespace {

std::string Inflate(const std::string& compressed) {
  z_stream stream = {};
  EXPECT_EQ(inflateInit2(&stream, MAX_WBITS + 16), Z_OK);
  std::string bytes(1 << 16, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(compressed.data()));
  stream.avail_in = static_cast<uInt>(compressed.size());
  stream.next_out = reinterpret_cast<Bytef*>(bytes.data());
  stream.avail_out = static_cast<uInt>(bytes.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
  bytes.resize(stream.total_out);
  inflateEnd(&stream);
  return bytes;
}

v1::Preview PreviewOf(const LayeredImage& picture) {
  rpc::EncodedPicture encoded = rpc::EncodePicture(picture);
  v1::Preview preview;
  preview.set_units(3);
  preview.set_width(4);
  preview.set_height(2);
  preview.set_reduction(2);
  preview.add_layers("");
  preview.add_layers("N\"<script>");
  *preview.mutable_layout() = std::move(encoded.layout);
  preview.set_planes(std::move(encoded.bytes));
  return preview;
}

TEST(PreviewBytes, HasALengthATextAndThePlanes) {
  LayeredImage picture(2, 1);
  const FloatView half = picture.Add("id.Y");
  half.At(0, 0) = 1;
  half.At(1, 0) = -2;
  const FloatView full = picture.Add("Z");
  full.At(0, 0) = 0.1f;
  full.At(1, 0) = 3e9f;
  const absl::StatusOr<std::string> compressed = BytesOfPreview(PreviewOf(picture));
  ASSERT_TRUE(compressed.ok()) << compressed.status();
  const std::string bytes = Inflate(*compressed);
  uint32_t size = 0;
  std::memcpy(&size, bytes.data(), sizeof(size));
  const std::string text = bytes.substr(4, size);
  for (const char* part :
       {"\"units\":3", "\"preview_width\":2", "\"channels\":[\"id.Y\",\"Z\"]",
        "\"types\":[\"half\",\"float\"]", "\"layers\":[\"\",\"N\\\"<script>\"]", "\"finished\":false"})
    EXPECT_NE(text.find(part), std::string::npos) << part << " in " << text;
  ASSERT_EQ(bytes.size(), 4 + size + 2 * 2 + 2 * 4);
  EXPECT_EQ(bytes.substr(4 + size, 4), std::string("\x00\x3c\x00\xc0", 4));
  float values[2] = {};
  std::memcpy(values, bytes.data() + 8 + size, sizeof(values));
  EXPECT_EQ(values[0], 0.1f);
  EXPECT_EQ(values[1], 3e9f);
}

TEST(PreviewBytes, AMalformedPreviewIsAnError) {
  LayeredImage picture(2, 1);
  picture.Add("Z").At(0, 0) = 0.1f;
  v1::Preview preview = PreviewOf(picture);
  preview.mutable_planes()->resize(1);
  EXPECT_EQ(BytesOfPreview(preview).status().code(), absl::StatusCode::kInternal);
  preview.mutable_layout()->set_width(1 << 30);
  EXPECT_EQ(BytesOfPreview(preview).status().code(), absl::StatusCode::kInternal);
}

}  // namespace
}  // namespace lumifold::page
