#include "filter/image/film_layout.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"

namespace lumifold {
namespace {

using Role = FilmLayout::Role;

constexpr std::array<const char*, FilmLayout::kRoles> kRoleNames = {
    "combined", "direct", "indirect",      "albedo",      "emission",     "normal",
    "depth",    "glossy", "glossy_albedo", "transmitted", "transmittance"};

/// Colour roles besides the picture, and the layers of a film that they become.
constexpr std::array<std::pair<Role, std::string_view>, 4> kColorRoles = {{
    {FilmLayout::kDirect, layers::kDirect},
    {FilmLayout::kIndirect, layers::kIndirect},
    {FilmLayout::kAlbedo, layers::kAlbedo},
    {FilmLayout::kEmission, layers::kEmission},
}};

/// Roles that count only in pairs of light and factor.
struct RolePair {
  Role light;
  Role factor;
  layers::LobeLayer layer;
};
constexpr std::array<RolePair, 2> kLobeRoles = {
    {{FilmLayout::kGlossy, FilmLayout::kGlossyAlbedo, layers::kLobeLayers[0]},
     {FilmLayout::kTransmitted, FilmLayout::kTransmittance, layers::kLobeLayers[1]}}};

/// Blender writes 1e10 where a ray leaves the scene.
constexpr float kSkyDepth = 1e10f;

const char* WhatFollows(Role role) {
  switch (role) {
    case FilmLayout::kNormal:
      return "edges between surfaces at equal depth are not guarded";
    case FilmLayout::kDepth:
      return "edges between parallel surfaces are not guarded";
    case FilmLayout::kAlbedo:
      return "textures are filtered with the light on them";
    default:
      return "it is filtered as part of the remainder";
  }
}

std::optional<Role> FindRole(const std::string& name) {
  const auto found = std::find(kRoleNames.begin(), kRoleNames.end(), name);
  if (found == kRoleNames.end()) return std::nullopt;
  return static_cast<Role>(found - kRoleNames.begin());
}

absl::Status ParseLine(const std::string& line, FilmLayout* layout) {
  const std::vector<std::string> sides = absl::StrSplit(line, absl::MaxSplits('=', 1));
  if (sides.size() != 2) return absl::InvalidArgumentError("expected ROLE = LAYER");
  const std::string name(absl::StripAsciiWhitespace(sides[0]));
  const std::optional<Role> role = FindRole(name);
  if (!role.has_value()) return absl::InvalidArgumentError(absl::StrCat("no role is named '", name, "'"));
  std::vector<std::string>& sources = layout->sources[*role];
  if (!sources.empty()) return absl::InvalidArgumentError(absl::StrCat(name, " is given twice"));
  for (const absl::string_view source : absl::StrSplit(sides[1], '+')) {
    sources.emplace_back(absl::StripAsciiWhitespace(source));
    if (sources.back().empty()) return absl::InvalidArgumentError("a layer's name is missing");
  }
  return absl::OkStatus();
}

/// The prefix of `layer` in the file's channels: "" or a view layer's name with its dot. The first in the
/// file's order. The layer without a name has no prefix.
std::optional<std::string> FindPrefix(const LayeredImage& file, const std::string& layer) {
  const std::string channel = layers::ColorChannels(layer)[0];
  if (file.Has(channel)) return "";
  if (layer.empty()) return std::nullopt;
  for (const LayeredImage::Channel& candidate : file.channels()) {
    if (absl::EndsWith(candidate.name, absl::StrCat(".", channel)))
      return candidate.name.substr(0, candidate.name.size() - channel.size());
  }
  return std::nullopt;
}

/// The first of the layers that a layout calls the picture that the file has, and its prefix.
std::optional<std::pair<std::string, std::string>> FindCombined(const LayeredImage& file,
                                                                const FilmLayout& layout) {
  for (const std::string& layer : layout.sources[FilmLayout::kCombined]) {
    if (const auto prefix = FindPrefix(file, layer)) return std::pair(layer, *prefix);
  }
  return std::nullopt;
}

using NamedLayouts = std::vector<std::pair<std::string, FilmLayout>>;

FilmLayout LumifoldLayout() {
  const auto layer = [](std::string_view name) { return std::vector{std::string(name)}; };
  return {{{layer(layers::kNoisy),
            layer(layers::kDirect),
            layer(layers::kIndirect),
            layer(layers::kAlbedo),
            layer(layers::kEmission),
            {"N"},
            {"distance"},
            layer(layers::kGlossy),
            layer(layers::kGlossyAlbedo),
            {},
            {}}}};
}

/// Names of Blender until 4.5, and those since 5.0: a file has one or the other.
FilmLayout CyclesLayout() {
  return {{{{"Combined"},
            {"DiffDir", "Diffuse Direct"},
            {"DiffInd", "Diffuse Indirect"},
            {"DiffCol", "Diffuse Color"},
            {"Emit", "Env", "Emission", "Environment"},
            {"Normal"},
            {"Depth"},
            {"GlossDir", "GlossInd", "Glossy Direct", "Glossy Indirect"},
            {"GlossCol", "Glossy Color"},
            {"TransDir", "TransInd", "Transmission Direct", "Transmission Indirect"},
            {"TransCol", "Transmission Color"}}}};
}

/// Those of renderers come before "plain", which fits nearly every file.
NamedLayouts MakeLayouts() {
  FilmLayout arnold = {{{{"", "RGBA", "beauty"},
                         {"diffuse_direct"},
                         {"diffuse_indirect"},
                         {"diffuse_albedo"},
                         {"emission", "background"},
                         {"N"},
                         {"Z"},
                         {},
                         {},
                         {},
                         {}}}};
  arnold.lit_albedo = true;
  // V-Ray's raw passes are the light without the diffuse colour.
  FilmLayout vray = {{{{"", "rgba", "RGB_color", "effectsResult"},
                       {"rawLight", "rawLighting"},
                       {"rawGI"},
                       {"diffuse", "diffuseFilter"},
                       {"selfIllum", "background"},
                       {"normals", "Normals"},
                       {"zDepth", "Z", "Z-depth"},
                       {},
                       {},
                       {},
                       {}}}};
  FilmLayout plain = {{{{"", "rgba", "RGBA", "rgb", "RGB", "beauty", "Beauty", "C", "Ci", "color", "image"},
                        {},
                        {},
                        {"albedo", "Albedo"},
                        {},
                        {"N", "normal", "Normal", "normals", "sh_normal", "nn"},
                        {"Z", "depth", "Depth", "z", "dd"},
                        {},
                        {},
                        {},
                        {}}}};
  return {{"lumifold", LumifoldLayout()},
          {"cycles", CyclesLayout()},
          {"arnold", std::move(arnold)},
          {"vray", std::move(vray)},
          {"plain", std::move(plain)}};
}

const NamedLayouts& Layouts() {
  static const auto* const layouts = new NamedLayouts(MakeLayouts());
  return *layouts;
}

/// Whether the file has a layer of the role.
bool HasRole(const LayeredImage& file, const FilmLayout& layout, Role role, const std::string& prefix) {
  const std::vector<std::string>& sources = layout.sources[role];
  return std::any_of(sources.begin(), sources.end(),
                     [&](const std::string& source) { return file.HasColor(prefix + source); });
}

/// A file, read by a layout.
class Reader {
 public:
  /// `combined`: the layer that is the picture.
  Reader(const LayeredImage& file, const FilmLayout& layout, std::string combined, std::string prefix)
      : file_(file), layout_(layout), combined_(std::move(combined)), prefix_(std::move(prefix)) {}

  ForeignFilm Read() {
    result_.film = LayeredImage(file_.width(), file_.height());
    AddSum({prefix_ + combined_}, layers::kNoisy);
    for (const auto& [role, layer] : kColorRoles) AddColor(role, layer);
    if (layout_.lit_albedo) DivideByAlbedo();
    for (const RolePair& pair : kLobeRoles) AddPair(pair);
    AddNormal();
    AddDistance();
    AddMask();
    AddAlpha();
    return std::move(result_);
  }

 private:
  /// The role's layers that the file has. If it has none, adds a note.
  std::vector<std::string> Present(Role role, const std::vector<std::string>& suffixes) {
    std::vector<std::string> present = Find(role, suffixes);
    if (present.empty()) Note(role);
    return present;
  }

  std::vector<std::string> Find(Role role, const std::vector<std::string>& suffixes) const {
    std::vector<std::string> present;
    for (const std::string& source : layout_.sources[role]) {
      const std::string layer = prefix_ + source;
      const bool whole = std::all_of(suffixes.begin(), suffixes.end(),
                                     [&](const std::string& suffix) { return file_.Has(layer + suffix); });
      if (whole) present.push_back(layer);
    }
    return present;
  }

  void Note(Role role) {
    const std::vector<std::string>& sources = layout_.sources[role];
    const std::string looked_for =
        sources.empty() ? "the layout names no layer for it" : absl::StrCat("no layer ", prefix_, sources[0]);
    result_.notes.push_back(
        absl::StrCat("no ", kRoleNames[role], " (", looked_for, "): ", WhatFollows(role)));
  }

  void AddColor(Role role, std::string_view layer) { AddSum(Present(role, kColorSuffixes), layer); }

  /// Light without its factor cannot be multiplied back. A layout that names neither needs no note.
  void AddPair(const RolePair& pair) {
    if (layout_.sources[pair.light].empty() && layout_.sources[pair.factor].empty()) return;
    const std::vector<std::string> light = Present(pair.light, kColorSuffixes);
    const std::vector<std::string> factor = Present(pair.factor, kColorSuffixes);
    if (light.empty() || factor.empty()) return;
    AddSum(light, pair.layer.light);
    AddSum(factor, pair.layer.factor);
  }

  void AddSum(const std::vector<std::string>& sources, std::string_view layer) {
    const ColorView out = result_.film.AddColor(layer);
    for (const std::string& source : sources) {
      const ConstColorView in = file_.GetColor(source);
      for (size_t c = 0; c < 3; ++c) {
        ForEachPixel(file_.width(), file_.height(), [&](int x, int y) { out[c].At(x, y) += in[c].At(x, y); });
      }
    }
  }

  /// Where there is no albedo the light stays in the remainder.
  void DivideByAlbedo() {
    const ConstColorView albedo = std::as_const(result_.film).GetColor(layers::kAlbedo);
    for (const std::string_view layer : {layers::kDirect, layers::kIndirect}) {
      const ColorView light = result_.film.GetColor(layer);
      for (size_t c = 0; c < 3; ++c) {
        ForEachPixel(file_.width(), file_.height(), [&](int x, int y) {
          float& value = light[c].At(x, y);
          value = albedo[c].At(x, y) > 1e-3f ? value / albedo[c].At(x, y) : 0.0f;
        });
      }
    }
  }

  /// In channels X, Y, Z, or R, G, B.
  void AddNormal() {
    const std::array<std::string_view, 3> ours = {layers::kNormalX, layers::kNormalY, layers::kNormalZ};
    std::vector<std::string> suffixes = {".X", ".Y", ".Z"};
    if (Find(FilmLayout::kNormal, suffixes).empty()) suffixes = kColorSuffixes;
    const std::vector<std::string> present = Present(FilmLayout::kNormal, suffixes);
    for (size_t i = 0; i < ours.size(); ++i) {
      const FloatView out = result_.film.Add(ours[i]);
      if (!present.empty()) CopyPlane(file_.Get(absl::StrCat(present[0], suffixes[i])), out);
    }
  }

  void AddDistance() {
    const FloatView out = result_.film.Add(layers::kDistance);
    std::optional<ConstFloatView> depth;
    for (const std::string& source : layout_.sources[FilmLayout::kDepth]) {
      for (const char* suffix : {"", ".Z", ".V", ".Y", ".R"}) {
        const std::string channel = absl::StrCat(prefix_, source, suffix);
        if (!depth.has_value() && file_.Has(channel)) depth = file_.Get(channel);
      }
    }
    if (!depth.has_value()) Note(FilmLayout::kDepth);
    ForEachPixel(file_.width(), file_.height(), [&](int x, int y) {
      const float z = depth.has_value() ? depth->At(x, y) : 1.0f;
      out.At(x, y) = z > 0 && z < kSkyDepth ? z : 0.0f;
    });
  }

  void AddMask() {
    const FloatView out = result_.film.Add(layers::kMask);
    const ConstColorView albedo = std::as_const(result_.film).GetColor(layers::kAlbedo);
    ForEachPixel(file_.width(), file_.height(), [&](int x, int y) {
      const bool diffuse = albedo[0].At(x, y) > 0 || albedo[1].At(x, y) > 0 || albedo[2].At(x, y) > 0;
      out.At(x, y) = diffuse ? 1.0f : 0.0f;
    });
  }

  void AddAlpha() {
    const FloatView out = result_.film.Add(layers::kAlpha);
    const std::string channel = absl::StrCat(prefix_, combined_, combined_.empty() ? "A" : ".A");
    ForEachPixel(file_.width(), file_.height(),
                 [&](int x, int y) { out.At(x, y) = file_.Has(channel) ? file_.Get(channel).At(x, y) : 1; });
  }

  const std::vector<std::string> kColorSuffixes = {".R", ".G", ".B"};

  const LayeredImage& file_;
  const FilmLayout& layout_;
  const std::string combined_;
  const std::string prefix_;
  ForeignFilm result_;
};

/// Appends the mean of `a` and `b` under `name`.
void AddMean(std::string_view name, ConstFloatView a, ConstFloatView b, LayeredImage* film) {
  const FloatView out = film->Add(name);
  ForEachPixel(out.width(), out.height(),
               [&](int x, int y) { out.At(x, y) = 0.5f * a.At(x, y) + 0.5f * b.At(x, y); });
}

}  // namespace

absl::StatusOr<FilmLayout> ParseFilmLayout(const std::string& name, const std::string& text) {
  FilmLayout layout;
  int number = 0;
  for (const absl::string_view raw : absl::StrSplit(text, '\n')) {
    ++number;
    const std::string line(absl::StripAsciiWhitespace(raw.substr(0, raw.find('#'))));
    if (line.empty()) continue;
    const absl::Status status = ParseLine(line, &layout);
    if (!status.ok())
      return absl::InvalidArgumentError(absl::StrCat(name, ": line ", number, ": ", status.message()));
  }
  if (layout.sources[FilmLayout::kCombined].empty())
    return absl::InvalidArgumentError(absl::StrCat(name, ": says nothing of the combined layer"));
  return layout;
}

const FilmLayout* FindFilmLayout(std::string_view name) {
  for (const auto& [known, layout] : Layouts()) {
    if (known == name) return &layout;
  }
  return nullptr;
}

absl::StatusOr<std::string> GuessFilmLayout(const std::string& name, const LayeredImage& file) {
  for (const auto& [known, layout] : Layouts()) {
    const auto combined = FindCombined(file, layout);
    if (!combined.has_value()) continue;
    // Several programs call the picture R, G and B: its light says whose it is.
    const bool has_own_name = layout.sources[FilmLayout::kCombined].size() == 1;
    if (known == "plain" || has_own_name || HasRole(file, layout, FilmLayout::kDirect, combined->second))
      return known;
  }
  return absl::InvalidArgumentError(absl::StrCat(
      name, ": has no colour that looks like a picture, such as R, G and B; a layout file names its layers"));
}

absl::StatusOr<ForeignFilm> ReadForeignFilm(const std::string& name, const LayeredImage& file,
                                            const FilmLayout& layout) {
  const auto combined = FindCombined(file, layout);
  if (!combined.has_value())
    return absl::InvalidArgumentError(
        absl::StrCat(name, ": has no colour layer '", layout.sources[FilmLayout::kCombined][0], "'"));
  const auto& [layer, prefix] = *combined;
  if (!file.HasColor(prefix + layer)) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, ": the layer '", prefix, layer, "' lacks R, G or B"));
  }
  return Reader(file, layout, layer, prefix).Read();
}

absl::StatusOr<LayeredImage> JoinHalves(const LayeredImage& a, const LayeredImage& b) {
  if (a.bounds() != b.bounds()) {
    return absl::InvalidArgumentError(absl::StrCat("the halves differ in size: ", a.width(), "x", a.height(),
                                                   " and ", b.width(), "x", b.height()));
  }
  LayeredImage film(a.width(), a.height());
  for (const LayeredImage::Channel& channel : a.channels()) {
    if (b.Has(channel.name)) AddMean(channel.name, channel.plane.view(), b.Get(channel.name), &film);
  }
  std::vector<std::string_view> halved = {layers::kNoisy, layers::kDirect, layers::kIndirect, layers::kAlbedo,
                                          layers::kEmission};
  for (const layers::LobeLayer& layer : layers::kLobeLayers) {
    if (film.HasColor(layer.light)) halved.insert(halved.end(), {layer.light, layer.factor});
  }
  for (const std::string_view layer : halved) {
    const ColorView half_a = film.AddColor(layers::HalfA(layer));
    const ColorView half_b = film.AddColor(layers::HalfB(layer));
    for (size_t c = 0; c < 3; ++c) {
      CopyPlane(a.GetColor(layer)[c], half_a[c]);
      CopyPlane(b.GetColor(layer)[c], half_b[c]);
    }
  }
  for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB}) {
    Plane ones(film.width(), film.height());
    ones.Fill(1);
    film.Add(count, std::move(ones));
  }
  return film;
}

}  // namespace lumifold
