#include "filter/image/exr_parts.h"

#include <ImfChannelList.h>
#include <ImfCompression.h>
#include <ImfPartType.h>
#include <ImfStringAttribute.h>

#include <algorithm>
#include <exception>
#include <new>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "filter/image/exr_io.h"

namespace lumifold {
namespace {

/// The most channels that are read: our pictures have under a hundred, a damaged header may list any number.
constexpr int kMaxChannels = 1024;

/// The most samples (channels times pixels) that a byte of a file can stand for, so that a header alone
/// cannot make a reader take memory. Deflate compresses at most 1032:1. DWA also keeps one number for a block
/// of 8x8 pixels.
int64_t MaxSamplesPerByte(Imf::Compression compression) {
  const bool is_dwa = compression == Imf::DWAA_COMPRESSION || compression == Imf::DWAB_COMPRESSION;
  return is_dwa ? 64 * 1032 : 1032;
}

absl::Status CheckHeader(const std::string& path, const Imf::Header& header, uint64_t file_bytes) {
  const auto invalid = [&path](const std::string& why) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", why));
  };
  if (header.hasType() && Imf::isDeepData(header.type()))
    return invalid("holds deep data, which is not read");
  const Imath::Box2i& window = header.dataWindow();
  const int64_t width = int64_t{window.max.x} - window.min.x + 1;
  const int64_t height = int64_t{window.max.y} - window.min.y + 1;
  if (width <= 0 || height <= 0) return invalid("has no pixels");
  if (width > kMaxPixels || height > kMaxPixels / width) {
    return invalid(absl::StrCat(width, "x", height, " pixels is more than is read: ", kMaxPixels));
  }
  int channels = 0;
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
    if (it.channel().xSampling != 1 || it.channel().ySampling != 1) {
      return invalid(absl::StrCat("channel ", it.name(), " is subsampled, which is not read"));
    }
    ++channels;
  }
  if (channels == 0) return invalid("has no channels");
  if (channels > kMaxChannels) return invalid(absl::StrCat(channels, " channels is more than is read"));
  if (width * height * channels / MaxSamplesPerByte(header.compression()) >
      static_cast<int64_t>(file_bytes)) {
    return invalid(absl::StrCat("claims ", width, "x", height, " pixels of ", channels,
                                " channels, but has only ", file_bytes, " bytes"));
  }
  return absl::OkStatus();
}

/// Number of the first part of the lists at the end of a file; that of its parts where there are none.
/// OpenEXR refuses files that have a name twice.
int FirstList(const Imf::MultiPartInputFile& file) {
  int first = file.parts();
  while (first > 1 && IsExrList(file.header(first - 1))) --first;
  return first;
}

}  // namespace

absl::Status CatchExr(const std::string& path, absl::FunctionRef<absl::Status()> body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat(path, ": not enough memory for this picture"));
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", error.what()));
  }
}

Imf::Slice ExrSliceOf(FloatView view, int x0, int y0) {
  const std::ptrdiff_t row_bytes = view.stride() * static_cast<std::ptrdiff_t>(sizeof(float));
  const std::ptrdiff_t offset = y0 * row_bytes + x0 * static_cast<std::ptrdiff_t>(sizeof(float));
  char* base = reinterpret_cast<char*>(view.Row(0)) - offset;
  return Imf::Slice(Imf::FLOAT, base, sizeof(float), static_cast<size_t>(row_bytes));
}

Imf::FrameBuffer ExrFrameOf(const LayeredImage& image, int x0, int y0) {
  Imf::FrameBuffer frame;
  for (const LayeredImage::Channel& channel : image.channels()) {
    const ConstFloatView view = channel.plane.view();
    // A slice of OpenEXR serves reading and writing, so it is never const.
    const FloatView writable(const_cast<float*>(view.Row(0)), view.width(), view.height(), view.stride());
    frame.insert(channel.name, ExrSliceOf(writable, x0, y0));
  }
  return frame;
}

absl::Status CheckExr(const std::string& path, const Imf::MultiPartInputFile& file, uint64_t file_bytes) {
  if (FirstList(file) != 1) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": has several parts; only single-part OpenEXR is read"));
  }
  for (int part = 0; part < file.parts(); ++part) {
    if (absl::Status status = CheckHeader(path, file.header(part), file_bytes); !status.ok()) return status;
  }
  return absl::OkStatus();
}

bool IsExrPart(const Imf::Header& header, const char* name) {
  return header.hasName() && header.name() == name;
}

bool IsExrList(const Imf::Header& header) {
  return IsExrPart(header, kExrEdgePart) || IsExrPart(header, kExrFragmentPart);
}

absl::Status CheckLayeredExr(const std::string& path, const Imf::MultiPartInputFile& file,
                             uint64_t file_bytes) {
  const int first_list = FirstList(file);
  for (int part = 0; part < file.parts(); ++part) {
    const Imf::Header& header = file.header(part);
    if (absl::Status status = CheckHeader(path, header, file_bytes); !status.ok()) return status;
    if (part >= first_list) continue;
    if (header.dataWindow() != file.header(0).dataWindow()) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ": has parts of different windows; only those of one picture are read"));
    }
  }
  return absl::OkStatus();
}

std::string ExrChannelName(const Imf::MultiPartInputFile& file, int part, const std::string& channel) {
  const bool is_whole = part == 0 || channel.find('.') != std::string::npos;
  return is_whole ? channel : absl::StrCat(file.header(part).name(), ".", channel);
}

Imf::Header ExrHeaderOf(const ExrOrigin& origin) {
  constexpr std::string_view kOfStorage[] = {"channels",      "chunkCount", "compression", "dataWindow",
                                             "displayWindow", "lineOrder",  "multiView",   "name",
                                             "preview",       "tiles",      "type",        "version"};
  Imf::Header header(origin.header.displayWindow(), origin.header.dataWindow());
  for (auto it = origin.header.begin(); it != origin.header.end(); ++it) {
    const bool is_of_storage =
        std::find(std::begin(kOfStorage), std::end(kOfStorage), it.name()) != std::end(kOfStorage);
    if (!is_of_storage) header.insert(it.name(), it.attribute());
  }
  return header;
}

std::map<std::string, std::string> ExrMetadata(const Imf::Header& header) {
  std::map<std::string, std::string> metadata;
  for (auto it = header.begin(); it != header.end(); ++it) {
    const auto* text = dynamic_cast<const Imf::StringAttribute*>(&it.attribute());
    const std::string_view name = it.name();
    if (text != nullptr && name != "type" && name != "name") metadata[it.name()] = text->value();
  }
  return metadata;
}

LayeredImage ExrImage(const Imf::Header& header, int width, int height) {
  LayeredImage image = IsExrList(header) ? LayeredImage::List(width, height) : LayeredImage(width, height);
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) image.Add(it.name());
  return image;
}

}  // namespace lumifold
