#include "filter/image/exr_film.h"

#include <ImfHeader.h>
#include <ImfInputPart.h>
#include <ImfPartType.h>
#include <ImfThreading.h>
#include <ImfTiledInputPart.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/exr_parts.h"
#include "filter/image/file_io.h"
#include "filter/image/layers.h"

namespace lumifold {
namespace {

/// Scan lines decoded at a time, at least: ZIP compresses this many together.
constexpr int kLines = 16;
/// Rows of a list searched at a time.
constexpr int kListRows = 4096;
/// Bytes that go to or from the scratch file at once, where whole rows do. A row of a list has 64 a channel,
/// and each call costs as much as copying several thousand.
constexpr size_t kPieceBytes = size_t{1} << 20;

/// Memory for decoding. OpenEXR holds two chunks of lines for each thread, three times each: as read, as
/// decompressed, and in the order of the channels.
constexpr double kDecodeBytes = 512.0 * (1 << 20);

/// Threads for decoding a file within kDecodeBytes, at most `most`: fewer where a chunk is large.
int DecodeThreads(const Imf::MultiPartInputFile& file, int most) {
  double threads = most;
  for (int part = 0; part < file.parts(); ++part) {
    const Imf::Header& header = file.header(part);
    const Imath::Box2i& window = header.dataWindow();
    double chunk = sizeof(float) * kLines * (static_cast<double>(window.max.x) - window.min.x + 1);
    chunk *= static_cast<double>(ExrImage(header, 0, 0).channels().size());
    if (!header.hasTileDescription()) threads = std::min(threads, std::ceil(kDecodeBytes / (6 * chunk)));
  }
  return static_cast<int>(threads);
}

/// Copies the common part of two images. `from` starts at (x, y) in the coordinates of `to`; any overlap is
/// allowed.
void CopyOverlap(const LayeredImage& from, int x, int y, LayeredImage* to) {
  const Rect common = Intersect({x, y, x + from.width(), y + from.height()}, to->bounds());
  if (common.IsEmpty()) return;
  const Rect source = {common.x0 - x, common.y0 - y, common.x1 - x, common.y1 - y};
  for (size_t i = 0; i < from.channels().size(); ++i) {
    CopyPlane(from.channels()[i].plane.view().Crop(source), to->channels()[i].plane.view().Crop(common));
  }
}

}  // namespace

/// One part of the file.
class ExrFilm::Part {
 public:
  /// `is_reread`: the same rows will be read again, even if they are read in full width.
  Part(std::string path, std::string scratch_folder, Imf::MultiPartInputFile* file, int number,
       bool is_reread)
      : path_(std::move(path)),
        scratch_folder_(std::move(scratch_folder)),
        file_(*file),
        number_(number),
        window_(file->header(number).dataWindow()),
        is_tiled_(file->header(number).hasTileDescription()),
        is_reread_(is_reread) {}

  const std::string& name() const { return file_.header(number_).name(); }
  int width() const { return window_.max.x - window_.min.x + 1; }
  int height() const { return window_.max.y - window_.min.y + 1; }
  LayeredImage Outline() const { return Image(0, 0); }

  /// The channel's name in the whole picture.
  std::string NameOf(const std::string& channel) const { return ExrChannelName(file_, number_, channel); }

  /// Adds what Read() returns to `picture`, under the names that the channels have there.
  absl::Status AddTo(const Rect& rect, LayeredImage* picture) {
    absl::StatusOr<LayeredImage> pixels = Read(rect);
    if (!pixels.ok()) return pixels.status();
    for (LayeredImage::Channel& channel : pixels->channels()) {
      const std::string name = NameOf(channel.name);
      if (picture->Has(name))
        return absl::InvalidArgumentError(absl::StrCat(path_, ": has the channel ", name, " twice"));
      picture->Add(name, std::move(channel.plane));
    }
    return absl::OkStatus();
  }

  absl::StatusOr<LayeredImage> Read(const Rect& rect) {
    const bool is_all = rect == Rect{0, 0, width(), height()};
    const bool is_direct = is_tiled_ || is_all || (!is_reread_ && rect.width() == width());
    if (!is_direct) return ReadSpooled(rect);
    LayeredImage image;
    const absl::Status status = CatchExr(path_, [&] {
      image = is_tiled_ ? DecodeTiles(rect) : DecodeLines(rect.y0, rect.y1);
      return absl::OkStatus();
    });
    if (!status.ok()) return status;
    return image;
  }

  /// Rows [y0, y1) in full width, without the scratch file.
  absl::StatusOr<LayeredImage> Peek(int y0, int y1) {
    LayeredImage image;
    const absl::Status status = CatchExr(path_, [&] {
      image = is_tiled_ ? DecodeTiles({0, y0, width(), y1}) : DecodeLines(y0, y1);
      return absl::OkStatus();
    });
    if (!status.ok()) return status;
    return image;
  }

 private:
  LayeredImage Image(int columns, int rows) const { return ExrImage(file_.header(number_), columns, rows); }

  /// May throw, and so may the next.
  LayeredImage DecodeLines(int y0, int y1) {
    LayeredImage image = Image(width(), y1 - y0);
    if (y1 == y0) return image;
    Imf::InputPart part(file_, number_);
    part.setFrameBuffer(ExrFrameOf(image, window_.min.x, window_.min.y + y0));
    part.readPixels(window_.min.y + y0, window_.min.y + y1 - 1);
    return image;
  }

  LayeredImage DecodeTiles(const Rect& rect) {
    Imf::TiledInputPart part(file_, number_);
    const int tile_width = static_cast<int>(part.tileXSize());
    const int tile_height = static_cast<int>(part.tileYSize());
    LayeredImage image = Image(rect.width(), rect.height());
    const int first = rect.x0 / tile_width;
    const int last = (rect.x1 - 1) / tile_width;
    for (int row = rect.y0 / tile_height; row * tile_height < rect.y1; ++row) {
      const int x0 = first * tile_width;
      const int y0 = row * tile_height;
      const LayeredImage tiles =
          Image(std::min((last + 1) * tile_width, width()) - x0, std::min(y0 + tile_height, height()) - y0);
      part.setFrameBuffer(ExrFrameOf(tiles, window_.min.x + x0, window_.min.y + y0));
      part.readTiles(first, last, row, row);
      CopyOverlap(tiles, x0 - rect.x0, y0 - rect.y0, &image);
    }
    return image;
  }

  /// Offset of row y of channel c in the scratch file.
  uint64_t PlaceOf(int y, size_t c) const {
    const uint64_t row_bytes = sizeof(float) * static_cast<uint64_t>(width());
    return (static_cast<uint64_t>(y) * channel_count_ + c) * row_bytes;
  }

  /// Makes the scratch file hold rows [y0, y1), and drops the rows above.
  absl::Status Spool(int y0, int y1) {
    if (!spool_.has_value()) {
      absl::StatusOr<ScratchFile> scratch = ScratchFile::Create(scratch_folder_);
      if (!scratch.ok()) return scratch.status();
      spool_.emplace(*std::move(scratch));
      channel_count_ = Outline().channels().size();
    }
    if (y0 < spooled_from_ || y0 > spooled_to_) spooled_to_ = y0 / kLines * kLines;
    spooled_from_ = y0;
    spool_->Forget(PlaceOf(std::min(y0, spooled_to_), 0));
    while (spooled_to_ < y1) {
      const int end = std::min(spooled_to_ + std::max(kLines, RowsAtOnce() / kLines * kLines), height());
      const absl::StatusOr<LayeredImage> lines = Peek(spooled_to_, end);
      if (!lines.ok()) return lines.status();
      if (absl::Status status = Keep(*lines, spooled_to_); !status.ok()) return status;
      spooled_to_ = end;
    }
    return absl::OkStatus();
  }

  size_t RowFloats() const { return channel_count_ * static_cast<size_t>(width()); }

  int RowsAtOnce() const {
    return static_cast<int>(std::max(size_t{1}, kPieceBytes / (sizeof(float) * RowFloats())));
  }

  /// Calls copy(plane's row, place in `piece`) for the rows [y0, y1) of an image, in the scratch file's
  /// order.
  template <typename Image, typename Copy>
  void ForEachRow(Image& image, int y0, int y1, std::vector<float>& piece, Copy copy) const {
    float* place = piece.data();
    for (int y = y0; y < y1; ++y) {
      for (auto& channel : image.channels()) {
        copy(channel.plane.Row(y), place);
        place += width();
      }
    }
  }

  absl::Status Keep(const LayeredImage& lines, int y0) {
    const int step = RowsAtOnce();
    std::vector<float> piece;
    for (int y = 0; y < lines.height(); y += step) {
      const int end = std::min(y + step, lines.height());
      piece.resize(static_cast<size_t>(end - y) * RowFloats());
      ForEachRow(lines, y, end, piece,
                 [&](const float* row, float* place) { std::copy_n(row, width(), place); });
      const std::string_view bytes(reinterpret_cast<const char*>(piece.data()), sizeof(float) * piece.size());
      if (absl::Status status = spool_->Write(PlaceOf(y0 + y, 0), bytes); !status.ok()) return status;
    }
    return absl::OkStatus();
  }

  absl::StatusOr<LayeredImage> ReadSpooled(const Rect& rect) {
    if (absl::Status status = Spool(rect.y0, rect.y1); !status.ok()) return status;
    LayeredImage image = Image(rect.width(), rect.height());
    const absl::Status status =
        rect.width() == width() ? ReadWholeRows(rect.y0, &image) : ReadPart(rect, &image);
    if (!status.ok()) return status;
    return image;
  }

  absl::Status ReadWholeRows(int y0, LayeredImage* image) const {
    const int step = RowsAtOnce();
    std::vector<float> piece;
    for (int y = 0; y < image->height(); y += step) {
      const int end = std::min(y + step, image->height());
      piece.resize(static_cast<size_t>(end - y) * RowFloats());
      absl::Status status = spool_->Read(PlaceOf(y0 + y, 0), reinterpret_cast<char*>(piece.data()),
                                         sizeof(float) * piece.size());
      if (!status.ok()) return status;
      ForEachRow(*image, y, end, piece,
                 [&](float* row, const float* place) { std::copy_n(place, width(), row); });
    }
    return absl::OkStatus();
  }

  absl::Status ReadPart(const Rect& rect, LayeredImage* image) const {
    const size_t bytes = sizeof(float) * static_cast<size_t>(rect.width());
    for (int y = 0; y < rect.height(); ++y) {
      for (size_t c = 0; c < channel_count_; ++c) {
        const uint64_t place = PlaceOf(rect.y0 + y, c) + sizeof(float) * static_cast<uint64_t>(rect.x0);
        char* row = reinterpret_cast<char*>(image->channels()[c].plane.Row(y));
        if (absl::Status status = spool_->Read(place, row, bytes); !status.ok()) return status;
      }
    }
    return absl::OkStatus();
  }

  const std::string path_;
  const std::string scratch_folder_;
  Imf::MultiPartInputFile& file_;
  const int number_;
  const Imath::Box2i window_;
  const bool is_tiled_;
  const bool is_reread_;
  std::optional<ScratchFile> spool_;
  size_t channel_count_ = 0;
  int spooled_from_ = 0;  // rows [spooled_from_, spooled_to_) are in the scratch file
  int spooled_to_ = 0;
};

struct ExrFilm::File {
  std::string path;
  std::unique_ptr<Imf::MultiPartInputFile> input;
  std::vector<std::unique_ptr<Part>> pixels;  // at least one
  std::unique_ptr<Part> edges;                // null without an edge set
  std::unique_ptr<Part> fragments;            // null without fragments
};

ExrFilm::ExrFilm(std::unique_ptr<File> file) : file_(std::move(file)) {}
ExrFilm::~ExrFilm() = default;

absl::StatusOr<std::unique_ptr<ExrFilm>> ExrFilm::Open(const std::string& path,
                                                       const std::string& scratch_folder) {
  if (absl::Status status = CheckIsFile(path); !status.ok()) return status;
  auto file = std::make_unique<File>();
  file->path = path;
  const absl::Status status = CatchExr(path, [&] {
    const int threads = DecodeThreads(Imf::MultiPartInputFile(path.c_str(), 0), Imf::globalThreadCount());
    file->input = std::make_unique<Imf::MultiPartInputFile>(path.c_str(), threads);
    return CheckLayeredExr(path, *file->input, std::filesystem::file_size(path));
  });
  if (!status.ok()) return status;
  for (int number = 0; number < file->input->parts(); ++number) {
    const Imf::Header& header = file->input->header(number);
    const bool is_list = number > 0 && IsExrList(header);
    auto part = std::make_unique<Part>(path, scratch_folder, file->input.get(), number, is_list);
    if (!is_list)
      file->pixels.push_back(std::move(part));
    else
      (IsExrPart(header, kExrEdgePart) ? file->edges : file->fragments) = std::move(part);
  }
  return std::unique_ptr<ExrFilm>(new ExrFilm(std::move(file)));
}

int ExrFilm::width() const { return file_->pixels[0]->width(); }
int ExrFilm::height() const { return file_->pixels[0]->height(); }

std::shared_ptr<const ExrOrigin> ExrFilm::origin() const {
  return std::make_shared<const ExrOrigin>(ExrOrigin{file_->input->header(0)});
}

LayeredImage ExrFilm::Outline() const {
  LayeredImage outline;
  for (const std::unique_ptr<Part>& part : file_->pixels) {
    const LayeredImage of_part = part->Outline();
    for (const LayeredImage::Channel& channel : of_part.channels()) {
      const std::string name = part->NameOf(channel.name);
      if (!outline.Has(name)) outline.Add(name);
    }
  }
  outline.metadata() = ExrMetadata(file_->input->header(0));
  return outline;
}

absl::StatusOr<EdgedImage> ExrFilm::Read(const Rect& rect) {
  EdgedImage film{LayeredImage(rect.width(), rect.height())};
  for (const std::unique_ptr<Part>& part : file_->pixels) {
    if (absl::Status status = part->AddTo(rect, &film.pixels); !status.ok()) return status;
  }
  for (const auto& [part, list] :
       {std::pair(file_->edges.get(), &film.edges), {file_->fragments.get(), &film.fragments}}) {
    if (part == nullptr) continue;
    absl::StatusOr<LayeredImage> rows = ReadList(*part, rect);
    if (!rows.ok()) return rows.status();
    *list = *std::move(rows);
  }
  return film;
}

absl::StatusOr<LayeredImage> ExrFilm::ReadList(Part& list, const Rect& rect) const {
  if (rect == Rect{0, 0, width(), height()}) return list.Peek(0, list.height());
  const LayeredImage outline = list.Outline();
  for (const std::string_view place : {layers::kPixelX, layers::kPixelY}) {
    if (!outline.Has(place))
      return absl::InvalidArgumentError(
          absl::StrCat(file_->path, ": the part ", list.name(), " has no channel ", std::string(place)));
  }
  const absl::StatusOr<int> first = FirstRowFrom(list, rect.y0);
  if (!first.ok()) return first.status();
  const absl::StatusOr<int> last = FirstRowFrom(list, rect.y1);
  if (!last.ok()) return last.status();
  return ReadRows(list, *first, *last, rect);
}

/// The first row of a list whose pixel lies in row y of the picture or below.
absl::StatusOr<int> ExrFilm::FirstRowFrom(Part& list, int y) {
  int first = 0;
  int last = list.height();
  while (first < last) {
    const int middle = first + (last - first) / 2;
    const absl::StatusOr<LayeredImage> row = list.Peek(middle, middle + 1);
    if (!row.ok()) return row.status();
    if (row->Get(layers::kPixelY).At(0, 0) < static_cast<float>(y))
      first = middle + 1;
    else
      last = middle;
  }
  return first;
}

absl::StatusOr<LayeredImage> ExrFilm::ReadRows(Part& list, int first, int last, const Rect& rect) const {
  std::vector<LayeredImage> pieces;
  for (int row = first; row < last; row += kListRows) {
    const absl::StatusOr<LayeredImage> rows =
        list.Read({0, row, list.width(), std::min(row + kListRows, last)});
    if (!rows.ok()) return rows.status();
    const ConstFloatView y = rows->Get(layers::kPixelY);
    for (int i = 0; i < rows->height(); ++i) {
      if (!(y.At(0, i) >= static_cast<float>(rect.y0) && y.At(0, i) < static_cast<float>(rect.y1)))
        return absl::InvalidArgumentError(absl::StrCat(file_->path, ": the part ", list.name(),
                                                       " is not in the order of the picture's rows"));
    }
    pieces.push_back(EdgesInside(*rows, rect));
  }
  return JoinRows(pieces);
}

}  // namespace lumifold
