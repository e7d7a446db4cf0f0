#include "server/preview/make_preview.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>
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
#include "proto/rpc/rect_codec.h"
#include "server/child/child_task.h"
#include "server/commit/committed_units.h"
#include "server/film/matte.h"
#include "server/film/result.h"
#include "server/film/unit_film.h"
#include "server/preview/fill_gaps.h"

namespace lumifold::server {
namespace {

constexpr std::string_view kSamples = "samples.Y";
constexpr std::string_view kErrorChannel = "error.Y";

/// Rows that are read at a time: of tiles, so that none is read twice.
constexpr int kBandRows = 64;

/// Pixels around a region that its filter sees.
constexpr int kApron = 32;

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

/// By how much a film of few samples is reduced, so that its pixels that have any have kPreviewSamples of
/// them on average.
int ExtraReduction(const LayeredImage& film) {
  const Plane samples = SamplesOf(film, 1);
  double sum = 0;
  int64_t sampled = 0;
  for (int y = 0; y < samples.height(); ++y) {
    for (int x = 0; x < samples.width(); ++x) {
      sum += samples.At(x, y);
      sampled += samples.At(x, y) > 0 ? 1 : 0;
    }
  }
  if (sampled == 0) return 1;
  const double wanted = std::sqrt(kPreviewSamples * static_cast<double>(sampled) / sum);
  const int most = std::max(film.width(), film.height()) / kLeastPreviewSide;
  return std::clamp(static_cast<int>(std::lround(wanted)), 1, std::max(1, most));
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

bool IsTransparent(const v1::JobSpec& spec) { return spec.background() == v1::BACKGROUND_TRANSPARENT; }

/// Whether the colours of a layer are premultiplied by A in a transparent picture.
bool HasAlpha(const std::string& layer) { return layer.empty() || layer == layers::kNoisy; }

/// What a picture that is shown stands for.
struct Part {
  int frame_width = 0;
  int frame_height = 0;
  int reduction = 1;
  Rect region = {};  // empty: all
};

absl::Status CheckRegion(const Rect& region, int width, int height) {
  if (region == Rect{} || Intersect(region, {0, 0, width, height}) == region) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("the region is not within the frame of ", width, "x", height, " pixels"));
}

/// A preview with the picture, which it rounds.
v1::Preview PreviewOf(const Part& part, LayeredImage picture) {
  v1::Preview preview;
  preview.set_width(part.frame_width);
  preview.set_height(part.frame_height);
  preview.set_reduction(part.reduction);
  if (!part.region.IsEmpty()) *preview.mutable_region() = rpc::ProtoOf(part.region);
  RoundToHalf(&picture);
  rpc::EncodedPicture encoded = rpc::EncodePicture(picture);
  *preview.mutable_layout() = std::move(encoded.layout);
  preview.set_planes(std::move(encoded.bytes));
  for (const std::string& layer : LayersOf(preview.layout())) preview.add_layers(layer);
  return preview;
}

/// A region of a film, or all of it, reduced.
absl::StatusOr<LayeredImage> ReadPart(FilmSource* film, const Part& part, int band_rows) {
  if (part.region.IsEmpty()) return ReadReduced(film, part.reduction, band_rows);
  absl::StatusOr<EdgedImage> region = film->Read(part.region);
  if (!region.ok()) return region.status();
  return std::move(region->pixels);
}

absl::StatusOr<v1::Preview> PreviewOfResult(const DataFolder& folder, const ledger::JobRecord& job,
                                            int32_t frame, const Rect& region) {
  const absl::StatusOr<std::unique_ptr<ExrFilm>> film =
      ExrFilm::Open(folder.ResultPath(job.id, frame), folder.FilmPath(job.id));
  if (!film.ok()) return film.status();
  const int width = (*film)->width();
  const int height = (*film)->height();
  if (absl::Status status = CheckRegion(region, width, height); !status.ok()) return status;
  const Part part = {width, height, region.IsEmpty() ? FactorOf(width, height) : 1, region};
  absl::StatusOr<LayeredImage> picture = ReadPart(film->get(), part, kBandRows);
  if (!picture.ok()) return picture.status();
  v1::Preview preview = PreviewOf(part, *std::move(picture));
  preview.set_units(kFinishedUnits);
  preview.set_finished(true);
  preview.set_samples_per_pixel(job.spec.samples_per_pixel());
  preview.set_transparent(IsTransparent(job.spec));
  return preview;
}

/// A frame that is not finished.
struct Unfinished {
  const v1::JobSpec& spec;
  int32_t frame;
  const CommittedUnits& units;
  TaskPool* pool;
};

/// A frame or region as far as it is committed, reduced, and what the filter makes of it.
struct FilteredPreview {
  Part part;
  LayeredImage film;
  FilteredPicture filtered;  // the deviation is empty where the method does not know it
};

Picture Crop(const Picture& picture, const Rect& rect) {
  Picture part;
  if (picture[0].width() == 0) return part;
  for (size_t c = 0; c < part.size(); ++c) {
    part[c] = Plane::Uninitialized(rect.width(), rect.height());
    CopyPlane(picture[c].view().Crop(rect), part[c].view());
  }
  return part;
}

/// Without edge set and fragments, which reduced films do not have.
absl::StatusOr<FilteredPicture> Filter(const Unfinished& of, const LayeredImage& film) {
  const std::string& method = of.spec.filter().method();
  if (filter::CheckDeviation(method).ok()) return filter::FilterFilmWithDeviation(film, method, of.pool);
  absl::StatusOr<Picture> picture = filter::FilterFilm(film, method, of.pool);
  if (!picture.ok()) return picture.status();
  return FilteredPicture{*std::move(picture), {}, {}};
}

/// A region, filtered with what is around it.
absl::StatusOr<FilteredPreview> FilterRegion(const Unfinished& of, film::UnitFilm* film, const Part& part) {
  const Rect around = Inflate(part.region, kApron, {0, 0, part.frame_width, part.frame_height});
  const absl::StatusOr<EdgedImage> read = film->Read(around);
  if (!read.ok()) return read.status();
  const absl::StatusOr<FilteredPicture> filtered = Filter(of, read->pixels);
  if (!filtered.ok()) return filtered.status();
  const Rect inner = SeenFrom(around.x0, around.y0, part.region);
  return FilteredPreview{
      part,
      read->pixels.Crop(inner),
      {Crop(filtered->picture, inner), Crop(filtered->deviation, inner), Crop(filtered->returned, inner)}};
}

/// Of the committed units. A reduction of 0 is what the samples ask for.
absl::StatusOr<FilteredPreview> FilterUnits(const Unfinished& of, Part part) {
  absl::StatusOr<film::UnitFilm> film = film::UnitFilm::OpenUnfinished(
      of.spec, of.frame, &of.units, [&of](const job::UnitKey& key) { return of.units.Has(key); }, of.pool);
  if (!film.ok()) return film.status();
  if (!part.region.IsEmpty()) return FilterRegion(of, &*film, part);
  const int factor = FactorOf(part.frame_width, part.frame_height);
  absl::StatusOr<LayeredImage> reduced = ReadReduced(&*film, factor, of.spec.tile_size());
  if (!reduced.ok()) return reduced.status();
  const int extra = part.reduction == 0 ? ExtraReduction(*reduced) : part.reduction / factor;
  if (extra > 1) reduced = ReduceFilm(*reduced, extra);
  part.reduction = factor * extra;
  absl::StatusOr<FilteredPicture> filtered = Filter(of, *reduced);
  if (!filtered.ok()) return filtered.status();
  return FilteredPreview{part, *std::move(reduced), *std::move(filtered)};
}

/// The estimated error of each pixel, in 8-bit steps: constant in blocks, 0 where a tile has no pass.
Plane ErrorOf(const FilteredPreview& preview, TaskPool* pool) {
  const metrics::FilteredFilm view = {preview.film, preview.filtered};
  const metrics::ErrorEstimate estimate =
      metrics::EstimateError(view, kSampleBlock, metrics::ErrorMetric::kMse255, pool);
  Plane error(preview.film.width(), preview.film.height());
  for (int y = 0; y < error.height(); ++y) {
    for (int x = 0; x < error.width(); ++x) {
      const int block = y / kSampleBlock * estimate.columns + x / kSampleBlock;
      error.At(x, y) =
          static_cast<float>(std::sqrt(std::max(0.0, estimate.blocks[static_cast<size_t>(block)])));
    }
  }
  return error;
}

/// Whether surfaces of the film show shadows alone.
bool CatchesShadows(const LayeredImage& film) {
  if (!film.Has(layers::kCatcher)) return false;
  const ConstFloatView catcher = film.Get(layers::kCatcher);
  for (int y = 0; y < film.height(); ++y) {
    if (std::any_of(catcher.Row(y), catcher.Row(y) + film.width(), [](float part) { return part > 0; }))
      return true;
  }
  return false;
}

/// The result that the film so far makes.
absl::StatusOr<LayeredImage> ResultOf(const Unfinished& of, FilteredPreview preview) {
  LayeredImage& film = preview.film;
  if (CatchesShadows(film)) {
    absl::StatusOr<Picture> shadow =
        filter::FilterFilm(film::ShadowFilmOf(film), of.spec.filter().method(), of.pool);
    if (!shadow.ok()) return shadow.status();
    film.Add(layers::kShadow, std::move((*shadow)[0]));
  }
  film::ResultInfo info;
  info.spec.set_background(of.spec.background());
  *info.spec.mutable_filter() = of.spec.filter();
  return film::BuildResult({std::move(film), {}}, std::move(preview.filtered.picture), info).pixels;
}

absl::StatusOr<v1::Preview> PreviewOfUnits(const Unfinished& of, const Rect& region) {
  const Part whole = {of.spec.width(), of.spec.height(), region.IsEmpty() ? 0 : 1, region};
  if (absl::Status status = CheckRegion(region, whole.frame_width, whole.frame_height); !status.ok())
    return status;
  absl::StatusOr<FilteredPreview> filtered = FilterUnits(of, whole);
  if (!filtered.ok()) return filtered.status();
  std::optional<Plane> error;
  if (filtered->filtered.deviation[0].width() > 0) error = ErrorOf(*filtered, of.pool);
  const Part part = filtered->part;
  Plane samples = SamplesOf(filtered->film, part.reduction);
  const double mean = MeanOf(samples);
  absl::StatusOr<LayeredImage> built = ResultOf(of, *std::move(filtered));
  if (!built.ok()) return built.status();
  LayeredImage picture = *std::move(built);
  FillGaps(samples, picture.GetColor(layers::kBeauty));
  if (IsTransparent(of.spec)) {
    const FloatView alpha = picture.Get(layers::kAlpha);
    FillGaps(samples, {alpha, alpha, alpha});
  }
  picture.Add(kSamples, std::move(samples));
  if (error.has_value()) picture.Add(kErrorChannel, *std::move(error));
  v1::Preview preview = PreviewOf(part, std::move(picture));
  preview.set_units(of.units.count());
  preview.set_samples_per_pixel(mean);
  preview.set_transparent(IsTransparent(of.spec));
  return preview;
}

absl::StatusOr<std::string> PreviewAsChild(const ChildTask& task) {
  int32_t frame = 0;
  PreviewRequest request;
  if (task.arguments.size() != 4 || !absl::SimpleAtoi(task.arguments[1], &frame))
    return absl::InvalidArgumentError("make-preview: only the coordinator starts this command");
  request.region = rpc::ParseRect(task.arguments[2]).value_or(Rect{});
  const absl::StatusOr<v1::Preview> preview =
      MakePreview(task.folder, task.store, job::JobId(task.arguments[0]), frame, request, task.pool);
  if (!preview.ok()) return preview.status();
  return preview->SerializeAsString();
}

}  // namespace

absl::StatusOr<v1::Preview> MakePreview(const DataFolder& folder, ledger::JobStore& store,
                                        const job::JobId& job, int32_t frame, const PreviewRequest& request,
                                        TaskPool* pool) {
  const absl::StatusOr<ledger::JobRecord> record = store.GetJob(job);
  if (!record.ok()) return record.status();
  const absl::StatusOr<std::vector<int32_t>> finished = store.FinishedFrames(job);
  if (!finished.ok()) return finished.status();
  if (std::binary_search(finished->begin(), finished->end(), frame))
    return PreviewOfResult(folder, *record, frame, request.region);
  const absl::StatusOr<CommittedUnits> units = CommittedUnits::Open(folder, store, *record, frame);
  if (!units.ok()) return units.status();
  if (units->count() == 0) return absl::OutOfRangeError("no unit of the frame is committed yet");
  return PreviewOfUnits({record->spec, frame, *units, pool}, request.region);
}

absl::StatusOr<v1::Preview> LayerOfPreview(const v1::Preview& all, const std::string& layer) {
  std::vector<std::string> channels = ChannelsOf(all.layout(), layer);
  if (all.transparent() && HasAlpha(layer)) channels.emplace_back(layers::kAlpha);
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
  const auto& all_channels = all.layout().channels();
  for (const std::string& channel : channels) {
    const auto i = std::find(all_channels.begin(), all_channels.end(), channel) - all_channels.begin();
    const rpc::EncodedPlane& plane = planes[static_cast<size_t>(i)];
    part.mutable_layout()->add_channels(channel);
    part.mutable_layout()->add_encodings(plane.encoding);
    if (plane.encoding == v1::PLANE_ENCODING_ZSTD)
      part.mutable_layout()->add_compressed_bytes(static_cast<uint32_t>(plane.size_bytes));
    part.mutable_planes()->append(all.planes(), plane.first_byte, plane.size_bytes);
  }
  return part;
}

absl::StatusOr<v1::Preview> RunMakePreview(ChildProcess* process, const DataFolder& folder, int threads,
                                           const job::JobId& job, int32_t frame,
                                           const PreviewRequest& request) {
  const std::string task = absl::StrCat("the preview of frame ", frame);
  const absl::StatusOr<std::string> answer =
      process->Run({.command = kMakePreviewCommand,
                    .root = folder.root(),
                    .threads = threads,
                    .arguments = {job.value(), absl::StrCat(frame), rpc::RectText(request.region),
                                  request.urgent ? kUrgent : ""},
                    .job = job,
                    .task = task});
  if (!answer.ok()) return answer.status();
  v1::Preview preview;
  if (!preview.ParseFromString(*answer))
    return absl::InternalError(absl::StrCat("the filter process of ", task, " ended without an answer"));
  return preview;
}

int RunMakePreviewProcess(const std::vector<std::string>& arguments) {
  return RunChildTask(arguments, kIdleNiceness, PreviewAsChild);
}

}  // namespace lumifold::server
