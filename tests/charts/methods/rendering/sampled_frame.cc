#include "tests/charts/methods/rendering/sampled_frame.h"

#include <algorithm>
#include <numeric>

#include "filter/image/check.h"
#include "filter/image/planes.h"

namespace lumifold::charts {

using render::CameraPacket;
using render::IsFinite;
using render::PathTracer;
using scene::Vec3;

SampledFrame::SampledFrame(const CameraFrame& frame)
    : frame_(&frame), pixels_(static_cast<size_t>(frame.pixels())) {}

void SampledFrame::Trace(int x, int y, uint32_t more, Pixel* pixel) const {
  std::array<Vec3, PathTracer::kPacket> radiances;
  frame_->ForEachPacket(x, y, {pixel->next, pixel->next + more}, [&](const CameraPacket& packet) {
    frame_->tracer().TraceRadiance(packet.rays(), packet.samplers(), radiances);
    for (size_t i = 0; i < packet.size(); ++i) {
      if (!IsFinite(radiances[i])) continue;
      const size_t half = packet.Index(i) & 1u;
      pixel->count[half] += 1;
      for (size_t c = 0; c < 3; ++c) {
        const double value = static_cast<double>(radiances[i][static_cast<int>(c)]);
        pixel->sum[half][c] += value;
        pixel->squares[c] += value * value;
      }
    }
  });
  pixel->next += more;
}

void SampledFrame::Take(absl::Span<const uint32_t> more, TaskPool* pool) {
  LUMIFOLD_CHECK(more.size() == pixels_.size());
  frame_->ForEachPixel(pool, [&](int x, int y) {
    const size_t number = static_cast<size_t>(y) * static_cast<size_t>(width()) + static_cast<size_t>(x);
    if (more[number] > 0) Trace(x, y, more[number], &pixels_[number]);
  });
  taken_ = std::accumulate(more.begin(), more.end(), taken_);
}

void SampledFrame::TakeFirst(uint32_t samples_per_pixel, TaskPool* pool) {
  const uint32_t first = std::min(samples_per_pixel, std::max(4u, samples_per_pixel / 4));
  Take(std::vector<uint32_t>(pixels_.size(), first), pool);
}

Planes SampledFrame::Means() const {
  Planes means = MakePlanes(3, width(), height());
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(width(), height(), [&](int x, int y) {
      const Pixel& pixel = At(x, y);
      const double count = static_cast<double>(pixel.count[0] + pixel.count[1]);
      if (count > 0) means[c].At(x, y) = static_cast<float>((pixel.sum[0][c] + pixel.sum[1][c]) / count);
    });
  }
  return means;
}

Planes SampledFrame::HalfMeans(size_t half) const {
  Planes means = Means();
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(width(), height(), [&](int x, int y) {
      const Pixel& pixel = At(x, y);
      if (pixel.count[half] > 0)
        means[c].At(x, y) = static_cast<float>(pixel.sum[half][c] / static_cast<double>(pixel.count[half]));
    });
  }
  return means;
}

double SampledFrame::NeighbourVariance(const Planes& means, size_t channel, int x, int y) const {
  double sum = 0;
  double squares = 0;
  double count = 0;
  for (int v = std::max(0, y - 1); v <= std::min(height() - 1, y + 1); ++v) {
    for (int u = std::max(0, x - 1); u <= std::min(width() - 1, x + 1); ++u) {
      const double away =
          static_cast<double>(means[channel].At(u, v)) - static_cast<double>(means[channel].At(x, y));
      sum += away;
      squares += away * away;
      count += 1;
    }
  }
  return count > 1 ? std::max(0.0, squares - sum * sum / count) / (count - 1) : 0.0;
}

Planes SampledFrame::Variances() const {
  const Planes means = Means();
  Planes variances = MakePlanes(3, width(), height());
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(width(), height(), [&](int x, int y) {
      const Pixel& pixel = At(x, y);
      const double count = static_cast<double>(pixel.count[0] + pixel.count[1]);
      const double sum = pixel.sum[0][c] + pixel.sum[1][c];
      const double variance = count < 2
                                  ? NeighbourVariance(means, c, x, y)
                                  : std::max(0.0, pixel.squares[c] - sum * sum / count) / (count - 1) / count;
      variances[c].At(x, y) = static_cast<float>(variance);
    });
  }
  return variances;
}

Planes SampledFrame::HalfVariances(size_t half) const {
  Planes variances = Variances();
  for (Plane& plane : variances) {
    ForEachPixel(width(), height(), [&](int x, int y) {
      const Pixel& pixel = At(x, y);
      const float all = pixel.count[0] + pixel.count[1];
      if (pixel.count[half] > 0) plane.At(x, y) *= all / pixel.count[half];
    });
  }
  return variances;
}

Plane SampledFrame::ShareOfHalfA() const {
  Plane share(width(), height());
  ForEachPixel(width(), height(), [&](int x, int y) {
    const float all = At(x, y).count[0] + At(x, y).count[1];
    share.At(x, y) = all > 0 ? At(x, y).count[0] / all : 0.5f;
  });
  return share;
}

Plane SampledFrame::Counts() const {
  Plane counts(width(), height());
  ForEachPixel(width(), height(), [&](int x, int y) {
    counts.At(x, y) = std::max(1.0f, At(x, y).count[0] + At(x, y).count[1]);
  });
  return counts;
}

std::vector<size_t> WorthiestPixels(const Plane& worth, size_t count) {
  std::vector<size_t> order(static_cast<size_t>(worth.width()) * static_cast<size_t>(worth.height()));
  std::iota(order.begin(), order.end(), size_t{0});
  const auto worth_of = [&](size_t pixel) {
    const auto width = static_cast<size_t>(worth.width());
    return worth.At(static_cast<int>(pixel % width), static_cast<int>(pixel / width));
  };
  count = std::min(count, order.size());
  const auto last = order.begin() + static_cast<std::ptrdiff_t>(count);
  std::nth_element(order.begin(), last, order.end(), [&](size_t a, size_t b) {
    const float worth_a = worth_of(a);
    const float worth_b = worth_of(b);
    return worth_a != worth_b ? worth_a > worth_b : a < b;
  });
  order.resize(count);
  return order;
}

}  // namespace lumifold::charts
