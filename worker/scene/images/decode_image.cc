#include "worker/scene/images/decode_image.h"

#include <jpeglib.h>
#include <png.h>
// jerror.h needs the types of jpeglib.h.
#include <jerror.h>

#include <bit>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/scene/images/image_size.h"
#include "worker/scene/images/ktx2.h"
#include "worker/scene/images/webp.h"

// libpng and libjpeg report errors by longjmp: a function that calls setjmp here holds nothing with a
// destructor.

namespace lumifold::scene {
namespace {

constexpr std::string_view kPngMagic = "\x89PNG\r\n\x1a\n";
constexpr std::string_view kJpegMagic = "\xff\xd8\xff";

// Deflate compresses at most 1032:1 and a PNG has at least one bit per pixel; JPEG needs at least one bit for
// 64 pixels. An image that claims more pixels is a decompression bomb or truncated.
constexpr int64_t kMaxPixelsPerByte = 8 * 1032;

/// State shared by a decoder and its callbacks.
struct Decoding {
  std::string_view rest;  // not yet read, PNG only
  int64_t encoded_bytes = 0;
  int64_t max_pixels = 0;
  ImageData image;
  absl::Status refused;    // error of the size check
  char message[200] = "";  // the library's message
  jmp_buf on_error;        // JPEG only; libpng has its own
};

/// Checks the size and allocates the pixels.
bool Accept(Decoding* decoding, uint64_t width, uint64_t height, bool is_deep = false) {
  decoding->refused = CheckImageSize(width, height, decoding->max_pixels);
  if (decoding->refused.ok())
    decoding->refused = CheckImageBytes(width, height, kMaxPixelsPerByte, decoding->encoded_bytes);
  if (decoding->refused.ok()) decoding->image = EmptyImage(width, height, is_deep);
  return decoding->refused.ok();
}

/// Of either depth.
uint8_t* Row(Decoding* decoding, int y) {
  ImageData& image = decoding->image;
  const size_t first = static_cast<size_t>(y) * static_cast<size_t>(image.width) * 4;
  return image.is_deep() ? reinterpret_cast<uint8_t*>(image.rgba16.data() + first)
                         : image.rgba.data() + first;
}

[[noreturn]] void OnPngError(png_structp png, png_const_charp message) {
  auto* decoding = static_cast<Decoding*>(png_get_error_ptr(png));
  std::snprintf(decoding->message, sizeof(decoding->message), "%s", message);
  png_longjmp(png, 1);
}

void OnPngWarning(png_structp, png_const_charp) {}

void ReadPngBytes(png_structp png, png_bytep out, size_t count) {
  auto* decoding = static_cast<Decoding*>(png_get_io_ptr(png));
  if (count > decoding->rest.size()) png_error(png, "cut short");
  std::memcpy(out, decoding->rest.data(), count);
  decoding->rest.remove_prefix(count);
}

/// Configures libpng to output RGBA for every kind of file, with 8 bits or those of this machine's uint16_t.
void RequestRgba(png_structp png, bool is_deep) {
  png_set_expand(png);
  if (is_deep && std::endian::native == std::endian::little) png_set_swap(png);
  png_set_gray_to_rgb(png);
  png_set_add_alpha(png, is_deep ? 0xffff : 0xff, PNG_FILLER_AFTER);
}

bool RunPng(png_structp png, png_infop info, Decoding* decoding) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_read_fn(png, decoding, ReadPngBytes);
  png_set_user_limits(png, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
  png_read_info(png, info);
  const bool is_deep = png_get_bit_depth(png, info) == 16;
  if (!Accept(decoding, png_get_image_width(png, info), png_get_image_height(png, info), is_deep))
    return false;
  RequestRgba(png, is_deep);
  const int passes = png_set_interlace_handling(png);
  png_read_update_info(png, info);
  for (int pass = 0; pass < passes; ++pass) {
    for (int y = 0; y < decoding->image.height; ++y) png_read_row(png, Row(decoding, y), nullptr);
  }
  png_read_end(png, nullptr);
  return true;
}

bool DecodePng(Decoding* decoding) {
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, decoding, OnPngError, OnPngWarning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  const bool decoded = info != nullptr && RunPng(png, info, decoding);
  png_destroy_read_struct(&png, &info, nullptr);
  return decoded;
}

[[noreturn]] void OnJpegError(j_common_ptr jpeg) {
  auto* decoding = static_cast<Decoding*>(jpeg->client_data);
  char message[JMSG_LENGTH_MAX];
  jpeg->err->format_message(jpeg, message);
  std::snprintf(decoding->message, sizeof(decoding->message), "%s", message);
  std::longjmp(decoding->on_error, 1);
}

/// Turns the warning about a truncated file into an error, since libjpeg fills the missing part with grey.
/// Other warnings are harmless.
void OnJpegMessage(j_common_ptr jpeg, int level) {
  const bool is_cut_short = jpeg->err->msg_code == JWRN_JPEG_EOF || jpeg->err->msg_code == JWRN_HIT_MARKER;
  if (level < 0 && is_cut_short) OnJpegError(jpeg);
}

/// Bounds the scans of a progressive file: it may hold thousands of empty ones, each of which costs a pass
/// over the picture.
void OnJpegProgress(j_common_ptr jpeg) {
  constexpr int kMaxScans = 500;
  if (reinterpret_cast<j_decompress_ptr>(jpeg)->input_scan_number <= kMaxScans) return;
  auto* decoding = static_cast<Decoding*>(jpeg->client_data);
  std::snprintf(decoding->message, sizeof(decoding->message), "more than %d scans", kMaxScans);
  std::longjmp(decoding->on_error, 1);
}

bool RunJpeg(jpeg_decompress_struct* jpeg, std::string_view bytes, Decoding* decoding) {
  if (setjmp(decoding->on_error) != 0) return false;
  jpeg_mem_src(jpeg, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
  jpeg_read_header(jpeg, TRUE);
  if (!Accept(decoding, jpeg->image_width, jpeg->image_height)) return false;
  jpeg->out_color_space = JCS_EXT_RGBA;
  jpeg_start_decompress(jpeg);
  while (jpeg->output_scanline < jpeg->output_height) {
    JSAMPROW row = Row(decoding, static_cast<int>(jpeg->output_scanline));
    jpeg_read_scanlines(jpeg, &row, 1);
  }
  jpeg_finish_decompress(jpeg);
  return true;
}

bool DecodeJpeg(Decoding* decoding) {
  jpeg_decompress_struct jpeg = {};
  jpeg_error_mgr errors = {};
  jpeg_progress_mgr progress = {};
  jpeg.err = jpeg_std_error(&errors);
  errors.error_exit = OnJpegError;
  errors.emit_message = OnJpegMessage;
  jpeg.client_data = decoding;
  jpeg_create_decompress(&jpeg);
  progress.progress_monitor = OnJpegProgress;
  jpeg.progress = &progress;
  const bool decoded = RunJpeg(&jpeg, decoding->rest, decoding);
  jpeg_destroy_decompress(&jpeg);
  return decoded;
}

}  // namespace

absl::StatusOr<ImageData> DecodeImage(std::string_view bytes, int64_t max_pixels) {
  if (IsWebp(bytes)) return DecodeWebp(bytes, max_pixels);
  if (IsKtx2(bytes)) return DecodeKtx2(bytes, max_pixels);
  const bool is_png = bytes.substr(0, kPngMagic.size()) == kPngMagic;
  const bool is_jpeg = bytes.substr(0, kJpegMagic.size()) == kJpegMagic;
  if (!is_png && !is_jpeg) return absl::InvalidArgumentError("neither PNG, JPEG, WebP nor KTX2");
  Decoding decoding;
  decoding.rest = bytes;
  decoding.encoded_bytes = static_cast<int64_t>(bytes.size());
  decoding.max_pixels = max_pixels;
  if (is_png ? DecodePng(&decoding) : DecodeJpeg(&decoding)) return std::move(decoding.image);
  if (!decoding.refused.ok()) return decoding.refused;
  return absl::InvalidArgumentError(
      absl::StrCat("damaged ", is_png ? "PNG" : "JPEG", ": ", static_cast<const char*>(decoding.message)));
}

}  // namespace lumifold::scene
