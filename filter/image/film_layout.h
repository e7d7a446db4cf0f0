#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"

namespace lumifold {

/// What a film's layers are called in the files of some renderer. A role may be the sum of several layers of
/// the file, or of none. Colours are in channels LAYER.R LAYER.G LAYER.B; normals in .X .Y .Z (or .R .G .B);
/// depth in the one channel LAYER.Z, .V, .Y or .R.
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
};

/// Reads a layout's text. Roles are combined, direct, indirect, albedo, emission, normal, depth, glossy and
/// its factor glossy_albedo, transmitted and its factor transmittance; lines are "ROLE = LAYER" or "ROLE =
/// LAYER + LAYER"; what follows a # is a comment. Errors: kInvalidArgument naming `name`, the line and what
/// is wrong with it: an unknown role, a role given twice, no `combined`.
absl::StatusOr<FilmLayout> ParseFilmLayout(const std::string& name, const std::string& text);

/// The layouts that have a name: "lumifold", our own pictures, and "cycles", the passes of Blender's Cycles
/// in a multi-layer OpenEXR file. Null for any other name.
const FilmLayout* FindFilmLayout(std::string_view name);

/// A film made from a file, and what its user should know of it.
struct ForeignFilm {
  LayeredImage film;
  std::vector<std::string> notes;  // a line for each role the file has nothing for, with what follows from it
};

/// Makes a film of a renderer's picture. The combined layer may have any view layer's name before it
/// ("ViewLayer.Combined.R"); all others are then looked for behind the same prefix.
/// Shapes:  result: the file's size; channels noisy, direct, indirect, albedo, emission, N.X N.Y N.Z,
///          distance.Z, mask.Y, A, and glossy with glossy_albedo, transmitted with transmittance where the
///          file has both of a pair. Other roles without a layer are 0 (depth: 1). What is not there stays in
///          the remainder, C without all layers.
/// Edges:   a depth that is not finite, negative or 1e10 and more is sky; mask.Y is 1 where the albedo is not
/// 0. Errors:  kInvalidArgument naming `name` where there is no combined layer, or a layer lacks a channel.
/// Threads: pure.
absl::StatusOr<ForeignFilm> ReadForeignFilm(const std::string& name, const LayeredImage& file,
                                            const FilmLayout& layout);

/// The film of which `a` and `b` are the two independent halves, of equal sample counts: noisy, direct and
/// indirect, glossy and transmitted as the mean of both, and as halves (*_a, *_b, samples_a.Y, samples_b.Y);
/// all else as the mean. What only one of them has is left out, and stays in the remainder. Errors:
/// kInvalidArgument where they differ in size.
absl::StatusOr<LayeredImage> JoinHalves(const LayeredImage& a, const LayeredImage& b);

}  // namespace lumifold
