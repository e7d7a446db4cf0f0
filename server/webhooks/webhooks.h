#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/job.pb.h"
#include "server/ledger/delivery_queue.h"
#include "server/webhooks/poster.h"
#include "server/webhooks/targets.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::webhooks {

/// What an operator says of webhooks.
struct WebhookOptions {
  /// See AllowedHosts::Parse; empty: none is called.
  std::string hosts;
  /// See ReadSecret; empty: a file of the data folder, made if it is missing.
  std::string secret_path;
  /// Authorities whose receivers are trusted; empty: the system's.
  std::string ca_path;
};

/// What a coordinator's Webhooks work with; all outlives them.
struct Surroundings {
  /// Where the secret is if the options name no file.
  std::string secret_path = {};
  ledger::DeliveryQueue* queue = nullptr;
  std::function<absl::Time()> wall_now = {};
  std::function<uint64_t()> random = {};
  std::shared_ptr<spdlog::logger> log = {};
};

/// Pause before the next try of a message that has failed this often.
absl::Duration PauseAfter(int failures);

/// Calls the webhooks of jobs that have ended: each is tried again until its receiver accepts it, for a day.
/// What waits is in the ledger; this class has what is in flight, a few for each receiver, so that one that
/// hangs delays no other.
/// Threads: safe; it has one of its own, if there are hosts to call.
class Webhooks {
 public:
  /// Errors: those of the options, naming the option or the file.
  static absl::StatusOr<std::unique_ptr<Webhooks>> Open(const WebhookOptions& options,
                                                        Surroundings surroundings);
  ~Webhooks();

  /// Whether a job may have this webhook. Errors: those of AllowedHosts::Check.
  absl::Status Check(const std::string& url) const { return hosts_.Check(url).status(); }
  /// What JobStore::EndJob is to record; nullopt without a webhook. One that cannot be called is logged.
  std::optional<ledger::NewDelivery> DeliveryOf(const v1::JobStatus& ended);
  /// It is recorded.
  void Wake();
  /// Of a job that has ended; nullopt: it has none. Errors: those of the queue.
  absl::StatusOr<std::optional<v1::WebhookDelivery>> StatusOf(const std::string& job) const;
  /// nullopt where no host is allowed.
  std::optional<v1::WebhookCounts> counts() const;

  void Start();
  /// Breaks off what is in flight: it is tried again after the next start, or by another coordinator.
  void Stop();

 private:
  explicit Webhooks(Surroundings surroundings) : around_(std::move(surroundings)) {}

  void Run();
  bool is_stopping() const;
  /// Takes what is due and starts it. Returns the time until the next look.
  absl::Duration Look();
  void GiveUpOld();
  void Send(const ledger::Delivery& delivery, const std::string& origin);
  void Record(const PostOutcome& outcome);

  struct InFlight {
    ledger::Delivery delivery;
    std::string origin;
  };

  const Surroundings around_;
  AllowedHosts hosts_;
  std::string secret_;
  std::unique_ptr<Poster> poster_;  // null: no host is allowed
  std::thread thread_;
  std::map<int64_t, InFlight> in_flight_;  // of the thread, by number
  mutable absl::Mutex mutex_;
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  bool is_woken_ ABSL_GUARDED_BY(mutex_) = false;
  v1::WebhookCounts counts_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::webhooks
