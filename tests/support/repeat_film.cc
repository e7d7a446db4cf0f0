// Makes a film of any size by repeating a small one, row by row: pictures larger than memory, for tests.
//   repeat-film FILM.exr WIDTH HEIGHT OUT.exr
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "filter/image/exr_io.h"
#include "filter/image/exr_row_writer.h"
#include "filter/image/layers.h"

namespace lumifold {
namespace {

constexpr int kRows = 64;
constexpr int kListRows = 4096;

ExrLayout LayoutOf(const LayeredImage& image, int width, int height) {
  ExrLayout layout{width, height, {}, image.metadata()};
  for (const LayeredImage::Channel& channel : image.channels()) layout.channels.push_back(channel.name);
  return layout;
}

/// Rows [y0, y1) of the large picture.
LayeredImage RowsOf(const LayeredImage& film, int width, int y0, int y1) {
  LayeredImage rows(width, y1 - y0);
  for (const LayeredImage::Channel& channel : film.channels()) {
    const FloatView out = rows.Add(channel.name);
    for (int y = y0; y < y1; ++y) {
      const float* from = channel.plane.Row(y % film.height());
      for (int x = 0; x < width; ++x) out.At(x, y - y0) = from[x % film.width()];
    }
  }
  return rows;
}

/// A row of a list of the film, and the pixel of the picture that it is repeated in.
struct Repeated {
  int row;
  int x;
  int y;
};

/// The edge set or the fragments of a film of `tile`, repeated.
std::vector<Repeated> RowsOfList(const LayeredImage& list, const Rect& tile, int width, int height) {
  std::vector<Repeated> repeated;
  if (list.channels().empty()) return repeated;
  const ConstFloatView x = list.Get(layers::kPixelX);
  const ConstFloatView y = list.Get(layers::kPixelY);
  std::vector<std::vector<int>> rows_at(static_cast<size_t>(tile.height()));
  for (int row = 0; row < list.height(); ++row) rows_at[static_cast<size_t>(y.At(0, row))].push_back(row);
  for (int out_y = 0; out_y < height; ++out_y) {
    const std::vector<int>& rows = rows_at[static_cast<size_t>(out_y % tile.height())];
    for (int left = 0; left < width; left += tile.width()) {
      for (const int row : rows) {
        const int out_x = left + static_cast<int>(x.At(0, row));
        if (out_x < width) repeated.push_back({row, out_x, out_y});
      }
    }
  }
  return repeated;
}

LayeredImage ListRows(const LayeredImage& list, const std::vector<Repeated>& repeated, size_t first,
                      size_t last) {
  LayeredImage rows = list.Resized(list.width(), static_cast<int>(last - first));
  for (const LayeredImage::Channel& channel : list.channels()) {
    const FloatView out = rows.Add(channel.name);
    for (size_t i = first; i < last; ++i) {
      for (int s = 0; s < list.width(); ++s) {
        float value = channel.plane.At(s, repeated[i].row);
        if (channel.name == layers::kPixelX) value = static_cast<float>(repeated[i].x);
        if (channel.name == layers::kPixelY) value = static_cast<float>(repeated[i].y);
        out.At(s, static_cast<int>(i - first)) = value;
      }
    }
  }
  return rows;
}

absl::Status Repeat(const EdgedImage& film, int width, int height, const std::string& path) {
  const std::vector<Repeated> edges = RowsOfList(film.edges, film.pixels.bounds(), width, height);
  const std::vector<Repeated> fragments = RowsOfList(film.fragments, film.pixels.bounds(), width, height);
  const ExrLists lists = {LayoutOf(film.edges, kSubSamples, static_cast<int>(edges.size())),
                          LayoutOf(film.fragments, 1, static_cast<int>(fragments.size()))};
  absl::StatusOr<ExrRowWriter> writer =
      ExrRowWriter::Create(path, LayoutOf(film.pixels, width, height), lists);
  if (!writer.ok()) return writer.status();
  for (int y = 0; y < height; y += kRows) {
    absl::Status status = writer->Append(RowsOf(film.pixels, width, y, std::min(y + kRows, height)));
    if (!status.ok()) return status;
  }
  for (size_t i = 0; i < edges.size(); i += kListRows) {
    absl::Status status =
        writer->AppendEdges(ListRows(film.edges, edges, i, std::min(i + kListRows, edges.size())));
    if (!status.ok()) return status;
  }
  for (size_t i = 0; i < fragments.size(); i += kListRows) {
    absl::Status status = writer->AppendFragments(
        ListRows(film.fragments, fragments, i, std::min(i + kListRows, fragments.size())));
    if (!status.ok()) return status;
  }
  return writer->Finish();
}

int Run(int argc, char** argv) {
  if (argc != 5) {
    std::fputs("usage: repeat-film FILM.exr WIDTH HEIGHT OUT.exr\n", stderr);
    return 2;
  }
  const absl::StatusOr<EdgedImage> film = ReadEdgedExr(argv[1]);
  const absl::Status status =
      film.ok() ? Repeat(*film, std::atoi(argv[2]), std::atoi(argv[3]), argv[4]) : film.status();
  if (status.ok()) return 0;
  std::fprintf(stderr, "repeat-film: %s\n", std::string(status.message()).c_str());
  return 1;
}

}  // namespace
}  // namespace lumifold

int main(int argc, char** argv) { return lumifold::Run(argc, argv); }
