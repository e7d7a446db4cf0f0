// What lossless compression of units would give beyond the encodings of their planes: bytes of real units, encoded as a
// worker does, and with the planes that stay float32 as bytes 0, 1, 2, 3 of all values, compressed with LZ4 or zstd. Each
// plane is compressed by itself and stays as it is where that is not larger. The argument of a scene is the number of
// samples of its passes; 0 are geometry units.
#include <benchmark/benchmark.h>
#include <lz4.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/check.h"
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

using Bytes = std::string;

/// The planes of all units, one after another.
struct Units {
  std::vector<Plane> planes;
  int64_t raw_bytes = 0;
};

void AddPlanes(LayeredImage picture, Units* units) {
  for (LayeredImage::Channel& channel : picture.channels()) {
    units->raw_bytes += int64_t{picture.width()} * picture.height() * static_cast<int64_t>(sizeof(float));
    units->planes.push_back(std::move(channel.plane));
  }
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
  if (!units.planes.empty()) return units;
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
      AddPlanes(std::move(geometry.pixels), &units);
      AddPlanes(std::move(geometry.edges), &units);
    } else {
      render::RenderCounts counts;
      AddPlanes(renderer->RenderPass(tile, 0, {0, samples}, &counts), &units);
    }
  }
  return units;
}

/// Sorts the bytes of values into byte planes.
void Shuffle(const Bytes& plane, char* out) {
  const size_t count = plane.size() / sizeof(float);
  for (size_t byte = 0; byte < sizeof(float); ++byte) {
    for (size_t i = 0; i < count; ++i) out[byte * count + i] = plane[i * sizeof(float) + byte];
  }
}

void Unshuffle(const char* bytes, size_t size, char* out) {
  const size_t count = size / sizeof(float);
  for (size_t i = 0; i < count; ++i) {
    for (size_t byte = 0; byte < sizeof(float); ++byte)
      out[i * sizeof(float) + byte] = bytes[byte * count + i];
  }
}

/// Compresses `size` bytes into `out`; the size, or 0 where it does not fit.
struct Codec {
  size_t (*compress)(const char* bytes, size_t size, char* out, size_t capacity);
  bool (*decompress)(const char* bytes, size_t size, char* out, size_t out_size);
};

/// The encodings alone.
const Codec kPlain = {[](const char*, size_t, char*, size_t) { return size_t{0}; },
                      [](const char*, size_t, char*, size_t) { return false; }};

const Codec kLz4 = {[](const char* bytes, size_t size, char* out, size_t capacity) {
                      return static_cast<size_t>(LZ4_compress_default(bytes, out, static_cast<int>(size),
                                                                      static_cast<int>(capacity)));
                    },
                    [](const char* bytes, size_t size, char* out, size_t out_size) {
                      return LZ4_decompress_safe(bytes, out, static_cast<int>(size),
                                                 static_cast<int>(out_size)) == static_cast<int>(out_size);
                    }};

const Codec kZstd1 = {[](const char* bytes, size_t size, char* out, size_t capacity) {
                        static ZSTD_CCtx* const context = ZSTD_createCCtx();
                        const size_t done = ZSTD_compressCCtx(context, out, capacity, bytes, size, 1);
                        return ZSTD_isError(done) ? 0 : done;
                      },
                      [](const char* bytes, size_t size, char* out, size_t out_size) {
                        static ZSTD_DCtx* const context = ZSTD_createDCtx();
                        return ZSTD_decompressDCtx(context, out, out_size, bytes, size) == out_size;
                      }};

/// An encoded plane, compressed where that makes it smaller.
struct Encoded {
  v1::PlaneEncoding encoding = v1::PLANE_ENCODING_FLOAT;
  bool compressed = false;
  Bytes bytes;
};

Encoded Encode(const Codec& codec, const Plane& plane, Bytes* scratch) {
  Encoded encoded;
  encoded.encoding = rpc::EncodingOf(plane.view());
  rpc::AppendPlane(plane.view(), encoded.encoding, &encoded.bytes);
  if (encoded.encoding != v1::PLANE_ENCODING_FLOAT) return encoded;
  scratch->resize(encoded.bytes.size());
  Shuffle(encoded.bytes, scratch->data());
  Bytes out(encoded.bytes.size() - 1, '\0');
  const size_t size = codec.compress(scratch->data(), scratch->size(), out.data(), out.size());
  if (size == 0) return encoded;
  out.resize(size);
  return {encoded.encoding, true, std::move(out)};
}

/// Decodes a plane of `count` values.
void Decode(const Codec& codec, const Encoded& encoded, size_t count, Bytes* scratch, Bytes* floats,
            std::vector<float>* values) {
  values->resize(count);
  if (!encoded.compressed) {
    rpc::DecodeValues(encoded.encoding, encoded.bytes, values->data(), count);
    return;
  }
  scratch->resize(count * sizeof(float));
  floats->resize(scratch->size());
  LUMIFOLD_CHECK(
      codec.decompress(encoded.bytes.data(), encoded.bytes.size(), scratch->data(), scratch->size()));
  Unshuffle(scratch->data(), scratch->size(), floats->data());
  rpc::DecodeValues(encoded.encoding, *floats, values->data(), count);
}

size_t CountOf(const Plane& plane) {
  return static_cast<size_t>(plane.width()) * static_cast<size_t>(plane.height());
}

void Report(const Units& units, int64_t bytes, benchmark::State& state) {
  state.counters["raw_bytes_per_unit"] = static_cast<double>(units.raw_bytes) / kUnits;
  state.counters["bytes_per_unit"] = static_cast<double>(bytes) / kUnits;
  state.SetBytesProcessed(state.iterations() * units.raw_bytes);
}

void BM_Encode(benchmark::State& state, const std::string& scene, const Codec& codec) {
  const Units& units = UnitsOf(scene, static_cast<uint32_t>(state.range(0)));
  Bytes scratch;
  int64_t bytes = 0;
  for (auto _ : state) {
    bytes = 0;
    for (const Plane& plane : units.planes)
      bytes += static_cast<int64_t>(Encode(codec, plane, &scratch).bytes.size());
  }
  Report(units, bytes, state);
}

void BM_Decode(benchmark::State& state, const std::string& scene, const Codec& codec) {
  const Units& units = UnitsOf(scene, static_cast<uint32_t>(state.range(0)));
  Bytes scratch, floats;
  std::vector<float> values;
  std::vector<Encoded> encoded;
  int64_t bytes = 0;
  for (const Plane& plane : units.planes) {
    encoded.push_back(Encode(codec, plane, &scratch));
    bytes += static_cast<int64_t>(encoded.back().bytes.size());
    Decode(codec, encoded.back(), CountOf(plane), &scratch, &floats, &values);
    for (int y = 0; y < plane.height(); ++y)
      LUMIFOLD_CHECK(std::memcmp(plane.Row(y),
                                 values.data() + static_cast<size_t>(y) * static_cast<size_t>(plane.width()),
                                 static_cast<size_t>(plane.width()) * sizeof(float)) == 0);
  }
  for (auto _ : state) {
    for (size_t i = 0; i < encoded.size(); ++i) {
      Decode(codec, encoded[i], CountOf(units.planes[i]), &scratch, &floats, &values);
      benchmark::DoNotOptimize(values.data());
      benchmark::ClobberMemory();
    }
  }
  Report(units, bytes, state);
}

void Samples(benchmark::internal::Benchmark* bench) { bench->Arg(0)->Arg(4)->Arg(16)->Arg(64); }

#define LUMIFOLD_BENCH_SCENE(name, scene)                                    \
  BENCHMARK_CAPTURE(BM_Encode, name##_plain, scene, kPlain)->Apply(Samples); \
  BENCHMARK_CAPTURE(BM_Encode, name##_lz4, scene, kLz4)->Apply(Samples);     \
  BENCHMARK_CAPTURE(BM_Encode, name##_zstd1, scene, kZstd1)->Apply(Samples); \
  BENCHMARK_CAPTURE(BM_Decode, name##_plain, scene, kPlain)->Apply(Samples); \
  BENCHMARK_CAPTURE(BM_Decode, name##_lz4, scene, kLz4)->Apply(Samples);     \
  BENCHMARK_CAPTURE(BM_Decode, name##_zstd1, scene, kZstd1)->Apply(Samples)

LUMIFOLD_BENCH_SCENE(cornell_box, "cornell-box");
LUMIFOLD_BENCH_SCENE(meeting_room, "meeting-room");

}  // namespace
}  // namespace lumifold

BENCHMARK_MAIN();
