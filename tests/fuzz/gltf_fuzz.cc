// The scene loader. For any bytes, loading must return a valid Scene or an error of one line, within the
// given limits.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "tests/fuzz/fuzz_target.h"
#include "tests/support/gltf_samples.h"
#include "tests/support/scene_flaw.h"
#include "worker/scene/gltf_loader.h"

namespace {

using lumifold::scene::LoadOptions;

/// Limits under which any document takes well under a second and a few hundred MiB.
LoadOptions SmallLimits() {
  LoadOptions options;
  options.time_seconds = 0.5;
  options.limits.max_triangles = 1 << 14;
  options.limits.max_vertices = 1 << 18;
  options.limits.max_instances = 1 << 12;
  options.limits.max_keyframes = 1 << 16;
  options.limits.max_texture_pixels = 1 << 22;
  return options;
}

/// Input of JSON, a zero byte and binary data is converted to the GLB of both, so that mutations of the
/// JSON's length need no matching change of the container. Other input is passed on unchanged.
std::string Document(std::string_view input) {
  const size_t zero = input.find('\0');
  if (!input.starts_with("{") || zero == std::string_view::npos) return std::string(input);
  return lumifold::scene::MakeGlb(std::string(input.substr(0, zero)), std::string(input.substr(zero + 1)));
}

}  // namespace

std::vector<std::string> lumifold::fuzz::Seeds() {
  std::vector<std::string> seeds;
  for (const auto& [name, fixture] : lumifold::scene::SampleDocuments()) {
    seeds.push_back(fixture.Glb());
    seeds.push_back(fixture.FullJson().dump() + '\0' + fixture.binary);
  }
  return seeds;
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace lumifold;
  const std::string document = Document({reinterpret_cast<const char*>(data), size});
  const auto scene = scene::LoadGltf(document, "fuzz", scene::NoFiles, SmallLimits());
  if (scene.ok()) {
    const std::string flaw = scene::FirstFlaw(*scene);
    if (!flaw.empty()) fuzz::Fail("the scene has", flaw);
  } else if (scene.status().message().find('\n') != absl::string_view::npos) {
    fuzz::Fail("an error of several lines", std::string(scene.status().message()));
  }
  return 0;
}
