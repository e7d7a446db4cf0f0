#include "server/ledger/sql_deliveries.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::ledger {
namespace {

constexpr auto kWaiting = static_cast<int64_t>(DeliveryState::kWaiting);
constexpr auto kDelivered = static_cast<int64_t>(DeliveryState::kDelivered);
constexpr auto kGivenUp = static_cast<int64_t>(DeliveryState::kGivenUp);

DeliveryReport ReadReport(SqlRow& row) {
  DeliveryReport report;
  report.id = row.Text();
  report.job = job::JobId(row.Text());
  report.state = static_cast<DeliveryState>(row.Int());
  report.tries = static_cast<int>(row.Int());
  report.error = row.Text();
  return report;
}

}  // namespace

absl::Status InsertDelivery(SqlConnection& db, int64_t job, const NewDelivery& delivery) {
  const int64_t created_ms = absl::ToUnixMillis(delivery.created);
  return db.Run(
      "INSERT INTO deliveries(id, job, origin, url, body, created_ms, due_ms)"
      " VALUES($1, $2, $3, $4, $5, $6, $7)",
      {delivery.id, job, delivery.origin, delivery.url, SqlBytes{delivery.body}, created_ms, created_ms});
}

absl::StatusOr<std::vector<Delivery>> TakeDeliveries(SqlConnection& db, const std::string& origin,
                                                     absl::Time now, absl::Time until, int max) {
  std::vector<Delivery> taken;
  // The last condition is for a coordinator that has waited for another one to take the same rows.
  absl::Status status = db.Query(
      "UPDATE deliveries SET due_ms = $1, tries = tries + 1 WHERE number IN"
      " (SELECT number FROM deliveries WHERE state = $2 AND origin = $3 AND due_ms <= $4"
      "  ORDER BY due_ms, number LIMIT $5) AND state = $2 AND due_ms <= $4"
      " RETURNING number, id, (SELECT id FROM jobs WHERE jobs.number = deliveries.job), url, body, tries",
      {absl::ToUnixMillis(until), kWaiting, origin, absl::ToUnixMillis(now), int64_t{max}},
      [&taken](SqlRow& row) {
        Delivery& delivery = taken.emplace_back();
        delivery.number = row.Int();
        delivery.id = row.Text();
        delivery.job = job::JobId(row.Text());
        delivery.url = row.Text();
        delivery.body = row.Bytes();
        delivery.tries = static_cast<int>(row.Int());
      });
  if (!status.ok()) return status;
  std::sort(taken.begin(), taken.end(),
            [](const Delivery& a, const Delivery& b) { return a.number < b.number; });
  return taken;
}

absl::Status PutDeliveryOff(SqlConnection& db, int64_t number, absl::Time due, const std::string& error) {
  return db.Run(
      "UPDATE deliveries SET due_ms = $1, error = CASE WHEN $2 = '' THEN error ELSE $2 END"
      " WHERE number = $3 AND state = $4",
      {absl::ToUnixMillis(due), error, number, kWaiting});
}

absl::Status RecordDelivered(SqlConnection& db, int64_t number) {
  return db.Run("UPDATE deliveries SET state = $1, body = $2 WHERE number = $3",
                {kDelivered, SqlBytes{""}, number});
}

absl::StatusOr<std::vector<DeliveryReport>> GiveUpDeliveries(SqlConnection& db, absl::Time created_before) {
  std::vector<DeliveryReport> given_up;
  absl::Status status = db.Query(
      "UPDATE deliveries SET state = $1, body = $2 WHERE state = $3 AND created_ms < $4 RETURNING"
      " id, (SELECT id FROM jobs WHERE jobs.number = deliveries.job), state, tries, error",
      {kGivenUp, SqlBytes{""}, kWaiting, absl::ToUnixMillis(created_before)},
      [&given_up](SqlRow& row) { given_up.push_back(ReadReport(row)); });
  if (!status.ok()) return status;
  return given_up;
}

absl::StatusOr<int64_t> CountWaitingDeliveries(SqlConnection& db) {
  const absl::StatusOr<std::optional<int64_t>> count =
      db.QueryInt("SELECT COUNT(*) FROM deliveries WHERE state = $1", {kWaiting});
  if (!count.ok()) return count.status();
  return count->value_or(0);
}

absl::StatusOr<std::optional<DeliveryReport>> QueryLastDelivery(SqlConnection& db, const job::JobId& job) {
  std::optional<DeliveryReport> last;
  absl::Status status = db.Query(
      "SELECT deliveries.id, jobs.id, deliveries.state, tries, deliveries.error FROM deliveries"
      " JOIN jobs ON jobs.number = deliveries.job WHERE jobs.id = $1"
      " ORDER BY deliveries.number DESC LIMIT 1",
      {job.value()}, [&last](SqlRow& row) { last = ReadReport(row); });
  if (!status.ok()) return status;
  return last;
}

}  // namespace lumifold::ledger
