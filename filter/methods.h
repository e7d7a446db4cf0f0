#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/blocks.h"
#include "filter/image/film_source.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"

namespace lumifold::filter {

/// A way to turn a film into a picture, as `--filter NAME` takes it.
struct Method {
  std::string name;
  std::string summary;  // one line for --help
};

/// All methods, in the order help lists them: "default", "paper", "none", then the baselines of
/// filter/baselines.
const std::vector<Method>& Methods();

/// Whether FilterFilm knows the method. Errors: kInvalidArgument naming the method and those there are, or
/// the parameter that is wrong.
absl::Status CheckMethod(std::string_view method);

/// Filters a film: F = (D + I) * T + remainder + E with the noise of D, I and the remainder taken out. The
/// remainder is C - (D + I) T - E: R, and what the split of a pixel's mean loses.
/// Shapes:  film: W x H means, with the channels of filter/image/layers.h: noisy, direct and indirect with
///          their halves (*_a, *_b), albedo, emission, N.X N.Y N.Z, distance.Z, mask.Y, samples_a.Y,
///          samples_b.Y. Result: W x H, R G B.
/// Units:   linear scene-referred radiance; metres.
/// Edges:   clamped. A frame of more than 1536 x 1536 pixels is filtered in fixed blocks that overlap, see
///          BlockParams.
/// `method`: the name of one of Methods(); a baseline's may go on with its parameters, as in
/// "bilateral:sigma_s=4,sigma_r=0.1".
/// `edges`: the film's edge set, see EdgedImage; null or without channels where there is none.
/// Errors:  kInvalidArgument naming a channel that is missing; those of CheckMethod.
/// Threads: safe concurrently; the result is identical for any pool, null included.
/// Source:  Gruzdev, Frolov & Ignatenko 2015; oracle: manifold_slow.cc. Each baseline names its own.
absl::StatusOr<std::array<Plane, 3>> FilterFilm(const LayeredImage& film, std::string_view method,
                                                TaskPool* pool, const LayeredImage* edges = nullptr);

/// FilterFilm for a film that need not be in memory whole: gives the picture's rows to `sink` from the top
/// down, as R G B and the film's channels named in `passed_on`. The same bits as FilterFilm's. Errors:  those
/// of FilterFilm and FilterInBlocks.
absl::Status FilterFilmInRows(FilmSource* film, std::string_view method,
                              const std::vector<std::string>& passed_on, TaskPool* pool, const RowSink& sink,
                              const BlockParams& params = {});

}  // namespace lumifold::filter
