#include "filter/manifold/filter_device.h"

#include <utility>

namespace lumifold::filter {
namespace {

class PoolWithDevice final : public TaskPool {
 public:
  PoolWithDevice(std::unique_ptr<TaskPool> pool, std::shared_ptr<FilterDevice> device)
      : pool_(std::move(pool)), device_(std::move(device)) {}

  void Run(int64_t count, absl::FunctionRef<void(int64_t)> task) override { pool_->Run(count, task); }
  int Width() const override { return pool_->Width(); }
  FilterDevice* device() const { return device_.get(); }

 private:
  const std::unique_ptr<TaskPool> pool_;
  const std::shared_ptr<FilterDevice> device_;
};

}  // namespace

PlaneViews ViewsOf(absl::Span<const Plane> planes) {
  PlaneViews views;
  for (const Plane& plane : planes) views.push_back(plane.view());
  return views;
}

std::unique_ptr<TaskPool> WithDevice(std::unique_ptr<TaskPool> pool, std::shared_ptr<FilterDevice> device) {
  if (device == nullptr) return pool;
  return std::make_unique<PoolWithDevice>(std::move(pool), std::move(device));
}

FilterDevice* DeviceOf(TaskPool* pool) {
  const auto* const with_device = dynamic_cast<const PoolWithDevice*>(pool);
  return with_device == nullptr ? nullptr : with_device->device();
}

}  // namespace lumifold::filter
