#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "tests/scenes/glb_writer.h"
#include "tests/scenes/scenes.h"

namespace lumifold::scenes {
namespace {

// Exit codes; 0 is success.
constexpr int kFailure = 1;
constexpr int kUsageError = 2;

void ListScenes() {
  for (const SceneEntry& scene : AllScenes()) {
    std::printf("%-14s%s\n", std::string(scene.name).c_str(), std::string(scene.summary).c_str());
  }
}

/// Writes one scene and prints its path on stdout.
absl::Status Generate(const SceneEntry& entry, const std::filesystem::path& folder) {
  const SceneDescription scene = entry.build();
  const absl::StatusOr<std::string> bytes = EncodeGlb(scene);
  if (!bytes.ok()) return bytes.status();
  const std::string path = (folder / (std::string(entry.name) + ".glb")).string();
  if (absl::Status status = WriteFile(path, *bytes); !status.ok()) return status;
  std::printf("%s\n", path.c_str());
  return absl::OkStatus();
}

absl::Status GenerateAll(const std::vector<std::string>& names, const std::string& folder) {
  std::vector<const SceneEntry*> chosen;
  for (const std::string& name : names) {
    const SceneEntry* entry = FindScene(name);
    if (entry == nullptr)
      return absl::NotFoundError(absl::StrCat("no scene is named ", name, "; see --list"));
    chosen.push_back(entry);
  }
  if (names.empty()) {
    for (const SceneEntry& entry : AllScenes()) chosen.push_back(&entry);
  }
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return absl::UnavailableError(absl::StrCat(folder, ": ", error.message()));
  for (const SceneEntry* entry : chosen) {
    if (absl::Status status = Generate(*entry, folder); !status.ok()) return status;
  }
  return absl::OkStatus();
}

int Main(int argc, char** argv) {
  CLI::App app(
      "Writes Lumifold's test scenes as .glb files and prints their paths.\n"
      "Exit codes: 0 done, 1 cannot write, 2 wrong usage.",
      "lumifold-scenes");
  std::string folder;
  std::vector<std::string> names;
  bool list = false;
  CLI::Option* out =
      app.add_option("--out", folder, "the folder to write into; made if missing")->type_name("DIR");
  app.add_option("NAME", names, "which scenes; all of them by default");
  app.add_flag("--list", list, "print the scenes' names and what they show");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kUsageError;  // CLI11 also handles --help this way
  }
  if (list) {
    ListScenes();
    return 0;
  }
  if (out->empty()) {
    std::fprintf(stderr, "lumifold-scenes: --out DIR is missing\n");
    return kUsageError;
  }
  if (const absl::Status status = GenerateAll(names, folder); !status.ok()) {
    std::fprintf(stderr, "lumifold-scenes: %s\n", std::string(status.message()).c_str());
    return status.code() == absl::StatusCode::kNotFound ? kUsageError : kFailure;
  }
  return 0;
}

}  // namespace
}  // namespace lumifold::scenes

int main(int argc, char** argv) { return lumifold::scenes::Main(argc, argv); }
