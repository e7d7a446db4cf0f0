// How far a filtered picture moves where features of the geometry units are rounded to half precision, one
// group of planes at a time: docs/decisions/0020-plane-encodings.md. Prints a table in Markdown.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <string_view>
#include <vector>

#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/image/parallel.h"
#include "filter/methods.h"
#include "filter/metrics/metrics.h"
#include "tests/charts/films/film_source.h"

namespace lumifold {
namespace {

/// Planes that are rounded together.
struct Group {
  const char* name;
  std::vector<std::string_view> channels;  // also those of levels
  bool in_pixels;
  bool in_edges;
};

const std::vector<Group>& Groups() {
  static const auto& groups = *new std::vector<Group>{
      {"normals", {layers::kNormalX, layers::kNormalY, layers::kNormalZ}, true, false},
      {"distances", {layers::kDistance, layers::kPlanarDepth}, true, false},
      {"roughness", {layers::kRoughness}, true, false},
      {"normals of sub-samples", {layers::kNormalX, layers::kNormalY, layers::kNormalZ}, false, true},
      {"distances of sub-samples", {layers::kDistance}, false, true},
      {"albedo and emission of sub-samples",
       {"albedo.R", "albedo.G", "albedo.B", "emission.R", "emission.G", "emission.B"},
       false,
       true},
  };
  return groups;
}

/// The nearest half; a value beyond all of them stays as it is.
float Rounded(float value) {
  constexpr float kLargestHalf = 65504;
  constexpr float kLeastNormal = 0x1p-14f;
  if (std::abs(value) > kLargestHalf) return value;
  if (std::abs(value) < kLeastNormal) return std::nearbyint(value * 0x1p24f) * 0x1p-24f;
  const uint32_t bits = std::bit_cast<uint32_t>(value);
  const uint32_t to_even = bits >> 13 & 1;
  return std::bit_cast<float>((bits + 0xfff + to_even) & ~uint32_t{0x1fff});
}

bool IsOf(std::string_view channel, const Group& group) {
  return std::any_of(group.channels.begin(), group.channels.end(), [channel](std::string_view name) {
    return channel == name || channel.ends_with("_" + std::string(name));
  });
}

LayeredImage RoundedCopy(const LayeredImage& picture, const Group& group) {
  LayeredImage copy = picture.Crop(picture.bounds());
  for (LayeredImage::Channel& channel : copy.channels()) {
    if (!IsOf(channel.name, group)) continue;
    for (int y = 0; y < copy.height(); ++y) {
      float* row = channel.plane.Row(y);
      std::transform(row, row + copy.width(), row, Rounded);
    }
  }
  return copy;
}

/// How far a picture moved.
struct Move {
  double largest = 0;  // of a pixel, relative to its value or 0.01
  double above = 0;    // share of pixels that moved by more than 1e-4
  double mse255 = 0;
};

Move MoveOf(const Picture& picture, const Picture& from) {
  constexpr double kDark = 0.01;
  Move move;
  int64_t above = 0;
  const ConstColorView a = ViewOf(from);
  const ConstColorView b = ViewOf(picture);
  for (size_t c = 0; c < a.size(); ++c) {
    for (int y = 0; y < a[c].height(); ++y) {
      for (int x = 0; x < a[c].width(); ++x) {
        const double value = static_cast<double>(a[c].At(x, y));
        const double moved =
            std::abs(static_cast<double>(b[c].At(x, y)) - value) / std::max(std::abs(value), kDark);
        move.largest = std::max(move.largest, moved);
        above += moved > 1e-4 ? 1 : 0;
      }
    }
  }
  move.above = static_cast<double>(above) / (3.0 * a[0].width() * a[0].height());
  move.mse255 = metrics::Mse255(b, a);
  return move;
}

struct Flags {
  std::vector<std::string> scenes = {"cornell-box", "meeting-room", "bedroom", "atrium"};
  charts::FilmSettings film = {.width = 320, .height = 240, .samples = 32, .seed = 1};
  std::string cache = "build/half-features";
};

absl::Status Measure(const Flags& flags, const std::string& scene, TaskPool* pool) {
  const absl::StatusOr<charts::FilmSource> source = charts::FilmSource::Create(scene, flags.cache);
  if (!source.ok()) return source.status();
  const absl::StatusOr<charts::RenderedFilm> rendered = source->Get(flags.film, pool);
  if (!rendered.ok()) return rendered.status();
  const EdgedImage& film = rendered->film;
  const absl::StatusOr<Picture> picture =
      filter::FilterFilm(film.pixels, "default", pool, &film.edges, &film.fragments);
  if (!picture.ok()) return picture.status();
  for (const Group& group : Groups()) {
    const LayeredImage pixels =
        group.in_pixels ? RoundedCopy(film.pixels, group) : film.pixels.Crop(film.pixels.bounds());
    const LayeredImage edges =
        group.in_edges ? RoundedCopy(film.edges, group) : film.edges.Crop(film.edges.bounds());
    const absl::StatusOr<Picture> moved =
        filter::FilterFilm(pixels, "default", pool, &edges, &film.fragments);
    if (!moved.ok()) return moved.status();
    const Move move = MoveOf(*moved, *picture);
    std::printf("| %s | %s | %.1e | %.2f %% | %.1e |\n", scene.c_str(), group.name, move.largest,
                100 * move.above, move.mse255);
    std::fflush(stdout);
  }
  return absl::OkStatus();
}

int Run(const Flags& flags) {
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(2);
  std::printf(
      "| scene | planes as halves | largest move of a value | values that move by more than 1e-4 | MSE255 "
      "|\n");
  std::printf("|---|---|---|---|---|\n");
  for (const std::string& scene : flags.scenes) {
    if (const absl::Status status = Measure(flags, scene, pool.get()); !status.ok()) {
      std::cerr << "half-features: " << std::string(status.message()) << '\n';
      return 1;
    }
  }
  return 0;
}

}  // namespace
}  // namespace lumifold

int main(int argc, char** argv) {
  CLI::App app("Measures what features in half precision do to the filtered picture.", "half-features");
  lumifold::Flags flags;
  app.add_option("--scenes", flags.scenes, "Generated scenes, or files of LUMIFOLD_SCENES_DIR");
  app.add_option("--samples", flags.film.samples)->capture_default_str();
  app.add_option("--cache", flags.cache, "Folder of the films")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  return lumifold::Run(flags);
}
