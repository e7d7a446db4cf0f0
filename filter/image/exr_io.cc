#include "filter/image/exr_io.h"

#include <IexBaseExc.h>
#include <ImfChannelList.h>
#include <ImfIO.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfThreading.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "filter/image/exr_parts.h"
#include "filter/image/exr_row_writer.h"
#include "filter/image/file_io.h"

namespace lumifold {
namespace {

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

/// Adds the channels of a part to `image`.
void ReadPart(Imf::MultiPartInputFile& file, int number, LayeredImage* image) {
  const Imf::Header& header = file.header(number);
  const Imath::Box2i window = header.dataWindow();
  Imf::FrameBuffer frame;
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
    const std::string name = IsExrList(header) ? it.name() : ExrChannelName(file, number, it.name());
    if (image->Has(name)) throw Iex::InputExc("has the channel " + name + " twice");
    frame.insert(it.name(), ExrSliceOf(image->Add(name), window.min.x, window.min.y));
  }
  // Pixels are read even to find out whether the file is complete: isComplete() checks only the table of
  // lines, which a truncated file still has.
  Imf::InputPart part(file, number);
  part.setFrameBuffer(frame);
  part.readPixels(window.min.y, window.max.y);
}

/// An image without channels for a part.
LayeredImage ImageFor(const Imf::Header& header) {
  const Imath::Box2i& window = header.dataWindow();
  const int width = window.max.x - window.min.x + 1;
  const int height = window.max.y - window.min.y + 1;
  LayeredImage image = IsExrList(header) ? LayeredImage::List(width, height) : LayeredImage(width, height);
  image.metadata() = ExrMetadata(header);
  return image;
}

absl::Status ReadParts(const std::string& path, Imf::MultiPartInputFile& file, uint64_t file_bytes,
                       EdgedImage* image) {
  if (absl::Status status = CheckLayeredExr(path, file, file_bytes); !status.ok()) return status;
  image->pixels = ImageFor(file.header(0));
  for (int part = 0; part < file.parts(); ++part) {
    const Imf::Header& header = file.header(part);
    if (part > 0 && IsExrList(header)) {
      LayeredImage& list = IsExrPart(header, kExrEdgePart) ? image->edges : image->fragments;
      list = ImageFor(header);
      ReadPart(file, part, &list);
    } else {
      ReadPart(file, part, &image->pixels);
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<LayeredImage> PixelsOf(absl::StatusOr<EdgedImage> image) {
  if (!image.ok()) return image.status();
  return std::move(image->pixels);
}

}  // namespace

void SetExrThreads(int threads) {
  LUMIFOLD_CHECK(threads >= 1);
  Imf::setGlobalThreadCount(threads > 1 ? threads : 0);  // 0: no other threads, and no hand-over
}

absl::Status WriteExr(const std::string& path, const LayeredImage& image) {
  absl::StatusOr<ExrRowWriter> writer = ExrRowWriter::Create(path, ExrLayoutOf(image));
  if (!writer.ok()) return writer.status();
  if (absl::Status status = writer->Append(image); !status.ok()) return status;
  return writer->Finish();
}

absl::Status WriteExr(const std::string& path, const EdgedImage& image) {
  const ExrLists lists = {ExrLayoutOf(image.edges), ExrLayoutOf(image.fragments)};
  absl::StatusOr<ExrRowWriter> writer = ExrRowWriter::Create(path, ExrLayoutOf(image.pixels), lists);
  if (!writer.ok()) return writer.status();
  if (absl::Status status = writer->Append(image.pixels); !status.ok()) return status;
  if (absl::Status status = writer->AppendEdges(image.edges); !status.ok()) return status;
  if (absl::Status status = writer->AppendFragments(image.fragments); !status.ok()) return status;
  return writer->Finish();
}

absl::StatusOr<EdgedImage> ReadEdgedExr(const std::string& path) {
  if (absl::Status status = CheckIsFile(path); !status.ok()) return status;
  EdgedImage image;
  const absl::Status status = CatchExr(path, [&] {
    Imf::MultiPartInputFile file(path.c_str());
    return ReadParts(path, file, std::filesystem::file_size(path), &image);
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
    return ReadParts(name, file, bytes.size(), &image);
  });
  if (!status.ok()) return status;
  return std::move(image.pixels);
}

}  // namespace lumifold
