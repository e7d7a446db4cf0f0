#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/json_line.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "filter/image/exr_film.h"
#include "filter/image/film_layout.h"

namespace lumifold::client {
namespace {

using Json = nlohmann::ordered_json;

/// "0 'front', 1 'top'" for people.
std::string Numbered(const std::vector<std::string>& names) {
  std::vector<std::string> items;
  for (const std::string& name : names) items.push_back(absl::StrCat(items.size(), " '", name, "'"));
  return items.empty() ? "none" : absl::StrJoin(items, ", ");
}

std::string Line(const char* name, const std::string& text) {
  return absl::StrFormat("%-11s %s\n", name, text);
}

std::string SceneTable(const SceneFacts& facts) {
  std::string animations = Numbered(facts.animations);
  if (!facts.animations.empty()) absl::StrAppendFormat(&animations, ", %g s", facts.animation_seconds);
  std::string table = absl::StrCat(
      Line("cameras",
           facts.cameras.empty() ? "none: one that sees everything is used" : Numbered(facts.cameras)),
      Line("animations", animations), Line("variants", Numbered(facts.variants)),
      Line("lights", facts.lights.empty() ? "none" : absl::StrJoin(facts.lights, ", ")),
      Line("geometry", absl::StrCat(facts.triangles, " triangles in ", facts.instances, " instances")),
      Line("materials", absl::StrCat(facts.materials)),
      Line("textures", absl::StrFormat("%d of %.1f megapixels", facts.textures,
                                       static_cast<double>(facts.texture_pixels) / 1e6)),
      Line("extensions", facts.extensions.empty() ? "none" : absl::StrJoin(facts.extensions, ", ")),
      Line("memory", absl::StrFormat("about %.0f MiB", static_cast<double>(facts.memory_bytes) / (1 << 20))));
  for (const std::string& warning : facts.warnings) absl::StrAppend(&table, "warning: ", warning, "\n");
  return table;
}

Json SceneJson(const SceneFacts& facts) {
  return {{"cameras", facts.cameras},
          {"animations", facts.animations},
          {"animation_seconds", facts.animation_seconds},
          {"variants", facts.variants},
          {"lights", facts.lights},
          {"triangles", facts.triangles},
          {"instances", facts.instances},
          {"materials", facts.materials},
          {"textures", facts.textures},
          {"texture_pixels", facts.texture_pixels},
          {"extensions", facts.extensions},
          {"memory_bytes", facts.memory_bytes},
          {"warnings", facts.warnings}};
}

/// The channels of each layer, "" for those without one.
std::map<std::string, std::vector<std::string>> LayersOf(const LayeredImage& outline) {
  std::map<std::string, std::vector<std::string>> layers;
  for (const LayeredImage::Channel& channel : outline.channels()) {
    const size_t dot = channel.name.rfind('.');
    const std::string layer = dot == std::string::npos ? "" : channel.name.substr(0, dot);
    layers[layer].push_back(dot == std::string::npos ? channel.name : channel.name.substr(dot + 1));
  }
  return layers;
}

ExitCode PictureInfo(const std::string& path, bool json, const Environment& environment) {
  const absl::StatusOr<std::unique_ptr<ExrFilm>> film = ExrFilm::Open(path, ".");
  if (!film.ok()) return ReportError(environment, film.status());
  const LayeredImage outline = (*film)->Outline();
  const absl::StatusOr<std::string> layout = GuessFilmLayout(path, outline);
  const std::string size = absl::StrCat((*film)->width(), "x", (*film)->height());
  if (json) {
    Json layers = Json::object();
    for (const auto& [layer, channels] : LayersOf(outline)) layers[layer] = channels;
    environment.out << JsonLine({{"width", (*film)->width()},
                                 {"height", (*film)->height()},
                                 {"layout", layout.ok() ? *layout : ""},
                                 {"layers", std::move(layers)},
                                 {"metadata", outline.metadata()}})
                    << "\n"
                    << std::flush;
    return ExitCode::kOk;
  }
  environment.out << Line("size", size) << Line("layout", layout.ok() ? *layout : "not known");
  for (const auto& [layer, channels] : LayersOf(outline))
    environment.out << Line(
        "layer", absl::StrCat(layer.empty() ? "(picture)" : layer, ": ", absl::StrJoin(channels, " ")));
  for (const auto& [name, value] : outline.metadata())
    environment.out << Line("attribute", absl::StrCat(name, ": ", value));
  environment.out << std::flush;
  return ExitCode::kOk;
}

}  // namespace

ExitCode RunInfo(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string file;
  bool json = false;
  CommandLine command_line(WordsOf("info"));
  command_line.AddArgument("FILE", &file, "A scene, .gltf or .glb, or an OpenEXR picture");
  AddJson(command_line, &json);
  command_line.SetFooter(
      "Of a scene: cameras, animations and variants by number and name, lights, sizes, extensions, and the "
      "memory\n"
      "that a worker takes for it. Of a picture: its layers, and the layout by which 'filter' reads it.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (absl::EndsWithIgnoreCase(file, ".exr")) return PictureInfo(file, json, environment);
  if (!environment.local.scene_reader)
    return ReportError(environment, absl::UnimplementedError("this build has no worker, which reads scenes"));
  const absl::StatusOr<SceneFacts> facts = environment.local.scene_reader(file);
  if (!facts.ok()) return ReportError(environment, facts.status());
  environment.out << (json ? JsonLine(SceneJson(*facts)) + "\n" : SceneTable(*facts)) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
