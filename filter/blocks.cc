#include "filter/blocks.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/denoise/denoise.h"
#include "filter/image/check.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"

namespace lumifold::filter {
namespace {

int RoundUp(int value, int step) { return (value + step - 1) / step * step; }

/// Whether a frame of this size is one block.
bool IsWhole(int width, int height, const BlockParams& params) {
  return int64_t{width} * height <= params.whole && std::max(width, height) <= params.longest;
}

BlockParams OneBlock(int width, int height, BlockParams params) {
  params.core = RoundUp(std::max({width, height, 2 * params.fade}), kBandRows);
  return params;
}

/// The rows of the picture that are being blended.
class Strip {
 public:
  Strip(const BlockGrid& grid, const std::vector<std::string>& passed_on,
        const std::vector<std::string_view>& pictures)
      : grid_(grid), passed_on_(passed_on), pictures_(pictures) {}

  /// Allocates the rows that block row `row` overlaps, and keeps the unfinished rows of the block row above.
  void Begin(int row) {
    const Rect last = grid_.Output(grid_.columns() - 1, row);
    const LayeredImage left = std::move(rows_);
    rows_ = LayeredImage(last.x1, last.y1 - first_row_);
    const auto add = [&](const std::string& name) {
      const FloatView view = rows_.Add(name);
      if (left.height() > 0) CopyPlane(left.Get(name), view.Crop(left.bounds()));
    };
    for (const std::string& name : passed_on_) add(name);
    for (const std::string_view picture : pictures_) {
      for (const std::string& name : layers::ColorChannels(picture)) add(name);
    }
  }

  /// Blends in the result of a block, and copies the passed-on channels of its core.
  absl::Status Add(int column, int row, const LayeredImage& film, const std::vector<Picture>& filtered) {
    const Rect core = grid_.Core(column, row);
    const Rect input = grid_.Input(column, row);
    for (const std::string& name : passed_on_) {
      if (!film.Has(name)) return absl::InvalidArgumentError(absl::StrCat("the film has no channel ", name));
      CopyPlane(film.Get(name).Crop(SeenFrom(input.x0, input.y0, core)),
                rows_.Get(name).Crop(SeenFrom(0, first_row_, core)));
    }
    AddPictures(column, row, input, filtered);
    return absl::OkStatus();
  }

  /// Blends in the result of a block, which has the pixels of `rect`.
  void AddPictures(int column, int row, const Rect& rect, const std::vector<Picture>& filtered) {
    const Rect output = grid_.Output(column, row);
    for (int y = output.y0; y < output.y1; ++y) {
      const std::vector<float> factors = grid_.BlendFactors(column, row, y);
      for (size_t i = 0; i < pictures_.size(); ++i)
        Blend(factors, output, rect, y, filtered[i], rows_.GetColor(pictures_[i]));
    }
  }

  /// Removes and returns the rows that no later block overlaps.
  LayeredImage TakeFinished(int row) {
    const int end = row + 1 < grid_.rows() ? grid_.Output(0, row + 1).y0 : first_row_ + rows_.height();
    const int count = end - first_row_;
    LayeredImage left = rows_.Crop({0, count, rows_.width(), rows_.height()});
    rows_.Truncate(count);
    LayeredImage finished = std::exchange(rows_, std::move(left));
    first_row_ = end;
    return finished;
  }

 private:
  void Blend(const std::vector<float>& factors, const Rect& output, const Rect& rect, int y,
             const Picture& filtered, const ColorView& rows) {
    for (size_t c = 0; c < filtered.size(); ++c) {
      const float* from = filtered[c].Row(y - rect.y0) + output.x0 - rect.x0;
      float* to = rows[c].Row(y - first_row_) + output.x0;
      for (size_t x = 0; x < factors.size(); ++x) {
        to[x] = factors[x] < 1.0f ? to[x] + factors[x] * (from[x] - to[x]) : from[x];
      }
    }
  }

  const BlockGrid& grid_;
  const std::vector<std::string>& passed_on_;      // channels
  const std::vector<std::string_view>& pictures_;  // layers
  LayeredImage rows_;
  int first_row_ = 0;  // the row of the picture that is row 0 of rows_
};

absl::Status FilterBlock(FilmSource* film, const BlockGrid& grid, int column, int row, BlockFilter filter,
                         const ReadyBlocks& ready, Strip* strip) {
  if (ready != nullptr) {
    const absl::StatusOr<std::optional<std::vector<Picture>>> before = ready(column, row);
    if (!before.ok()) return before.status();
    if (before->has_value()) {
      strip->AddPictures(column, row, grid.Output(column, row), **before);
      return absl::OkStatus();
    }
  }
  const absl::StatusOr<EdgedImage> part = film->Read(grid.Input(column, row));
  if (!part.ok()) return part.status();
  const absl::StatusOr<std::vector<Picture>> filtered = filter(*part);
  if (!filtered.ok()) return filtered.status();
  return strip->Add(column, row, part->pixels, *filtered);
}

}  // namespace

BlockAxis::BlockAxis(int size, const BlockParams& params) : size_(size), fade_(params.fade) {
  LUMIFOLD_CHECK(fade_ > 0 && (fade_ & (fade_ - 1)) == 0 && params.core >= 2 * fade_);
  LUMIFOLD_CHECK(params.margin >= fade_ && params.core % kBandRows == 0);
  const int parts = std::max(1, (size + params.core - 1) / params.core);
  core_ = std::max(RoundUp((size + parts - 1) / parts, kBandRows), RoundUp(2 * fade_, kBandRows));
  count_ = std::max(1, (size + core_ - 1) / core_);
}

BlockAxis::Span BlockAxis::Widened(int i, int px) const {
  return {std::max(0, i * core_ - px), std::min(size_, (i + 1) * core_ + px)};
}

float BlockAxis::FadeAt(int border, int p) const {
  const float position = (static_cast<float>(p - border + fade_) + 0.5f) / static_cast<float>(2 * fade_);
  return std::clamp(position, 0.0f, 1.0f);
}

float BlockAxis::Weight(int i, int p) const {
  return std::min(i > 0 ? FadeAt(i * core_, p) : 1.0f, WeightSum(i, p));
}

float BlockAxis::WeightSum(int i, int p) const {
  return i + 1 < count_ ? 1.0f - FadeAt((i + 1) * core_, p) : 1.0f;
}

BlockGrid::BlockGrid(int width, int height, const BlockParams& params)
    : params_(IsWhole(width, height, params) ? OneBlock(width, height, params) : params),
      columns_(width, params_),
      rows_(height, params_) {}

Rect BlockGrid::Around(int column, int row, int px) const {
  const BlockAxis::Span x = columns_.Widened(column, px);
  const BlockAxis::Span y = rows_.Widened(row, px);
  return {x.begin, y.begin, x.end, y.end};
}

std::vector<float> BlockGrid::BlendFactors(int column, int row, int y) const {
  const Rect output = Output(column, row);
  const float weight = rows_.Weight(row, y);
  const float above = rows_.WeightSum(row, y) - weight;
  std::vector<float> factors;
  for (int x = output.x0; x < output.x1; ++x)
    factors.push_back(weight * columns_.Weight(column, x) / (above + weight * columns_.WeightSum(column, x)));
  return factors;
}

int MethodApron() {
  static const int apron = DenoiseApron();
  return apron;
}

absl::Status FilterInBlocks(FilmSource* film, const BlockParams& params,
                            const std::vector<std::string>& passed_on,
                            const std::vector<std::string_view>& pictures, BlockFilter filter,
                            const RowSink& sink, const ReadyBlocks& ready) {
  LUMIFOLD_CHECK(ready == nullptr || passed_on.empty());
  const BlockGrid grid(film->width(), film->height(), params);
  Strip strip(grid, passed_on, pictures);
  for (int row = 0; row < grid.rows(); ++row) {
    strip.Begin(row);
    for (int column = 0; column < grid.columns(); ++column) {
      absl::Status status = FilterBlock(film, grid, column, row, filter, ready, &strip);
      if (!status.ok()) return status;
    }
    if (absl::Status status = sink(strip.TakeFinished(row)); !status.ok()) return status;
  }
  return absl::OkStatus();
}

}  // namespace lumifold::filter
