#include "server/film/tile_fragments.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <string_view>
#include <utility>

#include "filter/image/layers.h"

namespace lumifold::film {
namespace {

bool IsOfLayer(const std::string& channel, const std::string& layer) {
  return channel.size() == layer.size() + 2 && channel.starts_with(layer) && channel[layer.size()] == '.';
}

bool IsPlace(std::string_view channel) {
  return channel == layers::kPixelX || channel == layers::kPixelY || channel == layers::kSurface;
}

/// What the sums of a channel are divided by.
enum class Over { kNothing, kSamplesOfA, kSamplesOfB, kSamples };

Over DivisorOf(const std::string& channel) {
  if (channel == layers::kSamplesA || channel == layers::kSamplesB) return Over::kNothing;
  for (const std::string_view layer : layers::kFragmentHalved) {
    if (IsOfLayer(channel, layers::HalfA(layer))) return Over::kSamplesOfA;
    if (IsOfLayer(channel, layers::HalfB(layer))) return Over::kSamplesOfB;
  }
  return Over::kSamples;
}

double NumberOf(Over over, double a, double b) {
  switch (over) {
    case Over::kNothing:
      return 1;
    case Over::kSamplesOfA:
      return a;
    case Over::kSamplesOfB:
      return b;
    case Over::kSamples:
      return a + b;
  }
  return 0;
}

}  // namespace

void TileFragments::Add(const LayeredImage& pass) {
  if (pass.channels().empty()) return;
  const ConstFloatView x = pass.Get(layers::kPixelX);
  const ConstFloatView y = pass.Get(layers::kPixelY);
  const ConstFloatView surface = pass.Get(layers::kSurface);
  std::vector<Place> added;
  added.reserve(pass.height());
  for (int row = 0; row < pass.height(); ++row)
    added.emplace_back(y.At(0, row), x.At(0, row), surface.At(0, row));
  std::vector<Place> merged;
  std::set_union(places_.begin(), places_.end(), added.begin(), added.end(), std::back_inserter(merged));
  if (names_.empty()) {
    for (const LayeredImage::Channel& channel : pass.channels()) {
      if (!IsPlace(channel.name)) names_.push_back(channel.name);
    }
    sums_.resize(names_.size());
  }
  for (size_t c = 0; c < names_.size(); ++c) {
    const ConstFloatView values = pass.Get(names_[c]);
    std::vector<double> sums(merged.size());
    for (size_t i = 0, before = 0, row = 0; i < merged.size(); ++i) {
      if (before < places_.size() && places_[before] == merged[i]) sums[i] += sums_[c][before++];
      if (row < added.size() && added[row] == merged[i]) sums[i] += values.At(0, static_cast<int>(row++));
    }
    sums_[c] = std::move(sums);
  }
  places_ = std::move(merged);
}

const std::vector<double>* TileFragments::Find(const std::string& channel) const {
  const auto found = std::find(names_.begin(), names_.end(), channel);
  return found == names_.end() ? nullptr : &sums_[static_cast<size_t>(found - names_.begin())];
}

LayeredImage TileFragments::Means(const std::vector<std::string>& channels) const {
  if (places_.empty()) return {};
  LayeredImage means = LayeredImage::List(1, static_cast<int>(places_.size()));
  for (const std::string& channel : channels) FillMeans(channel, means.Add(channel));
  FillPlaces(&means);
  return means;
}

void TileFragments::FillMeans(const std::string& channel, const FloatView& means) const {
  const std::vector<double>* const sums = Find(channel);
  if (sums == nullptr) return;
  const std::vector<double>& a = *Find(std::string(layers::kSamplesA));
  const std::vector<double>& b = *Find(std::string(layers::kSamplesB));
  const Over over = DivisorOf(channel);
  for (size_t i = 0; i < sums->size(); ++i) {
    const double number = NumberOf(over, a[i], b[i]);
    means.At(0, static_cast<int>(i)) = static_cast<float>(number > 0 ? (*sums)[i] / number : 0.0);
  }
}

void TileFragments::FillPlaces(LayeredImage* means) const {
  const FloatView x = means->Get(layers::kPixelX);
  const FloatView y = means->Get(layers::kPixelY);
  const FloatView surface = means->Get(layers::kSurface);
  for (int row = 0; row < means->height(); ++row)
    std::tie(y.At(0, row), x.At(0, row), surface.At(0, row)) = places_[static_cast<size_t>(row)];
}

}  // namespace lumifold::film
