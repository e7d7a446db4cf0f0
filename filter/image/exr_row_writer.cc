#include "filter/image/exr_row_writer.h"

#include <ImfChannelList.h>
#include <ImfChromaticities.h>
#include <ImfFramesPerSecond.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/exr_parts.h"
#include "filter/image/exr_stream.h"
#include "filter/image/file_io.h"

namespace lumifold {
namespace {

Imath::M44f MatrixOf(const std::array<float, 16>& m) {
  return {m[0], m[1], m[2],  m[3],  m[4],  m[5],  m[6],  m[7],
          m[8], m[9], m[10], m[11], m[12], m[13], m[14], m[15]};
}

void AddStandard(const ExrStandard& standard, Imf::Header* header) {
  if (standard.world_to_camera.has_value())
    Imf::addWorldToCamera(*header, MatrixOf(*standard.world_to_camera));
  if (standard.world_to_ndc.has_value()) Imf::addWorldToNDC(*header, MatrixOf(*standard.world_to_ndc));
  if (standard.is_rec709) Imf::addChromaticities(*header, Imf::Chromaticities());  // those of Rec. 709
  if (standard.exposure_seconds.has_value()) Imf::addExpTime(*header, *standard.exposure_seconds);
  if (standard.frames_per_second > 0)
    Imf::addFramesPerSecond(*header, Imf::guessExactFps(standard.frames_per_second));
}

/// A part's header; `display` is the display window of the whole file.
Imf::Header HeaderOf(const ExrLayout& layout, const Imath::Box2i& display) {
  const int x = layout.frame.x;
  const int y = layout.frame.y;
  Imf::Header header = layout.origin != nullptr
                           ? ExrHeaderOf(*layout.origin)
                           : Imf::Header(display, {{x, y}, {x + layout.width - 1, y + layout.height - 1}});
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const auto& [name, value] : layout.metadata) header.insert(name, Imf::StringAttribute(value));
  AddStandard(layout.standard, &header);
  for (const std::string& channel : layout.channels)
    header.channels().insert(channel, Imf::Channel(Imf::FLOAT));
  return header;
}

/// The first pixel.
Imath::V2i PlaceOf(const ExrLayout& layout) {
  return layout.origin != nullptr ? layout.origin->header.dataWindow().min
                                  : Imath::V2i(layout.frame.x, layout.frame.y);
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
  File(std::string name, AtomicFile target, const ExrLayout& picture, const ExrLists& lists)
      : path(std::move(name)), file(std::move(target)) {
    parts.push_back({kExrFilmPart, picture});
    if (!IsEmpty(lists.edges)) parts.push_back({kExrEdgePart, lists.edges});
    if (!IsEmpty(lists.fragments)) parts.push_back({kExrFragmentPart, lists.fragments});
  }

  struct Part {
    const char* name;
    ExrLayout layout;
    int written = 0;  // rows
  };

  /// May throw.
  void Open() {
    const ExrLayout& picture = parts[0].layout;
    const bool is_whole = picture.frame.width == 0;
    const Imath::Box2i display({0, 0}, {(is_whole ? picture.width : picture.frame.width) - 1,
                                        (is_whole ? picture.height : picture.frame.height) - 1});
    std::vector<Imf::Header> headers;
    for (const Part& part : parts) headers.push_back(HeaderOf(part.layout, display));
    if (headers.size() == 1) {
      single.emplace(stream, headers[0]);
      return;
    }
    for (size_t i = 0; i < headers.size(); ++i) {
      headers[i].setName(parts[i].name);
      headers[i].setType(Imf::SCANLINEIMAGE);
    }
    multi.emplace(stream, headers.data(), static_cast<int>(headers.size()));
  }

  /// May throw.
  void Write(size_t number, const LayeredImage& rows) {
    const Imath::V2i place = PlaceOf(parts[number].layout);
    const Imf::FrameBuffer frame = ExrFrameOf(rows, place.x, place.y + parts[number].written);
    const auto write = [&](auto&& output) {
      output.setFrameBuffer(frame);
      output.writePixels(rows.height());
    };
    if (single.has_value())
      write(*single);
    else
      write(Imf::OutputPart(*multi, static_cast<int>(number)));
  }

  /// The error: the disk's if there is one, else OpenEXR's.
  absl::Status Judge(const absl::Status& status) const {
    return stream.status().ok() ? status : stream.status();
  }

  std::string path;
  AtomicFile file;
  std::vector<Part> parts;
  ExrFileStream stream{path, &file};
  std::optional<Imf::OutputFile> single;  // a file of one part
  std::optional<Imf::MultiPartOutputFile> multi;
};

ExrRowWriter::ExrRowWriter(std::unique_ptr<File> file) : file_(std::move(file)) {}
ExrRowWriter::ExrRowWriter(ExrRowWriter&&) noexcept = default;
ExrRowWriter::~ExrRowWriter() = default;

absl::StatusOr<ExrRowWriter> ExrRowWriter::Create(const std::string& path, const ExrLayout& picture,
                                                  const ExrLists& lists, FileSystem* files) {
  if (IsEmpty(picture)) {
    return absl::InvalidArgumentError(
        absl::StrCat("cannot write ", path, ": the picture has no pixels or no channels"));
  }
  absl::StatusOr<AtomicFile> target = AtomicFile::Create(path, files);
  if (!target.ok()) return target.status();
  auto file = std::make_unique<File>(path, *std::move(target), picture, lists);
  const absl::Status status = CatchExr(path, [&] {
    file->Open();
    return absl::OkStatus();
  });
  if (!status.ok()) return file->Judge(status);
  return ExrRowWriter(std::move(file));
}

absl::Status ExrRowWriter::Append(const LayeredImage& rows) { return AppendTo(kExrFilmPart, rows); }

absl::Status ExrRowWriter::AppendEdges(const LayeredImage& rows) {
  return rows.channels().empty() ? absl::OkStatus() : AppendTo(kExrEdgePart, rows);
}

absl::Status ExrRowWriter::AppendFragments(const LayeredImage& rows) {
  return rows.channels().empty() ? absl::OkStatus() : AppendTo(kExrFragmentPart, rows);
}

absl::Status ExrRowWriter::AppendTo(std::string_view name, const LayeredImage& rows) {
  const auto invalid = [&](std::string_view why) {
    return absl::InvalidArgumentError(absl::StrCat("cannot write ", file_->path, ": ", std::string(why)));
  };
  const auto part = std::find_if(file_->parts.begin(), file_->parts.end(),
                                 [name](const File::Part& p) { return p.name == name; });
  if (part == file_->parts.end())
    return invalid(absl::StrCat("no part ", std::string(name), " was announced"));
  const ExrLayout& layout = part->layout;
  if (rows.width() != layout.width || rows.height() > layout.height - part->written)
    return invalid("rows of another size");
  for (const std::string& channel : layout.channels) {
    if (!rows.Has(channel)) return invalid(absl::StrCat("rows without ", channel));
  }
  if (rows.height() == 0) return absl::OkStatus();
  const absl::Status status = CatchExr(file_->path, [&] {
    file_->Write(static_cast<size_t>(part - file_->parts.begin()), rows);
    return absl::OkStatus();
  });
  part->written += rows.height();
  return file_->Judge(status);
}

absl::Status ExrRowWriter::Finish() {
  for (const File::Part& part : file_->parts) LUMIFOLD_CHECK(part.written == part.layout.height);
  const absl::Status status = CatchExr(file_->path, [&] {
    file_->single.reset();  // the destructors write the table of scan lines
    file_->multi.reset();
    return absl::OkStatus();
  });
  if (absl::Status judged = file_->Judge(status); !judged.ok()) return judged;
  return file_->file.Commit();
}

}  // namespace lumifold
