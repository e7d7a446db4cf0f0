#include "tests/stability/drawn_film.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/mix_bits.h"
#include "filter/image/planes.h"

namespace lumifold::stability {
namespace {

constexpr int kGrid = 4;  // sub-samples per axis
constexpr float kEdgeCosine = 0.9f;

/// Uniform random numbers in (0, 1], keyed by their use.
class Random {
 public:
  Random(uint32_t seed, uint64_t key) : state_(MixBits((uint64_t{seed} << 40) ^ key)) {}

  double Uniform() {
    state_ += 0x9e3779b97f4a7c15u;
    return (static_cast<double>(MixBits(state_) >> 11) + 1) * 0x1p-53;
  }
  /// 1 + deviation (x - 1), x exponentially distributed with mean 1.
  float Factor(float deviation) { return 1 + deviation * (static_cast<float>(-std::log(Uniform())) - 1); }
  /// Mean 0, standard deviation 1.
  float Normal() {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += Uniform();
    return static_cast<float>(sum);
  }

 private:
  uint64_t state_;
};

/// The points of one pixel, row by row.
std::vector<Surface> Look(const Drawing& drawing, int x, int y, int grid) {
  std::vector<Surface> surfaces;
  const float step = 1 / static_cast<float>(grid);
  for (int j = 0; j < grid; ++j) {
    for (int i = 0; i < grid; ++i) {
      surfaces.push_back(drawing(static_cast<float>(x) + (static_cast<float>(i) + 0.5f) * step,
                                 static_cast<float>(y) + (static_cast<float>(j) + 0.5f) * step));
    }
  }
  return surfaces;
}

bool IsValid(const Surface& s) { return s.object != 0 && s.has_diffuse; }

bool Differ(const Surface& a, const Surface& b) {
  const float cosine = a.normal[0] * b.normal[0] + a.normal[1] * b.normal[1] + a.normal[2] * b.normal[2];
  return a.object != b.object || IsValid(a) != IsValid(b) || cosine < kEdgeCosine;
}

void Put(const ColorView& color, int x, int y, const Triple& value) {
  for (size_t c = 0; c < 3; ++c) color[c].At(x, y) = value[c];
}

/// Sums of the samples of each layer.
struct LightSums {
  uint32_t count = 0;
  Triple noisy = {}, direct = {}, indirect = {}, albedo = {}, emission = {};

  void Add(const Surface& s, float direct_factor, float indirect_factor) {
    ++count;
    for (size_t c = 0; c < 3; ++c) {
      const float d = IsValid(s) ? s.direct[c] * direct_factor : 0;
      const float i = IsValid(s) ? s.indirect[c] * indirect_factor : 0;
      const float t = IsValid(s) ? s.albedo[c] : 0;
      noisy[c] += (d + i) * t + s.emission[c];
      direct[c] += d;
      indirect[c] += i;
      albedo[c] += t;
      emission[c] += s.emission[c];
    }
  }
};

Triple Mean(const Triple& sum, uint32_t count) {
  const float scale = count > 0 ? 1 / static_cast<float>(count) : 0;
  return {sum[0] * scale, sum[1] * scale, sum[2] * scale};
}

Triple Sum(const Triple& a, const Triple& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }

class Painter {
 public:
  Painter(int width, int height, const Drawing& drawing, const Sampling& sampling)
      : drawing_(drawing), sampling_(sampling), pixels_(width, height) {
    for (const std::string_view layer : {layers::kNoisy, layers::kDirect, layers::kIndirect}) {
      for (const std::string& name : {std::string(layer), layers::HalfA(layer), layers::HalfB(layer)})
        pixels_.AddColor(name);
    }
    for (const std::string_view layer : layers::kWhole) {
      if (layer != layers::kGlossyAlbedo) pixels_.AddColor(layer);
    }
    for (const std::string_view name :
         {layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance, layers::kObjectId,
          layers::kMask, layers::kAlpha, layers::kSamplesA, layers::kSamplesB}) {
      pixels_.Add(name);
    }
    for (Plane& plane : truth_) plane = Plane(width, height);
  }

  DrawnFilm Paint() {
    ForEachPixel(pixels_.width(), pixels_.height(), [&](int x, int y) {
      const std::vector<Surface> points = Look(drawing_, x, y, sampling_.truth_grid);
      PaintTruth(x, y, points);
      PaintLight(x, y, points);
      const std::vector<Surface> sub_samples =
          sampling_.truth_grid == kGrid ? points : Look(drawing_, x, y, kGrid);
      PaintGeometry(x, y, sub_samples);
      if (IsEdge(x, y, sub_samples)) edges_.push_back({x, y, sub_samples});
    });
    return {{std::move(pixels_), MakeEdgeSet()}, std::move(truth_)};
  }

 private:
  struct Edge {
    int x, y;
    std::vector<Surface> sub_samples;
  };

  Random RandomOf(int x, int y, uint64_t purpose) const {
    const uint64_t pixel =
        static_cast<uint64_t>(y) * static_cast<uint64_t>(pixels_.width()) + static_cast<uint64_t>(x);
    return Random(sampling_.seed, pixel * 4 + purpose);
  }

  void PaintTruth(int x, int y, const std::vector<Surface>& points) {
    std::array<double, 3> sum = {};
    for (const Surface& s : points) {
      for (size_t c = 0; c < 3; ++c) {
        const float light = IsValid(s) ? (s.direct[c] + s.indirect[c]) * s.albedo[c] : 0;
        sum[c] += static_cast<double>(light + s.emission[c]);
      }
    }
    for (size_t c = 0; c < 3; ++c)
      truth_[c].At(x, y) = static_cast<float>(sum[c] / static_cast<double>(points.size()));
  }

  LightSums SampleHalf(int x, int y, const std::vector<Surface>& points, int half) const {
    Random random = RandomOf(x, y, static_cast<uint64_t>(half));
    const uint32_t count = half == 0 ? (sampling_.samples + 1) / 2 : sampling_.samples / 2;
    // Steps through the points by about the golden ratio, so that a half covers its pixel evenly.
    const size_t first = static_cast<size_t>(random.Uniform() * static_cast<double>(points.size()));
    const size_t step = points.size() == kGrid * kGrid ? 11 : points.size() * 5 / 8 + 1;
    const bool is_spike = random.Uniform() < sampling_.spike_probability;
    const float gain = sampling_.direct_gain ? sampling_.direct_gain(x, y, half) : 1;
    LightSums sums;
    for (uint32_t i = 0; i < count; ++i) {
      const float spike = is_spike && i == 0 ? sampling_.spike_factor * static_cast<float>(count) : 1;
      const float direct = random.Factor(sampling_.noise) * spike * gain;
      const float indirect = random.Factor(sampling_.noise);
      sums.Add(points[(first + i * step) % points.size()], direct, indirect);
    }
    return sums;
  }

  void PaintLight(int x, int y, const std::vector<Surface>& points) {
    const LightSums a = SampleHalf(x, y, points, 0);
    const LightSums b = SampleHalf(x, y, points, 1);
    const uint32_t count = a.count + b.count;
    const auto put = [&](std::string_view layer, const Triple& sum_a, const Triple& sum_b) {
      Put(pixels_.GetColor(layers::HalfA(layer)), x, y, Mean(sum_a, a.count));
      Put(pixels_.GetColor(layers::HalfB(layer)), x, y, Mean(sum_b, b.count));
      Put(pixels_.GetColor(layer), x, y, Mean(Sum(sum_a, sum_b), count));
    };
    put(layers::kNoisy, a.noisy, b.noisy);
    put(layers::kDirect, a.direct, b.direct);
    put(layers::kIndirect, a.indirect, b.indirect);
    Put(pixels_.GetColor(layers::kAlbedo), x, y, Mean(Sum(a.albedo, b.albedo), count));
    Put(pixels_.GetColor(layers::kEmission), x, y, Mean(Sum(a.emission, b.emission), count));
    pixels_.Get(layers::kSamplesA).At(x, y) = static_cast<float>(a.count);
    pixels_.Get(layers::kSamplesB).At(x, y) = static_cast<float>(b.count);
  }

  void PaintGeometry(int x, int y, const std::vector<Surface>& sub_samples) {
    Random random = RandomOf(x, y, 2);
    Triple normal = {};
    float distance = 0, hits = 0, valid = 0;
    for (const Surface& s : sub_samples) {
      if (s.object == 0) continue;
      hits += 1;
      valid += IsValid(s) ? 1.0f : 0.0f;
      for (size_t c = 0; c < 3; ++c) normal[c] += s.normal[c];
      distance += s.distance;
    }
    if (hits == 0) return;
    const float blur = sampling_.feature_noise;
    if (blur > 0) {
      for (float& component : normal) component += blur * hits * random.Normal();
      distance *= std::max(0.1f, 1 + blur * random.Normal());
    }
    const float length = std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (float& component : normal) component /= std::max(length, 1e-6f);
    Put(NormalOf(pixels_), x, y, normal);
    pixels_.Get(layers::kDistance).At(x, y) = distance / hits;
    pixels_.Get(layers::kMask).At(x, y) = valid / static_cast<float>(sub_samples.size());
    pixels_.Get(layers::kAlpha).At(x, y) = hits / static_cast<float>(sub_samples.size());
    pixels_.Get(layers::kObjectId).At(x, y) = static_cast<float>(sub_samples[0].object);
  }

  bool IsEdge(int x, int y, const std::vector<Surface>& sub_samples) const {
    for (const Surface& s : sub_samples) {
      if (Differ(s, sub_samples[0])) return true;
    }
    for (int j = std::max(y - 1, 0); j <= std::min(y + 1, pixels_.height() - 1); ++j) {
      for (int i = std::max(x - 1, 0); i <= std::min(x + 1, pixels_.width() - 1); ++i) {
        if (Differ(sub_samples[0], drawing_(static_cast<float>(i) + 0.5f, static_cast<float>(j) + 0.5f)))
          return true;
      }
    }
    return false;
  }

  static ColorView NormalOf(LayeredImage& image) {
    return {image.Get(layers::kNormalX), image.Get(layers::kNormalY), image.Get(layers::kNormalZ)};
  }

  LayeredImage MakeEdgeSet() const {
    if (edges_.empty()) return {};
    LayeredImage set(kSubSamples, static_cast<int>(edges_.size()));
    for (const std::string& name : layers::EdgeChannels()) set.Add(name);
    for (int row = 0; row < set.height(); ++row) {
      const Edge& edge = edges_[static_cast<size_t>(row)];
      for (int j = 0; j < kSubSamples; ++j) {
        const Surface& s = edge.sub_samples[static_cast<size_t>(j)];
        set.Get(layers::kPixelX).At(j, row) = static_cast<float>(edge.x);
        set.Get(layers::kPixelY).At(j, row) = static_cast<float>(edge.y);
        set.Get(layers::kObjectId).At(j, row) = static_cast<float>(s.object);
        set.Get(layers::kMask).At(j, row) = IsValid(s) ? 1.0f : 0.0f;
        Put(set.GetColor(layers::kEmission), j, row, s.emission);
        if (s.object == 0) continue;
        Put(NormalOf(set), j, row, s.normal);
        set.Get(layers::kDistance).At(j, row) = s.distance;
        if (IsValid(s)) Put(set.GetColor(layers::kAlbedo), j, row, s.albedo);
      }
    }
    return set;
  }

  const Drawing& drawing_;
  const Sampling sampling_;
  LayeredImage pixels_;
  Picture truth_;
  std::vector<Edge> edges_;
};

}  // namespace

DrawnFilm DrawFilm(int width, int height, const Drawing& drawing, const Sampling& sampling) {
  return Painter(width, height, drawing, sampling).Paint();
}

}  // namespace lumifold::stability
