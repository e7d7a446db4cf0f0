#include "tests/charts/methods/samples/neighbourhood.h"

#include <algorithm>
#include <cmath>

#include "filter/image/mix_bits.h"
#include "filter/image/portable_math.h"

namespace lumifold::charts {
namespace {

using scene::Vec3;

struct Moments {
  double mean = 0;
  double deviation = 0;
};

Moments MomentsOf(absl::Span<const float> values) {
  Moments moments;
  for (const float value : values) moments.mean += static_cast<double>(value);
  moments.mean /= static_cast<double>(values.size());
  double sum = 0;
  for (const float value : values) {
    const double off = static_cast<double>(value) - moments.mean;
    sum += off * off;
  }
  moments.deviation = std::sqrt(sum / static_cast<double>(values.size()));
  return moments;
}

/// The random stream of one pixel and pass.
class Stream {
 public:
  Stream(int64_t pixel, int pass)
      : key_(MixBits(MixBits(static_cast<uint64_t>(pixel) + 1) + static_cast<uint64_t>(pass))) {}

  /// In [0, 1).
  float Uniform() {
    return static_cast<float>(MixBits(key_ + 0x9e3779b97f4a7c15u * ++drawn_) >> 40) * 0x1p-24f;
  }

 private:
  uint64_t key_;
  uint64_t drawn_ = 0;
};

struct Offset {
  int x = 0;
  int y = 0;
};

/// Normally distributed in both directions. Source: Box & Muller 1958.
Offset NormalOffset(float sigma, Stream* stream) {
  const float radius = sigma * std::sqrt(-2.0f * Log(1.0f - stream->Uniform()));
  float sine = 0;
  float cosine = 0;
  SinCos(2.0f * kPi * stream->Uniform(), &sine, &cosine);
  return {static_cast<int>(std::floor(radius * cosine + 0.5f)),
          static_cast<int>(std::floor(radius * sine + 0.5f))};
}

/// Accepts samples whose features are similar to those of one pixel's samples.
class FeatureGate {
 public:
  explicit FeatureGate(const Neighbourhood& own) {
    for (size_t f = 0; f < moments_.size(); ++f)
      moments_[f] = MomentsOf(own.Standard(Variables::kFeature + f));
  }

  bool Accepts(const Variables::Values& values) const {
    constexpr double kTolerance = 0.1;  // smaller differences count as equal even without variance
    for (size_t f = 0; f < moments_.size(); ++f) {
      const bool is_world = Variables::kFeature + f < Variables::kWorld + 3;
      const double off = std::abs(static_cast<double>(values[Variables::kFeature + f]) - moments_[f].mean);
      const bool matters = off > kTolerance || moments_[f].deviation > kTolerance;
      if (matters && off > (is_world ? 30 : 3) * moments_[f].deviation) return false;
    }
    return true;
  }

 private:
  std::array<Moments, Variables::kCount - Variables::kFeature> moments_;
};

}  // namespace

Variables::Values Variables::Of(const ChartSample& s, Vec3 color) {
  return {s.point.x,     s.point.y,     color.x,       color.y,       color.z,       s.lens.x,
          s.lens.y,      s.random[0].x, s.random[0].y, s.random[1].x, s.random[1].y, s.random[2].x,
          s.random[2].y, s.position.x,  s.position.y,  s.position.z,  s.normal.x,    s.normal.y,
          s.normal.z,    s.albedo.x,    s.albedo.y,    s.albedo.z};
}

void Neighbourhood::Clear() {
  colors_.clear();
  for (std::vector<float>& values : standard_) values.clear();
}

void Neighbourhood::Add(const Variables::Values& values, Vec3 color) {
  for (size_t v = 0; v < values.size(); ++v) standard_[v].push_back(values[v]);
  colors_.push_back(color);
}

void Neighbourhood::Draw(const SampleSet& set, const std::vector<Vec3>& colors, int x, int y, int pass,
                         int side, size_t most) {
  Clear();
  const auto index_of = [&](int px, int py, uint32_t i) {
    return (static_cast<size_t>(py) * static_cast<size_t>(set.width) + static_cast<size_t>(px)) *
               set.samples_per_pixel +
           i;
  };
  for (uint32_t i = 0; i < set.samples_per_pixel; ++i) {
    const Vec3 color = colors[index_of(x, y, i)];
    Add(Variables::Of(set.At(x, y, i), color), color);
  }
  const FeatureGate gate(*this);
  Stream stream(int64_t{y} * set.width + x, pass);
  for (size_t drawn = set.samples_per_pixel; drawn < most; ++drawn) {
    const Offset offset = NormalOffset(static_cast<float>(side) / 4, &stream);
    const float pick = stream.Uniform() * static_cast<float>(set.samples_per_pixel);
    const int qx = x + offset.x;
    const int qy = y + offset.y;
    const bool is_own = offset.x == 0 && offset.y == 0;
    const bool is_within = std::max(std::abs(offset.x), std::abs(offset.y)) <= side / 2 && qx >= 0 &&
                           qy >= 0 && qx < set.width && qy < set.height;
    if (is_own || !is_within) continue;
    const uint32_t i = std::min(static_cast<uint32_t>(pick), set.samples_per_pixel - 1);
    const size_t index = index_of(qx, qy, i);
    const Variables::Values values = Variables::Of(set.samples[index], colors[index]);
    if (gate.Accepts(values)) Add(values, colors[index]);
  }
  Standardise();
}

void Neighbourhood::Standardise() {
  constexpr double kLeastDeviation = 1e-6;  // of the largest magnitude: less is rounding
  for (std::vector<float>& values : standard_) {
    const Moments moments = MomentsOf(values);
    const bool varies = moments.deviation > kLeastDeviation * std::max(1e-20, std::abs(moments.mean));
    const double scale = varies ? 1.0 / moments.deviation : 0.0;
    for (float& value : values)
      value = static_cast<float>((static_cast<double>(value) - moments.mean) * scale);
  }
}

}  // namespace lumifold::charts
