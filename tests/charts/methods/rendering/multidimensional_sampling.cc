#include "tests/charts/methods/rendering/multidimensional_sampling.h"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "filter/image/mix_bits.h"
#include "filter/image/planes.h"
#include "tests/charts/methods/rendering/camera_frame.h"
#include "tests/charts/methods/rendering/sample_tree.h"

namespace lumifold::charts {
namespace {

using render::CameraPacket;
using render::IsFinite;
using render::kCameraPair;
using render::kLensPair;
using render::Ray;
using render::RenderSettings;
using render::Sampler;
using scene::Vec2;
using scene::Vec3;

using Point = SampleTree::Point;

/// Samples of every pixel before adaptive sampling starts, if the budget allows.
constexpr uint32_t kFirstSamples = 4;

/// In a round one box in this many gets a sample.
constexpr size_t kBoxesPerSample = 4;

/// Candidates drawn in a box; the one farthest from its samples is taken.
constexpr int kCandidates = 8;

/// Samples that determine a box's metric, and among which the nearest is searched.
constexpr size_t kNeighbours = 16;

/// Smallest squared scale of the metric along the stretched direction.
constexpr float kLeastCost = 0.05f;

/// Separates these random numbers from those of the camera samples of the same seed.
constexpr uint64_t kCandidateSeed = 0x6d646173u;
constexpr uint64_t kQuerySeed = 0x71756572u;

/// Maps between the dimensions of the tree and picture and lens.
class Space {
 public:
  Space(const CameraFrame& frame, float lens_pixels)
      : width_(frame.width()),
        height_(frame.height()),
        has_lens_(frame.camera().HasLens()),
        lens_pixels_(lens_pixels) {}

  int dimensions() const { return has_lens_ ? 4 : 2; }
  Point Size() const { return At({static_cast<float>(width_), static_cast<float>(height_)}, {1, 1}); }
  Point At(Vec2 picture, Vec2 lens) const {
    if (!has_lens_) return {picture.x, picture.y, 0, 0};
    return {picture.x, picture.y, lens.x * lens_pixels_, lens.y * lens_pixels_};
  }
  Vec2 Lens(const Point& point) const { return {point[2] / lens_pixels_, point[3] / lens_pixels_}; }
  size_t PixelOf(const Point& point) const {
    const int x = std::min(width_ - 1, static_cast<int>(point[0]));
    const int y = std::min(height_ - 1, static_cast<int>(point[1]));
    return static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
  }

 private:
  int width_;
  int height_;
  bool has_lens_;
  float lens_pixels_;
};

float DistanceSquared(const Point& a, const Point& b) {
  float sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
}

/// Fills a tree with samples.
class AdaptiveSampler {
 public:
  AdaptiveSampler(const CameraFrame& frame, const Space& space, TaskPool* pool)
      : frame_(frame),
        space_(space),
        pool_(pool),
        tree_(space.dimensions(), space.Size()),
        next_(static_cast<size_t>(frame.pixels())) {}

  SampleTree Sample(uint32_t samples_per_pixel) {
    uint64_t left = static_cast<uint64_t>(frame_.pixels()) * samples_per_pixel;
    const uint32_t first = std::min(samples_per_pixel, kFirstSamples);
    std::vector<Point> points = FirstPoints(first);
    Add(points);
    left -= points.size();
    for (int round = 0; left > 0; ++round) {
      points = Refine(WorstLeaves(left), round);
      Add(points);
      left -= points.size();
    }
    return std::move(tree_);
  }

 private:
  static constexpr int64_t kTask = 64;  // samples a task traces

  /// The camera samples of every pixel, in scattered order: a sorted order would make the tree deep.
  std::vector<Point> FirstPoints(uint32_t samples) const {
    std::vector<std::pair<uint64_t, Point>> scattered;
    ForEachPixel(frame_.width(), frame_.height(), [&](int x, int y) {
      frame_.ForEachPacket(x, y, {0, samples}, [&](const CameraPacket& packet) {
        for (size_t i = 0; i < packet.size(); ++i)
          scattered.emplace_back(MixBits(scattered.size()), space_.At(packet.Point(i), packet.LensPoint(i)));
      });
    });
    std::sort(scattered.begin(), scattered.end());
    std::vector<Point> points;
    points.reserve(scattered.size());
    for (const auto& [place, point] : scattered) points.push_back(point);
    return points;
  }

  /// The leaves with the largest error, in the order of their numbers.
  std::vector<size_t> WorstLeaves(uint64_t most) const {
    std::vector<std::pair<float, size_t>> leaves;
    for (size_t node = 0; node < tree_.nodes().size(); ++node) {
      if (tree_.IsLeaf(node)) leaves.emplace_back(-tree_.ErrorOf(node), node);
    }
    const size_t count = std::min<size_t>(most, std::max<size_t>(1, leaves.size() / kBoxesPerSample));
    std::nth_element(leaves.begin(), leaves.begin() + static_cast<std::ptrdiff_t>(count - 1), leaves.end());
    std::vector<size_t> worst;
    worst.reserve(count);
    for (size_t i = 0; i < count; ++i) worst.push_back(leaves[i].second);
    std::sort(worst.begin(), worst.end());
    return worst;
  }

  std::vector<Point> Refine(const std::vector<size_t>& leaves, int round) const {
    std::vector<Point> points;
    points.reserve(leaves.size());
    for (const size_t leaf : leaves) {
      const uint64_t key =
          MixBits(MixBits(frame_.seed() ^ kCandidateSeed) + static_cast<uint64_t>(round)) + leaf;
      points.push_back(PointIn(leaf, key));
    }
    return points;
  }

  /// Of a few random points in a leaf, the one farthest from its samples.
  Point PointIn(size_t leaf, uint64_t key) const {
    const SampleTree::Node& node = tree_.nodes()[leaf];
    Point best{};
    float best_distance = -1;
    for (int candidate = 0; candidate < kCandidates; ++candidate) {
      Point point{};
      for (int axis = 0; axis < space_.dimensions(); ++axis) {
        const auto a = static_cast<size_t>(axis);
        const uint64_t bits =
            MixBits(MixBits(key) + static_cast<uint64_t>(candidate * SampleTree::kMostDimensions + axis));
        const float number = static_cast<float>(bits >> 40) * 0x1p-24f;
        point[a] = node.least[a] + number * (node.most[a] - node.least[a]);
      }
      float distance = std::numeric_limits<float>::infinity();
      for (const uint32_t i : tree_.SamplesOf(leaf))
        distance = std::min(distance, DistanceSquared(point, tree_.samples()[i].at));
      if (distance <= best_distance) continue;
      best_distance = distance;
      best = point;
    }
    return best;
  }

  /// Traces in parallel, inserts in order.
  void Add(const std::vector<Point>& points) {
    std::vector<uint32_t> indices;
    indices.reserve(points.size());
    for (const Point& point : points) indices.push_back(next_[space_.PixelOf(point)]++);
    std::vector<Vec3> values(points.size());
    const auto count = static_cast<int64_t>(points.size());
    CameraFrame::ForEach(pool_, (count + kTask - 1) / kTask, [&](int64_t task) {
      for (int64_t i = task * kTask; i < std::min(count, (task + 1) * kTask); ++i)
        values[static_cast<size_t>(i)] =
            Trace(points[static_cast<size_t>(i)], indices[static_cast<size_t>(i)]);
    });
    for (size_t i = 0; i < points.size(); ++i) tree_.Insert({points[i], values[i]});
  }

  /// The radiance; black if it is not finite.
  Vec3 Trace(const Point& point, uint32_t index) const {
    const Sampler sampler(frame_.seed(), 0, static_cast<int64_t>(space_.PixelOf(point)), index);
    Ray ray = frame_.camera().RayThrough(point[0], point[1], space_.Lens(point));
    ray.random_key = sampler.Key(kCameraPair);
    Vec3 radiance;
    frame_.tracer().TraceRadiance({&ray, 1}, {&sampler, 1}, {&radiance, 1});
    return IsFinite(radiance) ? radiance : Vec3{};
  }

  const CameraFrame& frame_;
  const Space& space_;
  TaskPool* pool_;
  SampleTree tree_;
  std::vector<uint32_t> next_;  // index of each pixel's next sample
};

using Vector = Eigen::Matrix<float, SampleTree::kMostDimensions, 1>;
using Matrix = Eigen::Matrix<float, SampleTree::kMostDimensions, SampleTree::kMostDimensions>;

Vector VectorOf(const Point& point) { return Vector::Map(point.data()); }

/// The structure tensor at a sample: outer product of the light's gradient, from a least-squares fit to its
/// neighbours, summed over channels.
Matrix SlopesAt(const SampleTree& tree, const SampleTree::Sample& centre) {
  std::array<uint32_t, kNeighbours> near;
  const size_t count = tree.Nearest(centre.at, near);
  const auto share = 1 / static_cast<float>(count);
  Vector mean = Vector::Zero();
  Vec3 mean_value;
  for (size_t i = 0; i < count; ++i) {
    mean += (VectorOf(tree.samples()[near[i]].at) - VectorOf(centre.at)) * share;
    mean_value += tree.samples()[near[i]].value * share;
  }
  Matrix spread = Matrix::Zero();
  Eigen::Matrix<float, SampleTree::kMostDimensions, 3> rise = decltype(rise)::Zero();
  for (size_t i = 0; i < count; ++i) {
    const Vector step = VectorOf(tree.samples()[near[i]].at) - VectorOf(centre.at) - mean;
    const Vec3 growth = tree.samples()[near[i]].value - mean_value;
    spread += step * step.transpose();
    rise += step * Eigen::RowVector3f(growth.x, growth.y, growth.z);
  }
  // The ridge fixes directions without data: across neighbours on a line, and along unused dimensions.
  constexpr float kRidge = 1e-3f;
  const float ridge = kRidge * spread.trace();
  if (!(ridge > 0)) return Matrix::Zero();
  spread.diagonal().array() += ridge;
  const decltype(rise) slopes = spread.ldlt().solve(rise);
  return slopes * slopes.transpose();
}

/// Reconstructs pictures from a tree.
class Reconstruction {
 public:
  Reconstruction(const CameraFrame& frame, const Space& space, const SampleTree& tree, TaskPool* pool)
      : frame_(frame), space_(space), tree_(tree) {
    slopes_.resize(tree.nodes().size(), Matrix::Zero());
    metrics_.resize(tree.nodes().size(), Matrix::Identity());
    ForEachFilledLeaf(
        pool, [&](size_t leaf, const SampleTree::Sample& first) { slopes_[leaf] = SlopesAt(tree_, first); });
    ForEachFilledLeaf(
        pool, [&](size_t leaf, const SampleTree::Sample& first) { metrics_[leaf] = MetricAt(first); });
  }

  /// The mean over random points of a pixel and of the lens.
  Vec3 PixelMean(int x, int y, uint32_t queries) const {
    const int64_t pixel = static_cast<int64_t>(y) * frame_.width() + x;
    Vec3 sum;
    for (uint32_t i = 0; i < queries; ++i) {
      const Sampler sampler(frame_.seed() ^ kQuerySeed, 0, pixel, i);
      const Vec2 inside = sampler.Get2D(kCameraPair);
      sum += ValueAt(space_.At({static_cast<float>(x) + inside.x, static_cast<float>(y) + inside.y},
                               sampler.Get2D(kLensPair)));
    }
    return sum / static_cast<float>(queries);
  }

 private:
  /// Calls visit(leaf, first sample) for all leaves with samples, on the pool.
  template <typename Visit>
  void ForEachFilledLeaf(TaskPool* pool, Visit visit) const {
    constexpr int64_t kTask = 256;
    const auto count = static_cast<int64_t>(tree_.nodes().size());
    ParallelFor(pool, (count + kTask - 1) / kTask, [&](int64_t task) {
      for (int64_t i = task * kTask; i < std::min(count, (task + 1) * kTask); ++i) {
        const auto node = static_cast<size_t>(i);
        if (tree_.IsLeaf(node) && !tree_.SamplesOf(node).empty())
          visit(node, tree_.samples()[tree_.SamplesOf(node)[0]]);
      }
    });
  }

  /// The metric around a sample: the mean structure tensor, normalised to unit trace, plus a small multiple
  /// of the identity.
  Matrix MetricAt(const SampleTree::Sample& sample) const {
    std::array<uint32_t, kNeighbours> near;
    const size_t count = tree_.Nearest(sample.at, near);
    Matrix structure = Matrix::Zero();
    for (size_t i = 0; i < count; ++i) structure += slopes_[tree_.LeafAt(tree_.samples()[near[i]].at)];
    const float trace = structure.trace();
    if (!(trace > 0) || !std::isfinite(trace)) return Matrix::Identity();
    return structure / trace + kLeastCost * Matrix::Identity();
  }

  Vec3 ValueAt(const Point& point) const {
    std::array<uint32_t, kNeighbours> near;
    const size_t count = tree_.Nearest(point, near);
    const Matrix& metric = metrics_[tree_.LeafAt(point)];
    size_t best = 0;
    float best_distance = std::numeric_limits<float>::infinity();
    for (size_t i = 0; i < count; ++i) {
      const Vector step = VectorOf(tree_.samples()[near[i]].at) - VectorOf(point);
      const float distance = step.dot(metric * step);
      if (distance >= best_distance) continue;
      best_distance = distance;
      best = i;
    }
    return tree_.samples()[near[best]].value;
  }

  const CameraFrame& frame_;
  const Space& space_;
  const SampleTree& tree_;
  // By node.
  std::vector<Matrix, Eigen::aligned_allocator<Matrix>> slopes_;
  std::vector<Matrix, Eigen::aligned_allocator<Matrix>> metrics_;
};

absl::StatusOr<RenderedPicture> Render(std::shared_ptr<const scene::Scene> scene,
                                       const RenderSettings& settings, uint32_t samples_per_pixel,
                                       absl::Span<const float> values, TaskPool* pool) {
  const absl::StatusOr<CameraFrame> frame = CameraFrame::Create(std::move(scene), settings);
  if (!frame.ok()) return frame.status();
  const Space space(*frame, values[0]);
  const SampleTree tree = AdaptiveSampler(*frame, space, pool).Sample(samples_per_pixel);
  const Reconstruction reconstruction(*frame, space, tree, pool);
  const uint32_t queries = samples_per_pixel * static_cast<uint32_t>(values[1]);
  RenderedPicture out;
  out.camera_paths = static_cast<uint64_t>(frame->pixels()) * samples_per_pixel;
  out.picture = MakePicture(frame->width(), frame->height());
  frame->ForEachPixel(
      pool, [&](int x, int y) { PutPixel(&out.picture, x, y, reconstruction.PixelMean(x, y, queries)); });
  return out;
}

}  // namespace

RenderMethod MultidimensionalSamplingMethod() {
  return {
      .info =
          {.name = "mdas",
           .summary = "adaptive samples of picture and lens, reconstructed by an anisotropic metric",
           .source =
               "Hachisuka et al. 2008; the dimensions are picture and lens, light paths are not adapted",
           .parameters = {{"lens", "width of the lens in pixels of the picture", 8, {4, 8, 32}, 0.01f, 1000},
                          {"queries",
                           "reconstruction points of a pixel, over samples per pixel",
                           2,
                           {1, 2, 4},
                           1,
                           64}}},
      .render = Render};
}

}  // namespace lumifold::charts
