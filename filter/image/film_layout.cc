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

/// Colour roles and the layers of a film that they become.
constexpr std::array<std::pair<Role, std::string_view>, 5> kColorRoles = {{
    {FilmLayout::kCombined, layers::kNoisy},
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
/// file's order.
std::optional<std::string> FindPrefix(const LayeredImage& file, const std::string& layer) {
  const std::string channel = layers::ColorChannels(layer)[0];
  if (file.Has(channel)) return "";
  for (const LayeredImage::Channel& candidate : file.channels()) {
    if (absl::EndsWith(candidate.name, absl::StrCat(".", channel)))
      return candidate.name.substr(0, candidate.name.size() - channel.size());
  }
  return std::nullopt;
}

/// A file, read by a layout.
class Reader {
 public:
  Reader(const LayeredImage& file, const FilmLayout& layout, std::string prefix)
      : file_(file), layout_(layout), prefix_(std::move(prefix)) {}

  ForeignFilm Read() {
    result_.film = LayeredImage(file_.width(), file_.height());
    for (const auto& [role, layer] : kColorRoles) AddColor(role, layer);
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

  void AddNormal() {
    const std::array<std::string_view, 3> ours = {layers::kNormalX, layers::kNormalY, layers::kNormalZ};
    const std::vector<std::string> suffixes = {".X", ".Y", ".Z"};
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
      for (const char* suffix : {".Z", ".V", ".Y", ".R"}) {
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
    const std::string channel = absl::StrCat(prefix_, layout_.sources[FilmLayout::kCombined][0], ".A");
    ForEachPixel(file_.width(), file_.height(),
                 [&](int x, int y) { out.At(x, y) = file_.Has(channel) ? file_.Get(channel).At(x, y) : 1; });
  }

  const std::vector<std::string> kColorSuffixes = {".R", ".G", ".B"};

  const LayeredImage& file_;
  const FilmLayout& layout_;
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
  // Names of Blender until 4.5, and those since 5.0: a file has one or the other.
  static const FilmLayout* const cycles =
      new FilmLayout{{{{"Combined"},
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
  static const FilmLayout* const lumifold = new FilmLayout{{{{std::string(layers::kNoisy)},
                                                             {std::string(layers::kDirect)},
                                                             {std::string(layers::kIndirect)},
                                                             {std::string(layers::kAlbedo)},
                                                             {std::string(layers::kEmission)},
                                                             {"N"},
                                                             {"distance"},
                                                             {std::string(layers::kGlossy)},
                                                             {std::string(layers::kGlossyAlbedo)},
                                                             {},
                                                             {}}}};
  if (name == "cycles") return cycles;
  return name == "lumifold" ? lumifold : nullptr;
}

absl::StatusOr<ForeignFilm> ReadForeignFilm(const std::string& name, const LayeredImage& file,
                                            const FilmLayout& layout) {
  const std::string& combined = layout.sources[FilmLayout::kCombined][0];
  const std::optional<std::string> prefix = FindPrefix(file, combined);
  if (!prefix.has_value())
    return absl::InvalidArgumentError(absl::StrCat(name, ": has no colour layer '", combined, "'"));
  if (!file.HasColor(*prefix + combined)) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, ": the layer '", *prefix, combined, "' lacks R, G or B"));
  }
  return Reader(file, layout, *prefix).Read();
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
  std::vector<std::string_view> halved = {layers::kNoisy, layers::kDirect, layers::kIndirect};
  for (const layers::LobeLayer& layer : layers::kLobeLayers) {
    if (film.HasColor(layer.light)) halved.push_back(layer.light);
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
