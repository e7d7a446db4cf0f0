// Makes a film of any size by repeating a small one, row by row: pictures larger than memory, for tests.
//   repeat-film FILM.exr WIDTH HEIGHT OUT.exr [--without-edges]
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>
#include <vector>

#include "filter/image/exr_io.h"
#include "filter/image/exr_row_writer.h"
#include "filter/image/layers.h"

namespace lumifold {
namespace {

constexpr int kRows = 64;
constexpr int kEdgeRows = 4096;

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

/// An edge pixel of the large picture: its row in the small one's edge set, and its place.
struct Edge {
  int row;
  int x;
  int y;
};

std::vector<Edge> EdgesOf(const EdgedImage& film, int width, int height) {
  std::vector<Edge> edges;
  if (film.edges.channels().empty()) return edges;
  const ConstFloatView x = film.edges.Get(layers::kPixelX);
  const ConstFloatView y = film.edges.Get(layers::kPixelY);
  std::vector<std::vector<int>> rows_at(static_cast<size_t>(film.pixels.height()));
  for (int row = 0; row < film.edges.height(); ++row)
    rows_at[static_cast<size_t>(y.At(0, row))].push_back(row);
  for (int out_y = 0; out_y < height; ++out_y) {
    const std::vector<int>& rows = rows_at[static_cast<size_t>(out_y % film.pixels.height())];
    for (int left = 0; left < width; left += film.pixels.width()) {
      for (const int row : rows) {
        const int out_x = left + static_cast<int>(x.At(0, row));
        if (out_x < width) edges.push_back({row, out_x, out_y});
      }
    }
  }
  return edges;
}

LayeredImage EdgeRows(const LayeredImage& film_edges, const std::vector<Edge>& edges, size_t first,
                      size_t last) {
  LayeredImage rows(film_edges.width(), static_cast<int>(last - first));
  for (const LayeredImage::Channel& channel : film_edges.channels()) {
    const FloatView out = rows.Add(channel.name);
    for (size_t i = first; i < last; ++i) {
      const Edge& edge = edges[i];
      for (int s = 0; s < film_edges.width(); ++s) {
        float value = channel.plane.At(s, edge.row);
        if (channel.name == layers::kPixelX) value = static_cast<float>(edge.x);
        if (channel.name == layers::kPixelY) value = static_cast<float>(edge.y);
        out.At(s, static_cast<int>(i - first)) = value;
      }
    }
  }
  return rows;
}

absl::Status Repeat(const EdgedImage& film, int width, int height, const std::string& path) {
  const std::vector<Edge> edges = EdgesOf(film, width, height);
  const ExrLayout edge_layout = LayoutOf(film.edges, kSubSamples, static_cast<int>(edges.size()));
  absl::StatusOr<ExrRowWriter> writer = ExrRowWriter::Create(path, LayoutOf(film.pixels, width, height),
                                                             edges.empty() ? nullptr : &edge_layout);
  if (!writer.ok()) return writer.status();
  for (int y = 0; y < height; y += kRows) {
    absl::Status status = writer->Append(RowsOf(film.pixels, width, y, std::min(y + kRows, height)));
    if (!status.ok()) return status;
  }
  for (size_t i = 0; i < edges.size(); i += kEdgeRows) {
    absl::Status status =
        writer->AppendEdges(EdgeRows(film.edges, edges, i, std::min(i + kEdgeRows, edges.size())));
    if (!status.ok()) return status;
  }
  return writer->Finish();
}

int Run(int argc, char** argv) {
  const bool without_edges = argc == 6 && std::string_view(argv[5]) == "--without-edges";
  if (argc != 5 && !without_edges) {
    std::fputs("usage: repeat-film FILM.exr WIDTH HEIGHT OUT.exr [--without-edges]\n", stderr);
    return 2;
  }
  absl::StatusOr<EdgedImage> film = ReadEdgedExr(argv[1]);
  if (film.ok() && without_edges) film->edges = {};
  const absl::Status status =
      film.ok() ? Repeat(*film, std::atoi(argv[2]), std::atoi(argv[3]), argv[4]) : film.status();
  if (status.ok()) return 0;
  std::fprintf(stderr, "repeat-film: %s\n", std::string(status.message()).c_str());
  return 1;
}

}  // namespace
}  // namespace lumifold

int main(int argc, char** argv) { return lumifold::Run(argc, argv); }
