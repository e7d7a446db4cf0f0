// Runs the scene loader on libFuzzer's input. For any bytes, loading must return a valid Scene or an error of
// one line, within the given limits.

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

#include "tests/support/gltf_fixture.h"
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

[[noreturn]] void Fail(const char* what, const std::string& detail) {
  std::fprintf(stderr, "gltf_fuzz: %s: %s\n", what, detail.c_str());
  std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string document = Document({reinterpret_cast<const char*>(data), size});
  const auto no_files = [](const std::string& uri) -> absl::StatusOr<std::string> {
    return absl::NotFoundError(uri + " does not exist");
  };
  const auto scene = lumifold::scene::LoadGltf(document, "fuzz", no_files, SmallLimits());
  if (scene.ok()) {
    const std::string flaw = lumifold::scene::FirstFlaw(*scene);
    if (!flaw.empty()) Fail("the scene has", flaw);
  } else if (scene.status().message().find('\n') != absl::string_view::npos) {
    Fail("an error of several lines", std::string(scene.status().message()));
  }
  return 0;
}
