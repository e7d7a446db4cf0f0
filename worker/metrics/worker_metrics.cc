#include "worker/metrics/worker_metrics.h"

#include <utility>
#include <vector>

#include "proto/monitoring/families.h"

namespace lumifold::monitoring {
namespace {

std::vector<prometheus::MetricFamily> FamiliesOf(const WorkerMetrics& metrics) {
  const auto number = [](auto value) { return static_cast<double>(value); };
  const auto numbers = [](const std::map<std::string, int64_t>& counts) {
    return std::map<std::string, double>(counts.begin(), counts.end());
  };
  return {
      Gauge("lumifold_worker_connected", "1 while a coordinator has admitted this worker, else 0.",
            metrics.is_connected ? 1 : 0),
      Counter("lumifold_worker_connections_total", "Connections on which a coordinator admitted this worker.",
              number(metrics.connections)),
      GaugeBy("state", "lumifold_worker_leases", "Leases that this worker holds.", numbers(metrics.leases)),
      Counter("lumifold_worker_units_rendered_total", "Units rendered.", number(metrics.units_rendered)),
      Counter("lumifold_worker_frames_finished_total", "Frames finished.", number(metrics.frames_finished)),
      CounterBy("reason", "lumifold_worker_unit_failures_total",
                "Units that could not be rendered, or were refused.", numbers(metrics.failures)),
      Counter("lumifold_worker_samples_total", "Camera samples of rendered units.", number(metrics.samples)),
      Counter("lumifold_worker_rays_total", "Rays of rendered units.", number(metrics.rays)),
      CounterBy("activity", "lumifold_worker_thread_seconds_total", "Time of the render threads.",
                metrics.seconds),
      Counter("lumifold_worker_scenes_loaded_total", "Scenes loaded for rendering.",
              number(metrics.scenes_loaded)),
      Counter("lumifold_worker_scene_load_seconds_total", "Time of the threads that loaded scenes.",
              absl::ToDoubleSeconds(metrics.load_time)),
      CounterBy("source", "lumifold_worker_assets_total", "Assets that scenes were loaded from.",
                numbers(metrics.assets)),
      Gauge("lumifold_worker_asset_cache_bytes", "Bytes of assets kept in memory.",
            number(metrics.asset_cache_bytes)),
      Counter("lumifold_worker_received_bytes_total", "Bytes of assets from coordinators.",
              number(metrics.asset_bytes_received)),
      Counter("lumifold_worker_sent_bytes_total", "Bytes of units handed to the connection.",
              number(metrics.unit_bytes_sent))};
}

}  // namespace

std::shared_ptr<prometheus::Collectable> MakeWorkerMetrics(std::function<WorkerMetrics()> metrics) {
  return MakeSource([metrics = std::move(metrics)] { return FamiliesOf(metrics()); });
}

}  // namespace lumifold::monitoring
