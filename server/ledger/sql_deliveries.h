#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/ledger/delivery_queue.h"
#include "server/ledger/sql_connection.h"

// The statements of a DeliveryQueue, without locks and transactions.

namespace lumifold::ledger {

/// `job`: the number of its row.
absl::Status InsertDelivery(SqlConnection& db, int64_t job, const NewDelivery& delivery);
/// DeliveryQueue::Take.
absl::StatusOr<std::vector<Delivery>> TakeDeliveries(SqlConnection& db, const std::string& origin,
                                                     absl::Time now, absl::Time until, int max);
/// DeliveryQueue::PutOff.
absl::Status PutDeliveryOff(SqlConnection& db, int64_t number, absl::Time due, const std::string& error);
/// DeliveryQueue::SetDelivered.
absl::Status RecordDelivered(SqlConnection& db, int64_t number);
/// DeliveryQueue::GiveUp.
absl::StatusOr<std::vector<DeliveryReport>> GiveUpDeliveries(SqlConnection& db, absl::Time created_before);
/// DeliveryQueue::CountWaiting.
absl::StatusOr<int64_t> CountWaitingDeliveries(SqlConnection& db);
/// DeliveryQueue::LastOf.
absl::StatusOr<std::optional<DeliveryReport>> QueryLastDelivery(SqlConnection& db, const job::JobId& job);

}  // namespace lumifold::ledger
