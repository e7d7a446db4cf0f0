#include "server/film/film_builder.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "filter/image/layers.h"

namespace lumifold::film {
namespace {

using layers::Level;
using layers::OfLevel;

void AddHalved(std::string_view layer, LayeredImage* film) {
  film->AddColor(layer);
  film->AddColor(layers::HalfA(layer));
  film->AddColor(layers::HalfB(layer));
}

/// Adds a layer of layers::kWhole or layers::kLevelWhole.
void AddWhole(std::string_view layer, bool lens, LayeredImage* film) {
  if (lens) {
    AddHalved(layer, film);
  } else {
    film->AddColor(layer);
  }
}

/// Channels that a film has for a level.
std::vector<std::string> LevelFilmChannels(Level level, bool lens) {
  LayeredImage film(1, 1);
  for (const std::string_view layer : layers::kLevelHalved) AddHalved(OfLevel(level, layer), &film);
  for (const std::string_view layer : layers::kLevelWhole) AddWhole(OfLevel(level, layer), lens, &film);
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB}) film.Add(OfLevel(level, name));
  for (const std::string& name : layers::LevelFeatureChannels(level)) film.Add(name);
  std::vector<std::string> names;
  for (const LayeredImage::Channel& channel : film.channels()) names.push_back(channel.name);
  return names;
}

/// A tile and the assembled part of the frame, both in frame coordinates.
struct TilePlacement {
  Rect tile;
  Rect part;

  /// The pixels that are written, relative to the tile's corner and to the part's corner.
  Rect InTile() const { return SeenFrom(tile.x0, tile.y0, Intersect(tile, part)); }
  Rect InPart() const { return SeenFrom(part.x0, part.y0, Intersect(tile, part)); }
};

// Writes value(i) for each pixel i of the tile, in row-major order, into `channel` of the film.
template <typename Value>
void WriteTile(const TilePlacement& placement, std::string_view channel, LayeredImage* film, Value value) {
  const FloatView view = film->Get(channel).Crop(placement.InPart());
  const Rect inside = placement.InTile();
  const auto tile_width = static_cast<size_t>(placement.tile.width());
  for (int y = 0; y < view.height(); ++y) {
    size_t i = static_cast<size_t>(inside.y0 + y) * tile_width + static_cast<size_t>(inside.x0);
    for (int x = 0; x < view.width(); ++x) view.At(x, y) = static_cast<float>(value(i++));
  }
}

double Mean(double sum, double count) { return count > 0.0 ? sum / count : 0.0; }

/// The sample counts of the halves.
struct Counts {
  const std::vector<double>& a;
  const std::vector<double>& b;
};

void WriteCounts(const TilePlacement& placement, const Counts& counts, std::string_view a, std::string_view b,
                 LayeredImage* film) {
  WriteTile(placement, a, film, [&](size_t i) { return counts.a[i]; });
  WriteTile(placement, b, film, [&](size_t i) { return counts.b[i]; });
}

/// Writes the means of a layer with halves: of all samples and of each half.
void WriteHalved(const TilePlacement& placement, const TileSums& sums, std::string_view layer,
                 const Counts& counts, LayeredImage* film) {
  const auto both = layers::ColorChannels(layer);
  const auto half_a = layers::ColorChannels(layers::HalfA(layer));
  const auto half_b = layers::ColorChannels(layers::HalfB(layer));
  for (size_t c = 0; c < both.size(); ++c) {
    const std::vector<double>& a = sums.Of(half_a[c]);
    const std::vector<double>& b = sums.Of(half_b[c]);
    WriteTile(placement, both[c], film,
              [&](size_t i) { return Mean(a[i] + b[i], counts.a[i] + counts.b[i]); });
    WriteTile(placement, half_a[c], film, [&](size_t i) { return Mean(a[i], counts.a[i]); });
    WriteTile(placement, half_b[c], film, [&](size_t i) { return Mean(b[i], counts.b[i]); });
  }
}

/// Writes the means of a layer of layers::kWhole or layers::kLevelWhole.
void WriteWhole(const TilePlacement& placement, const TileSums& sums, std::string_view layer,
                const Counts& counts, bool lens, LayeredImage* film) {
  if (lens) return WriteHalved(placement, sums, layer, counts, film);
  for (const std::string& name : layers::ColorChannels(layer)) {
    const std::vector<double>& sum = sums.Of(name);
    WriteTile(placement, name, film, [&](size_t i) { return Mean(sum[i], counts.a[i] + counts.b[i]); });
  }
}

/// Writes layers::kMatte: means over all samples, or over those of a half.
void WriteMatte(const TilePlacement& placement, const TileSums& sums, const Counts& counts,
                LayeredImage* film) {
  for (const std::string_view name : {layers::kOpacity, layers::kCatcher}) {
    const std::vector<double>& sum = sums.Of(name);
    WriteTile(placement, name, film, [&](size_t i) { return Mean(sum[i], counts.a[i] + counts.b[i]); });
  }
  for (const auto& names : {layers::kCatcherLight, layers::kCatcherShadow}) {
    for (size_t half = 0; half < names.size(); ++half) {
      const std::vector<double>& sum = sums.Of(names[half]);
      const std::vector<double>& count = half == 0 ? counts.a : counts.b;
      WriteTile(placement, names[half], film, [&](size_t i) { return Mean(sum[i], count[i]); });
    }
  }
}

Counts CountsOf(const TileSums& sums) { return {sums.Of(layers::kSamplesA), sums.Of(layers::kSamplesB)}; }

/// All rows of all lists of the tiles, in the order of the frame's pixels. The rows of a pixel are in one
/// list, and keep their order.
LayeredImage AssembleLists(const std::vector<LayeredImage>& lists, const std::vector<std::string>& channels) {
  using Place = std::tuple<float, float, const LayeredImage*, int>;  // y, x, list, row
  std::vector<Place> places;
  int width = 0;
  for (const LayeredImage& list : lists) {
    width = std::max(width, list.width());
    for (int row = 0; row < list.height(); ++row)
      places.emplace_back(list.Get(layers::kPixelY).At(0, row), list.Get(layers::kPixelX).At(0, row), &list,
                          row);
  }
  if (places.empty()) return {};
  std::sort(places.begin(), places.end());
  LayeredImage assembled = LayeredImage::List(width, static_cast<int>(places.size()));
  for (const std::string& name : channels) {
    const FloatView view = assembled.Add(name);
    for (int row = 0; row < assembled.height(); ++row) {
      const auto& [y, x, list, list_row] = places[static_cast<size_t>(row)];
      std::copy_n(list->Get(name).Row(list_row), width, view.Row(row));
    }
  }
  return assembled;
}

/// What filters and results need is in a film in any case.
bool IsInFilm(std::string_view layer, const UnitModel& model) {
  return model.Has(layer) || (layer != layers::kGlossy && layer != layers::kGlossyAlbedo);
}

}  // namespace

void TileSums::Add(const EdgedImage& unit) {
  const LayeredImage& pass = unit.pixels;
  for (const LayeredImage::Channel& channel : pass.channels()) {
    std::vector<double>& sum = sums_[channel.name];
    sum.resize(static_cast<size_t>(pass.width()) * static_cast<size_t>(pass.height()));
    auto next = sum.begin();
    for (int y = 0; y < pass.height(); ++y) {
      const float* row = channel.plane.Row(y);
      for (int x = 0; x < pass.width(); ++x) *next++ += row[x];
    }
  }
  fragments_.Add(unit.fragments);
}

const std::vector<double>& TileSums::Of(std::string_view channel) const {
  const auto found = sums_.find(channel);
  LUMIFOLD_CHECK(found != sums_.end());
  return found->second;
}

FilmBuilder::FilmBuilder(int width, int height, const UnitModel& model)
    : FilmBuilder({0, 0, width, height}, {}, model) {}

FilmBuilder::FilmBuilder(const Rect& part, const LevelSet& levels, const UnitModel& model)
    : part_(part),
      model_(model),
      film_(part.width(), part.height()),
      levels_(part.width(), part.height(),
              [lens = model.carried.lens](Level level) { return LevelFilmChannels(level, lens); }) {
  for (const std::string_view layer : layers::kHalved) {
    if (IsInFilm(layer, model)) AddHalved(layer, &film_);
  }
  for (const std::string_view layer : layers::kWhole) {
    if (IsInFilm(layer, model)) AddWhole(layer, model.carried.lens, &film_);
  }
  film_.Add(layers::kSamplesA);
  film_.Add(layers::kSamplesB);
  if (model.has_matte) {
    for (const std::string_view name : layers::kMatte) film_.Add(name);
  }
  for (const std::string& name : GeometryChannels(model_)) film_.Add(name);
  for (size_t i = 0; i < levels.size(); ++i) {
    if (levels[i]) LevelOf(Level::Of(i));
  }
}

LayeredImage* FilmBuilder::LevelOf(Level level) {
  absl::MutexLock lock(&mutex_);
  return &levels_.At(level);  // the address is stable; tiles write to disjoint parts of the level
}

void FilmBuilder::SetMeans(const Rect& rect, const TileSums& sums) {
  const TilePlacement placement = {rect, part_};
  const Counts counts = CountsOf(sums);
  WriteCounts(placement, counts, layers::kSamplesA, layers::kSamplesB, &film_);
  for (const std::string_view layer : layers::kHalved) {
    if (model_.Has(layer)) WriteHalved(placement, sums, layer, counts, &film_);
  }
  for (const std::string_view layer : layers::kWhole) {
    if (model_.Has(layer)) WriteWhole(placement, sums, layer, counts, model_.carried.lens, &film_);
  }
  if (model_.has_matte) WriteMatte(placement, sums, counts, &film_);
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    if (sums.Has(OfLevel(Level::Of(i), layers::kSamplesA))) SetLevelMeans(rect, sums, Level::Of(i));
  }
  LayeredImage fragments = EdgesInside(sums.fragments().Means(FilmFragmentChannels(model_)), part_);
  absl::MutexLock lock(&mutex_);
  fragments_.push_back(std::move(fragments));
}

void FilmBuilder::SetLevelMeans(const Rect& rect, const TileSums& sums, Level level) {
  const TilePlacement placement = {rect, part_};
  const std::string samples_a = OfLevel(level, layers::kSamplesA);
  const std::string samples_b = OfLevel(level, layers::kSamplesB);
  const Counts level_counts = {sums.Of(samples_a), sums.Of(samples_b)};
  LayeredImage* film = LevelOf(level);
  WriteCounts(placement, level_counts, samples_a, samples_b, film);
  for (const std::string_view layer : layers::kLevelHalved)
    WriteHalved(placement, sums, OfLevel(level, layer), level_counts, film);
  for (const std::string_view layer : layers::kLevelWhole)
    WriteWhole(placement, sums, OfLevel(level, layer), CountsOf(sums), model_.carried.lens, film);
}

void FilmBuilder::SetGeometry(const Rect& rect, const LayeredImage& geometry) {
  const TilePlacement placement = {rect, part_};
  const auto copy = [&](const std::string& name, LayeredImage* film) {
    CopyPlane(geometry.Get(name).Crop(placement.InTile()), film->Get(name).Crop(placement.InPart()));
  };
  for (const std::string& name : GeometryChannels(model_)) copy(name, &film_);
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    const std::vector<std::string> names = layers::LevelFeatureChannels(Level::Of(i));
    if (!geometry.Has(names.front())) continue;
    LayeredImage* film = LevelOf(Level::Of(i));
    for (const std::string& name : names) copy(name, film);
  }
}

void FilmBuilder::AddEdges(const LayeredImage& edges) {
  LayeredImage inside = EdgesInside(edges, part_);
  absl::MutexLock lock(&mutex_);
  edges_.push_back(std::move(inside));
}

EdgedImage FilmBuilder::Take() {
  absl::MutexLock lock(&mutex_);
  levels_.MoveTo(&film_);
  return {std::move(film_), AssembleLists(edges_, layers::EdgeChannels()),
          AssembleLists(fragments_, FilmFragmentChannels(model_))};
}

std::vector<std::string> FilmFragmentChannels(const UnitModel& model) {
  if (PassFragmentChannels(model).empty()) return {};
  return layers::FragmentChannels([&model](std::string_view layer) { return IsInFilm(layer, model); });
}

}  // namespace lumifold::film
