#include "filter/methods.h"

#include <algorithm>
#include <functional>
#include <initializer_list>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "filter/baselines/baseline.h"
#include "filter/denoise/denoise.h"
#include "filter/image/layers.h"
#include "filter/layers/recombination.h"

namespace lumifold::filter {
namespace {

std::vector<std::string> NamesOf(std::initializer_list<std::string_view> singles,
                                 std::initializer_list<std::string_view> colors) {
  std::vector<std::string> names(singles.begin(), singles.end());
  for (const std::string_view layer : colors) {
    for (std::string& name : layers::ColorChannels(layer)) names.push_back(std::move(name));
  }
  return names;
}

std::vector<std::string> NoisyChannels() { return NamesOf({}, {layers::kNoisy}); }

/// The channels that every filter may read.
std::vector<std::string> FilterChannels() {
  std::vector<std::string> names =
      NamesOf({layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance, layers::kMask,
               layers::kSamplesA, layers::kSamplesB},
              {layers::kAlbedo, layers::kEmission});
  for (const std::string_view layer : {layers::kNoisy, layers::kDirect, layers::kIndirect}) {
    for (std::string& name : NamesOf({}, {layer, layers::HalfA(layer), layers::HalfB(layer)})) {
      names.push_back(std::move(name));
    }
  }
  return names;
}

absl::Status CheckChannels(const LayeredImage& film, const std::vector<std::string>& needed) {
  for (const std::string& name : needed) {
    if (!film.Has(name)) return absl::InvalidArgumentError(absl::StrCat("the film has no channel ", name));
  }
  return absl::OkStatus();
}

/// A method, and how it makes a picture of a film that has the channels it needs.
struct Entry {
  MethodInfo info;
  std::vector<std::string> channels;
  bool reads_edges = true;
  std::function<Picture(const FilmView& film, absl::Span<const float> values, TaskPool* pool,
                        const FilterProgress& progress)>
      filter;
  /// Empty: the method does not know the deviation of its picture.
  std::function<FilteredPicture(const Frame& frame, FilterPurpose purpose, TaskPool* pool,
                                const FilterProgress& progress)>
      with_deviation = {};
};

std::vector<Entry> ListEntries() {
  using Values = absl::Span<const float>;
  std::vector<Entry> entries = {
      {{.name = "default",
        .summary = "adaptive manifolds, two passes, scale chosen per pixel by estimated error",
        .source = "Gruzdev et al. 2015, extended: docs/method.md",
        .parameters = {}},
       FilterChannels(),
       true,
       [](const FilmView& film, Values, TaskPool* pool, const FilterProgress& progress) {
         return Denoise(Frame(film.pixels, film.edges, film.fragments), pool,
                        {.off = {}, .progress = progress});
       },
       [](const Frame& frame, FilterPurpose purpose, TaskPool* pool, const FilterProgress& progress) {
         return purpose == FilterPurpose::kEstimate
                    ? DenoiseToEstimate(frame, pool)
                    : DenoiseWithDeviation(frame, pool, {.off = {}, .progress = progress});
       }},
      {{.name = "none",
        .summary = "the noisy picture itself",
        .source = "path tracing alone",
        .parameters = {},
        .uses_auxiliary = false},
       NoisyChannels(),
       false,
       [](const FilmView& film, Values, TaskPool*, const FilterProgress&) {
         return ClonePicture(film.pixels.GetColor(layers::kNoisy));
       },
       [](const Frame& frame, FilterPurpose, TaskPool* pool, const FilterProgress&) {
         return FilteredPicture{ClonePicture(frame.combined.mean), DeviationOf(frame, NoChange(frame), pool),
                                DeviationOfReturned(frame, {}, pool)};
       }},
  };
  for (const Baseline& baseline : Baselines()) {
    const bool uses_auxiliary = baseline.info.uses_auxiliary;
    entries.push_back(
        {baseline.info, uses_auxiliary ? FilterChannels() : NoisyChannels(), uses_auxiliary,
         [filter = baseline.filter](const FilmView& film, Values values, TaskPool* pool,
                                    const FilterProgress&) { return filter(film, values, pool); }});
  }
  return entries;
}

const std::vector<Entry>& Entries() {
  static const std::vector<Entry> entries = ListEntries();
  return entries;
}

/// A method and the values of its parameters.
struct Call {
  const Entry* method = nullptr;
  std::vector<float> values;
};

/// Reads "NAME" or "NAME:PARAMETERS".
absl::StatusOr<Call> ParseCall(std::string_view text) {
  const size_t colon = text.find(':');
  const std::string_view name = text.substr(0, colon);
  const std::vector<Entry>& all = Entries();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const Entry& entry) { return entry.info.name == name; });
  if (found == all.end()) {
    const std::string names =
        absl::StrJoin(Methods(), ", ", [](std::string* out, const MethodInfo& m) { out->append(m.name); });
    return absl::InvalidArgumentError(
        absl::StrCat("no method is named \"", std::string(name), "\"; there are: ", names));
  }
  absl::StatusOr<std::vector<float>> values = ParseParameters(
      found->info, colon == std::string_view::npos ? std::string_view() : text.substr(colon + 1));
  if (!values.ok()) return values.status();
  return Call{&*found, *std::move(values)};
}

/// Whether a film has what the method reads.
absl::Status CheckFilm(const FilmView& film, const Call& call) {
  if (absl::Status status = CheckChannels(film.pixels, call.method->channels); !status.ok()) return status;
  if (call.method->reads_edges && film.edges != nullptr && !film.edges->channels().empty()) {
    absl::Status status = CheckChannels(*film.edges, layers::EdgeChannels());
    if (!status.ok()) return status;
  }
  if (film.fragments != nullptr && !film.fragments->channels().empty()) {
    const auto has = [&](std::string_view layer) {
      return film.fragments->HasColor(layer) || film.fragments->HasColor(layers::HalfA(layer));
    };
    absl::Status status = CheckChannels(*film.fragments, layers::FragmentChannels(has));
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

/// FilterFilm for a film that is one block.
absl::StatusOr<Picture> FilterBlock(const FilmView& film, const Call& call, TaskPool* pool,
                                    const FilterProgress& progress = nullptr) {
  if (absl::Status status = CheckFilm(film, call); !status.ok()) return status;
  return call.method->filter(film, call.values, pool, progress);
}

/// ParseCall for a method that knows the deviation.
absl::StatusOr<Call> ParseCallWithDeviation(std::string_view method) {
  absl::StatusOr<Call> call = ParseCall(method);
  if (!call.ok() || call->method->with_deviation) return call;
  std::vector<std::string> known;
  for (const Entry& entry : Entries()) {
    if (entry.with_deviation) known.push_back(entry.info.name);
  }
  return absl::InvalidArgumentError(absl::StrCat(
      "method \"", call->method->info.name,
      "\" does not tell its error, which adaptive sampling needs; these do: ", absl::StrJoin(known, ", ")));
}

/// Receives rows of pictures and puts them together.
class WholePictures {
 public:
  WholePictures(const std::vector<std::string_view>& layers, int width, int height)
      : layers_(layers), pictures_(layers.size()) {
    for (Picture& picture : pictures_) {
      for (Plane& plane : picture) plane = Plane::Uninitialized(width, height);
    }
  }

  absl::Status Append(const LayeredImage& rows) {
    for (size_t i = 0; i < layers_.size(); ++i) {
      const ConstColorView color = rows.GetColor(layers_[i]);
      for (size_t c = 0; c < color.size(); ++c)
        CopyPlane(color[c], pictures_[i][c].view().Crop({0, y_, rows.width(), y_ + rows.height()}));
    }
    y_ += rows.height();
    return absl::OkStatus();
  }

  std::vector<Picture> Take() { return std::move(pictures_); }

 private:
  const std::vector<std::string_view>& layers_;
  std::vector<Picture> pictures_;
  int y_ = 0;
};

/// Makes of the progress within each block that of the film.
class BlockCount {
 public:
  BlockCount(const FilmSource& film, const BlockParams& params, const FilterProgress& progress)
      : progress_(progress) {
    const BlockGrid grid(film.width(), film.height(), params);
    count_ = grid.columns() * grid.rows();
  }

  FilterProgress OfBlock() const {
    if (!progress_) return nullptr;
    return [this](double share) { progress_((done_ + share) / count_); };
  }
  void Next() { ++done_; }

 private:
  const FilterProgress& progress_;
  double count_ = 0;
  double done_ = 0;
};

}  // namespace

const std::vector<MethodInfo>& Methods() {
  static const std::vector<MethodInfo> methods = [] {
    std::vector<MethodInfo> infos;
    for (const Entry& entry : Entries()) infos.push_back(entry.info);
    return infos;
  }();
  return methods;
}

absl::Status CheckMethod(std::string_view method) { return ParseCall(method).status(); }

absl::StatusOr<Picture> FilterFilm(const LayeredImage& film, std::string_view method, TaskPool* pool,
                                   const LayeredImage* edges, const LayeredImage* fragments,
                                   const FilterProgress& progress) {
  if (BlockGrid(film.width(), film.height(), {}).IsOneBlock()) {
    const absl::StatusOr<Call> call = ParseCall(method);
    if (!call.ok()) return call.status();
    return FilterBlock({film, edges, fragments}, *call, pool, progress);
  }
  FilmInMemory source(film, edges, fragments);
  return FilterFilmByRows(&source, method, pool, {}, progress);
}

absl::Status FilterFilmInRows(FilmSource* film, std::string_view method,
                              const std::vector<std::string>& passed_on, TaskPool* pool, const RowSink& sink,
                              const BlockParams& params, const ReadyBlocks& ready,
                              const FilterProgress& progress) {
  const absl::StatusOr<Call> call = ParseCall(method);
  if (!call.ok()) return call.status();
  BlockCount count(*film, params, progress);
  const auto filter = [&](const EdgedImage& block) -> absl::StatusOr<std::vector<Picture>> {
    absl::StatusOr<Picture> picture =
        FilterBlock({block.pixels, &block.edges, &block.fragments}, *call, pool, count.OfBlock());
    if (!picture.ok()) return picture.status();
    count.Next();
    std::vector<Picture> pictures;
    pictures.push_back(*std::move(picture));
    return pictures;
  };
  if (ready == nullptr) return FilterInBlocks(film, params, passed_on, {layers::kBeauty}, filter, sink);
  const auto take = [&](int column, int row) {
    absl::StatusOr<std::optional<std::vector<Picture>>> pictures = ready(column, row);
    if (pictures.ok() && pictures->has_value()) count.Next();
    return pictures;
  };
  return FilterInBlocks(film, params, passed_on, {layers::kBeauty}, filter, sink, take);
}

absl::StatusOr<Picture> FilterFilmByRows(FilmSource* film, std::string_view method, TaskPool* pool,
                                         const BlockParams& params, const FilterProgress& progress) {
  const std::vector<std::string_view> names = {layers::kBeauty};
  WholePictures whole(names, film->width(), film->height());
  const auto append = [&](const LayeredImage& rows) { return whole.Append(rows); };
  if (absl::Status status = FilterFilmInRows(film, method, {}, pool, append, params, nullptr, progress);
      !status.ok())
    return status;
  return std::move(whole.Take().front());
}

absl::Status CheckDeviation(std::string_view method) { return ParseCallWithDeviation(method).status(); }

absl::StatusOr<FilteredPicture> FilterFilmWithDeviation(const LayeredImage& film, std::string_view method,
                                                        TaskPool* pool, const LayeredImage* edges,
                                                        const LayeredImage* fragments, FilterPurpose purpose,
                                                        const BlockParams& params,
                                                        const FilterProgress& progress) {
  const absl::StatusOr<Call> call = ParseCallWithDeviation(method);
  if (!call.ok()) return call.status();
  const std::vector<std::string> halves = NamesOf(
      {layers::kSamplesA, layers::kSamplesB}, {layers::HalfA(layers::kNoisy), layers::HalfB(layers::kNoisy)});
  if (absl::Status status = CheckChannels(film, halves); !status.ok()) return status;
  if (absl::Status status = CheckFilm({film, edges, fragments}, *call); !status.ok()) return status;
  if (BlockGrid(film.width(), film.height(), params).IsOneBlock())
    return call->method->with_deviation(Frame(film, edges, fragments), purpose, pool, progress);
  FilmInMemory source(film, edges, fragments);
  BlockCount count(source, params, progress);
  const auto filter = [&](const EdgedImage& block) -> absl::StatusOr<std::vector<Picture>> {
    FilteredPicture filtered = call->method->with_deviation(Frame(block), purpose, pool, count.OfBlock());
    count.Next();
    std::vector<Picture> pictures;
    pictures.push_back(std::move(filtered.picture));
    pictures.push_back(std::move(filtered.deviation));
    pictures.push_back(std::move(filtered.returned));
    return pictures;
  };
  const std::vector<std::string_view> names = {layers::kBeauty, "deviation", "returned"};
  WholePictures whole(names, film.width(), film.height());
  const auto append = [&](const LayeredImage& rows) { return whole.Append(rows); };
  if (absl::Status status = FilterInBlocks(&source, params, {}, names, filter, append); !status.ok())
    return status;
  std::vector<Picture> pictures = whole.Take();
  return FilteredPicture{std::move(pictures[0]), std::move(pictures[1]), std::move(pictures[2])};
}

}  // namespace lumifold::filter
