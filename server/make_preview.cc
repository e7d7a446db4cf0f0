#include "server/make_preview.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <numeric>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "filter/image/exr_film.h"
#include "filter/image/layers.h"
#include "filter/image/reduce.h"
#include "filter/image/tile_samples.h"
#include "filter/methods.h"
#include "filter/metrics/error_estimate.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/plane_codec.h"
#include "server/child_task.h"
#include "server/committed_units.h"
#include "server/film/result.h"
#include "server/film/unit_film.h"

namespace lumifold::server {
namespace {

constexpr std::string_view kSamples = "samples.Y";
constexpr std::string_view kErrorChannel = "error.Y";
/// Last argument of the child process where somebody waits for the preview.
constexpr char kUrgent[] = "urgent";

/// Rows that are read at a time: of tiles, so that none is read twice.
constexpr int kBandRows = 64;

/// The whole film, reduced band by band.
absl::StatusOr<LayeredImage> ReadReduced(FilmSource* film, int factor, int band_rows) {
  std::vector<LayeredImage> bands;
  const int rows = factor * std::max(1, band_rows / factor);
  for (int y = 0; y < film->height(); y += rows) {
    const absl::StatusOr<EdgedImage> band =
        film->Read({0, y, film->width(), std::min(y + rows, film->height())});
    if (!band.ok()) return band.status();
    bands.push_back(ReduceFilm(band->pixels, factor));
  }
  return JoinRows(bands);
}

/// The samples per pixel of the frame.
Plane SamplesOf(const LayeredImage& reduced, int factor) {
  const ConstFloatView a = reduced.Get(layers::kSamplesA);
  const ConstFloatView b = reduced.Get(layers::kSamplesB);
  Plane samples = Plane::Uninitialized(reduced.width(), reduced.height());
  for (int y = 0; y < reduced.height(); ++y) {
    for (int x = 0; x < reduced.width(); ++x)
      samples.At(x, y) = (a.At(x, y) + b.At(x, y)) / static_cast<float>(factor * factor);
  }
  return samples;
}

double MeanOf(const Plane& plane) {
  double sum = 0;
  for (int y = 0; y < plane.height(); ++y)
    sum = std::accumulate(plane.Row(y), plane.Row(y) + plane.width(), sum);
  return sum / (static_cast<double>(plane.width()) * plane.height());
}

/// Nearest binary16 values take half the bytes; but ids and depths must stay what they are.
void RoundToHalf(LayeredImage* picture) {
  const std::set<std::string_view> exact = {layers::kObjectId, layers::kPlanarDepth, layers::kDistance};
  for (LayeredImage::Channel& channel : picture->channels()) {
    if (!exact.contains(channel.name)) rpc::RoundToHalf(channel.plane.view());
  }
}

/// The channels of a layer in the picture; empty if it has no such layer.
std::vector<std::string> ChannelsOf(const v1::PixelLayout& layout, const std::string& layer) {
  const std::set<std::string> all(layout.channels().begin(), layout.channels().end());
  const std::string prefix = layer.empty() ? "" : layer + ".";
  for (const std::string_view suffixes : {"RGB", "XYZ", "Y", "Z"}) {
    std::vector<std::string> channels;
    for (const char suffix : suffixes) channels.push_back(prefix + suffix);
    const bool has_all = std::all_of(channels.begin(), channels.end(),
                                     [&all](const std::string& name) { return all.contains(name); });
    if (has_all && (suffixes == "RGB" || !layer.empty())) return channels;
  }
  if (!layer.empty() && all.contains(layer)) return {layer};
  return {};
}

/// The layers that ChannelsOf knows, in the order of their channels.
std::vector<std::string> LayersOf(const v1::PixelLayout& layout) {
  std::vector<std::string> layers;
  for (const std::string& channel : layout.channels()) {
    const std::string layer = channel.substr(0, channel.rfind('.') + 1);
    const std::string name =
        layer.empty() ? (channel == "Z" || channel == "A" ? channel : "") : layer.substr(0, layer.size() - 1);
    if (std::find(layers.begin(), layers.end(), name) == layers.end()) layers.push_back(name);
  }
  return layers;
}

int FactorOf(int width, int height) { return (std::max(width, height) + kPreviewSide - 1) / kPreviewSide; }

/// A preview with the picture, which it rounds.
v1::Preview PreviewOf(int width, int height, LayeredImage picture) {
  v1::Preview preview;
  preview.set_width(width);
  preview.set_height(height);
  preview.set_reduction(FactorOf(width, height));
  RoundToHalf(&picture);
  rpc::EncodedPicture encoded = rpc::EncodePicture(picture);
  *preview.mutable_layout() = std::move(encoded.layout);
  preview.set_planes(std::move(encoded.bytes));
  for (const std::string& layer : LayersOf(preview.layout())) preview.add_layers(layer);
  return preview;
}

absl::StatusOr<v1::Preview> PreviewOfResult(const DataFolder& folder, const ledger::JobRecord& job,
                                            int32_t frame) {
  const absl::StatusOr<std::unique_ptr<ExrFilm>> film =
      ExrFilm::Open(folder.ResultPath(job.id, frame), folder.FilmPath(job.id));
  if (!film.ok()) return film.status();
  const int factor = FactorOf((*film)->width(), (*film)->height());
  absl::StatusOr<LayeredImage> reduced = ReadReduced(film->get(), factor, kBandRows);
  if (!reduced.ok()) return reduced.status();
  v1::Preview preview = PreviewOf((*film)->width(), (*film)->height(), *std::move(reduced));
  preview.set_units(kFinishedUnits);
  preview.set_finished(true);
  preview.set_samples_per_pixel(job.spec.samples_per_pixel());
  return preview;
}

/// For each tile its last committed pass; -1 where it has none.
std::vector<int32_t> LastPasses(const v1::JobSpec& spec, int32_t frame, const CommittedUnits& units) {
  const job::FrameUnits tiles(spec);
  std::vector<int32_t> last(static_cast<size_t>(tiles.tiles().count()), -1);
  for (int32_t tile = 0; tile < tiles.tiles().count(); ++tile) {
    for (int32_t pass = 0; pass < tiles.pass_count(); ++pass) {
      if (units.Has({frame, tile, pass, v1::UNIT_KIND_PASS})) last[static_cast<size_t>(tile)] = pass;
    }
  }
  return last;
}

/// A frame as far as it is committed, reduced, and what the filter makes of it.
struct FilteredPreview {
  LayeredImage film;
  std::array<Plane, 3> picture;
};

absl::StatusOr<FilteredPreview> FilterUnits(const v1::JobSpec& spec, int32_t frame,
                                            const CommittedUnits& units,
                                            const std::function<bool(const job::UnitKey&)>& has,
                                            TaskPool* pool) {
  absl::StatusOr<film::UnitFilm> film = film::UnitFilm::OpenUnfinished(spec, frame, &units, has, pool);
  if (!film.ok()) return film.status();
  absl::StatusOr<LayeredImage> reduced =
      ReadReduced(&*film, FactorOf(spec.width(), spec.height()), spec.tile_size());
  if (!reduced.ok()) return reduced.status();
  absl::StatusOr<std::array<Plane, 3>> picture = filter::FilterFilm(*reduced, spec.filter().method(), pool);
  if (!picture.ok()) return picture.status();
  return FilteredPreview{*std::move(reduced), *std::move(picture)};
}

metrics::FilteredFilm ViewOf(const FilteredPreview& preview) {
  return {preview.film, {preview.picture[0].view(), preview.picture[1].view(), preview.picture[2].view()}};
}

/// The estimated error of each pixel of `now`, in 8-bit steps: constant in blocks, 0 where a tile has one pass only. It is
/// compared with the frame as it was before the last pass of each tile.
absl::StatusOr<Plane> ErrorOf(const v1::JobSpec& spec, int32_t frame, const CommittedUnits& units,
                              const FilteredPreview& now, TaskPool* pool) {
  Plane error(now.film.width(), now.film.height());
  const std::vector<int32_t> last = LastPasses(spec, frame, units);
  if (std::all_of(last.begin(), last.end(), [](int32_t pass) { return pass < 1; })) return error;
  const absl::StatusOr<FilteredPreview> earlier = FilterUnits(
      spec, frame, units,
      [&](const job::UnitKey& key) {
        const bool is_last =
            key.kind == v1::UNIT_KIND_PASS && key.pass > 0 && key.pass == last[static_cast<size_t>(key.tile)];
        return units.Has(key) && !is_last;
      },
      pool);
  if (!earlier.ok()) return earlier.status();
  const metrics::ErrorEstimate estimate = metrics::EstimateError(ViewOf(*earlier), ViewOf(now), kSampleBlock,
                                                                 metrics::ErrorMetric::kMse255, pool);
  for (int y = 0; y < error.height(); ++y) {
    for (int x = 0; x < error.width(); ++x) {
      const int block = y / kSampleBlock * estimate.columns + x / kSampleBlock;
      error.At(x, y) =
          static_cast<float>(std::sqrt(std::max(0.0, estimate.blocks[static_cast<size_t>(block)])));
    }
  }
  return error;
}

absl::StatusOr<v1::Preview> PreviewOfUnits(const ledger::JobRecord& job, int32_t frame,
                                           const CommittedUnits& units, const PreviewWish& wish,
                                           TaskPool* pool) {
  const v1::JobSpec& spec = job.spec;
  absl::StatusOr<FilteredPreview> filtered = FilterUnits(
      spec, frame, units, [&units](const job::UnitKey& key) { return units.Has(key); }, pool);
  if (!filtered.ok()) return filtered.status();
  absl::StatusOr<Plane> error = Plane();
  if (wish.error) error = ErrorOf(spec, frame, units, *filtered, pool);
  if (!error.ok()) return error.status();
  Plane samples = SamplesOf(filtered->film, FactorOf(spec.width(), spec.height()));
  const double mean = MeanOf(samples);
  LayeredImage picture =
      film::BuildResult({std::move(filtered->film), {}}, std::move(filtered->picture), {}).pixels;
  picture.Add(kSamples, std::move(samples));
  if (wish.error) picture.Add(kErrorChannel, *std::move(error));
  v1::Preview preview = PreviewOf(spec.width(), spec.height(), std::move(picture));
  if (!wish.error) preview.add_layers(kErrorLayer);  // for who wishes for it
  preview.set_units(units.count());
  preview.set_samples_per_pixel(mean);
  return preview;
}

absl::StatusOr<std::string> PreviewAsChild(const ChildTask& task) {
  int32_t frame = 0;
  if (task.arguments.size() != 4 || !absl::SimpleAtoi(task.arguments[1], &frame))
    return absl::InvalidArgumentError("make-preview: only the coordinator starts this command");
  const absl::StatusOr<v1::Preview> preview =
      MakePreview(task.folder, task.store, job::JobId(task.arguments[0]), frame,
                  {.error = task.arguments[2] == kErrorLayer}, task.pool);
  if (!preview.ok()) return preview.status();
  return preview->SerializeAsString();
}

}  // namespace

absl::StatusOr<v1::Preview> MakePreview(const DataFolder& folder, ledger::JobStore& store,
                                        const job::JobId& job, int32_t frame, const PreviewWish& wish,
                                        TaskPool* pool) {
  const absl::StatusOr<ledger::JobRecord> record = store.GetJob(job);
  if (!record.ok()) return record.status();
  const absl::StatusOr<std::vector<int32_t>> finished = store.FinishedFrames(job);
  if (!finished.ok()) return finished.status();
  if (std::binary_search(finished->begin(), finished->end(), frame))
    return PreviewOfResult(folder, *record, frame);
  const absl::StatusOr<CommittedUnits> units = CommittedUnits::Open(folder, store, *record, frame);
  if (!units.ok()) return units.status();
  if (units->count() == 0) return absl::OutOfRangeError("no unit of the frame is committed yet");
  return PreviewOfUnits(*record, frame, *units, wish, pool);
}

bool HasErrorLayer(const v1::Preview& preview) {
  const auto& channels = preview.layout().channels();
  return std::find(channels.begin(), channels.end(), kErrorChannel) != channels.end();
}

absl::StatusOr<v1::Preview> LayerOfPreview(const v1::Preview& all, const std::string& layer) {
  const std::vector<std::string> channels = ChannelsOf(all.layout(), layer);
  if (channels.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("a preview has no layer \"", layer, "\", but \"",
                                                   absl::StrJoin(all.layers(), "\", \""), "\""));
  }
  v1::Preview part = all;
  part.clear_planes();
  part.mutable_layout()->clear_channels();
  part.mutable_layout()->clear_encodings();
  part.mutable_layout()->clear_compressed_bytes();
  const std::vector<rpc::EncodedPlane> planes = rpc::PlanesOf(all.layout());
  for (int i = 0; i < all.layout().channels_size(); ++i) {
    if (std::find(channels.begin(), channels.end(), all.layout().channels(i)) == channels.end()) continue;
    const rpc::EncodedPlane& plane = planes[static_cast<size_t>(i)];
    part.mutable_layout()->add_channels(all.layout().channels(i));
    part.mutable_layout()->add_encodings(plane.encoding);
    if (plane.encoding == v1::PLANE_ENCODING_ZSTD)
      part.mutable_layout()->add_compressed_bytes(static_cast<uint32_t>(plane.size_bytes));
    part.mutable_planes()->append(all.planes(), plane.first_byte, plane.size_bytes);
  }
  return part;
}

absl::StatusOr<v1::Preview> RunMakePreview(ChildProcess* process, const DataFolder& folder,
                                           const job::JobId& job, int32_t frame, const PreviewWish& wish) {
  const std::string task = absl::StrCat("the preview of frame ", frame);
  const absl::StatusOr<std::string> answer = process->Run(
      kMakePreviewCommand, folder.root(),
      {job.value(), absl::StrCat(frame), wish.error ? kErrorLayer : "", wish.urgent ? kUrgent : ""}, job,
      task);
  if (!answer.ok()) return answer.status();
  v1::Preview preview;
  if (!preview.ParseFromString(*answer))
    return absl::InternalError(absl::StrCat("the filter process of ", task, " ended without an answer"));
  return preview;
}

int RunMakePreviewProcess(const std::vector<std::string>& arguments) {
  const bool is_urgent = !arguments.empty() && arguments.back() == kUrgent;
  return RunChildTask(arguments, is_urgent ? 0 : kIdleNiceness, PreviewAsChild);
}

}  // namespace lumifold::server
