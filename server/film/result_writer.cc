#include "server/film/result_writer.h"

#include <algorithm>
#include <array>
#include <optional>
#include <utility>

#include "filter/image/layers.h"

namespace lumifold::film {

namespace {

std::optional<std::array<float, 16>> MatrixOf(const google::protobuf::RepeatedField<float>& values) {
  std::array<float, 16> matrix = {};
  if (values.size() != static_cast<int>(matrix.size())) return std::nullopt;
  std::copy(values.begin(), values.end(), matrix.begin());
  return matrix;
}

absl::StatusOr<ExrLists> ListsOf(const UnitFilm& film) {
  const absl::StatusOr<int64_t> fragments = film.CountFragments();
  if (!fragments.ok()) return fragments.status();
  return ExrLists{{kSubSamples, static_cast<int>(film.edge_rows()), layers::EdgeChannels(), {}},
                  {1, static_cast<int>(*fragments), film.FragmentChannels(), {}}};
}

}  // namespace

ResultWriter::ResultWriter(ExrRowWriter file, ResultInfo info)
    : file_(std::move(file)), info_(std::move(info)) {}

absl::StatusOr<ResultWriter> ResultWriter::Create(const std::string& path, const UnitFilm& film,
                                                  ResultInfo info, FileSystem* files) {
  ExrLayout picture = ExrLayoutOf(BuildResult({film.Outline()}, {}, info).pixels);
  picture.width = film.width();
  picture.height = film.height();
  if (info.spec.has_crop()) {
    const v1::Crop& crop = info.spec.crop();
    picture.frame = {crop.frame_width(), crop.frame_height(), crop.x(), crop.y()};
  }
  const v1::CameraMatrices& camera = info.facts.camera();
  picture.standard.world_to_camera = MatrixOf(camera.world_to_camera());
  picture.standard.world_to_ndc = MatrixOf(camera.world_to_ndc());
  picture.standard.is_rec709 = true;
  picture.standard.exposure_seconds = 0;  // a frame shows one moment
  picture.standard.frames_per_second = info.spec.frames_per_second();
  const absl::StatusOr<ExrLists> lists = info.spec.save_film() ? ListsOf(film) : ExrLists();
  if (!lists.ok()) return lists.status();
  absl::StatusOr<ExrRowWriter> file = ExrRowWriter::Create(path, picture, *lists, files);
  if (!file.ok()) return file.status();
  return ResultWriter(*std::move(file), std::move(info));
}

absl::Status ResultWriter::Append(EdgedImage part, std::array<Plane, 3> filtered) {
  EdgedImage rows = BuildResult(std::move(part), std::move(filtered), info_);
  if (absl::Status status = file_.Append(rows.pixels); !status.ok()) return status;
  MovePlaces(0, rows_, &rows.edges);
  MovePlaces(0, rows_, &rows.fragments);
  rows_ += rows.pixels.height();
  if (absl::Status status = file_.AppendEdges(rows.edges); !status.ok()) return status;
  return file_.AppendFragments(rows.fragments);
}

}  // namespace lumifold::film
