#include "server/webhooks/webhooks.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "proto/logging/fields.h"
#include "proto/retry/pauses.h"
#include "proto/rpc/monotonic.h"
#include "server/webhooks/message.h"
#include "server/webhooks/secret.h"

namespace lumifold::webhooks {
namespace {

/// For a receiver that is away: soon after a restart of it, and no burden while it stays away.
constexpr retry::Pauses kPauses = {.first = absl::Seconds(1), .longest = absl::Minutes(15)};
/// After which a message is given up: a receiver that was down over a night still gets it.
constexpr absl::Duration kLifetime = absl::Hours(24);
/// Messages that wait; more are dropped. Each has one or two KiB.
constexpr int64_t kMaxWaiting = 10'000;
constexpr size_t kMaxInFlight = 16;
constexpr size_t kMaxInFlightOfOrigin = 4;
/// How long a message is the taker's: its request's time and the storage's.
constexpr absl::Duration kHold = absl::Seconds(30);
/// Between two looks into the queue: while something waits, and while nothing does. Other coordinators may
/// have left something there.
constexpr absl::Duration kLookInterval = absl::Seconds(1);
constexpr absl::Duration kIdleLookInterval = absl::Seconds(10);

}  // namespace

absl::Duration PauseAfter(int failures) { return kPauses.After(failures); }

absl::StatusOr<std::unique_ptr<Webhooks>> Webhooks::Open(const WebhookOptions& options,
                                                         Surroundings surroundings) {
  std::unique_ptr<Webhooks> webhooks(new Webhooks(std::move(surroundings)));
  absl::StatusOr<AllowedHosts> hosts = AllowedHosts::Parse(options.hosts);
  if (!hosts.ok()) return hosts.status();
  webhooks->hosts_ = *std::move(hosts);
  if (webhooks->hosts_.origins().empty()) return webhooks;
  absl::StatusOr<std::string> secret = options.secret_path.empty()
                                           ? ReadOrMakeSecret(webhooks->around_.secret_path)
                                           : ReadSecret(options.secret_path);
  if (!secret.ok()) return secret.status();
  webhooks->secret_ = *std::move(secret);
  absl::StatusOr<std::unique_ptr<Poster>> poster = Poster::Open(options.ca_path, RequestLimits());
  if (!poster.ok()) return poster.status();
  webhooks->poster_ = *std::move(poster);
  return webhooks;
}

Webhooks::~Webhooks() { Stop(); }

std::optional<ledger::NewDelivery> Webhooks::DeliveryOf(const v1::JobStatus& ended) {
  const std::string& url = ended.scheduling().webhook();
  if (url.empty()) return std::nullopt;
  const absl::StatusOr<Target> target = hosts_.Check(url);
  absl::Status status = target.status();
  {
    absl::MutexLock lock(&mutex_);
    if (status.ok() && counts_.waiting() >= kMaxWaiting)
      status = absl::ResourceExhaustedError(absl::StrCat(kMaxWaiting, " webhooks wait already"));
    if (!status.ok()) counts_.set_given_up(counts_.given_up() + 1);
  }
  if (!status.ok()) {
    around_.log->error("event=webhook_dropped job={} error={}", ended.job_id(),
                       logging::Quoted(status.message()));
    return std::nullopt;
  }
  const absl::Time now = around_.wall_now();
  std::string id = absl::StrFormat("%016x%016x", around_.random(), around_.random());
  std::string body = MessageOf(ended, id, now);
  return ledger::NewDelivery{.id = std::move(id),
                             .origin = target->origin,
                             .url = target->url,
                             .body = std::move(body),
                             .created = now};
}

void Webhooks::Wake() {
  if (poster_ == nullptr) return;
  {
    absl::MutexLock lock(&mutex_);
    is_woken_ = true;
    counts_.set_waiting(counts_.waiting() + 1);  // until the next look counts them
  }
  poster_->Wake();
}

absl::StatusOr<std::optional<v1::WebhookDelivery>> Webhooks::StatusOf(const std::string& job) const {
  const absl::StatusOr<std::optional<ledger::DeliveryReport>> last = around_.queue->LastOf(job::JobId(job));
  if (!last.ok()) return last.status();
  const std::optional<ledger::DeliveryReport>& report = *last;
  if (!report.has_value()) return std::nullopt;
  v1::WebhookDelivery delivery;
  delivery.set_delivery_id(report->id);
  delivery.set_tries(report->tries);
  delivery.set_error(report->error);
  switch (report->state) {
    case ledger::DeliveryState::kWaiting:
      delivery.set_state(v1::WebhookDelivery::STATE_WAITING);
      break;
    case ledger::DeliveryState::kDelivered:
      delivery.set_state(v1::WebhookDelivery::STATE_DELIVERED);
      break;
    case ledger::DeliveryState::kGivenUp:
      delivery.set_state(v1::WebhookDelivery::STATE_GIVEN_UP);
      break;
  }
  return delivery;
}

std::optional<v1::WebhookCounts> Webhooks::counts() const {
  if (poster_ == nullptr) return std::nullopt;
  absl::MutexLock lock(&mutex_);
  return counts_;
}

void Webhooks::Start() {
  if (poster_ != nullptr) thread_ = std::thread([this] { Run(); });
}

void Webhooks::Stop() {
  if (!thread_.joinable()) return;
  {
    absl::MutexLock lock(&mutex_);
    is_stopping_ = true;
  }
  poster_->Wake();
  thread_.join();
}

bool Webhooks::is_stopping() const {
  absl::MutexLock lock(&mutex_);
  return is_stopping_;
}

void Webhooks::Run() {
  absl::Time next_look = absl::InfinitePast();
  while (!is_stopping()) {
    bool is_due = rpc::MonotonicNow() >= next_look;
    {
      absl::MutexLock lock(&mutex_);
      is_due = std::exchange(is_woken_, false) || is_due;
    }
    if (is_due) next_look = rpc::MonotonicNow() + Look();
    const absl::Duration time = std::max(next_look - rpc::MonotonicNow(), absl::Milliseconds(1));
    const std::vector<PostOutcome> outcomes = poster_->Wait(time);
    for (const PostOutcome& outcome : outcomes) Record(outcome);
    if (!outcomes.empty()) next_look = absl::InfinitePast();  // places are free
  }
  // Free for the next start, or for another coordinator.
  for (const int64_t number : poster_->Abort())
    around_.queue->PutOff(number, around_.wall_now(), "").IgnoreError();
}

absl::Duration Webhooks::Look() {
  const absl::StatusOr<int64_t> waiting = around_.queue->CountWaiting();
  if (waiting.ok()) {
    absl::MutexLock lock(&mutex_);
    counts_.set_waiting(*waiting);
  }
  if (waiting.ok() && *waiting == 0) return kIdleLookInterval;
  GiveUpOld();
  const absl::Time now = around_.wall_now();
  for (const std::string& origin : hosts_.origins()) {
    const auto of_origin =
        static_cast<size_t>(std::count_if(in_flight_.begin(), in_flight_.end(),
                                          [&](const auto& entry) { return entry.second.origin == origin; }));
    const size_t free = std::min(kMaxInFlightOfOrigin - of_origin, kMaxInFlight - in_flight_.size());
    if (free == 0) continue;
    // An error of the storage is logged by those who cannot go on without it.
    const absl::StatusOr<std::vector<ledger::Delivery>> taken =
        around_.queue->Take(origin, now, now + kHold, static_cast<int>(free));
    if (!taken.ok()) break;
    for (const ledger::Delivery& delivery : *taken) Send(delivery, origin);
  }
  return kLookInterval;
}

void Webhooks::GiveUpOld() {
  const absl::StatusOr<std::vector<ledger::DeliveryReport>> given_up =
      around_.queue->GiveUp(around_.wall_now() - kLifetime);
  if (!given_up.ok()) return;
  for (const ledger::DeliveryReport& report : *given_up) {
    around_.log->error("event=webhook_given_up job={} delivery={} tries={} error={}", report.job.value(),
                       report.id, report.tries, logging::Quoted(report.error));
  }
  absl::MutexLock lock(&mutex_);
  counts_.set_given_up(counts_.given_up() + static_cast<int64_t>(given_up->size()));
}

void Webhooks::Send(const ledger::Delivery& delivery, const std::string& origin) {
  const int64_t timestamp = absl::ToUnixSeconds(around_.wall_now());
  in_flight_[delivery.number] = {delivery, origin};
  poster_->Start(
      {.number = delivery.number,
       .url = delivery.url,
       .body = delivery.body,
       .headers = {"Content-Type: application/json", absl::StrCat("X-Lumifold-Timestamp: ", timestamp),
                   absl::StrCat("X-Lumifold-Delivery: ", delivery.id),
                   absl::StrCat("X-Lumifold-Signature: ", SignatureOf(secret_, timestamp, delivery.body))}});
}

void Webhooks::Record(const PostOutcome& outcome) {
  const auto found = in_flight_.extract(outcome.number);
  const auto& [delivery, origin] = found.mapped();
  const bool is_delivered = outcome.status.ok();
  {
    absl::MutexLock lock(&mutex_);
    if (is_delivered) counts_.set_delivered(counts_.delivered() + 1);
    if (!is_delivered) counts_.set_failed(counts_.failed() + 1);
  }
  // Of a result that cannot be recorded the hold ends, and the message is sent again.
  if (is_delivered) {
    around_.queue->SetDelivered(delivery.number).IgnoreError();
    around_.log->info("event=webhook_delivered job={} delivery={} receiver={} tries={}", delivery.job.value(),
                      delivery.id, origin, delivery.tries);
    return;
  }
  const std::string error(outcome.status.message());
  const absl::Duration pause = PauseAfter(delivery.tries);
  around_.queue->PutOff(delivery.number, around_.wall_now() + pause, error).IgnoreError();
  around_.log->warn("event=webhook_failed job={} delivery={} receiver={} tries={} next_s={} error={}",
                    delivery.job.value(), delivery.id, origin, delivery.tries, absl::ToInt64Seconds(pause),
                    logging::Quoted(error));
}

}  // namespace lumifold::webhooks
