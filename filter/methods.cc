#include "filter/methods.h"

#include <algorithm>
#include <initializer_list>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/baselines/baseline.h"
#include "filter/denoise/denoise.h"
#include "filter/image/layers.h"

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

/// What every method but "none" reads.
std::vector<std::string> ChannelsToFilter() {
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

std::array<Plane, 3> Unfiltered(const LayeredImage& film) {
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  std::array<Plane, 3> copy;
  for (size_t c = 0; c < 3; ++c) {
    copy[c] = Plane(film.width(), film.height());
    CopyPlane(noisy[c], copy[c].view());
  }
  return copy;
}

std::vector<Method> ListMethods() {
  std::vector<Method> methods = {
      {"default", "adaptive manifolds, two passes, scale chosen per pixel by estimated error"},
      {"paper", "adaptive manifolds as published: one pass with one scale"},
      {"none", "the noisy picture itself"},
  };
  for (const Baseline& baseline : Baselines()) methods.push_back({baseline.name, baseline.summary});
  return methods;
}

/// A baseline and the values to run it with.
struct BaselineCall {
  const Baseline* baseline = nullptr;  // null: one of our own methods
  std::vector<float> values;
};

absl::StatusOr<BaselineCall> ParseMethod(std::string_view method) {
  const size_t colon = method.find(':');
  const std::string_view name = method.substr(0, colon);
  if (const Baseline* baseline = FindBaseline(name)) {
    absl::StatusOr<std::vector<float>> values = ParseParameters(
        *baseline, colon == std::string_view::npos ? std::string_view() : method.substr(colon + 1));
    if (!values.ok()) return values.status();
    return BaselineCall{baseline, *std::move(values)};
  }
  const std::vector<Method>& all = Methods();
  if (std::any_of(all.begin(), all.end(), [&](const Method& m) { return m.name == method; }))
    return BaselineCall{};
  std::string names;
  for (const Method& m : all) absl::StrAppend(&names, names.empty() ? "" : ", ", m.name);
  return absl::InvalidArgumentError(
      absl::StrCat("no filter is named \"", std::string(method), "\"; there are: ", names));
}

/// FilterFilm for a film that is one block.
absl::StatusOr<std::array<Plane, 3>> FilterBlock(const LayeredImage& film, std::string_view method,
                                                 TaskPool* pool, const LayeredImage* edges) {
  const absl::StatusOr<BaselineCall> call = ParseMethod(method);
  if (!call.ok()) return call.status();
  if (method == "none") {
    const absl::Status status = CheckChannels(film, NamesOf({}, {layers::kNoisy}));
    if (!status.ok()) return status;
    return Unfiltered(film);
  }
  if (const absl::Status status = CheckChannels(film, ChannelsToFilter()); !status.ok()) return status;
  if (edges != nullptr && !edges->channels().empty()) {
    const absl::Status status = CheckChannels(*edges, layers::EdgeChannels());
    if (!status.ok()) return status;
  }
  if (call->baseline != nullptr) return call->baseline->filter(film, call->values, pool);
  return method == "paper" ? DenoiseAsPublished(film, edges, pool) : Denoise(film, edges, pool);
}

}  // namespace

const std::vector<Method>& Methods() {
  static const std::vector<Method> methods = ListMethods();
  return methods;
}

absl::Status CheckMethod(std::string_view method) { return ParseMethod(method).status(); }

absl::StatusOr<std::array<Plane, 3>> FilterFilm(const LayeredImage& film, std::string_view method,
                                                TaskPool* pool, const LayeredImage* edges) {
  if (BlockGrid(film.width(), film.height(), {}).IsOneBlock()) return FilterBlock(film, method, pool, edges);
  FilmInMemory source(film, edges);
  std::array<Plane, 3> picture;
  for (Plane& plane : picture) plane = Plane::Uninitialized(film.width(), film.height());
  int y = 0;
  const auto keep = [&](const LayeredImage& rows) {
    const ConstColorView color = rows.GetColor(layers::kBeauty);
    for (size_t c = 0; c < picture.size(); ++c)
      CopyPlane(color[c], picture[c].view().Crop({0, y, rows.width(), y + rows.height()}));
    y += rows.height();
    return absl::OkStatus();
  };
  if (absl::Status status = FilterFilmInRows(&source, method, {}, pool, keep); !status.ok()) return status;
  return picture;
}

absl::Status FilterFilmInRows(FilmSource* film, std::string_view method,
                              const std::vector<std::string>& passed_on, TaskPool* pool, const RowSink& sink,
                              const BlockParams& params) {
  if (absl::Status status = CheckMethod(method); !status.ok()) return status;  // before anything is read
  const auto filter = [&](const EdgedImage& block) {
    return FilterBlock(block.pixels, method, pool, &block.edges);
  };
  return FilterInBlocks(film, params, passed_on, filter, sink);
}

}  // namespace lumifold::filter
