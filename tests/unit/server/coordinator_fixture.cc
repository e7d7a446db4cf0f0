#include "tests/unit/server/coordinator_fixture.h"

#include "server/storage/folder_contents.h"

#include <spdlog/logger.h>
#include <spdlog/sinks/ostream_sink.h>

#include <fstream>
#include <iterator>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "filter/image/file_io.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/version.h"
#include "server/commit/recover.h"
#include "server/job/job_state.h"
#include "server/ledger/sqlite_job_store.h"
#include "server/picture/picture_code.h"
#include "tests/support/made_up_plan.h"
#include "tests/support/random_unit.h"

namespace lumifold::server {
namespace {

constexpr char kScene[] = "a scene nobody reads";

}  // namespace

PumpedWorker::PumpedWorker(Coordinator* coordinator, int slots, const std::string& name, uint32_t seed,
                           const access::Identity& caller)
    : seed_(seed) {
  v1::Hello hello;
  hello.set_name(name);
  hello.set_slots(slots);
  Open(coordinator, std::move(hello), caller);
}

PumpedWorker::PumpedWorker(Coordinator* coordinator, int slots, uint64_t instance) : seed_(1) {
  v1::Hello hello;
  hello.set_name("pumped");
  hello.set_slots(slots);
  hello.set_instance(instance);
  Open(coordinator, std::move(hello), access::LocalIdentity());
}

PumpedWorker::PumpedWorker(Coordinator* coordinator, const std::string& name) : seed_(1) {
  v1::Hello hello;
  hello.set_name(name);
  hello.set_finishes(1);
  hello.set_finish_memory_bytes(uint64_t{1} << 40);
  Open(coordinator, std::move(hello), access::LocalIdentity());
}

PumpedWorker::PumpedWorker(Coordinator* coordinator, const v1::Hello& hello) : seed_(1) {
  Open(coordinator, hello, access::LocalIdentity());
}

void PumpedWorker::Open(Coordinator* coordinator, v1::Hello hello, const access::Identity& caller) {
  hello.set_numeric_class(absl::StrCat("test-", PictureCode(), "-"));
  hello.set_wire_version(rpc::kWireVersion);
  absl::StatusOr<std::unique_ptr<WorkerSession>> session =
      WorkerSession::Open(&coordinator->workers(), hello, caller, this);
  EXPECT_TRUE(session.ok()) << session.status();
  session_ = *std::move(session);
}

void PumpedWorker::Send(const v1::CoordinatorMessage& message) {
  absl::MutexLock lock(&mutex_);
  for (const v1::Lease& lease : message.grant().leases()) {
    leases_.push_back(lease);
    leased_.insert(job::UnitFromProto(lease.unit()));
  }
  if (message.has_welcome()) id_ = message.welcome().worker_id();
  if (message.has_move()) move_address_ = message.move().address();
  if (message.has_ack() && message.ack().refused().empty())
    acknowledged_.insert(job::UnitFromProto(message.ack().unit()));
}

int PumpedWorker::Deliver(int count) {
  int delivered = 0;
  for (; delivered < count; ++delivered) {
    v1::Lease lease;
    {
      absl::MutexLock lock(&mutex_);
      if (leases_.empty()) break;
      lease = leases_.front();
      leases_.pop_front();
    }
    DeliverUnit(lease);
  }
  return delivered;
}

absl::Status PumpedWorker::DeliverResult(Coordinator* coordinator, const std::string& bytes,
                                         const std::string& promised) {
  const v1::Lease lease = TakeLease();
  v1::ResultAnnouncement announcement;
  *announcement.mutable_unit() = lease.unit();
  announcement.set_attempt(lease.attempt());
  {
    absl::MutexLock lock(&mutex_);
    announcement.set_worker_id(id_);
  }
  absl::StatusOr<std::unique_ptr<ResultUpload>> upload =
      coordinator->workers().ReceiveResult(announcement, access::KeyOf(access::LocalIdentity()));
  if (!upload.ok()) return upload.status();
  v1::ByteChunk chunk;
  chunk.set_data(bytes);
  chunk.set_total_size(bytes.size());
  chunk.set_checksum(rpc::Checksum(bytes));
  chunk.set_sha256(rpc::Sha256Hex(promised));
  if (absl::Status status = (*upload)->Add(chunk); !status.ok()) return status;
  return (*upload)->Finish();
}

void PumpedWorker::Fail(int count) {
  for (; count > 0 && leases() > 0; --count) {
    const v1::Lease lease = TakeLease();
    v1::WorkerMessage message;
    *message.mutable_failure()->mutable_unit() = lease.unit();
    message.mutable_failure()->set_attempt(lease.attempt());
    message.mutable_failure()->set_error("no such texture");
    message.mutable_failure()->set_permanent(true);
    EXPECT_TRUE(session_->Handle(&message).ok());
  }
}

int PumpedWorker::leases() const {
  absl::MutexLock lock(&mutex_);
  return static_cast<int>(leases_.size());
}

job::UnitRef PumpedWorker::next() const {
  absl::MutexLock lock(&mutex_);
  return job::UnitFromProto(leases_.front().unit());
}

std::string PumpedWorker::move_address() const {
  absl::MutexLock lock(&mutex_);
  return move_address_;
}

std::set<job::UnitRef> PumpedWorker::acknowledged() const {
  absl::MutexLock lock(&mutex_);
  return acknowledged_;
}

std::set<job::UnitRef> PumpedWorker::leased() const {
  absl::MutexLock lock(&mutex_);
  return leased_;
}

v1::Lease PumpedWorker::TakeLease() {
  const auto has_lease = [this]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return !leases_.empty(); };
  absl::MutexLock lock(&mutex_);
  mutex_.Await(absl::Condition(&has_lease));  // it may be on its way
  v1::Lease lease = leases_.front();
  leases_.pop_front();
  return lease;
}

void PumpedWorker::DeliverPlan(const v1::Plan& plan) { DeliverPlan(TakeLease(), plan); }

void PumpedWorker::DeliverPixels() { DeliverPixels(TakeLease()); }

void PumpedWorker::DeliverPlan(const v1::Lease& lease, const v1::Plan& plan) {
  v1::WorkerMessage message;
  *message.mutable_plan()->mutable_unit() = lease.unit();
  message.mutable_plan()->set_attempt(lease.attempt());
  *message.mutable_plan()->mutable_plan() = plan;
  EXPECT_TRUE(session_->Handle(&message).ok());
}

void PumpedWorker::DeliverUnit(const v1::Lease& lease) {
  lease.unit().kind() == v1::UNIT_KIND_PLAN ? DeliverPlan(lease, MadeUpPlan()) : DeliverPixels(lease);
}

void PumpedWorker::DeliverPixels(const v1::Lease& lease) {
  if (lease.keep()) {
    v1::WorkerMessage kept;
    *kept.mutable_kept()->mutable_unit() = lease.unit();
    kept.mutable_kept()->set_attempt(lease.attempt());
    EXPECT_TRUE(session_->Handle(&kept).ok());
    return;
  }
  const Rect rect = {lease.rect().x0(), lease.rect().y0(), lease.rect().x1(), lease.rect().y1()};
  const SampleRange samples = {static_cast<uint32_t>(lease.first_sample()),
                               static_cast<uint32_t>(lease.last_sample())};
  const EdgedImage image = RandomUnit(job::UnitFromProto(lease.unit()).key, rect, samples, seed_);
  v1::WorkerMessage message;
  *message.mutable_chunk()->mutable_unit() = lease.unit();
  message.mutable_chunk()->set_attempt(lease.attempt());
  const auto send = [&] {
    v1::WorkerMessage sent = message;  // the session takes its content
    EXPECT_TRUE(session_->Handle(&sent).ok());
  };
  if (ListOf(image).height() > 0) {
    rpc::PixelChunker list(ListOf(image));
    while (list.Next(message.mutable_chunk()->mutable_edges())) send();
    message.mutable_chunk()->clear_edges();
  }
  rpc::PixelChunker pixels(image.pixels);
  while (pixels.Next(message.mutable_chunk()->mutable_pixels())) send();
}

absl::Status CoordinatorFixture::Start() {
  absl::StatusOr<rpc::FileHandle> lock = data_.Claim();
  if (!lock.ok()) return lock.status();
  lock_ = *std::move(lock);
  if (absl::Status status = RemoveLeftovers(data_); !status.ok()) return status;
  if (absl::Status status = CheckHasLedger(data_); !status.ok()) return status;
  absl::StatusOr<std::unique_ptr<ledger::JobStore>> store = ledger::OpenSqliteJobStore(data_.LedgerPath());
  if (!store.ok()) return AdviseRecovery(data_, store.status());
  store_ = wrap_store_ ? wrap_store_(*std::move(store)) : *std::move(store);
  assets_ = std::make_unique<AssetStore>(data_.AssetsPath(), data_.IncomingPath(), nullptr, &files_);
  finisher_ =
      make_finisher_ ? make_finisher_() : MakeInProcessFinisher(data_, store_.get(), rpc::MonotonicNow);
  options_.finishing.pause = absl::Milliseconds(1);
  options_.now = rpc::MonotonicNow;
  options_.wall_now = [] { return absl::Now(); };
  options_.random = [this] { return std::hash<std::string>()(folder_.path()) + ++random_; };
  options_.log = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_mt>(log_));
  options_.storage.pauses.first = absl::Milliseconds(1);
  options_.storage.pauses.longest = absl::Milliseconds(2);
  absl::StatusOr<std::unique_ptr<Coordinator>> coordinator =
      Coordinator::Create(options_, data_, store_.get(), assets_.get(), finisher_.get());
  if (!coordinator.ok()) return coordinator.status();
  coordinator_ = *std::move(coordinator);
  return absl::OkStatus();
}

void CoordinatorFixture::Stop() {
  coordinator_.reset();
  finisher_.reset();
  assets_.reset();
  store_.reset();
  lock_ = rpc::FileHandle();
}

v1::JobSpec CoordinatorFixture::Spec(int tiles) const {
  const std::string content = kScene;
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.mutable_scene()->mutable_file()->set_sha256(rpc::Sha256Hex(content));
  spec.mutable_scene()->mutable_file()->set_size(content.size());
  spec.set_width(8 * tiles);
  spec.set_height(8);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(4);
  spec.set_pass_samples(4);
  spec.set_frame_count(1);
  spec.mutable_filter()->set_method("none");
  return spec;
}

v1::JobSpec CoordinatorFixture::UnplannedSpec(int tiles) const {
  v1::JobSpec spec = Spec(tiles);
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_AUTO);
  spec.clear_tile_size();
  spec.clear_pass_samples();
  return spec;
}

absl::StatusOr<job::JobId> CoordinatorFixture::TrySubmit(const v1::JobSpec& spec,
                                                         const std::string& request_id) {
  const v1::AssetRef& file = spec.scene().file();
  if (!assets_->Has(file.sha256())) {
    const absl::StatusOr<std::unique_ptr<AssetUpload>> upload =
        coordinator_->submissions().ReceiveAsset(file, "ann");
    if (!upload.ok()) return upload.status();
    v1::ByteChunk chunk;
    chunk.set_data(kScene);
    chunk.set_total_size(file.size());
    chunk.set_checksum(rpc::Checksum(chunk.data()));
    if (absl::Status status = coordinator_->submissions().NoteError((*upload)->Add(chunk)); !status.ok())
      return status;
    if (absl::Status status = coordinator_->submissions().NoteError((*upload)->Finish()); !status.ok())
      return status;
  }
  v1::SubmitJobRequest request;
  *request.mutable_spec() = spec;
  *request.mutable_scheduling() = scheduling_;
  request.set_request_id(request_id);
  const absl::StatusOr<v1::SubmitJobResponse> response = coordinator_->submissions().SubmitJob(request);
  if (!response.ok()) return response.status();
  return job::JobId(response->job_id());
}

job::JobId CoordinatorFixture::Submit(const v1::JobSpec& spec, const std::string& request_id) {
  while (true) {
    absl::StatusOr<job::JobId> job = TrySubmit(spec, request_id);
    if (job.ok()) return *std::move(job);
    EXPECT_EQ(job.status().code(), absl::StatusCode::kUnavailable) << job.status();
    if (files_.has_stopped()) return job::JobId();
    absl::SleepFor(absl::Milliseconds(1));
  }
}

v1::JobStatus CoordinatorFixture::Finish(const job::JobId& job, PumpedWorker* worker) {
  while (true) {
    const absl::StatusOr<v1::JobStatus> status = coordinator_->jobs().GetJob(job.value());
    EXPECT_TRUE(status.ok()) << status.status();
    if (!status.ok() || job::HasEnded(status->state()) || files_.has_stopped())
      return status.value_or(v1::JobStatus());
    if (worker->Deliver() == 0) absl::SleepFor(absl::Milliseconds(1));
  }
}

absl::Status CoordinatorFixture::Cancel(const job::JobId& job) {
  absl::Notification answered;
  absl::Status answer;
  coordinator_->changes().CancelJob(job.value(), [&](const absl::StatusOr<v1::JobStatus>& status) {
    answer = status.status();
    answered.Notify();
  });
  answered.WaitForNotification();
  return answer;
}

void CoordinatorFixture::Await(const std::function<bool()>& condition) {
  while (!condition()) absl::SleepFor(absl::Milliseconds(1));
}

void CoordinatorFixture::Deliver(PumpedWorker* worker, int count) {
  int left = count;
  Await([&] { return (left -= worker->Deliver(left)) == 0; });
}

std::string CoordinatorFixture::Result(const job::JobId& job, int32_t frame) const {
  return ReadFile(data_.ResultPath(job, frame), int64_t{1} << 30).value_or("");
}

}  // namespace lumifold::server
