#include "worker/render/lights/environment.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "filter/image/color.h"
#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

using scene::Vec2;
using scene::Vec3;

/// A texel is read as a vector of four, the last of which is not used.
using Four [[gnu::vector_size(4 * sizeof(float))]] = float;

Four Load(const float* texel) {
  Four value;
  std::memcpy(&value, texel, sizeof(value));
  return value;
}

Four Mix(Four a, Four b, float t) { return a * (1.0f - t) + b * t; }

}  // namespace

absl::StatusOr<std::shared_ptr<const Environment>> Environment::Create(const LayeredImage& picture,
                                                                       float rotate_degrees, float scale) {
  if (picture.width() <= 0 || picture.height() <= 0 || !picture.HasColor(""))
    return absl::InvalidArgumentError("the environment has no pixels");
  if (!std::isfinite(rotate_degrees) || !std::isfinite(scale) || scale <= 0)
    return absl::InvalidArgumentError("the environment's rotation or scale is no finite number");
  std::shared_ptr<const Environment> environment(new Environment(picture, rotate_degrees, scale));
  if (environment->fluence_ <= 0) return absl::InvalidArgumentError("the environment is black");
  return environment;
}

Environment::Environment(const LayeredImage& picture, float rotate_degrees, float scale)
    : width_(picture.width()), height_(picture.height()) {
  SinCos(std::remainder(rotate_degrees, 360.0f) * (kPi / 180.0f), &sin_turn_, &cos_turn_);
  ReadTexels(picture, scale);
  BuildDistribution();
}

void Environment::ReadTexels(const LayeredImage& picture, float scale) {
  const ConstColorView color = picture.GetColor("");
  texels_.resize(TexelIndex(0, height_) + 1);
  float* texel = texels_.data();
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x, texel += kChannels) {
      const Vec3 value = Vec3{color[0].At(x, y), color[1].At(x, y), color[2].At(x, y)} * scale;
      const bool good = std::isfinite(value.x) && std::isfinite(value.y) && std::isfinite(value.z) &&
                        value.x >= 0 && value.y >= 0 && value.z >= 0;
      if (!good) {
        ++bad_texels_;
        continue;
      }
      texel[0] = value.x;
      texel[1] = value.y;
      texel[2] = value.z;
    }
  }
}

/// Mean luminance of the bilinear picture over each texel's area. Neighbours contribute to it, so no texel
/// that emits light anywhere has weight 0.
std::vector<float> Environment::CellLuminances() const {
  constexpr float kSide = 0.125f;
  constexpr float kMiddle = 0.75f;
  const auto row_begin = [&](int y) { return static_cast<size_t>(y) * static_cast<size_t>(width_); };
  std::vector<float> across(row_begin(height_));
  for (int y = 0; y < height_; ++y) {
    const auto at = [&](int x) {
      const float* texel = &texels_[TexelIndex(x, y)];
      return Luminance(texel[0], texel[1], texel[2]);
    };
    for (int x = 0; x < width_; ++x) {
      const int left = x == 0 ? width_ - 1 : x - 1;
      const int right = x == width_ - 1 ? 0 : x + 1;
      across[row_begin(y) + x] = kSide * (at(left) + at(right)) + kMiddle * at(x);
    }
  }
  std::vector<float> mean(across.size());
  for (int y = 0; y < height_; ++y) {
    const float* above = &across[row_begin(std::max(y - 1, 0))];
    const float* here = &across[row_begin(y)];
    const float* below = &across[row_begin(std::min(y + 1, height_ - 1))];
    for (int x = 0; x < width_; ++x)
      mean[row_begin(y) + x] = kSide * (above[x] + below[x]) + kMiddle * here[x];
  }
  return mean;
}

void Environment::BuildDistribution() {
  const std::vector<float> luminances = CellLuminances();
  for (int y = 0; y <= height_; ++y) {
    float sine = 0;
    float cosine = 0;
    SinCos(kPi * static_cast<float>(y) / static_cast<float>(height_), &sine, &cosine);
    row_cos_.push_back(cosine);
  }
  row_cos_.front() = 1;
  row_cos_.back() = -1;
  columns_ = CellDistributions(height_, width_);
  rows_ = CellDistributions(1, height_);
  std::vector<double> columns(width_);
  std::vector<double> rows(height_);
  for (int y = 0; y < height_; ++y) {
    const double cell_angle =
        2.0 * static_cast<double>(kPi) / width_ * static_cast<double>(row_cos_[y] - row_cos_[y + 1]);
    for (int x = 0; x < width_; ++x)
      columns[x] = static_cast<double>(luminances[static_cast<size_t>(y) * width_ + x]);
    rows[y] = columns_.Fill(y, columns.data()) * cell_angle;
  }
  fluence_ = rows_.Fill(0, rows.data());
}

Environment::TexelPoint Environment::PointOf(Vec3 direction) const {
  // Inverse rotation, into the picture's frame.
  const float x = cos_turn_ * direction.x - sin_turn_ * direction.z;
  const float z = sin_turn_ * direction.x + cos_turn_ * direction.z;
  const float u = 0.5f + Atan2(z, x) / (2.0f * kPi);
  const float v = Acos(direction.y) / kPi;
  return {u * static_cast<float>(width_), v * static_cast<float>(height_)};
}

Vec3 Environment::Interpolate(TexelPoint point) const {
  const float x = point.x - 0.5f;
  const float y = point.y - 0.5f;
  const float floor_x = std::floor(x);
  const float floor_y = std::floor(y);
  int left = static_cast<int>(floor_x);
  if (left < 0) left += width_;
  if (left >= width_) left -= width_;
  const int right = left == width_ - 1 ? 0 : left + 1;
  const int top = std::clamp(static_cast<int>(floor_y), 0, height_ - 1);
  const int bottom = std::clamp(static_cast<int>(floor_y) + 1, 0, height_ - 1);
  const auto at = [this](int column, int row) { return Load(&texels_[TexelIndex(column, row)]); };
  const float fx = x - floor_x;
  const Four upper = Mix(at(left, top), at(right, top), fx);
  const Four value = Mix(upper, Mix(at(left, bottom), at(right, bottom), fx), y - floor_y);
  return {value[0], value[1], value[2]};
}

Vec3 Environment::Radiance(Vec3 direction) const { return Interpolate(PointOf(direction)); }

float Environment::CellDensity(int column, int row) const {
  const float probability = rows_.Share(0, row) * columns_.Share(row, column);
  return probability * static_cast<float>(width_) / (2.0f * kPi * (row_cos_[row] - row_cos_[row + 1]));
}

float Environment::Density(Vec3 direction) const {
  const TexelPoint point = PointOf(direction);
  return CellDensity(std::clamp(static_cast<int>(point.x), 0, width_ - 1),
                     std::clamp(static_cast<int>(point.y), 0, height_ - 1));
}

EnvironmentSample Environment::Sample(Vec2 u) const {
  const CellDistributions::Pick row = rows_.Sample(0, u.y);
  const CellDistributions::Pick column = columns_.Sample(row.cell, u.x);
  const float y = row_cos_[row.cell] + (row_cos_[row.cell + 1] - row_cos_[row.cell]) * row.fraction;
  const float radius = std::sqrt(std::max(0.0f, 1.0f - y * y));
  const float across = static_cast<float>(column.cell) + column.fraction;
  float sine = 0;
  float cosine = 0;
  SinCos((across / static_cast<float>(width_) - 0.5f) * (2.0f * kPi), &sine, &cosine);
  EnvironmentSample sample;
  sample.direction = {radius * (cos_turn_ * cosine + sin_turn_ * sine), y,
                      radius * (cos_turn_ * sine - sin_turn_ * cosine)};
  sample.radiance = Interpolate({across, Acos(y) / kPi * static_cast<float>(height_)});
  sample.pdf = CellDensity(column.cell, row.cell);
  return sample;
}

}  // namespace lumifold::render
