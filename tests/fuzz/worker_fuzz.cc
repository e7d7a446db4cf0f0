// What a worker gets from a coordinator: messages of its stream, specs and leases, as bytes of protobuf.

#include <memory>
#include <utility>

#include "google/protobuf/stubs/logging.h"
#include "spdlog/spdlog.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/unit/worker/fake_assets.h"
#include "worker/leases/lease_runner.h"
#include "worker/units/unit_renderer.h"

namespace lumifold::fuzz {
namespace {

using worker::FakeAssets;

/// One triangle, no camera, no light.
constexpr char kScene[] = R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
  "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
  "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
  "bufferViews":[{"buffer":0,"byteLength":36}],
  "buffers":[{"byteLength":36,
    "uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})";

/// A unit that is larger is stopped at once: only whether it is accepted is of interest.
constexpr int64_t kMaxSamples = 4096;

/// Knows one job only, so that some units have a spec and some have none.
class OneSpec final : public worker::SpecSource {
 public:
  explicit OneSpec(v1::JobSpec spec) : spec_(std::move(spec)) {}
  absl::StatusOr<v1::JobSpec> Fetch(const std::string& job_id) override {
    if (job_id == "j-1") return spec_;
    return absl::NotFoundError("no such job");
  }

 private:
  const v1::JobSpec spec_;
};

class Deaf final : public worker::Outbox {
 public:
  void Send(v1::WorkerMessage) override {}
};

v1::JobSpec Spec() {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(16);
  spec.set_height(16);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(2);
  spec.set_pass_samples(2);
  spec.set_frame_count(1);
  spec.set_frames_per_second(24);
  spec.set_max_bounces(2);
  spec.mutable_scene()->mutable_file()->set_sha256(std::string(64, 'a'));
  return spec;
}

v1::Lease Lease(v1::UnitKind kind) {
  v1::Lease lease;
  lease.mutable_unit()->set_job_id("j-1");
  lease.mutable_unit()->set_kind(kind);
  lease.set_attempt(1);
  lease.mutable_rect()->set_x1(8);
  lease.mutable_rect()->set_y1(8);
  lease.set_last_sample(2);
  return lease;
}

void Render(const v1::JobSpec& spec, const v1::Lease& lease) {
  FakeAssets assets{std::string(kScene)};
  worker::UnitRenderer renderer(&assets);
  worker::UnitControl control;
  const int64_t width = int64_t{lease.rect().x1()} - lease.rect().x0();
  const int64_t height = int64_t{lease.rect().y1()} - lease.rect().y0();
  const int64_t samples = int64_t{lease.last_sample()} - lease.first_sample();
  control.stop = width > 64 || height > 64 || samples > 64 || width * height * samples > kMaxSamples;
  (void)renderer.Render(spec, lease, &control);
}

}  // namespace

std::vector<std::string> Seeds() {
  google::protobuf::SetLogHandler(nullptr);  // it would print a line for each malformed message
  const std::string spec = Spec().SerializeAsString();
  std::vector<v1::CoordinatorMessage> messages(8);
  messages[0].mutable_welcome()->set_worker_id("w-1");
  messages[0].mutable_welcome()->set_heartbeat_ms(100);
  *messages[1].mutable_grant()->add_leases() = Lease(v1::UNIT_KIND_PASS);
  *messages[1].mutable_grant()->add_leases() = Lease(v1::UNIT_KIND_GEOMETRY);
  *messages[1].mutable_grant()->add_leases() = Lease(v1::UNIT_KIND_PLAN);
  *messages[2].mutable_ack()->mutable_unit() = Lease(v1::UNIT_KIND_PASS).unit();
  messages[2].mutable_ack()->set_attempt(1);
  messages[3].mutable_job_ended()->set_job_id("j-1");
  *messages[4].mutable_void_leases()->add_leases() = Lease(v1::UNIT_KIND_PASS);
  messages[5].mutable_drain();
  messages[6].mutable_released();
  messages[7].mutable_move()->set_address("127.0.0.1:1");
  std::vector<std::string> seeds;
  std::vector<std::string> all = {spec};
  for (const v1::CoordinatorMessage& message : messages) {
    all.push_back(message.SerializeAsString());
    seeds.push_back(Joined({spec, all.back()}));
  }
  seeds.push_back(Joined(all));
  return seeds;
}

/// What a worker does with a spec and messages of a coordinator.
void TryWorker(std::string_view bytes) {
  const std::vector<std::string> pieces = Pieces(bytes);
  v1::JobSpec spec;
  if (pieces.empty() || !spec.ParseFromString(pieces.front())) return;
  OneSpec one_spec(spec);
  worker::SpecCache specs(&one_spec);
  worker::FakeAssets assets{absl::NotFoundError("no such asset")};
  worker::UnitRenderer renderer(&assets);
  worker::LeaseRunner worker(1, &specs, &renderer, worker::SilentLog());
  for (const bool is_first : {true, false}) {  // the second connection finds what the first has left
    worker.OnConnected(std::make_shared<Deaf>());
    for (size_t i = 1; i < pieces.size(); ++i) {
      v1::CoordinatorMessage message;
      if (!message.ParseFromString(pieces[i])) continue;
      worker.OnMessage(message);
      (void)worker.MakeHeartbeat();
      if (!is_first) continue;
      for (const v1::Lease& lease : message.grant().leases()) Render(spec, lease);
    }
    worker.OnDisconnected();
    (void)worker.TakeMove();
  }
}

}  // namespace lumifold::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  lumifold::fuzz::TryWorker({reinterpret_cast<const char*>(data), size});
  return 0;
}
