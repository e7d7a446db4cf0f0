#include "server/filtered_rounds.h"

#include <algorithm>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/planes.h"
#include "filter/methods.h"
#include "lumifold/v1/rounds.pb.h"
#include "proto/rpc/checked_file.h"
#include "server/film/unit_film.h"

namespace lumifold::server {
namespace {

constexpr rpc::CheckedFileType kPictureFile = {"LFP1", "the picture of a round", int64_t{1} << 30};

metrics::FilteredFilm ViewOf(const FilteredRound& round) {
  return {round.film.pixels, {round.picture[0].view(), round.picture[1].view(), round.picture[2].view()}};
}

}  // namespace

absl::StatusOr<FilteredRound> FilteredRounds::Get(int round) const {
  absl::StatusOr<film::UnitFilm> film =
      film::UnitFilm::Open(job_.spec, frame_, &units_, pool_, {&rounds_, round + 1});
  if (!film.ok()) return film.status();
  absl::StatusOr<EdgedImage> read = film->Read({0, 0, film->width(), film->height()});
  if (!read.ok()) return read.status();
  absl::StatusOr<std::array<Plane, 3>> picture = ReadKept(round);
  if (!picture.ok())
    picture =
        filter::FilterFilm(read->pixels, job_.spec.filter().method(), pool_, &read->edges, &read->fragments);
  if (!picture.ok()) return picture.status();
  return FilteredRound{*std::move(read), *std::move(picture)};
}

absl::StatusOr<std::array<Plane, 3>> FilteredRounds::ReadKept(int round) const {
  const absl::StatusOr<std::string> bytes =
      rpc::ReadCheckedFile(folder_.RoundPicturePath(job_.id, frame_), kPictureFile);
  if (!bytes.ok()) return bytes.status();
  v1::RoundPicture kept;
  const int width = job_.spec.width();
  const int height = job_.spec.height();
  if (!kept.ParseFromString(*bytes) || kept.round() != round ||
      kept.values_size() != int64_t{3} * width * height)
    return absl::NotFoundError("another round is kept");
  std::array<Plane, 3> picture;
  const float* values = kept.values().data();
  for (Plane& plane : picture) {
    plane = Plane::Uninitialized(width, height);
    for (int y = 0; y < height; ++y, values += width) std::copy_n(values, width, plane.view().Row(y));
  }
  return picture;
}

absl::Status FilteredRounds::Keep(int round, const FilteredRound& filtered) const {
  v1::RoundPicture kept;
  kept.set_round(round);
  kept.mutable_values()->Reserve(3 * job_.spec.width() * job_.spec.height());
  for (const Plane& plane : filtered.picture) {
    for (int y = 0; y < plane.height(); ++y)
      kept.mutable_values()->Add(plane.view().Row(y), plane.view().Row(y) + plane.width());
  }
  return rpc::WriteCheckedFile(folder_.RoundPicturePath(job_.id, frame_), kPictureFile,
                               kept.SerializeAsString(), folder_.files());
}

metrics::ErrorEstimate FilteredRounds::Compare(const FilteredRound& earlier,
                                               const FilteredRound& later) const {
  const auto metric = job_.spec.adaptive().metric() == v1::ERROR_METRIC_REL_MSE
                          ? metrics::ErrorMetric::kRelMse
                          : metrics::ErrorMetric::kMse255;
  return metrics::EstimateError(ViewOf(earlier), ViewOf(later), kSampleBlock, metric, pool_);
}

}  // namespace lumifold::server
