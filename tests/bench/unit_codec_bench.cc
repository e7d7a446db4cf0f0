// Encoding and decoding of real units: by the encodings that need no library, and as they are sent, with
// planes compressed. The argument of a scene is the number of samples of its passes; 0 are geometry units.
#include <benchmark/benchmark.h>

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/check.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/plane_codec.h"
#include "tests/scenes/glb_writer.h"
#include "tests/scenes/scenes.h"
#include "worker/render/renderer.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold {
namespace {

constexpr int kSize = 512;
constexpr int kTile = 32;
constexpr int kUnits = 32;

/// The pixels and the edge sets of all units.
struct Units {
  std::vector<LayeredImage> pictures;
  int64_t raw_bytes = 0;
};

void Add(LayeredImage picture, Units* units) {
  if (picture.height() == 0) return;
  units->raw_bytes += static_cast<int64_t>(rpc::EncodedBytesOf(rpc::LayoutOf(picture)));
  units->pictures.push_back(std::move(picture));
}

std::unique_ptr<render::Renderer> RendererOf(const std::string& name) {
  const auto glb = scenes::EncodeGlb(scenes::FindScene(name)->build());
  LUMIFOLD_CHECK(glb.ok());
  auto scene = scene::LoadGltf(*glb, name, nullptr);
  LUMIFOLD_CHECK(scene.ok());
  render::RenderSettings settings;
  settings.width = kSize;
  settings.height = kSize;
  return *render::Renderer::Create(std::make_shared<scene::Scene>(*std::move(scene)), settings);
}

/// Units of tiles spread over a frame, rendered once for all benchmarks.
const Units& UnitsOf(const std::string& name, uint32_t samples) {
  static auto& renderers = *new std::map<std::string, std::unique_ptr<render::Renderer>>;
  static auto& known = *new std::map<std::pair<std::string, uint32_t>, Units>;
  Units& units = known[{name, samples}];
  if (!units.pictures.empty()) return units;
  std::unique_ptr<render::Renderer>& renderer = renderers[name];
  if (renderer == nullptr) renderer = RendererOf(name);
  constexpr int kColumns = kSize / kTile;
  for (int i = 0; i < kUnits; ++i) {
    const int number = i * kColumns * kColumns / kUnits + i % kColumns;
    const int x = number % kColumns * kTile;
    const int y = number / kColumns % kColumns * kTile;
    const Rect tile = {x, y, x + kTile, y + kTile};
    if (samples == 0) {
      EdgedImage geometry = renderer->RenderGeometry(tile, 0);
      Add(std::move(geometry.pixels), &units);
      Add(std::move(geometry.edges), &units);
    } else {
      render::RenderCounts counts;
      EdgedImage pass = renderer->RenderPass(tile, 0, {0, samples}, &counts);
      Add(std::move(pass.pixels), &units);
      Add(std::move(pass.fragments), &units);
    }
  }
  return units;
}

/// Without compression.
rpc::EncodedPicture EncodePlain(const LayeredImage& picture) {
  rpc::EncodedPicture encoded{rpc::LayoutOf(picture), ""};
  for (const LayeredImage::Channel& channel : picture.channels()) {
    const v1::PlaneEncoding encoding = rpc::EncodingOf(channel.plane.view());
    encoded.layout.add_encodings(encoding);
    rpc::AppendPlane(channel.plane.view(), encoding, &encoded.bytes);
  }
  return encoded;
}

using Encoder = rpc::EncodedPicture (*)(const LayeredImage&);

void Report(const Units& units, int64_t bytes, benchmark::State& state) {
  state.counters["raw_bytes_per_unit"] = static_cast<double>(units.raw_bytes) / kUnits;
  state.counters["bytes_per_unit"] = static_cast<double>(bytes) / kUnits;
  state.SetBytesProcessed(state.iterations() * units.raw_bytes);
}

void BM_Encode(benchmark::State& state, const std::string& scene, Encoder encode) {
  const Units& units = UnitsOf(scene, static_cast<uint32_t>(state.range(0)));
  int64_t bytes = 0;
  while (state.KeepRunning()) {
    bytes = 0;
    for (const LayeredImage& picture : units.pictures)
      bytes += static_cast<int64_t>(encode(picture).bytes.size());
  }
  Report(units, bytes, state);
}

/// As the unit log decodes pictures and lists, of which the latter are narrower than a tile.
absl::StatusOr<LayeredImage> Decoded(const rpc::EncodedPicture& picture) {
  return picture.layout.width() < kTile ? rpc::ListFromBytes(picture.layout, picture.bytes, {})
                                        : rpc::ImageFromBytes(picture.layout, picture.bytes, {});
}

void BM_Decode(benchmark::State& state, const std::string& scene, Encoder encode) {
  const Units& units = UnitsOf(scene, static_cast<uint32_t>(state.range(0)));
  std::vector<rpc::EncodedPicture> encoded;
  int64_t bytes = 0;
  for (const LayeredImage& picture : units.pictures) {
    encoded.push_back(encode(picture));
    bytes += static_cast<int64_t>(encoded.back().bytes.size());
  }
  while (state.KeepRunning()) {
    for (const rpc::EncodedPicture& picture : encoded) benchmark::DoNotOptimize(Decoded(picture));
  }
  Report(units, bytes, state);
}

void Samples(benchmark::internal::Benchmark* bench) { bench->Arg(0)->Arg(4)->Arg(16)->Arg(64); }

#define LUMIFOLD_BENCH_SCENE(name, scene)                                               \
  BENCHMARK_CAPTURE(BM_Encode, name##_plain, scene, EncodePlain)->Apply(Samples);       \
  BENCHMARK_CAPTURE(BM_Encode, name##_zstd, scene, rpc::EncodePicture)->Apply(Samples); \
  BENCHMARK_CAPTURE(BM_Decode, name##_plain, scene, EncodePlain)->Apply(Samples);       \
  BENCHMARK_CAPTURE(BM_Decode, name##_zstd, scene, rpc::EncodePicture)->Apply(Samples)

LUMIFOLD_BENCH_SCENE(cornell_box, "cornell-box");
LUMIFOLD_BENCH_SCENE(meeting_room, "meeting-room");

}  // namespace
}  // namespace lumifold

BENCHMARK_MAIN();
