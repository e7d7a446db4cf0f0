#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"

namespace lumifold {

/// The names of a film's layers in the files of some renderer. A role is the sum of any number of layers of
/// the file; of those called `combined` the first that there is counts. "" is the layer of plain R, G and
/// B. Colours are in channels LAYER.R LAYER.G LAYER.B; normals in .X .Y .Z (or .R .G .B); depth in the one
/// channel LAYER.Z, .V, .Y or .R.
struct FilmLayout {
  enum Role {
    kCombined,
    kDirect,
    kIndirect,
    kAlbedo,
    kEmission,
    kNormal,
    kDepth,
    kGlossy,
    kGlossyAlbedo,
    kTransmitted,
    kTransmittance,
    kRoles
  };

  std::array<std::vector<std::string>, kRoles> sources;
  /// Direct and indirect light have the albedo in them: they are divided by it.
  bool lit_albedo = false;
};

/// Reads a layout's text: lines of "ROLE = LAYER" or "ROLE = LAYER + LAYER"; # starts a comment. The roles
/// are combined, direct, indirect, albedo, emission, normal, depth, glossy with its factor glossy_albedo, and
/// transmitted with its factor transmittance.
/// Errors: kInvalidArgument naming `name`, the line and the problem: an unknown role, a role given twice, no
///         `combined`.
absl::StatusOr<FilmLayout> ParseFilmLayout(const std::string& name, const std::string& text);

/// The built-in layouts: "lumifold" for our own pictures; "cycles", "arnold" and "vray" for the passes of
/// these renderers; "plain" for a picture of R, G and B, with an albedo, normals and depth if it has them
/// by one of their usual names. Null for any other name.
const FilmLayout* FindFilmLayout(std::string_view name);

/// The name of the first built-in layout whose most important layers the file has: those of our own, of a
/// renderer, or a colour.
/// Error: kInvalidArgument naming `name` where nothing in the file looks like a picture.
absl::StatusOr<std::string> GuessFilmLayout(const std::string& name, const LayeredImage& file);

/// A film made from a file of another renderer, and notes for its user.
struct ForeignFilm {
  LayeredImage film;
  std::vector<std::string> notes;  // one line for each role without a layer in the file: the consequence
};

/// Makes a film of a renderer's picture. The combined layer may be prefixed with the name of a view layer
/// ("ViewLayer.Combined.R"); the same prefix then applies to all other layers.
/// Shapes:  result: the file's size; channels noisy, direct, indirect, albedo, emission, N.X N.Y N.Z,
///          distance.Z, mask.Y, A; glossy with glossy_albedo and transmitted with transmittance if the file
///          has both of the pair. Other roles without a layer are 0 (depth: 1). Light without a layer stays
///          in the remainder, which is C minus all layers.
/// Units:   a depth that is not finite, negative, or at least 1e10 is sky; mask.Y is 1 where the albedo is
///          not 0.
/// Errors:  kInvalidArgument naming `name` if there is no combined layer, or a layer lacks a channel.
/// Threads: pure.
absl::StatusOr<ForeignFilm> ReadForeignFilm(const std::string& name, const LayeredImage& file,
                                            const FilmLayout& layout);

/// The film whose two independent halves, of equal sample counts, are `a` and `b`. Colours become the mean of
/// both and are kept as halves (*_a, *_b, samples_a.Y, samples_b.Y): the albedo of a half goes with its
/// light. All other channels become the mean. A layer that only one of them has is dropped, and its light
/// stays in the remainder.
/// Errors: kInvalidArgument if they differ in size.
absl::StatusOr<LayeredImage> JoinHalves(const LayeredImage& a, const LayeredImage& b);

}  // namespace lumifold
