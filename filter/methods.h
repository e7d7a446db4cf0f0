#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/baselines/method_info.h"
#include "filter/blocks.h"
#include "filter/image/film_source.h"
#include "filter/image/filtered_picture.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// All methods that filter a film, in the order help lists them: "default", "none", then the baselines
/// of filter/baselines.
const std::vector<MethodInfo>& Methods();

/// Whether FilterFilm knows the method.
/// Errors: kInvalidArgument naming the method and those there are, or the parameter that is wrong.
absl::Status CheckMethod(std::string_view method);

/// Filters a film. The picture C is a sum of products of light and throughput, of emission, and of a
/// remainder: C = (D + I) T + G S + the products of every level of reflection and transmission + E + E of the
/// levels + remainder. Each factor of light is filtered on its own, and so is the remainder, which is C minus
/// all other terms: light beyond the last level, and what the product of means differs from the mean of
/// products. Terms that the film has no channels of stay in the remainder. Throughput (T, S) and emission are
/// not filtered, except for their antialiasing on edges.
/// Shapes:  film: W x H means, with the channels of filter/image/layers.h: noisy, direct and indirect with
///          their halves (*_a, *_b), albedo, emission, N.X N.Y N.Z, distance.Z, mask.Y, samples_a.Y,
///          samples_b.Y. Glossy light and levels are optional. Result: W x H, R G B.
/// Units:   linear scene-referred radiance; metres.
/// Edges:   clamped. A frame of more than 1536 x 1536 pixels, or longer than 4096, is filtered in fixed
///          blocks that overlap, see BlockParams.
/// `method`: the name of one of Methods(). Its parameters may follow, as in
/// "bilateral:sigma_s=4,sigma_r=0.1". `edges`, `fragments`: the film's edge set and fragments, see
/// EdgedImage; null or without channels if the film has none. `progress`: empty, or is told the share of the
/// blocks, and within one of its layers.
/// Errors:  kInvalidArgument naming a channel that is missing; those of CheckMethod.
/// Threads: safe concurrently; the result is identical for any pool, null included.
/// Source:  Gruzdev, Frolov & Ignatenko 2015. Methods() names the source of each
///          baseline.
absl::StatusOr<Picture> FilterFilm(const LayeredImage& film, std::string_view method, TaskPool* pool,
                                   const LayeredImage* edges = nullptr,
                                   const LayeredImage* fragments = nullptr,
                                   const FilterProgress& progress = nullptr);

/// What a filtered picture is for.
enum class FilterPurpose {
  kPicture,   // to be shown: the bits of FilterFilm
  kEstimate,  // to estimate where it errs: see DenoiseToEstimate
};

/// FilterFilm with the deviation of the picture, by methods that know it.
/// Errors:  also those of CheckDeviation; kInvalidArgument naming a half of C that is missing.
absl::StatusOr<FilteredPicture> FilterFilmWithDeviation(const LayeredImage& film, std::string_view method,
                                                        TaskPool* pool, const LayeredImage* edges = nullptr,
                                                        const LayeredImage* fragments = nullptr,
                                                        FilterPurpose purpose = FilterPurpose::kPicture,
                                                        const BlockParams& params = {},
                                                        const FilterProgress& progress = nullptr);

/// Whether FilterFilmWithDeviation knows the method: "default", whose halves go to the end, and "none".
/// Errors: those of CheckMethod; kInvalidArgument naming the methods that know it.
absl::Status CheckDeviation(std::string_view method);

/// FilterFilm for a film that need not be in memory as a whole. The picture's rows go to `sink` from the top
/// down, as R G B and the film's channels named in `passed_on`. The bits are those of FilterFilm, also where
/// blocks are `ready`, each with one picture: FilterFilm of its Input(), cut to its Output().
/// Errors:  those of FilterFilm and FilterInBlocks.
absl::Status FilterFilmInRows(FilmSource* film, std::string_view method,
                              const std::vector<std::string>& passed_on, TaskPool* pool, const RowSink& sink,
                              const BlockParams& params = {}, const ReadyBlocks& ready = nullptr,
                              const FilterProgress& progress = nullptr);

/// FilterFilmInRows with its rows put together.
absl::StatusOr<Picture> FilterFilmByRows(FilmSource* film, std::string_view method, TaskPool* pool,
                                         const BlockParams& params = {},
                                         const FilterProgress& progress = nullptr);

}  // namespace lumifold::filter
