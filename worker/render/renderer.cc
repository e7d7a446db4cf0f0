#include "worker/render/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/layers.h"
#include "worker/render/camera.h"
#include "worker/render/embree_scene.h"
#include "worker/render/floating_point.h"
#include "worker/render/path_tracer.h"

namespace lumifold::render {
namespace {

/// Sub-pixels of the geometry unit lie at the centres of a 4x4 grid.
constexpr int kSubPixelGrid = 4;

/// Where the ray of a sub-pixel passes the lens: the centres of another 4x4 grid, each once, so that every
/// row and every column of sub-pixels sees every row and every column of it (two orthogonal Latin squares,
/// made of sums and products in the field of four elements).
Vec2 LensPointOfSubPixel(int sub_pixel) {
  constexpr int kTwice[kSubPixelGrid] = {0, 2, 3, 1};
  const int x = sub_pixel % kSubPixelGrid;
  const int y = sub_pixel / kSubPixelGrid;
  const int column = x ^ y;
  const int row = x ^ kTwice[y];
  return {(static_cast<float>(column) + 0.5f) / kSubPixelGrid,
          (static_cast<float>(row) + 0.5f) / kSubPixelGrid};
}

/// What is wrong with a lens for this camera; empty where nothing is.
std::string ProblemOf(const Lens& lens, const scene::Camera& camera) {
  if (lens.f_stop == 0) return "";
  if (!(lens.f_stop > 0 && std::isfinite(lens.f_stop))) return "the f-stop is no positive number";
  if (!(lens.focus_metres > 0 && std::isfinite(lens.focus_metres)))
    return "the distance of focus is no positive number";
  if (camera.kind != scene::Camera::Kind::kPerspective)
    return absl::StrCat("the camera '", camera.name, "' is orthographic and has no lens to focus");
  return "";
}

bool IsFinite(Vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

bool IsFinite(const LayerSample& s) {
  return IsFinite(s.combined) && IsFinite(s.direct) && IsFinite(s.indirect) && IsFinite(s.albedo) &&
         IsFinite(s.reflected) && IsFinite(s.emitted);
}

/// Sums of one pixel: the halved layers twice, the others once.
struct PixelSums {
  std::array<Vec3, layers::kHalved.size()> half[2];
  Vec3 albedo;
  Vec3 emitted;
  float count[2] = {0, 0};

  void Add(const LayerSample& s, int h) {
    half[h][0] += s.combined;
    half[h][1] += s.direct;
    half[h][2] += s.indirect;
    half[h][3] += s.reflected;
    albedo += s.albedo;
    emitted += s.emitted;
    count[h] += 1;
  }
};

/// The planes a pass writes its sums to.
struct PassPlanes {
  std::array<ColorView, layers::kHalved.size()> half[2];
  ColorView albedo;
  ColorView emission;
  FloatView count[2];

  explicit PassPlanes(LayeredImage* image) {
    for (size_t i = 0; i < layers::kHalved.size(); ++i) {
      half[0][i] = image->AddColor(layers::HalfA(layers::kHalved[i]));
      half[1][i] = image->AddColor(layers::HalfB(layers::kHalved[i]));
    }
    albedo = image->AddColor(layers::kAlbedo);
    emission = image->AddColor(layers::kEmission);
    count[0] = image->Add(layers::kSamplesA);
    count[1] = image->Add(layers::kSamplesB);
  }

  static void Put(const ColorView& view, int x, int y, Vec3 value) {
    view[0].At(x, y) = value.x;
    view[1].At(x, y) = value.y;
    view[2].At(x, y) = value.z;
  }

  void Store(int x, int y, const PixelSums& sums) const {
    for (int h = 0; h < 2; ++h) {
      for (size_t i = 0; i < layers::kHalved.size(); ++i) Put(half[h][i], x, y, sums.half[h][i]);
      count[h].At(x, y) = sums.count[h];
    }
    Put(albedo, x, y, sums.albedo);
    Put(emission, x, y, sums.emitted);
  }
};

/// What the sub-pixels of one pixel have in common.
struct PixelGeometry {
  Vec3 normal = {0, 0, 0};
  float planar_depth = 0;
  float distance = 0;
  float id = 0;
  float mask = 0;
  float alpha = 0;
};

/// The instance most sub-pixels see, 1-based, the lowest of equals; 0 for none.
float CommonestId(std::array<int, kSubPixelGrid * kSubPixelGrid> ids) {
  std::sort(ids.begin(), ids.end());
  int best = 0;
  int best_count = 0;
  for (size_t i = 0; i < ids.size();) {
    size_t end = i;
    while (end < ids.size() && ids[end] == ids[i]) ++end;
    const int count = static_cast<int>(end - i);
    if (count > best_count) {
      best = ids[i];
      best_count = count;
    }
    i = end;
  }
  return static_cast<float>(best);
}

class RendererImpl final : public Renderer {
 public:
  RendererImpl(std::shared_ptr<const scene::Scene> scene, std::unique_ptr<EmbreeScene> embree,
               const scene::Camera& camera, const RenderSettings& settings)
      : scene_(std::move(scene)),
        embree_(std::move(embree)),
        settings_(settings),
        camera_(camera, settings.lens, settings.width, settings.height),
        tracer_(*scene_, *embree_, settings.environment, settings.max_bounces, settings.light_strategy),
        warnings_(scene_->warnings) {
    if (!tracer_.HasLights()) warnings_.push_back("the scene has no light: the picture is black");
    if (settings.environment != nullptr && settings.environment->bad_texels() > 0) {
      warnings_.push_back(
          absl::StrCat(settings.environment->bad_texels(),
                       " pixels of the environment are negative or not finite: taken as black"));
    }
  }

  LayeredImage RenderPass(const Rect& rect, int frame, SampleRange range,
                          RenderCounts* counts) const override {
    const ScopedFloatEnvironment environment;
    LayeredImage image(rect.width(), rect.height());
    const PassPlanes planes(&image);
    for (int y = rect.y0; y < rect.y1; ++y) {
      for (int x = rect.x0; x < rect.x1; ++x) {
        planes.Store(x - rect.x0, y - rect.y0, SumPixel(x, y, frame, range, counts));
      }
    }
    return image;
  }

  LayeredImage RenderGeometry(const Rect& rect, int) const override {
    const ScopedFloatEnvironment environment;
    LayeredImage image(rect.width(), rect.height());
    const FloatView normal[3] = {image.Add(layers::kNormalX), image.Add(layers::kNormalY),
                                 image.Add(layers::kNormalZ)};
    const FloatView planar_depth = image.Add(layers::kPlanarDepth);
    const FloatView distance = image.Add(layers::kDistance);
    const FloatView id = image.Add(layers::kObjectId);
    const FloatView mask = image.Add(layers::kMask);
    const FloatView alpha = image.Add(layers::kAlpha);
    for (int y = 0; y < rect.height(); ++y) {
      for (int x = 0; x < rect.width(); ++x) {
        const PixelGeometry pixel = GeometryOfPixel(rect.x0 + x, rect.y0 + y);
        for (int i = 0; i < 3; ++i) normal[i].At(x, y) = pixel.normal[i];
        planar_depth.At(x, y) = pixel.planar_depth;
        distance.At(x, y) = pixel.distance;
        id.At(x, y) = pixel.id;
        mask.At(x, y) = pixel.mask;
        alpha.At(x, y) = pixel.alpha;
      }
    }
    return image;
  }

  const std::vector<std::string>& warnings() const override { return warnings_; }

 private:
  PixelSums SumPixel(int x, int y, int frame, SampleRange range, RenderCounts* counts) const {
    PixelSums sums;
    const int64_t pixel = static_cast<int64_t>(y) * settings_.width + x;
    for (uint32_t i = range.first; i < range.last; ++i) {
      const Sampler sampler(settings_.seed, frame, pixel, i);
      const Vec2 jitter = sampler.Get2D(kCameraPair);
      const Vec2 lens = camera_.HasLens() ? sampler.Get2D(kLensPair) : Vec2{};
      const Ray ray =
          camera_.RayThrough(static_cast<float>(x) + jitter.x, static_cast<float>(y) + jitter.y, lens);
      const LayerSample sample = tracer_.Trace(ray, sampler);
      ++counts->samples;
      if (IsFinite(sample)) {
        sums.Add(sample, static_cast<int>(i & 1));
      } else {
        ++counts->bad_samples;
      }
    }
    return sums;
  }

  PixelGeometry GeometryOfPixel(int x, int y) const {
    PixelGeometry pixel;
    std::array<int, kSubPixelGrid* kSubPixelGrid> ids = {};
    float hits = 0;
    for (int i = 0; i < kSubPixelGrid * kSubPixelGrid; ++i) {
      const float dx = (static_cast<float>(i % kSubPixelGrid) + 0.5f) / kSubPixelGrid;
      const float dy = (static_cast<float>(i / kSubPixelGrid) + 0.5f) / kSubPixelGrid;
      Ray ray = camera_.RayThrough(static_cast<float>(x) + dx, static_cast<float>(y) + dy,
                                   LensPointOfSubPixel(i), 1.0f / kSubPixelGrid);
      // Alike in all frames, so that what is half transparent does not flicker.
      const int64_t pixel_number = static_cast<int64_t>(y) * settings_.width + x;
      ray.chance = Sampler(settings_.seed, 0, pixel_number, static_cast<uint32_t>(i)).Key(kCameraPair);
      const GeometrySample sample = tracer_.TraceGeometry(ray);
      if (!sample.hit) continue;
      hits += 1;
      pixel.normal += sample.normal;
      pixel.planar_depth += camera_.PlanarDepth(sample.position);
      pixel.distance += sample.distance;
      pixel.mask += sample.valid ? 1.0f : 0.0f;
      ids[i] = sample.instance + 1;
    }
    if (hits == 0) return pixel;
    if (LengthSquared(pixel.normal) > 0) pixel.normal = Normalize(pixel.normal);
    pixel.planar_depth /= hits;
    pixel.distance /= hits;
    pixel.mask /= kSubPixelGrid * kSubPixelGrid;
    pixel.alpha = hits / (kSubPixelGrid * kSubPixelGrid);
    pixel.id = CommonestId(ids);
    return pixel;
  }

  std::shared_ptr<const scene::Scene> scene_;
  std::unique_ptr<EmbreeScene> embree_;
  RenderSettings settings_;
  PictureCamera camera_;
  PathTracer tracer_;
  std::vector<std::string> warnings_;
};

}  // namespace

std::string NumericClass() {
  return absl::StrCat("lumifold-", LUMIFOLD_VERSION, "/", TracingInstructionSet());
}

absl::StatusOr<std::unique_ptr<Renderer>> Renderer::Create(std::shared_ptr<const scene::Scene> scene,
                                                           const RenderSettings& settings) {
  const std::optional<scene::Camera> camera = FindCamera(*scene, settings.camera);
  if (!camera.has_value())
    return absl::NotFoundError(absl::StrCat("the scene has no camera called '", settings.camera, "'"));
  if (const std::string problem = ProblemOf(settings.lens, *camera); !problem.empty())
    return absl::InvalidArgumentError(problem);
  absl::StatusOr<std::unique_ptr<EmbreeScene>> embree = EmbreeScene::Create(*scene);
  if (!embree.ok()) return embree.status();
  return std::make_unique<RendererImpl>(std::move(scene), *std::move(embree), *camera, settings);
}

}  // namespace lumifold::render
