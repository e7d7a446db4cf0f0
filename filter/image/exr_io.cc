#include "filter/image/exr_io.h"

#include <IexBaseExc.h>
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStringAttribute.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <exception>
#include <new>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"

namespace lumifold {
namespace {

/// Channels a picture may have at most: ours have under a hundred, a damaged header may list any number.
constexpr int kMaxChannels = 1024;

/// The parts of a picture with an edge set.
constexpr std::array<const char*, 2> kPartNames = {"picture", "edges"};

/// An OpenEXR file in memory, so that the disk sees it whole or not at all.
class StringStream final : public Imf::OStream {
 public:
  explicit StringStream(const std::string& name) : Imf::OStream(name.c_str()) {}

  void write(const char bytes[], int count) override {
    const size_t end = position_ + static_cast<size_t>(count);
    if (end > bytes_.size()) bytes_.resize(end);
    std::copy_n(bytes, count, bytes_.begin() + static_cast<std::ptrdiff_t>(position_));
    position_ = end;
  }
  uint64_t tellp() override { return position_; }
  void seekp(uint64_t position) override { position_ = position; }

  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
  size_t position_ = 0;
};

/// The bytes of an OpenEXR file, for OpenEXR to read.
class ViewStream final : public Imf::IStream {
 public:
  ViewStream(const std::string& name, std::string_view bytes) : Imf::IStream(name.c_str()), bytes_(bytes) {}

  bool read(char target[], int count) override {
    if (count < 0 || static_cast<size_t>(count) > bytes_.size() - position_) {
      throw Iex::InputExc("Unexpected end of file.");
    }
    std::copy_n(bytes_.data() + position_, count, target);
    position_ += static_cast<size_t>(count);
    return position_ < bytes_.size();
  }
  uint64_t tellg() override { return position_; }
  void seekg(uint64_t position) override { position_ = std::min<uint64_t>(position, bytes_.size()); }

 private:
  std::string_view bytes_;
  size_t position_ = 0;
};

/// Runs `body`, the only place where OpenEXR is called, and turns what it throws into a Status.
absl::Status CatchExr(const std::string& path, absl::FunctionRef<absl::Status()> body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat(path, ": not enough memory for this picture"));
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", error.what()));
  }
}

/// A slice whose pixel (x0, y0) is the view's first; the view's pixels are only read when OpenEXR writes.
Imf::Slice SliceOf(FloatView view, int x0, int y0) {
  const std::ptrdiff_t row_bytes = view.stride() * static_cast<std::ptrdiff_t>(sizeof(float));
  const std::ptrdiff_t offset = y0 * row_bytes + x0 * static_cast<std::ptrdiff_t>(sizeof(float));
  char* base = reinterpret_cast<char*>(view.Row(0)) - offset;
  return Imf::Slice(Imf::FLOAT, base, sizeof(float), static_cast<size_t>(row_bytes));
}

Imath::Box2i WindowOf(const LayeredImage& image) { return {{0, 0}, {image.width() - 1, image.height() - 1}}; }

/// A header with the picture's channels and metadata; `display` is what the whole file shows.
Imf::Header HeaderOf(const LayeredImage& image, const Imath::Box2i& display) {
  Imf::Header header(display, WindowOf(image));
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const auto& [name, value] : image.metadata()) header.insert(name, Imf::StringAttribute(value));
  for (const LayeredImage::Channel& channel : image.channels())
    header.channels().insert(channel.name, Imf::Channel(Imf::FLOAT));
  return header;
}

Imf::FrameBuffer FrameOf(const LayeredImage& image) {
  Imf::FrameBuffer frame;
  for (const LayeredImage::Channel& channel : image.channels()) {
    const ConstFloatView view = channel.plane.view();
    // OpenEXR's slices are for both directions and so never const.
    const FloatView writable(const_cast<float*>(view.Row(0)), view.width(), view.height(), view.stride());
    frame.insert(channel.name, SliceOf(writable, 0, 0));
  }
  return frame;
}

std::string Encode(const std::string& path, const LayeredImage& image) {
  StringStream stream(path);
  {
    Imf::OutputFile file(stream, HeaderOf(image, WindowOf(image)));
    file.setFrameBuffer(FrameOf(image));
    file.writePixels(image.height());
  }  // the destructor writes the table of lines
  return stream.bytes();
}

std::string EncodeParts(const std::string& path, const EdgedImage& image) {
  const std::array<const LayeredImage*, 2> pictures = {&image.pixels, &image.edges};
  std::array<Imf::Header, 2> headers;
  for (size_t i = 0; i < pictures.size(); ++i) {
    headers[i] = HeaderOf(*pictures[i], WindowOf(image.pixels));
    headers[i].setName(kPartNames[i]);
    headers[i].setType(Imf::SCANLINEIMAGE);
  }
  StringStream stream(path);
  {
    Imf::MultiPartOutputFile file(stream, headers.data(), static_cast<int>(headers.size()));
    for (size_t i = 0; i < pictures.size(); ++i) {
      Imf::OutputPart part(file, static_cast<int>(i));
      part.setFrameBuffer(FrameOf(*pictures[i]));
      part.writePixels(pictures[i]->height());
    }
  }
  return stream.bytes();
}

absl::Status CheckParts(const std::string& path, const Imf::MultiPartInputFile& file) {
  const bool has_edges =
      file.parts() == 2 && file.header(1).hasName() && file.header(1).name() == kPartNames[1];
  if (file.parts() == 1 || has_edges) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": has several parts; only single-part OpenEXR is read"));
}

absl::Status CheckHeader(const std::string& path, const Imf::Header& header) {
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
    return invalid(absl::StrCat(width, "x", height, " pixels is more than is read"));
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
  return absl::OkStatus();
}

void ReadMetadata(const Imf::Header& header, LayeredImage* image) {
  for (auto it = header.begin(); it != header.end(); ++it) {
    const auto* text = dynamic_cast<const Imf::StringAttribute*>(&it.attribute());
    const std::string_view name = it.name();
    if (text != nullptr && name != "type" && name != "name") image->metadata()[it.name()] = text->value();
  }
}

absl::Status ReadPart(const std::string& path, Imf::MultiPartInputFile& file, int number,
                      LayeredImage* image) {
  const Imf::Header& header = file.header(number);
  if (const absl::Status checked = CheckHeader(path, header); !checked.ok()) return checked;
  const Imath::Box2i window = header.dataWindow();
  *image = LayeredImage(window.max.x - window.min.x + 1, window.max.y - window.min.y + 1);
  ReadMetadata(header, image);
  Imf::FrameBuffer frame;
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
    frame.insert(it.name(), SliceOf(image->Add(it.name()), window.min.x, window.min.y));
  }
  // Pixels are read even to learn whether the file is whole: isComplete() looks at the table of lines only,
  // which a file cut short still has.
  Imf::InputPart part(file, number);
  part.setFrameBuffer(frame);
  part.readPixels(window.min.y, window.max.y);
  return absl::OkStatus();
}

absl::Status ReadParts(const std::string& path, Imf::MultiPartInputFile& file, EdgedImage* image) {
  if (absl::Status status = CheckParts(path, file); !status.ok()) return status;
  if (absl::Status status = ReadPart(path, file, 0, &image->pixels); !status.ok()) return status;
  return file.parts() == 2 ? ReadPart(path, file, 1, &image->edges) : absl::OkStatus();
}

absl::StatusOr<LayeredImage> PixelsOf(absl::StatusOr<EdgedImage> image) {
  if (!image.ok()) return image.status();
  return std::move(image->pixels);
}

absl::Status WriteEncoded(const std::string& path, const LayeredImage& image,
                          absl::FunctionRef<std::string()> encode) {
  if (image.width() <= 0 || image.height() <= 0 || image.channels().empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("cannot write ", path, ": the picture has no pixels or no channels"));
  }
  std::string bytes;
  const absl::Status status = CatchExr(path, [&] {
    bytes = encode();
    return absl::OkStatus();
  });
  return status.ok() ? WriteFileAtomically(path, bytes) : status;
}

}  // namespace

absl::Status WriteExr(const std::string& path, const LayeredImage& image) {
  return WriteEncoded(path, image, [&] { return Encode(path, image); });
}

absl::Status WriteExr(const std::string& path, const EdgedImage& image) {
  if (image.edges.channels().empty()) return WriteExr(path, image.pixels);
  return WriteEncoded(path, image.pixels, [&] { return EncodeParts(path, image); });
}

absl::StatusOr<EdgedImage> ReadEdgedExr(const std::string& path) {
  struct stat info;
  if (stat(path.c_str(), &info) != 0) return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError(absl::StrCat(path, ": not a regular file"));
  EdgedImage image;
  const absl::Status status = CatchExr(path, [&] {
    Imf::MultiPartInputFile file(path.c_str());
    return ReadParts(path, file, &image);
  });
  if (!status.ok()) return status;
  return image;
}

absl::StatusOr<LayeredImage> ReadExr(const std::string& path) { return PixelsOf(ReadEdgedExr(path)); }

absl::StatusOr<LayeredImage> DecodeExr(const std::string& name, std::string_view bytes) {
  EdgedImage image;
  const absl::Status status = CatchExr(name, [&] {
    ViewStream stream(name, bytes);
    Imf::MultiPartInputFile file(stream);
    return ReadParts(name, file, &image);
  });
  if (!status.ok()) return status;
  return std::move(image.pixels);
}

}  // namespace lumifold
