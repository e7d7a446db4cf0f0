#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "spdlog/spdlog.h"
#include "tests/unit/worker/fake_assets.h"
#include "tests/unit/worker/fake_specs.h"
#include "worker/leases/lease_runner.h"

namespace lumifold::worker {

/// One triangle, no camera, no light.
inline constexpr char kScene[] = R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
  "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
  "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
  "bufferViews":[{"buffer":0,"byteLength":36}],
  "buffers":[{"byteLength":36,
    "uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})";

/// Leaves out the fragments of passes, so that a pass of a small tile is one message. Heartbeats are kept
/// apart.
class FakeOutbox final : public Outbox {
 public:
  void Send(v1::WorkerMessage message) override {
    if (message.chunk().has_edges() && message.chunk().unit().kind() == v1::UNIT_KIND_PASS) return;
    absl::MutexLock lock(&mutex_);
    (message.has_heartbeat() ? heartbeats_ : messages_).push_back(std::move(message));
  }

  /// Waits until `count` messages were sent, and returns them.
  std::vector<v1::WorkerMessage> Await(size_t count) {
    absl::MutexLock lock(&mutex_);
    const auto reached = [&] { return messages_.size() >= count; };
    mutex_.Await(absl::Condition(&reached));
    return messages_;
  }
  size_t size() {
    absl::MutexLock lock(&mutex_);
    return messages_.size();
  }
  std::vector<v1::WorkerMessage> heartbeats() {
    absl::MutexLock lock(&mutex_);
    return heartbeats_;
  }

 private:
  absl::Mutex mutex_;
  std::vector<v1::WorkerMessage> messages_;
  std::vector<v1::WorkerMessage> heartbeats_;
};

inline std::shared_ptr<spdlog::logger> Silent() { return std::make_shared<spdlog::logger>("silent"); }

inline v1::JobSpec Spec() {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(16);
  spec.set_height(16);
  spec.set_max_bounces(2);
  spec.mutable_scene()->set_display_name("triangle.gltf");
  return spec;
}

inline v1::CoordinatorMessage Grant(int count, const std::string& job = "j") {
  v1::CoordinatorMessage message;
  for (int i = 0; i < count; ++i) {
    v1::Lease* lease = message.mutable_grant()->add_leases();
    lease->mutable_unit()->set_job_id(job);
    lease->mutable_unit()->set_tile(i);
    lease->mutable_unit()->set_kind(v1::UNIT_KIND_PASS);
    lease->set_attempt(i + 1);
    lease->mutable_rect()->set_x1(16);
    lease->mutable_rect()->set_y1(16);
    lease->set_last_sample(2);
  }
  return message;
}

inline v1::CoordinatorMessage Ack(const v1::Lease& lease) {
  v1::CoordinatorMessage message;
  *message.mutable_ack()->mutable_unit() = lease.unit();
  message.mutable_ack()->set_attempt(lease.attempt());
  return message;
}

/// A connected worker, and what it is connected to.
struct Rig {
  explicit Rig(const absl::StatusOr<std::string>& scene = std::string(kScene),
               const absl::StatusOr<v1::JobSpec>& spec = Spec(), int threads = 1,
               WorkerLog log = {.log = Silent()})
      : assets(scene), source(spec) {
    worker = std::make_unique<LeaseRunner>(threads, &specs, &renderer, std::move(log));
    worker->OnConnected(outbox);
  }

  FakeAssets assets;
  UnitRenderer renderer{&assets};
  FakeSpecs source;
  SpecCache specs{&source};
  const std::shared_ptr<FakeOutbox> outbox = std::make_shared<FakeOutbox>();
  std::unique_ptr<LeaseRunner> worker;
};

}  // namespace lumifold::worker
