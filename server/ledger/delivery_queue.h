#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/job/ids.h"

namespace lumifold::ledger {

/// A message for a webhook that is to be delivered.
struct NewDelivery {
  std::string id;
  /// SCHEME://HOST:PORT of the URL.
  std::string origin;
  std::string url;
  std::string body;
  absl::Time created;
};

/// A message that is being delivered.
struct Delivery {
  int64_t number = 0;
  std::string id;
  job::JobId job;
  std::string url;
  std::string body;
  /// Tries, with this one.
  int tries = 0;
};

enum class DeliveryState { kWaiting = 0, kDelivered = 1, kGivenUp = 2 };

/// What is known of a delivery afterwards.
struct DeliveryReport {
  std::string id;
  job::JobId job;
  DeliveryState state = DeliveryState::kWaiting;
  int tries = 0;
  /// Of the last try that failed.
  std::string error;
};

/// Messages for webhooks, which JobStore::EndJob records with the end of a job. Coordinators that share the
/// database share the queue: whoever takes a message has it until a time, after which it is free again, so
/// that none is lost with its coordinator. A message may so be delivered more than once.
///
/// Errors of all calls: those of JobStore's storage. Every call can be repeated.
/// Threads: safe.
class DeliveryQueue {
 public:
  virtual ~DeliveryQueue() = default;

  /// Takes at most `max` messages of an origin that are due at `now`, those that wait longest first. They are
  /// due again at `until`.
  virtual absl::StatusOr<std::vector<Delivery>> Take(const std::string& origin, absl::Time now,
                                                     absl::Time until, int max) = 0;
  /// A try has failed; the message is due again at `due`. An empty `error` keeps the last one.
  virtual absl::Status PutOff(int64_t number, absl::Time due, const std::string& error) = 0;
  virtual absl::Status SetDelivered(int64_t number) = 0;
  /// Gives up the waiting messages that were created before a time, and returns them.
  virtual absl::StatusOr<std::vector<DeliveryReport>> GiveUp(absl::Time created_before) = 0;
  virtual absl::StatusOr<int64_t> CountWaiting() = 0;
  /// The last one of a job; nullopt: none.
  virtual absl::StatusOr<std::optional<DeliveryReport>> LastOf(const job::JobId& job) = 0;
};

}  // namespace lumifold::ledger
