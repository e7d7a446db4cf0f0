#include "worker/render/environment.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "filter/image/color.h"
#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

using scene::Vec2;
using scene::Vec3;

/// The cell of a distribution that contains u, and the position of u within it, 0 to 1.
struct CellPick {
  int cell;
  float fraction;
};

/// `cdf` has count + 1 entries from 0 to 1. Cells of weight 0 are never picked.
CellPick PickCell(const float* cdf, int count, float u) {
  const float* above = std::upper_bound(cdf + 1, cdf + count, u);
  const int cell = static_cast<int>(above - cdf) - 1;
  const float share = cdf[cell + 1] - cdf[cell];
  return {cell, share > 0 ? std::min((u - cdf[cell]) / share, 1.0f) : 0.5f};
}

/// Writes the cumulative distribution of `weights` to cdf[0..count]; returns the sum of the weights.
double FillCdf(const double* weights, int count, float* cdf) {
  double total = 0;
  for (int i = 0; i < count; ++i) total += weights[i];
  double sum = 0;
  for (int i = 0; i < count; ++i) {
    cdf[i] = total > 0 ? static_cast<float>(sum / total) : static_cast<float>(i) / static_cast<float>(count);
    sum += weights[i];
  }
  cdf[count] = 1;
  return total;
}

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
  texels_.reserve(static_cast<size_t>(width_) * static_cast<size_t>(height_));
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const Vec3 value = Vec3{color[0].At(x, y), color[1].At(x, y), color[2].At(x, y)} * scale;
      const bool good = std::isfinite(value.x) && std::isfinite(value.y) && std::isfinite(value.z) &&
                        value.x >= 0 && value.y >= 0 && value.z >= 0;
      if (!good) ++bad_texels_;
      texels_.push_back(good ? value : Vec3{});
    }
  }
}

/// Mean luminance of the bilinear picture over each texel's area. Neighbours contribute to it, so no texel
/// that emits light anywhere has weight 0.
std::vector<float> Environment::CellLuminances() const {
  constexpr float kSide = 0.125f;
  constexpr float kMiddle = 0.75f;
  const auto row_begin = [&](int y) { return static_cast<size_t>(y) * static_cast<size_t>(width_); };
  std::vector<float> across(texels_.size());
  for (int y = 0; y < height_; ++y) {
    const Vec3* row = &texels_[row_begin(y)];
    const auto at = [&](int x) { return Luminance(row[x].x, row[x].y, row[x].z); };
    for (int x = 0; x < width_; ++x) {
      const int left = x == 0 ? width_ - 1 : x - 1;
      const int right = x == width_ - 1 ? 0 : x + 1;
      across[row_begin(y) + x] = kSide * (at(left) + at(right)) + kMiddle * at(x);
    }
  }
  std::vector<float> mean(texels_.size());
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
  const size_t stride = static_cast<size_t>(width_) + 1;
  column_cdf_.resize(stride * static_cast<size_t>(height_));
  std::vector<double> columns(width_);
  std::vector<double> rows(height_);
  for (int y = 0; y < height_; ++y) {
    const double cell_angle =
        2.0 * static_cast<double>(kPi) / width_ * static_cast<double>(row_cos_[y] - row_cos_[y + 1]);
    for (int x = 0; x < width_; ++x)
      columns[x] = static_cast<double>(luminances[static_cast<size_t>(y) * width_ + x]);
    rows[y] = FillCdf(columns.data(), width_, &column_cdf_[stride * static_cast<size_t>(y)]) * cell_angle;
  }
  row_cdf_.resize(static_cast<size_t>(height_) + 1);
  fluence_ = FillCdf(rows.data(), height_, row_cdf_.data());
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
  const auto left = (static_cast<int>(floor_x) + width_) % width_;
  const int right = left == width_ - 1 ? 0 : left + 1;
  const int top = std::clamp(static_cast<int>(floor_y), 0, height_ - 1);
  const int bottom = std::clamp(static_cast<int>(floor_y) + 1, 0, height_ - 1);
  const Vec3* upper = &texels_[static_cast<size_t>(top) * static_cast<size_t>(width_)];
  const Vec3* lower = &texels_[static_cast<size_t>(bottom) * static_cast<size_t>(width_)];
  const float fx = x - floor_x;
  return Lerp(Lerp(upper[left], upper[right], fx), Lerp(lower[left], lower[right], fx), y - floor_y);
}

Vec3 Environment::Radiance(Vec3 direction) const { return Interpolate(PointOf(direction)); }

float Environment::CellDensity(int column, int row) const {
  const float* columns = &column_cdf_[(static_cast<size_t>(width_) + 1) * static_cast<size_t>(row)];
  const float probability = (row_cdf_[row + 1] - row_cdf_[row]) * (columns[column + 1] - columns[column]);
  return probability * static_cast<float>(width_) / (2.0f * kPi * (row_cos_[row] - row_cos_[row + 1]));
}

float Environment::Density(Vec3 direction) const {
  const TexelPoint point = PointOf(direction);
  return CellDensity(std::clamp(static_cast<int>(point.x), 0, width_ - 1),
                     std::clamp(static_cast<int>(point.y), 0, height_ - 1));
}

EnvironmentSample Environment::Sample(Vec2 u) const {
  const CellPick row = PickCell(row_cdf_.data(), height_, u.y);
  const float* columns = &column_cdf_[(static_cast<size_t>(width_) + 1) * static_cast<size_t>(row.cell)];
  const CellPick column = PickCell(columns, width_, u.x);
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
