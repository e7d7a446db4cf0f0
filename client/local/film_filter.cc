#include "client/local/film_filter.h"

#include <memory>
#include <utility>

#include "filter/baselines/method_info.h"
#include "filter/image/layers.h"
#include "filter/layers/single_picture.h"
#include "filter/manifold/filter_device.h"
#include "filter/methods.h"
#include "filter/opencl/device.h"
#include "filter/opencl/open_device.h"
#include "proto/device/device_process.h"

namespace lumifold::local {
namespace {

/// Adds halves to a film that has none.
class FilmWithHalves final : public FilmSource {
 public:
  FilmWithHalves(FilmSource* film, TaskPool* pool) : film_(*film), pool_(pool) {}

  int width() const override { return film_.width(); }
  int height() const override { return film_.height(); }
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override {
    absl::StatusOr<EdgedImage> part = film_.Read(rect);
    if (part.ok() && !part->pixels.Has(layers::kSamplesA))
      filter::SplitIntoHalves(&part->pixels, pool_, rect.x0, rect.y0);
    return part;
  }

 private:
  FilmSource& film_;
  TaskPool* const pool_;
};

}  // namespace

absl::Status FilterFilm(FilmSource* film, const std::string& method, const client::FilterMachine& machine,
                        const std::vector<std::string>& passed_on, const RowSink& sink,
                        const std::function<void(double share)>& progress) {
  absl::StatusOr<filter::OpenedDevice> device =
      device::OpenDevice({.choice = {machine.device, machine.allows_other_bits}, .warn = machine.warn});
  if (!device.ok()) return device.status();
  const std::unique_ptr<TaskPool> pool = filter::WithDevice(MakeTaskPool(machine.threads), device->device);
  FilmWithHalves halved(film, pool.get());
  return filter::FilterFilmInRows(&halved, method, passed_on, pool.get(), sink, {}, nullptr, progress);
}

absl::StatusOr<std::vector<client::DeviceFacts>> ListDevices() {
  const absl::StatusOr<std::vector<filter::DeviceInfo>> devices = filter::ListDevices();
  if (!devices.ok()) return devices.status();
  std::vector<client::DeviceFacts> facts;
  for (const filter::DeviceInfo& device : *devices)
    facts.push_back(
        {device.name, device.driver, device.is_gpu, device.memory_bytes, device.refusal, device.other_bits});
  return facts;
}

client::MethodTexts DescribeMethods() {
  const std::vector<filter::MethodInfo>& methods = filter::Methods();
  return {filter::MethodNames(methods), filter::MethodTable(methods), filter::MethodsAsJson(methods)};
}

}  // namespace lumifold::local
