#include "filter/image/reduce.h"

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "filter/image/layers.h"

namespace lumifold {
namespace {

/// How a channel is reduced.
struct Rule {
  enum Kind { kMean, kSum, kMiddle } kind = kMean;
  /// The channels of sample counts that weight a mean; none: all pixels count alike.
  std::vector<std::string> weights = {};
};

/// "reflection1_" of a channel of a level; otherwise empty.
std::string_view LevelPrefixOf(std::string_view channel) {
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    const std::string prefix = layers::NameOf(layers::Level::Of(i)) + "_";
    if (channel.starts_with(prefix)) return channel.substr(0, prefix.size());
  }
  return {};
}

bool IsHalved(std::string_view layer) {
  return std::find(layers::kHalved.begin(), layers::kHalved.end(), layer) != layers::kHalved.end();
}

Rule RuleOf(std::string_view channel, const LayeredImage& film) {
  const std::string prefix(LevelPrefixOf(channel));
  const std::string_view name = channel.substr(prefix.size());
  if (name == layers::kSamplesA || name == layers::kSamplesB) return {Rule::kSum};
  if (name == layers::kObjectId) return {Rule::kMiddle};
  const std::string_view layer = name.substr(0, name.rfind('.'));
  if (!film.HasColor(prefix + std::string(layer))) return {};
  const std::string a(layers::kSamplesA);
  const std::string b(layers::kSamplesB);
  for (const std::string_view halved : layers::kHalved) {
    if (layer == layers::HalfA(halved)) return {Rule::kMean, {prefix + a}};
    if (layer == layers::HalfB(halved)) return {Rule::kMean, {prefix + b}};
  }
  if (IsHalved(layer)) return {Rule::kMean, {prefix + a, prefix + b}};
  return {Rule::kMean, {a, b}};  // over all samples of the pixel
}

/// The pixels that one of the reduced film stands for.
Rect BlockOf(const LayeredImage& film, int factor, int x, int y) {
  return Intersect({x * factor, y * factor, (x + 1) * factor, (y + 1) * factor}, film.bounds());
}

/// Calls `add` with each value of the block and its weight.
template <typename Add>
void ForEachValue(const Rect& block, const ConstFloatView& values, const std::vector<ConstFloatView>& weights,
                  Add add) {
  for (int y = block.y0; y < block.y1; ++y) {
    for (int x = block.x0; x < block.x1; ++x) {
      double weight = weights.empty() ? 1.0 : 0.0;
      for (const ConstFloatView& counts : weights) weight += counts.At(x, y);
      add(values.At(x, y), weight);
    }
  }
}

float ValueOf(const Rule& rule, const Rect& block, const ConstFloatView& values,
              const std::vector<ConstFloatView>& weights) {
  if (rule.kind == Rule::kMiddle) return values.At((block.x0 + block.x1) / 2, (block.y0 + block.y1) / 2);
  double sum = 0;
  double total = 0;
  ForEachValue(block, values, weights, [&](double value, double weight) {
    sum += value * weight;
    total += weight;
  });
  if (rule.kind == Rule::kSum) return static_cast<float>(sum);
  return total > 0 ? static_cast<float>(sum / total) : 0.0F;
}

}  // namespace

LayeredImage ReduceFilm(const LayeredImage& film, int factor) {
  LayeredImage reduced((film.width() + factor - 1) / factor, (film.height() + factor - 1) / factor);
  for (const LayeredImage::Channel& channel : film.channels()) {
    const Rule rule = RuleOf(channel.name, film);
    std::vector<ConstFloatView> weights;
    for (const std::string& name : rule.weights) {
      if (film.Has(name)) weights.push_back(film.Get(name));
    }
    const ConstFloatView values = channel.plane.view();
    const FloatView result = reduced.Add(channel.name);
    for (int y = 0; y < reduced.height(); ++y) {
      for (int x = 0; x < reduced.width(); ++x)
        result.At(x, y) = ValueOf(rule, BlockOf(film, factor, x, y), values, weights);
    }
  }
  return reduced;
}

}  // namespace lumifold
