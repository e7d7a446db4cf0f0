#include "filter/opencl/layer_planes.h"

#include <algorithm>
#include <vector>

namespace lumifold::filter {

using Buffer = KernelRun::Buffer;

LayerSizes::LayerSizes(const LayerCall& call) {
  const auto cells_in = [](int side) { return (side + kChoiceCell - 1) / kChoiceCell; };
  const int width = call.halves.weight.width(), height = call.halves.weight.height();
  points = call.points.Count();
  grid = {width, height, cells_in(width), cells_in(height), Int(points)};
  pixels = static_cast<uint64_t>(width) * static_cast<uint64_t>(height);
  sites = pixels + points;
  cells = static_cast<uint64_t>(grid.columns) * static_cast<uint64_t>(grid.rows);
  geometry = call.geometry.size();
  kinds = points > 0 ? kMostKinds : call.halves.is_mixed.IsEmpty() ? 1 : kMixedKind + 1;
}

LayerPlanes::LayerPlanes(const LayerCall& call, const LayerSizes& of, KernelRun* with)
    : sizes(of), run(*with) {
  noisy = run.Floats(LayerSizes::kPicturePlanes * sizes.sites);
  for (size_t h = 0; h < 2; ++h) {
    for (size_t c = 0; c < 3; ++c)
      run.WritePlane(call.halves.light[h][c], noisy, (3 * h + c) * sizes.sites * sizeof(float));
    masks[h] = Put(call.halves.masks[h]);
  }
  weight = Put(call.halves.weight);
  share_a = Put(call.halves.share_a);
  samples = Put(call.halves.samples);
  light = Put(call.halves.picture_light);
  expected = Put(call.halves.expected_difference);
  mixed = Put(call.halves.is_mixed);
  PutLists(call);
  PutGeometry(call);
  if (sizes.points > 0)
    PutPoints({call.points.of_halves[0]->signals, call.points.of_halves[1]->signals}, noisy);
}

DeviceMemory LayerPlanes::Need(const LayerSizes& sizes) {
  const uint64_t pixels = sizes.pixels, points = sizes.points;
  return Together({LayerSizes::kPicturePlanes * sizes.sites, sizes.geometry * sizes.sites, pixels, pixels,
                   pixels, pixels, pixels, pixels, pixels, pixels,
                   /*lists of points*/ points + 1, 2 * points, 2 * points, points, points, points, points,
                   points, points});
}

Buffer LayerPlanes::Put(ConstFloatView plane) const {
  const Buffer buffer = run.Floats(sizes.pixels);
  if (plane.IsEmpty())
    run.Write(buffer, 0, std::vector<float>(sizes.pixels).data(), sizes.pixels * sizeof(float));
  else
    run.WritePlane(plane, buffer, 0);
  return buffer;
}

void LayerPlanes::PutPoints(const std::array<absl::Span<const float>, 2>& values, Buffer picture) const {
  std::vector<float> channel(sizes.points);
  for (size_t h = 0; h < 2; ++h) {
    for (size_t c = 0; c < 3; ++c) {
      for (size_t i = 0; i < channel.size(); ++i) channel[i] = values[h][3 * i + c];
      run.Write(picture, ((3 * h + c) * sizes.sites + sizes.pixels) * sizeof(float), channel.data(),
                channel.size() * sizeof(float));
    }
  }
}

void LayerPlanes::PutLists(const LayerCall& call) {
  std::vector<int32_t> run_firsts, of_places;
  for (size_t i = 0; i < sizes.points; ++i) {
    const auto& pixels = call.points.of_halves[0]->pixels;
    if (i == 0 || pixels[i] != pixels[i - 1]) run_firsts.push_back(Int(i));
    of_places.insert(of_places.end(), pixels[i].begin(), pixels[i].end());
  }
  points.runs = run_firsts.size();
  run_firsts.push_back(Int(sizes.points));
  points.firsts = run.Upload(run_firsts);
  points.places = run.Upload(of_places);
  points.offsets = run.Upload(call.points.offsets);
  points.weights = run.Upload(call.points.weights);
  points.samples = run.Upload(call.points.samples);
  for (size_t h = 0; h < 2; ++h) {
    points.coverage[h] = run.Upload(call.points.coverage[h]);
    points.shares[h] = sizes.points > 0 ? run.Upload(call.points.of_halves[h]->weights) : run.Floats(0);
  }
}

void LayerPlanes::PutGeometry(const LayerCall& call) {
  geometry = run.Floats(sizes.geometry * sizes.sites);
  std::vector<float> of_points(sizes.points);
  const size_t own = sizes.points > 0 ? call.points.of_halves[0]->own_features : 0;
  for (size_t k = 0; k < sizes.geometry; ++k) {
    const size_t at = k * sizes.sites * sizeof(float);
    run.WritePlane(call.geometry[k], geometry, at);
    for (size_t i = 0; i < of_points.size(); ++i) {
      const auto& [x, y] = call.points.of_halves[0]->pixels[i];
      of_points[i] = k + own < sizes.geometry
                         ? call.geometry[k].At(x, y)
                         : call.points.of_halves[0]->features[i * own + (k + own - sizes.geometry)];
    }
    run.Write(geometry, at + sizes.pixels * sizeof(float), of_points.data(),
              of_points.size() * sizeof(float));
  }
}

}  // namespace lumifold::filter
