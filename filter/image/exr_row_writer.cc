#include "filter/image/exr_row_writer.h"

#include <IexBaseExc.h>
#include <ImfChannelList.h>
#include <ImfIO.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStringAttribute.h>

#include <optional>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/exr_parts.h"
#include "filter/image/file_io.h"

namespace lumifold {
namespace {

/// An AtomicFile as a stream of OpenEXR. It keeps the first error, because OpenEXR's destructors ignore them.
class FileStream final : public Imf::OStream {
 public:
  FileStream(const std::string& path, AtomicFile* file) : Imf::OStream(path.c_str()), file_(file) {}

  void write(const char bytes[], int count) override {
    if (status_.ok()) status_ = file_->Write(position_, {bytes, static_cast<size_t>(count)});
    if (!status_.ok()) throw Iex::IoExc(std::string(status_.message()));
    position_ += static_cast<uint64_t>(count);
  }
  uint64_t tellp() override { return position_; }
  void seekp(uint64_t position) override { position_ = position; }

  const absl::Status& status() const { return status_; }

 private:
  AtomicFile* const file_;
  uint64_t position_ = 0;
  absl::Status status_;
};

/// A part's header; `display` is the display window of the whole file.
Imf::Header HeaderOf(const ExrLayout& layout, const Imath::Box2i& display) {
  Imf::Header header(display, {{0, 0}, {layout.width - 1, layout.height - 1}});
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const auto& [name, value] : layout.metadata) header.insert(name, Imf::StringAttribute(value));
  for (const std::string& channel : layout.channels)
    header.channels().insert(channel, Imf::Channel(Imf::FLOAT));
  return header;
}

bool IsEmpty(const ExrLayout& layout) {
  return layout.width <= 0 || layout.height <= 0 || layout.channels.empty();
}

}  // namespace

ExrLayout ExrLayoutOf(const LayeredImage& image) {
  ExrLayout layout{image.width(), image.height(), {}, image.metadata()};
  for (const LayeredImage::Channel& channel : image.channels()) layout.channels.push_back(channel.name);
  return layout;
}

struct ExrRowWriter::File {
  File(std::string name, AtomicFile target, std::vector<ExrLayout> parts)
      : path(std::move(name)),
        file(std::move(target)),
        layouts(std::move(parts)),
        written(layouts.size(), 0) {}

  /// May throw.
  void Open() {
    const Imath::Box2i display({0, 0}, {layouts[0].width - 1, layouts[0].height - 1});
    std::vector<Imf::Header> headers;
    for (const ExrLayout& layout : layouts) headers.push_back(HeaderOf(layout, display));
    if (headers.size() == 1) {
      single.emplace(stream, headers[0]);
      return;
    }
    for (size_t i = 0; i < headers.size(); ++i) {
      headers[i].setName(kExrPartNames[i]);
      headers[i].setType(Imf::SCANLINEIMAGE);
    }
    multi.emplace(stream, headers.data(), static_cast<int>(headers.size()));
  }

  /// May throw.
  void Write(size_t part, const LayeredImage& rows) {
    const Imf::FrameBuffer frame = ExrFrameOf(rows, 0, written[part]);
    const auto write = [&](auto&& output) {
      output.setFrameBuffer(frame);
      output.writePixels(rows.height());
    };
    if (single.has_value())
      write(*single);
    else
      write(Imf::OutputPart(*multi, static_cast<int>(part)));
  }

  /// The error: the disk's if there is one, else OpenEXR's.
  absl::Status Judge(const absl::Status& status) const {
    return stream.status().ok() ? status : stream.status();
  }

  std::string path;
  AtomicFile file;
  std::vector<ExrLayout> layouts;
  std::vector<int> written;  // rows of each part
  FileStream stream{path, &file};
  std::optional<Imf::OutputFile> single;  // a file of one part
  std::optional<Imf::MultiPartOutputFile> multi;
};

ExrRowWriter::ExrRowWriter(std::unique_ptr<File> file) : file_(std::move(file)) {}
ExrRowWriter::ExrRowWriter(ExrRowWriter&&) noexcept = default;
ExrRowWriter::~ExrRowWriter() = default;

absl::StatusOr<ExrRowWriter> ExrRowWriter::Create(const std::string& path, const ExrLayout& picture,
                                                  const ExrLayout* edges, FileSystem* files) {
  if (IsEmpty(picture) || (edges != nullptr && IsEmpty(*edges))) {
    return absl::InvalidArgumentError(
        absl::StrCat("cannot write ", path, ": the picture has no pixels or no channels"));
  }
  absl::StatusOr<AtomicFile> target = AtomicFile::Create(path, files);
  if (!target.ok()) return target.status();
  std::vector<ExrLayout> parts = {picture};
  if (edges != nullptr) parts.push_back(*edges);
  auto file = std::make_unique<File>(path, *std::move(target), std::move(parts));
  const absl::Status status = CatchExr(path, [&] {
    file->Open();
    return absl::OkStatus();
  });
  if (!status.ok()) return file->Judge(status);
  return ExrRowWriter(std::move(file));
}

absl::Status ExrRowWriter::AppendTo(size_t part, const LayeredImage& rows) {
  const auto invalid = [&](std::string_view why) {
    return absl::InvalidArgumentError(absl::StrCat("cannot write ", file_->path, ": ", std::string(why)));
  };
  if (part >= file_->layouts.size()) return invalid("no edge set was announced");
  const ExrLayout& layout = file_->layouts[part];
  int& written = file_->written[part];
  if (rows.width() != layout.width || rows.height() > layout.height - written)
    return invalid("rows of another size");
  for (const std::string& channel : layout.channels) {
    if (!rows.Has(channel)) return invalid(absl::StrCat("rows without ", channel));
  }
  if (rows.height() == 0) return absl::OkStatus();
  const absl::Status status = CatchExr(file_->path, [&] {
    file_->Write(part, rows);
    return absl::OkStatus();
  });
  written += rows.height();
  return file_->Judge(status);
}

absl::Status ExrRowWriter::Finish() {
  for (size_t i = 0; i < file_->layouts.size(); ++i)
    LUMIFOLD_CHECK(file_->written[i] == file_->layouts[i].height);
  const absl::Status status = CatchExr(file_->path, [&] {
    file_->single.reset();  // the destructors write the table of scan lines
    file_->multi.reset();
    return absl::OkStatus();
  });
  if (absl::Status judged = file_->Judge(status); !judged.ok()) return judged;
  return file_->file.Commit();
}

}  // namespace lumifold
