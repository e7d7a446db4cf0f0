#include "worker/worker_impl.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/limits.h"
#include "spdlog/spdlog.h"

namespace lumifold::worker {
namespace {

bool IsLease(const v1::Lease& lease, const v1::UnitId& unit, int64_t attempt) {
  const v1::UnitId& own = lease.unit();
  return lease.attempt() == attempt && own.job_id() == unit.job_id() && own.frame() == unit.frame() &&
         own.tile() == unit.tile() && own.pass() == unit.pass() && own.kind() == unit.kind();
}

std::string Describe(const v1::UnitId& unit) {
  return absl::StrCat("job=", unit.job_id(), " frame=", unit.frame(), " tile=", unit.tile(),
                      " pass=", unit.pass(),
                      " kind=", unit.kind() == v1::UNIT_KIND_GEOMETRY ? "geometry" : "pass");
}

v1::WorkerMessage MakeChunk(const v1::Lease& lease) {
  v1::WorkerMessage message;
  *message.mutable_chunk()->mutable_unit() = lease.unit();
  message.mutable_chunk()->set_attempt(lease.attempt());
  return message;
}

void SendUnit(const v1::Lease& lease, const RenderedUnit& unit, Outbox* outbox) {
  v1::PixelChunk piece;
  if (unit.image.edges.height() > 0) {
    rpc::PixelChunker edges(unit.image.edges);
    while (edges.Next(&piece)) {
      v1::WorkerMessage message = MakeChunk(lease);
      message.mutable_chunk()->mutable_edges()->Swap(&piece);
      outbox->Send(std::move(message));
    }
  }
  rpc::PixelChunker pixels(unit.image.pixels);
  while (pixels.Next(&piece)) {
    v1::WorkerMessage message = MakeChunk(lease);
    if (piece.last()) *message.mutable_chunk()->mutable_stats() = unit.stats;
    message.mutable_chunk()->mutable_pixels()->Swap(&piece);
    outbox->Send(std::move(message));
  }
}

void SendFailure(const v1::Lease& lease, const absl::Status& failure, Outbox* outbox) {
  v1::WorkerMessage message;
  v1::UnitFailure* out = message.mutable_failure();
  *out->mutable_unit() = lease.unit();
  out->set_attempt(lease.attempt());
  out->set_error(rpc::BoundedLine(std::string(failure.message()), rpc::kMaxErrorBytes));
  out->set_permanent(IsPermanent(failure));
  outbox->Send(std::move(message));
}

}  // namespace

WorkerImpl::WorkerImpl(int threads, UnitRenderer* renderer, std::shared_ptr<spdlog::logger> log)
    : renderer_(renderer), log_(std::move(log)) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { RunThread(); });
}

WorkerImpl::~WorkerImpl() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
  }
  for (std::thread& thread : threads_) thread.join();
}

void WorkerImpl::OnConnected(std::shared_ptr<Outbox> outbox) {
  absl::MutexLock lock(&mutex_);
  outbox_ = std::move(outbox);
}

void WorkerImpl::OnDisconnected() {
  absl::MutexLock lock(&mutex_);
  outbox_ = nullptr;
  newest_attempt_ = 0;
  waiting_.clear();
  held_.clear();
  progress_.clear();
  specs_.clear();
}

void WorkerImpl::OnMessage(const v1::CoordinatorMessage& message) {
  absl::MutexLock lock(&mutex_);
  switch (message.message_case()) {
    case v1::CoordinatorMessage::kGrant:
      return OnGrant(message.grant());
    case v1::CoordinatorMessage::kAck:
      return OnAck(message.ack());
    case v1::CoordinatorMessage::kJobEnded:
      return OnJobEnded(message.job_ended().job_id());
    default:
      return;  // Welcome is handled by the connection
  }
}

void WorkerImpl::OnGrant(const v1::Grant& grant) {
  for (const v1::Lease& lease : grant.leases()) {
    const std::string& job_id = lease.unit().job_id();
    if (grant.has_spec()) specs_[job_id] = std::make_shared<v1::JobSpec>(grant.spec());
    if (!specs_.contains(job_id)) {
      log_->error("event=lease_without_spec {}", Describe(lease.unit()));
      continue;
    }
    newest_attempt_ = std::max(newest_attempt_, lease.attempt());
    held_.push_back(lease);
    waiting_.push_back(lease);
  }
}

template <typename Condition>
void WorkerImpl::RemoveHeld(Condition condition) {
  std::erase_if(held_, [&](const v1::Lease& lease) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!condition(lease)) return false;
    const auto progress = progress_.find(lease.attempt());
    if (progress != progress_.end()) {
      past_progress_ += *progress->second;
      progress_.erase(progress);
    }
    return true;
  });
}

void WorkerImpl::OnAck(const v1::UnitAck& ack) {
  if (!ack.refused().empty())
    log_->error("event=unit_refused {} reason=\"{}\"", Describe(ack.unit()), ack.refused());
  RemoveHeld([&](const v1::Lease& held) { return IsLease(held, ack.unit(), ack.attempt()); });
}

void WorkerImpl::Forget(const v1::Lease& lease) {
  absl::MutexLock lock(&mutex_);
  RemoveHeld([&](const v1::Lease& held) { return IsLease(held, lease.unit(), lease.attempt()); });
}

void WorkerImpl::OnJobEnded(const std::string& job_id) {
  const auto is_of_job = [&](const v1::Lease& lease) { return lease.unit().job_id() == job_id; };
  std::erase_if(waiting_, is_of_job);
  RemoveHeld(is_of_job);
  specs_.erase(job_id);
  renderer_->ForgetJob(job_id);
}

v1::Heartbeat WorkerImpl::MakeHeartbeat() const {
  absl::MutexLock lock(&mutex_);
  v1::Heartbeat heartbeat;
  int64_t all = past_progress_;
  for (const auto& [attempt, progress] : progress_) all += *progress;
  for (const v1::Lease& lease : held_) {
    const auto own = progress_.find(lease.attempt());
    *heartbeat.add_held() = lease;
    heartbeat.mutable_held()->rbegin()->set_progress(own == progress_.end() ? all : own->second->load());
  }
  heartbeat.set_newest_attempt(newest_attempt_);
  return heartbeat;
}

void WorkerImpl::RunThread() {
  while (true) {
    v1::Lease lease;
    std::shared_ptr<const v1::JobSpec> spec;
    std::shared_ptr<Outbox> outbox;
    const auto progress = std::make_shared<std::atomic<int64_t>>(0);
    {
      absl::MutexLock lock(&mutex_);
      mutex_.Await(absl::Condition(this, &WorkerImpl::HasWorkOrStops));
      if (stopping_) return;
      lease = std::move(waiting_.front());
      waiting_.pop_front();
      spec = specs_.at(lease.unit().job_id());
      outbox = outbox_;
      progress_[lease.attempt()] = progress;
    }
    RenderAndSend(lease, *spec, outbox, progress.get());
  }
}

void WorkerImpl::RenderAndSend(const v1::Lease& lease, const v1::JobSpec& spec,
                               const std::shared_ptr<Outbox>& outbox, std::atomic<int64_t>* progress) {
  const absl::StatusOr<RenderedUnit> unit = renderer_->Render(spec, lease, progress);
  if (!IsCurrent(lease, outbox)) return;
  if (!unit.ok()) {
    log_->error("event=unit_failed {} error=\"{}\"", Describe(lease.unit()),
                std::string(unit.status().message()));
    Forget(lease);
    SendFailure(lease, unit.status(), outbox.get());
    return;
  }
  log_->debug("event=unit_rendered {} seconds={:.3f}", Describe(lease.unit()), unit->stats.seconds());
  SendUnit(lease, *unit, outbox.get());
}

bool WorkerImpl::IsCurrent(const v1::Lease& lease, const std::shared_ptr<Outbox>& outbox) const {
  absl::MutexLock lock(&mutex_);
  return outbox_ == outbox && std::any_of(held_.begin(), held_.end(), [&](const v1::Lease& held) {
           return IsLease(held, lease.unit(), lease.attempt());
         });
}

}  // namespace lumifold::worker
