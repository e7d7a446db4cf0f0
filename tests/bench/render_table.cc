// Prints one line for each scene: the renderer's speed, its ratio to Embree alone on the same rays, and its
// memory.
//
//   render-table [SCENE...]     cornell-box, meeting-room, bedroom, atrium, staircase, or a file's path;
//                               without arguments: all but the bedroom
//
// Columns:
//   samples/s   samples of two threads per second of wall-clock time
//   one thread  samples per second of processor time, which other load on the machine hardly changes
//   embree      fraction of the rendering time spent in Embree
//   limit       processor time of Embree alone for the same rays in the same order, over that of rendering
//   memory      peak resident memory that loading and rendering add to the process
//   needed      memory of the scene's arrays, of Embree's acceleration structure with its copy of the
//   triangles,
//               and of the tiles being rendered
// Times are the minimum of several interleaved runs. Each scene is measured in a process of its own.
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "filter/image/check.h"
#include "filter/image/parallel.h"
#include "tests/bench/embree_tap.h"
#include "tests/scenes/glb_writer.h"
#include "tests/scenes/scenes.h"
#include "tests/support/cpu_seconds.h"
#include "tests/support/temp_folder.h"
#include "worker/render/renderer.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold::bench {
namespace {

constexpr int kWidth = 256;
constexpr int kHeight = 192;
constexpr int kTile = 32;
constexpr int kTiles = (kWidth / kTile) * (kHeight / kTile);
constexpr uint32_t kSamples = 8;
constexpr double kAllSamples = 1.0 * kWidth * kHeight * kSamples;
constexpr int kThreads = 2;
constexpr int kRounds = 5;

/// Cost of a task: wall-clock time and processor time of all threads.
struct Cost {
  double wall_seconds = 1e30;
  double cpu_seconds = 1e30;
};

/// The figures of one line.
struct Measured {
  Cost render;
  Cost replay;
  double share_inside = 0;
  int64_t extension_rays = 0;  // including camera rays
  int64_t shadow_rays = 0;
  int64_t gained_bytes = 0;
  int64_t scene_bytes = 0;
  int64_t embree_bytes = 0;
  int64_t tile_bytes = 0;
};

Rect TileRect(int64_t number) {
  constexpr int kColumns = kWidth / kTile;
  const int x = static_cast<int>(number) % kColumns * kTile;
  const int y = static_cast<int>(number) / kColumns * kTile;
  return {x, y, x + kTile, y + kTile};
}

render::RenderSettings Settings() {
  render::RenderSettings settings;
  settings.width = kWidth;
  settings.height = kHeight;
  return settings;
}

EdgedImage RenderTile(const render::Renderer& renderer, int64_t number) {
  render::RenderCounts counts;
  return renderer.RenderPass(TileRect(number), 0, {0, kSamples}, &counts);
}

template <typename T>
int64_t BytesOf(const std::vector<T>& values) {
  return static_cast<int64_t>(values.size() * sizeof(T));
}

int64_t BytesOf(const scene::Scene& scene) {
  int64_t bytes = BytesOf(scene.instances) + BytesOf(scene.materials) + BytesOf(scene.meshes);
  for (const scene::Mesh& mesh : scene.meshes) {
    bytes += BytesOf(mesh.positions) + BytesOf(mesh.normals) + BytesOf(mesh.uvs[0]) + BytesOf(mesh.uvs[1]) +
             BytesOf(mesh.tangents) + BytesOf(mesh.colors) + BytesOf(mesh.triangles);
  }
  for (const scene::SharedImage& image : scene.images) bytes += BytesOf(image->rgba);
  return bytes;
}

int64_t BytesOf(const EdgedImage& image) {
  int64_t bytes = 0;
  for (const LayeredImage* part : {&image.pixels, &image.edges, &image.fragments})
    bytes += static_cast<int64_t>(part->channels().size() * sizeof(float)) * part->width() * part->height();
  return bytes;
}

/// A value of /proc/self/status in bytes: "VmRSS" resident memory, "VmHWM" its peak.
int64_t ResidentBytes(const std::string& field) {
  std::ifstream status("/proc/self/status");
  std::string line;
  while (std::getline(status, line)) {
    if (absl::StartsWith(line, field)) return 1024 * std::atoll(line.c_str() + field.size() + 1);
  }
  LUMIFOLD_CHECK(false);
  return 0;
}

/// Runs `work` and lowers `cost` to its cost, if that is less.
void Time(const std::function<void()>& work, Cost* cost) {
  const absl::Time start = absl::Now();
  const double cpu_start = CpuSeconds();
  work();
  cost->cpu_seconds = std::min(cost->cpu_seconds, CpuSeconds() - cpu_start);
  cost->wall_seconds = std::min(cost->wall_seconds, absl::ToDoubleSeconds(absl::Now() - start));
}

std::vector<RayLog> LogRays(const render::Renderer& renderer, TaskPool& pool) {
  std::vector<RayLog> logs(kTiles);
  pool.Run(kTiles, [&](int64_t i) {
    const ScopedRayLog listening(&logs[i]);
    RenderTile(renderer, i);
  });
  return logs;
}

double ShareInsideEmbree(const render::Renderer& renderer, TaskPool& pool) {
  std::vector<int64_t> inside(kTiles), total(kTiles);
  pool.Run(kTiles, [&](int64_t i) {
    const ScopedEmbreeTime time;
    RenderTile(renderer, i);
    inside[i] = time.inside_ns();
    total[i] = time.total_ns();
  });
  double all_inside = 0;
  double all = 0;
  for (int i = 0; i < kTiles; ++i) {
    all_inside += static_cast<double>(inside[i]);
    all += static_cast<double>(total[i]);
  }
  return all_inside / all;
}

void MeasureSpeed(const render::Renderer& renderer, TaskPool& pool, Measured* m) {
  const std::vector<RayLog> logs = LogRays(renderer, pool);
  for (const RayLog& log : logs) {
    const auto shadow =
        std::count_if(log.rays.begin(), log.rays.end(), [](const TracedRay& ray) { return ray.occlusion; });
    m->shadow_rays += shadow;
    m->extension_rays += static_cast<int64_t>(log.rays.size()) - shadow;
  }
  for (int round = 0; round < kRounds; ++round) {
    Time([&] { pool.Run(kTiles, [&](int64_t i) { RenderTile(renderer, i); }); }, &m->render);
    Time([&] { pool.Run(kTiles, [&](int64_t i) { LUMIFOLD_CHECK(Replay(logs[i]) == logs[i].hits); }); },
         &m->replay);
  }
  m->share_inside = ShareInsideEmbree(renderer, pool);
}

/// Renders a scene of one triangle, so that the program's own pages and tables are resident and do not count
/// as memory of the measured scene.
void WarmUp(TaskPool& pool) {
  const auto scene = std::make_shared<scene::Scene>();
  scene->materials.emplace_back();
  scene::Mesh triangle;
  triangle.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  triangle.triangles = {0, 1, 2};
  triangle.material = 0;
  scene->meshes.push_back(std::move(triangle));
  scene->instances.emplace_back().mesh = 0;
  const auto renderer = render::Renderer::Create(scene, Settings());
  LUMIFOLD_CHECK(renderer.ok());
  pool.Run(kTiles, [&](int64_t i) { RenderTile(**renderer, i); });
}

absl::StatusOr<Measured> Measure(const std::string& path) {
  Measured m;
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(kThreads);
  WarmUp(*pool);
  const int64_t before = ResidentBytes("VmRSS");
  absl::StatusOr<scene::Scene> loaded = scene::LoadGltfFile(path);
  if (!loaded.ok()) return loaded.status();
  const auto scene = std::make_shared<const scene::Scene>(*std::move(loaded));
  m.scene_bytes = BytesOf(*scene);
  const int64_t embree_before = EmbreeBytes();
  const absl::StatusOr<std::unique_ptr<render::Renderer>> renderer =
      render::Renderer::Create(scene, Settings());
  if (!renderer.ok()) return renderer.status();
  m.embree_bytes = EmbreeBytes() - embree_before;
  m.tile_bytes = kThreads * BytesOf(RenderTile(**renderer, 0));
  pool->Run(kTiles, [&](int64_t i) { RenderTile(**renderer, i); });
  m.gained_bytes = ResidentBytes("VmHWM") - before;
  MeasureSpeed(**renderer, *pool, &m);
  return m;
}

void PrintHead() {
  std::printf("%-14s %10s %10s %10s %8s %8s %7s %6s | %7s %s\n", "scene", "samples/s", "one thread",
              "path rays", "shadow", "rays/s", "embree", "limit", "memory",
              "needed (scene + tree + tiles)   ratio");
  std::printf("%-14s %10s %10s %10s %8s %8s %7s %6s | %7s %s\n", "", "M", "M", "/sample", "/sample", "M", "%",
              "%", "MiB", "MiB");
}

void PrintLine(const std::string& name, const Measured& m) {
  constexpr double kMebi = 1 << 20;
  const auto per_sample = [](int64_t rays) { return static_cast<double>(rays) / kAllSamples; };
  const auto mebi = [](int64_t bytes) { return static_cast<double>(bytes) / kMebi; };
  const int64_t needed = m.scene_bytes + m.embree_bytes + m.tile_bytes;
  std::printf(
      "%-14s %10.3f %10.3f %10.2f %8.2f %8.2f %7.1f %6.1f | %7.1f %6.1f (%5.1f + %5.1f + %4.1f) %7.2f\n",
      name.c_str(), kAllSamples / m.render.wall_seconds / 1e6, kAllSamples / m.render.cpu_seconds / 1e6,
      per_sample(m.extension_rays), per_sample(m.shadow_rays),
      static_cast<double>(m.extension_rays + m.shadow_rays) / m.render.wall_seconds / 1e6,
      100 * m.share_inside, 100 * m.replay.cpu_seconds / m.render.cpu_seconds, mebi(m.gained_bytes),
      mebi(needed), mebi(m.scene_bytes), mebi(m.embree_bytes), mebi(m.tile_bytes),
      mebi(m.gained_bytes) / mebi(needed));
}

/// The path of the scene's file; generated scenes are written to `folder`. Empty, with a message, if there is
/// none.
std::string PathOf(const std::string& name, const TempFolder& folder) {
  if (scenes::FindScene(name) != nullptr) return folder.PathOf(name + ".glb");
  if (name != "staircase") return name;
  const char* real_scenes = std::getenv("LUMIFOLD_SCENES_DIR");
  if (real_scenes != nullptr) return absl::StrCat(real_scenes, "/staircase.glb");
  std::fprintf(stderr, "staircase: skipped, LUMIFOLD_SCENES_DIR is not set\n");
  return "";
}

bool Generate(const scenes::SceneEntry& entry, const std::string& path) {
  const absl::StatusOr<std::string> glb = scenes::EncodeGlb(entry.build());
  return glb.ok() && scenes::WriteFile(path, *glb).ok();
}

/// Runs `work` in a process of its own, so that memory is measured from zero; returns whether it succeeded.
bool InChild(const std::function<bool()>& work) {
  std::fflush(stdout);
  const pid_t child = fork();
  if (child == 0) {
    const bool ok = work();
    std::fflush(stdout);
    _exit(ok ? EXIT_SUCCESS : EXIT_FAILURE);
  }
  int status = 0;
  LUMIFOLD_CHECK(child > 0 && waitpid(child, &status, 0) == child);
  return WIFEXITED(status) && WEXITSTATUS(status) == EXIT_SUCCESS;
}

bool MeasureAndPrint(const std::string& path) {
  const absl::StatusOr<Measured> measured = Measure(path);
  if (!measured.ok()) {
    std::fprintf(stderr, "%s\n", std::string(measured.status().message()).c_str());
    return false;
  }
  PrintLine(std::filesystem::path(path).stem().string(), *measured);
  return true;
}

int Main(std::vector<std::string> names) {
  if (names.empty()) names = {"cornell-box", "meeting-room", "atrium", "staircase"};
  const TempFolder folder;
  PrintHead();
  bool ok = true;
  for (const std::string& name : names) {
    const std::string path = PathOf(name, folder);
    if (path.empty()) continue;
    const scenes::SceneEntry* entry = scenes::FindScene(name);
    if (entry != nullptr) LUMIFOLD_CHECK(InChild([&] { return Generate(*entry, path); }));
    ok &= InChild([&] { return MeasureAndPrint(path); });
  }
  return ok ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace
}  // namespace lumifold::bench

int main(int argc, char** argv) {
  return lumifold::bench::Main(std::vector<std::string>(argv + 1, argv + argc));
}
