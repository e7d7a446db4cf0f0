// A worker for tests: it renders as lumifold-worker does, but breaks the protocol in the way that --behaviour
// names, or in several by turns. It writes "event=hostile" with what it did to standard error for each unit,
// so that a test knows that it did harm.
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "filter/image/layers.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/version.h"
#include "worker/cache/asset_cache.h"
#include "worker/cache/spec_cache.h"
#include "worker/connection/remote_sources.h"
#include "worker/render/renderer.h"
#include "worker/units/unit_renderer.h"

namespace lumifold {
namespace {

using worker::RenderedUnit;

constexpr absl::Duration kReconnectPause = absl::Milliseconds(300);
/// Texts of 3 MB just fit a message.
constexpr size_t kLongTextBytes = 3'000'000;
constexpr size_t kWarningBytes = 1000;
/// The factor of wrong pixels: wrong enough to be seen in any picture, and plausible.
constexpr float kWrongFactor = 1.5f;

struct Options {
  std::string server;
  std::string name;
  std::vector<std::string> behaviours;
  int slots = 2;
  double late_seconds = 5;
};

void Report(const std::string& text) { std::fprintf(stderr, "event=hostile %s\n", text.c_str()); }

std::string Describe(const v1::UnitId& unit) {
  return absl::StrCat("unit=", unit.job_id(), "/", unit.frame(), "/", unit.tile(), "/", unit.pass());
}

/// Changes a piece of a unit before it is sent.
using Spoil = void (*)(v1::UnitChunk& chunk);

/// The coordinator, and who it takes this worker for.
struct Farm {
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<v1::WorkerService::Stub> stub;
  worker::CurrentCoordinator current;
};

/// One stream to the coordinator. Threads: safe concurrently.
class Session {
 public:
  Session(Farm* farm, worker::SpecCache* specs, worker::UnitRenderer* renderer, const Options& options)
      : options_(options),
        specs_(specs),
        renderer_(renderer),
        farm_(farm),
        stream_(farm->stub->Work(&context_)) {}

  bool Send(const v1::WorkerMessage& message) {
    absl::MutexLock lock(&write_mutex_);
    return stream_->Write(message);
  }

  void SendHello(int wire_version) {
    v1::WorkerMessage message;
    message.mutable_hello()->set_name(options_.name);
    message.mutable_hello()->set_numeric_class(render::NumericClass());
    message.mutable_hello()->set_slots(options_.slots);
    message.mutable_hello()->set_wire_version(wire_version);
    Send(message);
  }

  /// Sends a unit under any name and attempt; each piece is passed through `spoil`.
  void SendUnit(const v1::UnitId& unit, int64_t attempt, const RenderedUnit& rendered, Spoil spoil) {
    v1::WorkerMessage message;
    v1::UnitChunk* chunk = message.mutable_chunk();
    *chunk->mutable_unit() = unit;
    chunk->set_attempt(attempt);
    for (const LayeredImage* list : {&rendered.image.edges, &rendered.image.fragments}) {
      if (list->height() == 0) continue;
      rpc::PixelChunker rows(*list);
      while (rows.Next(chunk->mutable_edges())) Send(message);
      chunk->clear_edges();
    }
    rpc::PixelChunker pixels(rendered.image.pixels);
    while (pixels.Next(chunk->mutable_pixels())) {
      if (chunk->pixels().last()) *chunk->mutable_stats() = rendered.stats;
      v1::WorkerMessage spoilt = message;
      spoil(*spoilt.mutable_chunk());
      Send(spoilt);
    }
  }

  void SendPlan(const v1::Lease& lease, const v1::Plan& plan) {
    v1::WorkerMessage message;
    *message.mutable_plan()->mutable_unit() = lease.unit();
    message.mutable_plan()->set_attempt(lease.attempt());
    *message.mutable_plan()->mutable_plan() = plan;
    Send(message);
  }

  void SendUnit(const v1::Lease& lease, const RenderedUnit& rendered) {
    SendUnit(lease.unit(), lease.attempt(), rendered, [](v1::UnitChunk&) {});
  }

  void SendFailure(const v1::Lease& lease, std::string error, bool permanent) {
    v1::WorkerMessage message;
    *message.mutable_failure()->mutable_unit() = lease.unit();
    message.mutable_failure()->set_attempt(lease.attempt());
    message.mutable_failure()->set_error(std::move(error));
    message.mutable_failure()->set_permanent(permanent);
    Send(message);
    Forget(lease);
  }

  void SendHeartbeat() {
    v1::WorkerMessage message;
    {
      absl::MutexLock lock(&mutex_);
      if (silent_ || !welcome_) return;
      ++beats_;
      for (const auto& [attempt, lease] : held_) {
        *message.mutable_heartbeat()->add_held() = lease;
        message.mutable_heartbeat()->mutable_held()->rbegin()->set_progress(beats_);
      }
      message.mutable_heartbeat()->set_newest_attempt(newest_attempt_);
    }
    Send(message);
  }

  /// Sends no heartbeats while `silent`.
  void SetSilent(bool silent) {
    absl::MutexLock lock(&mutex_);
    silent_ = silent;
  }

  /// The next heartbeat does not name the lease any more.
  void Forget(const v1::Lease& lease) {
    absl::MutexLock lock(&mutex_);
    held_.erase(lease.attempt());
  }

  /// A lease of another job than `lease`, the last one that was granted; nullopt if there was none.
  std::optional<v1::Lease> LeaseOfAnotherJob(const v1::Lease& lease) const {
    absl::MutexLock lock(&mutex_);
    for (const auto& [job, last] : last_leases_) {
      if (job != lease.unit().job_id()) return last;
    }
    return std::nullopt;
  }

  absl::StatusOr<RenderedUnit> Render(const v1::Lease& lease) {
    const absl::StatusOr<std::shared_ptr<const v1::JobSpec>> spec =
        specs_->Get(lease.unit().job_id(), lease.unit().kind());
    if (!spec.ok()) return spec.status();
    worker::UnitControl control;
    return renderer_->Render(**spec, lease, &control);
  }

  /// Reads messages until the stream ends.
  void ReadAll() {
    v1::CoordinatorMessage message;
    while (stream_->Read(&message)) {
      absl::MutexLock lock(&mutex_);
      if (message.has_welcome()) {
        farm_->current.Set(farm_->channel, message.welcome().worker_id());
        welcome_ = true;
      }
      if (message.has_ack()) held_.erase(message.ack().attempt());
      if (message.has_grant()) OnGrant(message.grant());
    }
    absl::MutexLock lock(&mutex_);
    ended_ = true;
  }

  /// Waits for a lease; nullopt when the stream has ended.
  std::optional<v1::Lease> NextLease() {
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(
        +[](Session* self) ABSL_NO_THREAD_SAFETY_ANALYSIS { return self->ended_ || !self->waiting_.empty(); },
        this));
    if (ended_) return std::nullopt;
    v1::Lease lease = std::move(waiting_.front());
    waiting_.pop_front();
    return lease;
  }

  void Vanish() { context_.TryCancel(); }

  /// The status of the ended stream.
  grpc::Status Finish() { return stream_->Finish(); }

  const Options& options() const { return options_; }

 private:
  void OnGrant(const v1::Grant& grant) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    for (const v1::Lease& lease : grant.leases()) {
      held_[lease.attempt()] = lease;
      last_leases_[lease.unit().job_id()] = lease;
      newest_attempt_ = std::max(newest_attempt_, lease.attempt());
      waiting_.push_back(lease);
    }
  }

  const Options& options_;
  worker::SpecCache* const specs_;
  worker::UnitRenderer* const renderer_;
  Farm* const farm_;
  grpc::ClientContext context_;
  absl::Mutex write_mutex_;
  const std::unique_ptr<grpc::ClientReaderWriter<v1::WorkerMessage, v1::CoordinatorMessage>> stream_;

  mutable absl::Mutex mutex_;
  bool welcome_ ABSL_GUARDED_BY(mutex_) = false;
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
  bool silent_ ABSL_GUARDED_BY(mutex_) = false;
  int64_t beats_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t newest_attempt_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<int64_t, v1::Lease> held_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, v1::Lease> last_leases_ ABSL_GUARDED_BY(mutex_);
  std::deque<v1::Lease> waiting_ ABSL_GUARDED_BY(mutex_);
};

// ---- What is done with a rendered unit. ----

void Scale(RenderedUnit* unit, float factor) {
  for (LayeredImage::Channel& channel : unit->image.pixels.channels()) {
    if (!channel.name.ends_with(".R")) continue;
    for (int y = 0; y < channel.plane.height(); ++y) {
      float* row = channel.plane.Row(y);
      for (int x = 0; x < channel.plane.width(); ++x) row[x] *= factor;
    }
  }
}

void SendWithFirstValue(Session& session, const v1::Lease& lease, RenderedUnit& unit, float value) {
  unit.image.pixels.channels().front().plane.Row(0)[0] = value;
  session.SendUnit(lease, unit);
}

void SendWithCount(Session& session, const v1::Lease& lease, RenderedUnit& unit, float change) {
  for (LayeredImage::Channel& channel : unit.image.pixels.channels()) {
    if (channel.name == layers::kSamplesA) channel.plane.Row(0)[0] += change;
  }
  // Geometry units have no counts: their statistics are wrong instead.
  if (lease.unit().kind() == v1::UNIT_KIND_GEOMETRY) unit.stats.set_bad_samples(-1);
  session.SendUnit(lease, unit);
}

void SendNan(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  SendWithFirstValue(session, lease, unit, std::numeric_limits<float>::quiet_NaN());
}

void SendInfinity(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  SendWithFirstValue(session, lease, unit, std::numeric_limits<float>::infinity());
}

void SendNegativeCount(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  SendWithCount(session, lease, unit, -1e6f);
}

void SendTooManySamples(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  SendWithCount(session, lease, unit, 2);
}

void SendWrongSize(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  const LayeredImage& pixels = unit.image.pixels;
  unit.image.pixels = pixels.Crop({0, 0, pixels.width() - 1, pixels.height()});
  session.SendUnit(lease, unit);
}

void SendMissingChannel(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  unit.image.pixels.channels().pop_back();
  session.SendUnit(lease, unit);
}

void SendWrongTile(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  v1::UnitId other = lease.unit();
  other.set_tile(other.tile() == 0 ? 1 : other.tile() - 1);
  session.SendUnit(other, lease.attempt(), unit, [](v1::UnitChunk&) {});
  session.Forget(lease);
}

void SendWithTokenOfAnotherJob(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  Scale(&unit, kWrongFactor);
  if (const std::optional<v1::Lease> other = session.LeaseOfAnotherJob(lease); other.has_value()) {
    session.SendUnit(lease.unit(), other->attempt(), unit, [](v1::UnitChunk&) {});
    session.SendUnit(other->unit(), lease.attempt(), unit, [](v1::UnitChunk&) {});
    Report("sent with the token of another job");
  }
  session.Forget(lease);
}

void SendGarbage(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  session.SendUnit(lease.unit(), lease.attempt(), unit, [](v1::UnitChunk& chunk) {
    static std::mt19937 random(1);
    for (char& byte : *chunk.mutable_pixels()->mutable_data()) byte = static_cast<char>(random());
    chunk.mutable_pixels()->set_checksum(rpc::Checksum(chunk.pixels().data()));
  });
}

void SendFlippedBit(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  session.SendUnit(lease.unit(), lease.attempt(), unit,
                   [](v1::UnitChunk& chunk) { chunk.mutable_pixels()->mutable_data()->back() ^= 1; });
}

void SendShort(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  session.SendUnit(lease.unit(), lease.attempt(), unit, [](v1::UnitChunk& chunk) {
    chunk.mutable_pixels()->mutable_data()->resize(chunk.pixels().data().size() / 2);
    chunk.mutable_pixels()->set_checksum(rpc::Checksum(chunk.pixels().data()));
  });
}

void SendWarnings(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  static int64_t number = 0;
  for (size_t sent = 0; sent < kLongTextBytes; sent += kWarningBytes)
    unit.stats.add_warnings(absl::StrCat("warning ", ++number, std::string(kWarningBytes - 20, 'w')));
  session.SendUnit(lease, unit);
}

void SendTwice(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  session.SendUnit(lease, unit);
  Scale(&unit, kWrongFactor);
  session.SendUnit(lease, unit);
}

void SendLate(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  session.SetSilent(true);
  absl::SleepFor(absl::Seconds(session.options().late_seconds));
  Scale(&unit, kWrongFactor);
  session.SendUnit(lease, unit);
  session.Forget(lease);
  session.SetSilent(false);
}

void SendWrongPixels(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  Scale(&unit, kWrongFactor);
  session.SendUnit(lease, unit);
}

void SendHalfAndVanish(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  session.SendUnit(lease.unit(), lease.attempt(), unit,
                   [](v1::UnitChunk& chunk) { chunk.mutable_pixels()->set_last(false); });
  session.Vanish();
}

void SendLongFailure(Session& session, const v1::Lease& lease, RenderedUnit&) {
  session.SendFailure(lease, std::string(kLongTextBytes, 'e'), /*permanent=*/true);
}

void SendForeignFailures(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  for (int tile = 0; tile < 100; ++tile) {
    v1::Lease other = lease;
    other.mutable_unit()->set_tile(tile);
    other.set_attempt(lease.attempt() + tile + 1);
    session.SendFailure(other, "failure of a unit of another worker", /*permanent=*/true);
  }
  session.SendUnit(lease, unit);
}

void SendWrongPlan(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  if (!unit.plan.has_value()) return session.SendUnit(lease, unit);
  unit.plan->mutable_decisions()->rbegin()->set_value(-1);
  session.SendPlan(lease, *unit.plan);
}

void DeliverHonestly(Session& session, const v1::Lease& lease, RenderedUnit& unit) {
  if (unit.plan.has_value()) return session.SendPlan(lease, *unit.plan);
  session.SendUnit(lease, unit);
}

void KeepLease(Session&, const v1::Lease&, RenderedUnit&) {}

void SendHelloAgain(Session& session, const v1::Lease&, RenderedUnit&) {
  session.SendHello(rpc::kWireVersion);
}

struct Behaviour {
  const char* name;
  const char* what;
  void (*deliver)(Session& session, const v1::Lease& lease, RenderedUnit& unit);
  bool spoils_plans = false;  // it does that to plans, too
};

constexpr std::array kBehaviours = {
    Behaviour{"nan", "one value is NaN", SendNan},
    Behaviour{"infinity", "one value is infinite", SendInfinity},
    Behaviour{"negative-count", "a sample count is negative", SendNegativeCount},
    Behaviour{"too-many-samples", "a sample count is above that of the pass", SendTooManySamples},
    Behaviour{"wrong-size", "the unit is one pixel narrower than its tile", SendWrongSize},
    Behaviour{"missing-channel", "a channel is missing", SendMissingChannel},
    Behaviour{"wrong-tile", "delivers a tile under another's number", SendWrongTile},
    Behaviour{"other-job", "delivers with the token of another job", SendWithTokenOfAnotherJob},
    Behaviour{"garbage", "random bytes for pixels, with a checksum that fits", SendGarbage},
    Behaviour{"flipped-bit", "one bit differs from what the checksum is of", SendFlippedBit},
    Behaviour{"short", "half of the bytes", SendShort},
    Behaviour{"warnings", "3 MB of new warnings with each unit", SendWarnings},
    Behaviour{"twice", "delivers each unit twice, with wrong pixels the second time", SendTwice},
    Behaviour{"late", "is silent past its lease, then delivers wrong pixels", SendLate},
    Behaviour{"wrong-pixels", "plausible but wrong pixels", SendWrongPixels},
    Behaviour{"vanish", "breaks the connection within each unit", SendHalfAndVanish},
    Behaviour{"long-error", "calls each unit impossible to render, in 3 MB of text", SendLongFailure},
    Behaviour{"foreign-failures", "reports failures of units that others have leased", SendForeignFailures},
    Behaviour{"wrong-plan", "a value of each plan is out of range", SendWrongPlan, /*spoils_plans=*/true},
    Behaviour{"hoard", "reports progress for ever and delivers nothing", KeepLease},
    Behaviour{"second-hello", "introduces itself again", SendHelloAgain},
};
/// These two never get a lease.
constexpr const char* kOtherVersion = "other-version";
constexpr const char* kGarbageMessage = "garbage-message";

const Behaviour* FindBehaviour(const std::string& name) {
  for (const Behaviour& behaviour : kBehaviours) {
    if (name == behaviour.name) return &behaviour;
  }
  return nullptr;
}

/// One connection; returns how the coordinator ended it.
grpc::Status RunSession(Farm* farm, worker::SpecCache* specs, worker::UnitRenderer* renderer,
                        const Options& options) {
  static size_t turn = 0;
  Session session(farm, specs, renderer, options);
  session.SendHello(options.behaviours.front() == kOtherVersion ? rpc::kWireVersion + 1 : rpc::kWireVersion);
  std::thread reader([&session] { session.ReadAll(); });
  std::atomic<bool> stop = false;
  std::thread heart([&] {
    while (!stop) {
      session.SendHeartbeat();
      absl::SleepFor(absl::Milliseconds(100));
    }
  });
  while (const std::optional<v1::Lease> lease = session.NextLease()) {
    absl::StatusOr<RenderedUnit> unit = session.Render(*lease);
    if (!unit.ok()) {
      session.Forget(*lease);
      continue;
    }
    const Behaviour* behaviour = FindBehaviour(options.behaviours[turn++ % options.behaviours.size()]);
    const bool is_plan = unit->plan.has_value();
    (is_plan && !behaviour->spoils_plans ? &DeliverHonestly : behaviour->deliver)(session, *lease, *unit);
    Report(absl::StrCat("behaviour=", behaviour->name, " ", Describe(lease->unit())));
  }
  stop = true;
  heart.join();
  reader.join();
  return session.Finish();
}

/// Sends random bytes where a message should be.
grpc::Status SendGarbageMessage(const std::shared_ptr<grpc::Channel>& channel) {
  static std::mt19937 random(1);
  std::string bytes(1000, '\0');
  for (char& byte : bytes) byte = static_cast<char>(random());
  const grpc::Slice slice(bytes);
  const grpc::ByteBuffer message(&slice, 1);
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const auto call = stub.PrepareCall(&context, "/lumifold.v1.WorkerService/Work", &queue);
  void* tag = nullptr;
  bool ok = false;
  call->StartCall(nullptr);
  queue.Next(&tag, &ok);
  call->Write(message, nullptr);
  queue.Next(&tag, &ok);
  grpc::Status status;
  call->Finish(&status, nullptr);
  queue.Next(&tag, &ok);
  return status;
}

void Run(const Options& options) {
  Farm farm;
  farm.channel = rpc::MakeChannel(options.server, rpc::Security{});
  farm.stub = v1::WorkerService::NewStub(farm.channel);
  const auto labels = std::make_shared<logging::JobLabels>();
  const std::unique_ptr<worker::AssetSource> assets = worker::MakeRemoteAssetSource(&farm.current, labels);
  worker::AssetCache cache(assets.get(), worker::kAssetCacheBytes);
  worker::UnitRenderer renderer(&cache);
  const std::unique_ptr<worker::SpecSource> spec_source = worker::MakeRemoteSpecSource(&farm.current, labels);
  worker::SpecCache specs(spec_source.get());
  while (true) {
    const grpc::Status status = options.behaviours.front() == kGarbageMessage
                                    ? SendGarbageMessage(farm.channel)
                                    : RunSession(&farm, &specs, &renderer, options);
    Report(absl::StrCat("behaviour=", options.behaviours.front(), " ended code=",
                        static_cast<int>(status.error_code()), " error=\"", status.error_message(), "\""));
    absl::SleepFor(kReconnectPause);
  }
}

}  // namespace
}  // namespace lumifold

int main(int argc, char** argv) {
  setenv("GRPC_VERBOSITY", "NONE", /*overwrite=*/0);
  signal(SIGPIPE, SIG_IGN);
  CLI::App app("A worker that breaks the protocol in one way, for tests.", "hostile-worker");
  lumifold::Options options;
  options.name = absl::StrCat("hostile:", getpid());
  std::vector<std::string> names = {lumifold::kOtherVersion, lumifold::kGarbageMessage};
  for (const lumifold::Behaviour& behaviour : lumifold::kBehaviours) names.emplace_back(behaviour.name);
  app.add_option("--server", options.server, "Coordinator, HOST:PORT")->required();
  app.add_option("--behaviour", options.behaviours, "What it does; several: with one unit after the other")
      ->required()
      ->delimiter(',')
      ->check(CLI::IsMember(names));
  app.add_option("--name", options.name, "Name in the coordinator's log");
  app.add_option("--slots", options.slots, "Leases at a time");
  app.add_option("--late-seconds", options.late_seconds, "Silence of 'late'");
  CLI11_PARSE(app, argc, argv);
  lumifold::Run(options);
}
