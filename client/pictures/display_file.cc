#include "client/pictures/display_file.h"

#include <jpeglib.h>

#include <algorithm>
#include <cmath>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/pictures/exposure.h"
#include "filter/image/file_io.h"
#include "filter/image/planes.h"
#include "filter/image/png_io.h"

namespace lumifold::pictures {
namespace {

uint8_t ByteOf(float value) {
  return static_cast<uint8_t>(std::lround(255.0f * std::clamp(value, 0.0f, 1.0f)));
}

/// libjpeg reports errors by a function that must not return.
struct JpegErrors {
  jpeg_error_mgr manager;
  std::jmp_buf at;
};

[[noreturn]] void OnJpegError(j_common_ptr info) {
  std::longjmp(reinterpret_cast<JpegErrors*>(info->err)->at, 1);
}

/// Nothing with a destructor may be in here: an error leaves it by longjmp. `out` and `size` receive a block
/// of malloc.
bool EncodeJpeg(const uint8_t* bytes, int width, int height, int quality, unsigned char** out,
                unsigned long* size) {
  jpeg_compress_struct encoder = {};
  JpegErrors errors = {};
  encoder.err = jpeg_std_error(&errors.manager);
  errors.manager.error_exit = OnJpegError;
  if (setjmp(errors.at) != 0) {  // NOLINT(cert-err52-cpp): libjpeg has no other way
    jpeg_destroy_compress(&encoder);
    return false;
  }
  jpeg_create_compress(&encoder);
  jpeg_mem_dest(&encoder, out, size);
  encoder.image_width = static_cast<JDIMENSION>(width);
  encoder.image_height = static_cast<JDIMENSION>(height);
  encoder.input_components = 3;
  encoder.in_color_space = JCS_RGB;
  jpeg_set_defaults(&encoder);
  jpeg_set_quality(&encoder, quality, TRUE);
  for (int c = 0; c < 3; ++c) encoder.comp_info[c].h_samp_factor = encoder.comp_info[c].v_samp_factor = 1;
  jpeg_start_compress(&encoder, TRUE);
  while (encoder.next_scanline < encoder.image_height) {
    auto* row = const_cast<JSAMPROW>(bytes + size_t{3} * static_cast<size_t>(width) * encoder.next_scanline);
    jpeg_write_scanlines(&encoder, &row, 1);
  }
  jpeg_finish_compress(&encoder);
  jpeg_destroy_compress(&encoder);
  return true;
}

absl::Status WriteJpeg(const std::string& path, const std::vector<uint8_t>& bytes, int width, int height,
                       int quality) {
  unsigned char* encoded = nullptr;
  unsigned long size = 0;
  const absl::Cleanup release = [&] { std::free(encoded); };
  if (!EncodeJpeg(bytes.data(), width, height, quality, &encoded, &size))
    return absl::InvalidArgumentError(
        absl::StrCat("cannot write ", path, ": a JPEG picture has at most 65500 pixels a side"));
  return WriteFileAtomically(path, {reinterpret_cast<const char*>(encoded), size});
}

}  // namespace

DisplayWriter::DisplayWriter(std::string path, int width, int height, const DisplayOptions& options,
                             ViewTransform view)
    : path_(std::move(path)), width_(width), height_(height), options_(options), view_(std::move(view)) {
  if (options_.exposure.has_value()) {
    bytes_.reserve(size_t{3} * static_cast<size_t>(width) * static_cast<size_t>(height));
  } else {
    for (Plane& plane : linear_) plane = Plane::Uninitialized(width, height);
  }
}

absl::StatusOr<DisplayWriter> DisplayWriter::Create(const std::string& path, int width, int height,
                                                    const DisplayOptions& options) {
  absl::StatusOr<ViewTransform> view = ViewTransform::Create(options.view);
  if (!view.ok()) return view.status();
  if (width <= 0 || height <= 0)
    return absl::InvalidArgumentError(absl::StrCat("cannot write ", path, ": the picture has no pixels"));
  return DisplayWriter(path, width, height, options, *std::move(view));
}

bool DisplayWriter::IsPng() const { return absl::EndsWithIgnoreCase(path_, ".png"); }

void DisplayWriter::Append(const ConstColorView& linear, const ConstFloatView* alpha) {
  if (!IsPng()) alpha = nullptr;
  if (options_.exposure.has_value()) return Show(linear, alpha, *options_.exposure);
  const Rect rows = {0, rows_, width_, rows_ + linear[0].height()};
  for (size_t c = 0; c < linear_.size(); ++c) CopyPlane(linear[c], linear_[c].view().Crop(rows));
  if (alpha != nullptr) {
    if (alpha_.width() == 0) alpha_ = Plane::Uninitialized(width_, height_);
    CopyPlane(*alpha, alpha_.view().Crop(rows));
  }
  rows_ = rows.y1;
}

void DisplayWriter::Show(const ConstColorView& linear, const ConstFloatView* alpha, float exposure) {
  std::vector<float> row(size_t{3} * static_cast<size_t>(width_));
  for (int y = 0; y < linear[0].height(); ++y) {
    for (int x = 0; x < width_; ++x) {
      const float covered = alpha == nullptr ? 1 : alpha->At(x, y);
      const float factor = covered > 0 ? exposure / covered : 0;
      for (size_t c = 0; c < 3; ++c)
        row[size_t{3} * static_cast<size_t>(x) + c] = factor * linear[c].At(x, y);
    }
    view_.Apply(absl::MakeSpan(row));
    for (int x = 0; x < width_; ++x) {
      for (size_t c = 0; c < 3; ++c) bytes_.push_back(ByteOf(row[size_t{3} * static_cast<size_t>(x) + c]));
      if (alpha != nullptr) bytes_.push_back(ByteOf(alpha->At(x, y)));
    }
  }
}

absl::Status DisplayWriter::Finish() {
  if (!options_.exposure.has_value()) {
    const ConstColorView all = {std::as_const(linear_[0]).view(), std::as_const(linear_[1]).view(),
                                std::as_const(linear_[2]).view()};
    const ConstFloatView alpha = std::as_const(alpha_).view();
    Show(all, alpha_.width() == 0 ? nullptr : &alpha, AutomaticExposure(all, WhiteOf(options_.view.c_str())));
  }
  if (IsPng()) return WritePngBytes(path_, width_, height_, bytes_);
  return WriteJpeg(path_, bytes_, width_, height_, options_.jpeg_quality);
}

absl::Status WriteDisplayed(const std::string& path, const ConstColorView& linear,
                            const DisplayOptions& options, const ConstFloatView* alpha) {
  absl::StatusOr<DisplayWriter> writer =
      DisplayWriter::Create(path, linear[0].width(), linear[0].height(), options);
  if (!writer.ok()) return writer.status();
  writer->Append(linear, alpha);
  return writer->Finish();
}

}  // namespace lumifold::pictures
