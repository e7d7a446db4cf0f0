#include "tests/unit/server/fake_worker.h"

#include <algorithm>
#include <utility>

#include "absl/time/clock.h"
#include "proto/rpc/image_codec.h"
#include "tests/support/random_unit.h"

namespace lumifold::server {

namespace {

/// Says that the grant is received, and of earlier ones nothing.
v1::WorkerMessage AnswerTo(const v1::Grant& grant) {
  v1::WorkerMessage message;
  *message.mutable_heartbeat()->mutable_held() = grant.leases();
  return message;
}

}  // namespace

FakeWorker::FakeWorker(const std::shared_ptr<grpc::Channel>& channel, FakeWorkerOptions options)
    : options_(std::move(options)), stub_(v1::WorkerService::NewStub(channel)), thread_([this] { Run(); }) {}

FakeWorker::~FakeWorker() {
  Vanish();
  Wait();
}

grpc::Status FakeWorker::Wait() {
  if (thread_.joinable()) thread_.join();
  return result_;
}

int FakeWorker::acknowledged() const {
  absl::MutexLock lock(&mutex_);
  return acknowledged_;
}

int FakeWorker::delivered() const {
  absl::MutexLock lock(&mutex_);
  return delivered_;
}

std::vector<std::string> FakeWorker::ended_jobs() const {
  absl::MutexLock lock(&mutex_);
  return ended_jobs_;
}

std::vector<std::string> FakeWorker::refusals() const {
  absl::MutexLock lock(&mutex_);
  return refusals_;
}

bool FakeWorker::WaitForEndOf(const std::string& job_id) const {
  absl::MutexLock lock(&mutex_);
  const auto ended = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
    return std::count(ended_jobs_.begin(), ended_jobs_.end(), job_id) > 0;
  };
  return mutex_.AwaitWithTimeout(absl::Condition(&ended), absl::Minutes(10));
}

bool FakeWorker::WaitForDrain() const {
  absl::MutexLock lock(&mutex_);
  return mutex_.AwaitWithTimeout(absl::Condition(&is_drained_), absl::Minutes(10));
}

bool FakeWorker::Send(v1::WorkerMessage message, Stream* stream) {
  options_.spoil(message);
  return stream->Write(message);
}

void FakeWorker::Run() {
  const std::unique_ptr<Stream> stream = stub_->Work(&context_);
  v1::WorkerMessage hello;
  hello.mutable_hello()->set_name("fake");
  hello.mutable_hello()->set_numeric_class(options_.numeric_class);
  hello.mutable_hello()->set_slots(options_.slots);
  hello.mutable_hello()->set_wire_version(options_.wire_version);
  Send(hello, stream.get());
  v1::CoordinatorMessage message;
  while (stream->Read(&message)) {
    if (OnMessage(message, stream.get())) continue;
    if (options_.answers_grants) {
      stream->WritesDone();
    } else {
      Vanish();
    }
  }
  result_ = stream->Finish();
}

bool FakeWorker::OnMessage(const v1::CoordinatorMessage& message, Stream* stream) {
  if (message.has_job_ended()) {
    absl::MutexLock lock(&mutex_);
    ended_jobs_.push_back(message.job_ended().job_id());
  }
  if (message.has_drain()) {
    absl::MutexLock lock(&mutex_);
    is_drained_ = true;
  }
  if (message.has_ack()) {
    absl::MutexLock lock(&mutex_);
    ++acknowledged_;
  }
  if (!message.ack().refused().empty()) {
    absl::MutexLock lock(&mutex_);
    refusals_.push_back(message.ack().refused());
  }
  if (options_.answers_grants && message.has_grant() && !Send(AnswerTo(message.grant()), stream))
    return false;
  for (const v1::Lease& lease : message.grant().leases()) {
    if (!Deliver(lease, stream)) return false;
  }
  return true;
}

bool FakeWorker::Deliver(const v1::Lease& lease, Stream* stream) {
  const job::UnitRef unit = job::UnitFromProto(lease.unit());
  const Rect rect = {lease.rect().x0(), lease.rect().y0(), lease.rect().x1(), lease.rect().y1()};
  const SampleRange samples = {static_cast<uint32_t>(lease.first_sample()),
                               static_cast<uint32_t>(lease.last_sample())};
  const EdgedImage image = RandomUnit(unit.key, rect, samples, 1);
  v1::WorkerMessage message;
  *message.mutable_chunk()->mutable_unit() = lease.unit();
  message.mutable_chunk()->set_attempt(lease.attempt());
  if (ListOf(image).height() > 0) {
    rpc::PixelChunker list(ListOf(image));
    while (list.Next(message.mutable_chunk()->mutable_edges())) {
      if (!Send(message, stream)) return false;
    }
    message.mutable_chunk()->clear_edges();
  }
  rpc::PixelChunker chunker(image.pixels);
  while (chunker.Next(message.mutable_chunk()->mutable_pixels())) {
    const bool vanishes = delivered() == options_.vanish_after;
    if (vanishes && message.chunk().pixels().last()) return false;
    if (message.chunk().pixels().last()) message.mutable_chunk()->mutable_stats()->add_warnings("made up");
    if (!Send(message, stream)) return false;
  }
  absl::MutexLock lock(&mutex_);
  ++delivered_;
  return true;
}

}  // namespace lumifold::server
