#include "server/film/assemble.h"

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/layers.h"
#include "proto/rpc/image_codec.h"
#include "server/film/unit_layout.h"
#include "server/scheduler/tile_grid.h"

namespace lumifold::film {
namespace {

using scheduler::FrameUnits;
using scheduler::UnitKey;

// Sums of one tile over its passes, by channel name; each plane is the tile's rows one after another.
using TileSums = std::map<std::string, std::vector<double>, std::less<>>;

LayeredImage EmptyFilm(const v1::JobSpec& spec) {
  LayeredImage film(spec.width(), spec.height());
  for (const std::string_view layer : layers::kHalved) {
    film.AddColor(layer);
    film.AddColor(layers::HalfA(layer));
    film.AddColor(layers::HalfB(layer));
  }
  film.AddColor(layers::kAlbedo);
  film.AddColor(layers::kEmission);
  film.Add(layers::kSamplesA);
  film.Add(layers::kSamplesB);
  for (const std::string& name : GeometryChannels()) film.Add(name);
  return film;
}

absl::StatusOr<LayeredImage> ReadChecked(const UnitKey& key, const Rect& rect, UnitSource read) {
  absl::StatusOr<LayeredImage> unit = read(key);
  if (!unit.ok()) return unit.status();
  if (absl::Status status = CheckUnitLayout(key.kind, rect, rpc::LayoutOf(*unit)); !status.ok())
    return status;
  return unit;
}

void AddPass(const LayeredImage& pass, TileSums* sums) {
  for (const LayeredImage::Channel& channel : pass.channels()) {
    std::vector<double>& sum = (*sums)[channel.name];
    sum.resize(static_cast<size_t>(pass.width()) * static_cast<size_t>(pass.height()));
    auto next = sum.begin();
    for (int y = 0; y < pass.height(); ++y) {
      const float* row = channel.plane.Row(y);
      for (int x = 0; x < pass.width(); ++x) *next++ += row[x];
    }
  }
}

// Writes value(i) for each pixel i of the tile, rows one after another, into `channel` of the film.
template <typename Value>
void WriteTile(const Rect& rect, std::string_view channel, LayeredImage* film, Value value) {
  const FloatView view = film->Get(channel).Crop(rect);
  size_t i = 0;
  for (int y = 0; y < rect.height(); ++y) {
    for (int x = 0; x < rect.width(); ++x) view.At(x, y) = static_cast<float>(value(i++));
  }
}

double Mean(double sum, double count) { return count > 0.0 ? sum / count : 0.0; }

void WriteMeans(const TileSums& sums, const Rect& rect, LayeredImage* film) {
  const std::vector<double>& count_a = sums.find(layers::kSamplesA)->second;
  const std::vector<double>& count_b = sums.find(layers::kSamplesB)->second;
  WriteTile(rect, layers::kSamplesA, film, [&](size_t i) { return count_a[i]; });
  WriteTile(rect, layers::kSamplesB, film, [&](size_t i) { return count_b[i]; });
  for (const std::string_view layer : layers::kHalved) {
    const auto both = layers::ColorChannels(layer);
    const auto half_a = layers::ColorChannels(layers::HalfA(layer));
    const auto half_b = layers::ColorChannels(layers::HalfB(layer));
    for (size_t c = 0; c < both.size(); ++c) {
      const std::vector<double>& a = sums.find(half_a[c])->second;
      const std::vector<double>& b = sums.find(half_b[c])->second;
      WriteTile(rect, both[c], film, [&](size_t i) { return Mean(a[i] + b[i], count_a[i] + count_b[i]); });
      WriteTile(rect, half_a[c], film, [&](size_t i) { return Mean(a[i], count_a[i]); });
      WriteTile(rect, half_b[c], film, [&](size_t i) { return Mean(b[i], count_b[i]); });
    }
  }
  for (const std::string_view layer : {layers::kAlbedo, layers::kEmission}) {
    for (const std::string& name : layers::ColorChannels(layer)) {
      const std::vector<double>& sum = sums.find(name)->second;
      WriteTile(rect, name, film, [&](size_t i) { return Mean(sum[i], count_a[i] + count_b[i]); });
    }
  }
}

absl::Status AssembleTile(const FrameUnits& units, int32_t frame, int32_t tile, UnitSource read,
                          LayeredImage* film) {
  const Rect rect = units.tiles().RectOf(tile);
  TileSums sums;
  for (int32_t pass = 0; pass < units.pass_count(); ++pass) {
    const absl::StatusOr<LayeredImage> unit =
        ReadChecked({frame, tile, pass, v1::UNIT_KIND_PASS}, rect, read);
    if (!unit.ok()) return unit.status();
    AddPass(*unit, &sums);
  }
  WriteMeans(sums, rect, film);
  const absl::StatusOr<LayeredImage> geometry =
      ReadChecked({frame, tile, 0, v1::UNIT_KIND_GEOMETRY}, rect, read);
  if (!geometry.ok()) return geometry.status();
  for (const LayeredImage::Channel& channel : geometry->channels()) {
    CopyPlane(channel.plane.view(), film->Get(channel.name).Crop(rect));
  }
  return absl::OkStatus();
}

// The error of the lowest tile, so that which one is told does not depend on the race between threads.
class FirstError {
 public:
  void Offer(int64_t tile, absl::Status status) {
    absl::MutexLock lock(&mutex_);
    if (!status.ok()) errors_.emplace(tile, std::move(status));
  }
  absl::Status Get() {
    absl::MutexLock lock(&mutex_);
    return errors_.empty() ? absl::OkStatus() : errors_.begin()->second;
  }

 private:
  absl::Mutex mutex_;
  std::map<int64_t, absl::Status> errors_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

absl::StatusOr<LayeredImage> AssembleFilm(const v1::JobSpec& spec, int32_t frame, UnitSource read,
                                          TaskPool* pool) {
  const FrameUnits units(spec);
  LayeredImage film = EmptyFilm(spec);
  FirstError error;
  ParallelFor(pool, units.tiles().count(), [&](int64_t tile) {
    error.Offer(tile, AssembleTile(units, frame, static_cast<int32_t>(tile), read, &film));
  });
  if (absl::Status status = error.Get(); !status.ok()) return status;
  return film;
}

}  // namespace lumifold::film
